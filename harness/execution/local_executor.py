"""Groups of cells on this machine: one worker process per core, each with its own threads."""

import dataclasses
import multiprocessing
import os
import signal
from collections.abc import Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any

from harness.execution.group import failed_cells, missing_methods, run_group
from harness.machine.cores import own_cores
from harness.machine.device import gpu_masks
from harness.machine.provenance import changed_since, versions
from harness.machine.stopping import end_with_parent
from harness.plan.group_task import GroupTask
from harness.records.cells import CellRecord


@dataclass(frozen=True)
class Event:
    """An event of a group: training advanced, a cell ended, or there is a note for the reader."""

    task: GroupTask
    share: float | None = None
    cell: CellRecord | None = None
    notice: str | None = None


@dataclass
class _Worker:
    process: BaseProcess
    connection: Connection
    number: int
    task: GroupTask | None = field(default=None)


@dataclass(frozen=True)
class _Driver:
    """The code of the process that starts the workers, with which cells are labelled."""

    versions: dict[str, str]
    origin: dict[str, Any]

    @classmethod
    def here(cls) -> "_Driver":
        from harness.machine.provenance import code_here

        return cls(versions(), code_here())


@dataclass(frozen=True)
class _Refusal:
    """A refusal to train anything at all."""

    reason: str


def run_locally(tasks: list[GroupTask], workers: int) -> Iterator[Event]:
    """Run all tasks, at most `workers` at a time, each on cores and a GPU of its own as far as there are as many.

    A worker that dies costs what it was in the middle of: the methods of its group are then trained one at a time, and
    one that ends its worker again is recorded as an error. A worker that finds other sources than this process
    was started with trains nothing: its group goes to another, or is recorded as an error if none is left.

    Raises the `OSError` of a worker that cannot write its records: no other could. Closing the generator (Ctrl-C)
    ends the workers at once; cells that they had finished are on disk.
    """
    context = multiprocessing.get_context("spawn")
    waiting = list(tasks)
    pool: list[_Worker] = []
    masks = gpu_masks(workers, tasks[0].device) if tasks else []
    driver = _Driver.here()
    refusal = ""

    def start() -> None:
        ours, theirs = context.Pipe()
        number = min(set(range(workers)) - {worker.number for worker in pool})
        process = context.Process(target=_work, args=(theirs, masks[number], tasks[0].threads, driver), daemon=True)
        process.start()
        theirs.close()
        pool.append(_Worker(process, ours, number))
        feed(pool[-1])

    def feed(worker: _Worker) -> None:
        worker.task = waiting.pop(0) if waiting else None
        try:
            worker.connection.send(worker.task)
        except OSError:  # it died after its last message: nothing of this task was begun
            if worker.task is not None:
                waiting.insert(0, worker.task)
            replace(worker)

    def drop(worker: _Worker) -> None:
        worker.process.join()
        worker.connection.close()
        pool.remove(worker)

    def replace(worker: _Worker) -> None:
        drop(worker)
        if waiting:
            start()

    try:
        for _ in range(min(workers, len(waiting))):
            start()
        while any(worker.task for worker in pool):
            for ready in wait([worker.connection for worker in pool if worker.task]):
                worker = next(candidate for candidate in pool if candidate.connection is ready)
                task = worker.task
                assert task is not None
                try:
                    message = worker.connection.recv()
                except (EOFError, OSError):  # the latter without a number if it died in the middle of a message
                    alone = [dataclasses.replace(task, methods=(name,)) for name in missing_methods(task)]
                    again = len(task.methods) > 1 and bool(alone)
                    if again:
                        waiting[:0] = alone
                    replace(worker)
                    reason = f"the worker process ended with {_ending(worker.process.exitcode)}"
                    if again:
                        each = f"{task.scene}, seed {task.seed}: {reason}; its methods are trained one at a time"
                        yield Event(task, notice=each)
                    else:
                        yield from _failed(task, reason)
                    continue
                if message is None:
                    feed(worker)
                    yield Event(task, share=1.0)
                elif isinstance(message, OSError):
                    raise message
                elif isinstance(message, _Refusal):
                    refusal = message.reason
                    waiting.insert(0, task)
                    drop(worker)  # it would refuse any other task as well
                elif isinstance(message, float):
                    yield Event(task, share=message)
                elif isinstance(message, str):
                    yield Event(task, notice=message)
                else:
                    yield Event(task, cell=message)
        for task in waiting:
            yield from _failed(task, refusal)
    finally:
        for worker in pool:
            worker.process.kill()
        for worker in pool:
            worker.process.join()


def _failed(task: GroupTask, reason: str) -> Iterator[Event]:
    for cell in failed_cells(task, reason):
        yield Event(task, cell=cell)
    yield Event(task, share=1.0)


def _ending(exit_code: int | None) -> str:
    if exit_code is not None and exit_code < 0:
        return f"signal {-exit_code} ({signal.Signals(-exit_code).name}); out of memory, perhaps"
    return f"exit code {exit_code}"


def _work(connection: Connection, gpu: dict[str, str], threads: int, driver: _Driver) -> None:
    """Work on cores and a GPU of its own; input and output are those of `_serve`."""
    end_with_parent()
    os.environ.update(gpu)
    if wrong := _other_code(driver.versions):
        connection.recv()
        connection.send(
            _Refusal(f"the sources changed while the run was going on ({wrong}); start it again with --resume")
        )
    else:
        from harness.machine.device import available_cores  # after the environment: torch asks for GPUs only once

        machine = available_cores()
        with own_cores(threads) as cores:
            _serve(connection, {**driver.origin, "cores": machine, "own_cores": cores})
    connection.close()
    # without the interpreter's teardown, in which OpenImageIO's bindings print warnings that no user asked for
    os._exit(0)


def _other_code(versions: dict[str, str]) -> str:
    """Describe how the code that this worker trains with differs from the driver's `versions`; empty if it does not."""
    if wrong := changed_since(versions):
        return wrong
    from harness.training import lockstep  # noqa: F401 -- all that trains, which may change while it is imported

    return changed_since(versions)


def _serve(connection: Connection, placed: dict[str, Any]) -> None:
    """Take tasks; send progress (float), finished cells, notices (str), None (task ended) and `OSError`
    (cannot write).
    """
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
        connection.send(None)
