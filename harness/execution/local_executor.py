"""Executes groups of cells on this machine in worker processes, each with its own threads."""

import multiprocessing
import os
import signal
from collections.abc import Iterator
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from harness.execution.ground_truth import Arrival, Arriving
from harness.execution.group import run_group
from harness.execution.group_loop import Attempt, End, Event, News, run_at
from harness.machine.cores import own_cores
from harness.machine.device import available_cores, gpu_masks
from harness.machine.provenance import changed_since, code_here, versions
from harness.machine.stopping import end_with_parent
from harness.plan.group_task import GroupTask


@dataclass
class _Worker:
    process: BaseProcess
    connection: Connection
    number: int
    attempt: Attempt | None = None


def run_locally(tasks: list[GroupTask], workers: int, arriving: Arriving | None = None) -> Iterator[Event]:
    """Run all tasks and those that arrive, at most `workers` at a time, on separate cores and GPUs if there are enough.

    If a worker dies, the unfinished methods of its group are trained one at a time; one that ends its worker again is
    recorded as an error. A worker that finds changed sources refuses its group, which another takes, or is recorded as
    an error if none is left. Raises the `OSError` of a worker that cannot write its records.
    """
    return run_at(_Workers(workers, arriving), tasks) if tasks or arriving else iter(())


class _Workers:
    """The worker processes: a group is sent to an idle worker, or to a new one."""

    def __init__(self, workers: int, arriving: Arriving | None) -> None:
        self._workers, self._arriving, self.refusal = workers, arriving, ""
        self._seats = workers
        self._pool: list[_Worker] = []
        self._context = multiprocessing.get_context("spawn")
        self._driver = versions(), code_here()

    @property
    def room(self) -> int:
        return self._workers - (self._arriving.places if self._arriving else 0)

    @property
    def expecting(self) -> bool:
        return bool(self._arriving and self._arriving.places)

    def submit(self, attempt: Attempt, task: GroupTask) -> None:
        while True:
            worker = next((worker for worker in self._pool if worker.attempt is None), None) or self._start(task)
            try:
                worker.connection.send(task)
            except OSError:  # it died after its last message
                self._drop(worker)
            else:
                worker.attempt = attempt
                return

    def _start(self, task: GroupTask) -> _Worker:
        connection, workers_end = self._context.Pipe()
        masks = gpu_masks(self._seats, task.device)
        number = min(set(range(len(masks))) - {worker.number for worker in self._pool})
        arguments = workers_end, masks[number], task.threads, *self._driver
        process = self._context.Process(target=_work, args=arguments, daemon=True)
        process.start()
        workers_end.close()
        self._pool.append(_Worker(process, connection, number))
        return self._pool[-1]

    def _drop(self, worker: _Worker) -> None:
        worker.process.join()
        worker.connection.close()
        self._pool.remove(worker)

    def poll(self, running: list[Attempt]) -> Iterator[tuple[Attempt, News] | Arrival]:
        busy = {worker.connection: worker for worker in self._pool if worker.attempt}
        expected = [self._arriving.connection] if self._arriving and self.expecting else []
        for connection in wait([*busy, *expected]):
            if connection in expected and self._arriving:
                yield self._arriving.receive()
                continue
            worker = busy[connection]  # type: ignore[index]
            attempt = worker.attempt
            assert attempt is not None
            try:
                message = worker.connection.recv()
            except (EOFError, OSError):  # an incomplete message is an OSError without a number
                self._drop(worker)
                message = End(f"the worker process ended with {_ending(worker.process.exitcode)}")
            if isinstance(message, OSError):
                raise message
            if isinstance(message, End):
                worker.attempt = None
                if message.refused:  # it would refuse any task
                    self._drop(worker)
                    self._workers, self.refusal = self._workers - 1, message.lost or ""
            yield attempt, message

    def again(self, attempt: Attempt, lost: str, missing: tuple[str, ...]) -> tuple[list[Attempt], str]:
        task = attempt.task
        if len(task.methods) == 1:
            return [], lost
        single = [Attempt(replace(task, methods=(name,)), attempt.number + 1) for name in missing]
        return single, f"{task.scene}, seed {task.seed}: {lost}; its methods are trained one at a time"

    def cancel(self, running: list[Attempt]) -> None:
        if self._arriving:
            self._arriving.stop()
        for worker in self._pool:
            worker.process.kill()
        for worker in self._pool:
            worker.process.join()


def _ending(exit_code: int | None) -> str:
    if exit_code is not None and exit_code < 0:
        return f"signal {-exit_code} ({signal.Signals(-exit_code).name}); out of memory, perhaps"
    return f"exit code {exit_code}"


def _work(
    connection: Connection, gpu: dict[str, str], threads: int, known: dict[str, str], origin: dict[str, object]
) -> None:
    """Serve a driver of the `known` versions, on reserved cores and a GPU."""
    end_with_parent()
    os.environ.update(gpu)
    if wrong := _other_code(known):
        connection.recv()
        reason = f"the sources changed during the run ({wrong}); start it again with --resume"
        connection.send(End(reason, refused=True))
    else:
        machine = available_cores()
        with own_cores(threads) as cores:
            _serve(connection, {**origin, "cores": machine, "own_cores": cores})
    connection.close()
    # the interpreter's teardown would print warnings of OpenImageIO's bindings
    os._exit(0)


def _other_code(known: dict[str, str]) -> str:
    if wrong := changed_since(known):
        return wrong
    from harness.training import lockstep  # noqa: F401 -- the training code, which may change while it is imported

    return changed_since(known)


def _serve(connection: Connection, placed: dict[str, object]) -> None:
    """Receive tasks; send progress (float), finished cells, notices (str), `End` and `OSError` (cannot write)."""
    while (task := connection.recv()) is not None:
        last = 0.0

        def on_progress(share: float) -> None:
            nonlocal last
            if share - last >= 0.005:
                last = share
                connection.send(share)

        try:
            run_group(task, on_progress, connection.send, placed, connection.send)
        except OSError as error:
            connection.send(OSError(error.errno, error.strerror, error.filename))
            break
        connection.send(End())
