"""The end of a stopped command, and workers that end with it."""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from scenes.files.stopping import SIGNALS

ON = "go on with --resume --out"


@contextmanager
def told_when_stopped(kept: Callable[[], str]) -> Iterator[None]:
    """Turn `KeyboardInterrupt` into a message on what is kept and how to resume."""
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(kept()) from None


def end_workers() -> None:
    """End all children of `multiprocessing` at once: they may be in the middle of something long."""
    workers = multiprocessing.active_children()
    for worker in workers:
        worker.kill()
    for worker in workers:
        worker.join()


def end_with_parent() -> None:
    """End this worker with its parent: Ctrl-C is its parent's business, and without the parent it ends at once,
    whatever it is doing, as another process may have the folder by then.
    """
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
        _die_with_parent()
        if not parent.is_alive():  # before the kernel was asked
            os._exit(1)


def _die_with_parent() -> None:
    """Let the kernel end this process even if no Python runs; elsewhere, or if that is refused, the watching thread
    does.
    """
    import ctypes

    pr_set_pdeathsig = 1
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL, 0, 0, 0)
