"""Who may change a folder of the view cache, and the bytes in it, which those who do tell each other in a file.

Locks are the system's (`flock`): it releases them when their holder dies, by whatever signal.
"""

import errno
import fcntl
import os
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

LOCK_SECONDS = 5.0
"""After which a write gives up; the lock is held for milliseconds."""


@contextmanager
def locked(folder: Path, seconds: float | None = None) -> Iterator[int]:
    """The ledger of a folder, open and ours alone; raises `OSError` where somebody else does not let go of it within
    `seconds`, `LOCK_SECONDS` where that is None.
    """
    patience = LOCK_SECONDS if seconds is None else seconds
    handle = _opened(folder / "ledger")
    try:
        until = time.monotonic() + patience
        while True:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > until:
                    raise OSError(errno.EAGAIN, f"another process held it for {patience:g} s") from None
                time.sleep(0.001)
        yield handle
    finally:
        let_go(handle)


def _opened(ledger: Path) -> int:
    """Made where it is not there. Raises `OSError`, of a link in words that a user can follow."""
    try:
        return os.open(ledger, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o666)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise OSError(errno.ELOOP, f"{ledger.name} is a link; remove it") from error
        raise


def read_ledger(ledger: int) -> int | None:
    """None where the last one was killed, or nobody has counted yet."""
    line = os.pread(ledger, 32, 0)
    return int(line) if re.fullmatch(rb"[0-9]{1,30}\n", line) else None


def write_ledger(ledger: int, held: int) -> None:
    with suppress(OSError):  # on a full disk the next one counts for itself
        os.ftruncate(ledger, 0)
        os.pwrite(ledger, f"{max(held, 0)}\n".encode(), 0)


def is_abandoned(part: str) -> bool:
    """Whether the process that was writing it is no more."""
    handle = os.open(part, os.O_RDWR | os.O_CLOEXEC | os.O_NONBLOCK)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    finally:
        let_go(handle)
    return True


def let_go(handle: int) -> None:
    """Unlocked by name: a process that was forked meanwhile has the handle, too, and would keep the lock."""
    with suppress(OSError):
        fcntl.flock(handle, fcntl.LOCK_UN)
    os.close(handle)
