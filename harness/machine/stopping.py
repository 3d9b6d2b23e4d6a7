"""The end of a stopped command, and workers that end with it."""

import atexit
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from operator import call
from typing import TypeVar

from scenes.files.stopping import SIGNALS

ON = "resume with --resume --out"
Result = TypeVar("Result")


@contextmanager
def told_when_stopped(kept: Callable[[], str]) -> Iterator[None]:
    """Turn `KeyboardInterrupt` into a message on what is kept and how to resume."""
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(kept()) from None


def in_workers(calls: Sequence[Callable[[], Result]], workers: int) -> Iterator[Result]:
    """Yield the results of `calls` in order, from fresh single-threaded processes that end with this one. Raises the
    exception of a call, and `BrokenProcessPool` if its process dies.
    """
    from concurrent.futures import ProcessPoolExecutor

    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=spawn, initializer=_begin_worker) as pool:
        try:
            yield from pool.map(call, calls)
        except BaseException:
            # the pool would wait for their current calls
            for worker in multiprocessing.active_children():
                worker.kill()
                worker.join()
            raise


def in_child(function: Callable[..., Result], *given: object) -> Result:
    """Return `function(*given)`, called in a fresh single-threaded process."""
    (result,) = in_workers([partial(function, *given)], 1)
    return result


def _begin_worker() -> None:
    from harness.machine.device import keep_freed_memory, use_threads

    end_with_parent()
    use_threads(1)
    keep_freed_memory()
    # skip the interpreter's teardown, in which OpenImageIO's bindings print warnings
    atexit.register(os._exit, 0)


def end_with_parent() -> None:
    """End this worker as soon as its parent ends, as another process may then own the folder; ignore Ctrl-C."""
    from multiprocessing.connection import wait

    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    if sys.platform == "linux":
        import ctypes

        pr_set_pdeathsig = 1
        # the kernel then ends this process even if no Python runs; where that is refused, the watching thread does
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL, 0, 0, 0)
        if not parent.is_alive():  # it may have died before the call
            os._exit(1)
