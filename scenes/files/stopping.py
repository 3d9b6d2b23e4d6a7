"""Ctrl-C, and SIGTERM as clusters send it: the first stops in good order, within two seconds; the second at once."""

import multiprocessing
import os
import select
import signal
import threading
from contextlib import suppress
from pathlib import Path
from types import FrameType

IN_ORDER_SECONDS = 1.7
"""The time by which finished work is written: every file is written completely or stays as it was."""
STOPPED = 130
"""The exit code."""
LATE = "what is finished is kept; give the command again, with --resume and --out where it has them"
"""The default message."""
SIGNALS = (signal.SIGINT, signal.SIGTERM)


def stop_on_signals() -> None:
    """Stop on signals from now on; a signal that is ignored, as in the background of a shell, stays so.

    The main thread hears of a signal only between two steps of Python, which may be minutes apart where a library is
    at work. The system writes the signal's number into a pipe at once: another thread sees to the two seconds.
    """
    ours, theirs = os.pipe()
    os.set_blocking(theirs, False)
    signal.set_wakeup_fd(theirs, warn_on_full_buffer=False)
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _stop)
    threading.Thread(target=_end_late, args=(ours,), daemon=True).start()


def _stop(_number: int, _frame: FrameType | None) -> None:
    for number in SIGNALS:  # once: the second is the other thread's
        if signal.getsignal(number) is _stop:
            signal.signal(number, _nothing)
    raise KeyboardInterrupt


def _nothing(_number: int, _frame: FrameType | None) -> None:
    """Do nothing: the number of the signal then still goes into the pipe."""


def _end_late(asked: int) -> None:
    """End this process `IN_ORDER_SECONDS` after the first signal, or at the second."""
    while signal.getsignal(os.read(asked, 1)[0]) not in (_stop, _nothing):
        pass  # somebody else's, such as a server's
    select.select([asked], [], [], IN_ORDER_SECONDS)
    with suppress(OSError):
        os.write(2, f"interrupted: {LATE}\n".encode())
    # the renderer as well, if the system says who the children are; elsewhere it ends when nobody listens
    for worker in multiprocessing.active_children():
        worker.kill()
    for listing in Path("/proc/self/task").glob("*/children"):
        with suppress(OSError):
            for child in listing.read_text().split():
                os.kill(int(child), signal.SIGKILL)
    os._exit(STOPPED)
