"""Ctrl-C, and SIGTERM as clusters send it: the first stops cleanly within two seconds, the second at once."""

import multiprocessing
import os
import select
import signal
import threading
from contextlib import suppress
from pathlib import Path
from types import FrameType

IN_ORDER_SECONDS = 1.7
"""The time within which finished work is written; every file is written completely or stays as it was."""
STOPPED = 130
LATE = "what is finished is kept; give the command again, with --resume and --out where it has them"
SIGNALS = (signal.SIGINT, signal.SIGTERM)


def stop_on_signals() -> None:
    """Stop on signals from now on; a signal that is ignored, as in the background of a shell, stays ignored.

    The main thread handles a signal only between two steps of Python, which may be minutes apart while a library
    computes. The system writes the signal's number into a pipe at once: another thread keeps the two seconds.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _stop)
    threading.Thread(target=_end_late, args=(reading,), daemon=True).start()


def _stop(_number: int, _frame: FrameType | None) -> None:
    for number in SIGNALS:  # once: the second signal is handled by the other thread
        if signal.getsignal(number) is _stop:
            signal.signal(number, _nothing)
    raise KeyboardInterrupt


def _nothing(_number: int, _frame: FrameType | None) -> None:
    """Do nothing; the number of the signal still goes into the pipe."""


def _end_late(pipe: int) -> None:
    """End this process `IN_ORDER_SECONDS` after the first signal, or at the second."""
    while signal.getsignal(os.read(pipe, 1)[0]) not in (_stop, _nothing):
        pass  # a signal with another handler, such as a server's
    select.select([pipe], [], [], IN_ORDER_SECONDS)
    with suppress(OSError):
        os.write(2, f"interrupted: {LATE}\n".encode())
    # the renderer as well, if the system lists children; elsewhere it ends when its output is closed
    for worker in multiprocessing.active_children():
        worker.kill()
    for listing in Path("/proc/self/task").glob("*/children"):
        with suppress(OSError):
            for child in listing.read_text().split():
                os.kill(int(child), signal.SIGKILL)
    os._exit(STOPPED)
