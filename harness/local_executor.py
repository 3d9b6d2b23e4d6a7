"""Groups of cells on this machine: one worker process a core, each with its own threads."""

import multiprocessing
import os
import signal
from collections.abc import Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from harness.group import GroupTask, failed_cells, run_group
from harness.records import CellRecord


@dataclass(frozen=True)
class Event:
    """Something that happened in a group: training went on, or a cell ended."""

    task: GroupTask
    share: float | None = None
    cell: CellRecord | None = None


@dataclass
class _Worker:
    process: BaseProcess
    connection: Connection
    task: GroupTask | None = field(default=None)


def run_locally(tasks: list[GroupTask], workers: int) -> Iterator[Event]:
    """Run all tasks, at most `workers` at a time. A worker that dies costs its group, which is recorded as an error.

    Raises the `OSError` of a worker that cannot write its records: no other could. Closing the generator (Ctrl-C)
    ends the workers at once; what they had finished is on disk.
    """
    context = multiprocessing.get_context("spawn")
    waiting = list(tasks)
    pool: list[_Worker] = []

    def start() -> _Worker:
        ours, theirs = context.Pipe()
        process = context.Process(target=_work, args=(theirs,), daemon=True)
        process.start()
        theirs.close()
        return _Worker(process, ours)

    def feed(worker: _Worker) -> None:
        worker.task = waiting.pop(0) if waiting else None
        worker.connection.send(worker.task)

    try:
        for _ in range(min(workers, len(waiting))):
            pool.append(start())
            feed(pool[-1])
        while any(worker.task for worker in pool):
            for ready in wait([worker.connection for worker in pool if worker.task]):
                worker = next(one for one in pool if one.connection is ready)
                task = worker.task
                assert task is not None
                try:
                    message = worker.connection.recv()
                except (EOFError, ConnectionError):
                    worker.process.join()
                    pool.remove(worker)
                    for cell in failed_cells(task, f"the worker process ended with {_ending(worker.process.exitcode)}"):
                        yield Event(task, cell=cell)
                    yield Event(task, share=1.0)
                    if waiting:
                        pool.append(start())
                        feed(pool[-1])
                    continue
                if message is None:
                    feed(worker)
                    yield Event(task, share=1.0)
                elif isinstance(message, OSError):
                    raise message
                elif isinstance(message, float):
                    yield Event(task, share=message)
                else:
                    yield Event(task, cell=message)
    finally:
        for worker in pool:
            worker.process.terminate()
        for worker in pool:
            worker.process.join()


def _ending(exit_code: int | None) -> str:
    if exit_code is not None and exit_code < 0:
        return f"signal {-exit_code} ({signal.Signals(-exit_code).name}); out of memory, perhaps"
    return f"exit code {exit_code}"


def _work(connection: Connection) -> None:
    """Tasks in; progress (float), finished cells, None (task ended) and an `OSError` (cannot write) out."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's business
    while (task := connection.recv()) is not None:
        last = 0.0

        def on_progress(share: float) -> None:
            nonlocal last
            if share - last >= 0.005:
                last = share
                connection.send(share)

        try:
            run_group(task, on_progress, connection.send)
        except OSError as error:
            connection.send(OSError(error.errno, error.strerror, error.filename))
            break
        connection.send(None)
    connection.close()
    # without the interpreter's teardown, in which OpenImageIO's bindings print warnings that no user asked for
    os._exit(0)
