"""Groups of cells on this machine: one worker process per core, each with its own threads."""

import multiprocessing
import os
import signal
from collections.abc import Iterator
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from harness.execution.group import run_group
from harness.execution.group_loop import Attempt, End, Event, News, run_at
from harness.machine.cores import own_cores
from harness.machine.device import gpu_masks
from harness.machine.provenance import changed_since, code_here, versions
from harness.machine.stopping import end_with_parent
from harness.plan.group_task import GroupTask


@dataclass(frozen=True)
class _Refusal:
    reason: str


@dataclass
class _Worker:
    process: BaseProcess
    connection: Connection
    number: int
    attempt: Attempt | None = None


def run_locally(tasks: list[GroupTask], workers: int) -> Iterator[Event]:
    """Run all tasks, at most `workers` at a time, each on cores and a GPU of its own as far as there are as many.

    A worker that dies costs what it was in the middle of: the methods of its group are then trained one at a time, and
    one that ends its worker again is recorded as an error. A worker that finds other sources than this process
    was started with trains nothing: its group goes to another, or is recorded as an error if none is left.

    Raises the `OSError` of a worker that cannot write its records: no other could. Closing the generator (Ctrl-C)
    ends the workers at once; cells that they had finished are on disk.
    """
    return run_at(_Workers(tasks[0], workers), tasks) if tasks else iter(())


class _Workers:
    """The worker processes: a group is sent to one that is idle, or to a new one."""

    def __init__(self, first: GroupTask, workers: int) -> None:
        self.room, self.refusal = workers, ""
        self._pool: list[_Worker] = []
        self._context = multiprocessing.get_context("spawn")
        self._masks, self._threads = gpu_masks(workers, first.device), first.threads
        self._driver = versions(), code_here()

    def submit(self, attempt: Attempt, task: GroupTask) -> None:
        while True:
            worker = next((worker for worker in self._pool if worker.attempt is None), None) or self._start()
            try:
                worker.connection.send(task)
            except OSError:  # it died after its last message
                self._drop(worker)
            else:
                worker.attempt = attempt
                return

    def _start(self) -> _Worker:
        ours, theirs = self._context.Pipe()
        number = min(set(range(len(self._masks))) - {worker.number for worker in self._pool})
        given = theirs, self._masks[number], self._threads, *self._driver
        process = self._context.Process(target=_work, args=given, daemon=True)
        process.start()
        theirs.close()
        self._pool.append(_Worker(process, ours, number))
        return self._pool[-1]

    def _drop(self, worker: _Worker) -> None:
        worker.process.join()
        worker.connection.close()
        self._pool.remove(worker)

    def poll(self, running: list[Attempt]) -> Iterator[tuple[Attempt, News]]:
        busy = {worker.connection: worker for worker in self._pool if worker.attempt}
        for connection in wait(list(busy)):
            worker = busy[connection]  # type: ignore[index]
            attempt = worker.attempt
            assert attempt is not None
            try:
                message = worker.connection.recv()
            except (EOFError, OSError):  # the latter without a number if it died in the middle of a message
                self._drop(worker)
                message = End(f"the worker process ended with {_ending(worker.process.exitcode)}")
            if isinstance(message, OSError):
                raise message
            if isinstance(message, _Refusal):  # it would refuse any other task as well
                self._drop(worker)
                self.room, self.refusal, message = self.room - 1, message.reason, End(refused=True)
            if isinstance(message, End):
                worker.attempt = None
            yield attempt, message

    def again(self, attempt: Attempt, lost: str, missing: tuple[str, ...]) -> tuple[list[Attempt], str]:
        task = attempt.task
        if len(task.methods) == 1:
            return [], lost
        alone = [Attempt(replace(task, methods=(name,)), attempt.number + 1) for name in missing]
        return alone, f"{task.scene}, seed {task.seed}: {lost}; its methods are trained one at a time"

    def cancel(self, running: list[Attempt]) -> None:
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
    """Serve a driver of the `known` versions on cores and a GPU of its own."""
    end_with_parent()
    os.environ.update(gpu)
    if wrong := _other_code(known):
        connection.recv()
        connection.send(
            _Refusal(f"the sources changed while the run was going on ({wrong}); start it again with --resume")
        )
    else:
        from harness.machine.device import available_cores  # after the environment: torch asks for GPUs only once

        machine = available_cores()
        with own_cores(threads) as cores:
            _serve(connection, {**origin, "cores": machine, "own_cores": cores})
    connection.close()
    # without the interpreter's teardown, in which OpenImageIO's bindings print warnings that no user asked for
    os._exit(0)


def _other_code(known: dict[str, str]) -> str:
    if wrong := changed_since(known):
        return wrong
    from harness.training import lockstep  # noqa: F401 -- all that trains, which may change while it is imported

    return changed_since(known)


def _serve(connection: Connection, placed: dict[str, object]) -> None:
    """Take tasks; send progress (float), finished cells, notices (str), `End` and `OSError` (cannot write)."""
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
