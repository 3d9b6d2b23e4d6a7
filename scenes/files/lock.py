"""A lock on a file, which the system lets go of when its holder dies; containers that share the disk see it.

The file is opened here and its descriptor locked by `filelock`: no link is followed, who only asks makes no file, and
it takes 0.015 ms, where a `filelock.FileLock` takes 0.12. Every descriptor has a lock of its own, threads included.
"""

import errno
import os
import stat
import time
from contextlib import suppress
from functools import cache
from pathlib import Path
from types import ModuleType

NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)
"""What systems and file systems without locks answer."""
FLAGS = os.O_RDWR | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
"""A pipe is not waited for."""
POLL_SECONDS = 0.001
NOTE_BYTES = 500
"""More is not read of what the holder says about itself."""


class LockTaken(BlockingIOError):
    """Another holder does not let go of the lock."""

    def __init__(self, path: Path, note: bytes) -> None:
        super().__init__(errno.EAGAIN, "locked by another process", str(path))
        self.note = note
        """What its holder wrote into the file."""


class Lock:
    """It is held until `release`, or until this process dies; never where there are no locks."""

    def __init__(self, path: Path, handle: int | None) -> None:
        self.path = path
        self._handle = handle

    @property
    def is_held(self) -> bool:
        """False where the system or its file system has no locks."""
        return self._handle is not None

    @property
    def handle(self) -> int:
        """The locked file, open for reading and writing."""
        if self._handle is None:
            raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK), str(self.path))
        return self._handle

    def release(self, remove: bool = False) -> None:
        """Lets go; removes the file first on request, while nobody else can have made it theirs."""
        if self._handle is None:
            return
        if remove:
            with suppress(OSError):
                self.path.unlink()
        _close(self._handle)
        self._handle = None


def acquire(path: Path, seconds: float = 0.0, mode: int = 0o644) -> Lock:
    """Locks a file, made where it is not there. Raises `LockTaken` where another still has it after `seconds`, and
    `OSError` where it cannot be opened: `ELOOP` for a link of either kind or a device, which is not ours to write.
    """
    until = time.monotonic() + seconds
    while True:
        handle = _opened(path, os.O_CREAT, mode)
        held = False
        try:
            found = os.fstat(handle)
            if not stat.S_ISREG(found.st_mode) or found.st_nlink > 1:
                raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
            free = _try(handle)
            if free is None:
                return Lock(path, None)
            held = free and _is_still(path, found)
            if held:
                return Lock(path, handle)
            if not free and time.monotonic() >= until:
                raise LockTaken(path, os.pread(handle, NOTE_BYTES, 0))
        finally:
            if not held:
                os.close(handle)
        if not free:
            time.sleep(POLL_SECONDS)


def is_held(path: Path, create: bool = False) -> bool | None:
    """Whether anybody has the lock; None where that cannot be known, be it that there is no such file and none is to be
    made.
    """
    try:
        handle = _opened(path, os.O_CREAT if create else 0)
    except OSError:
        return None
    try:
        free = _try(handle)
    except OSError:
        free = None
    finally:
        _close(handle)
    return None if free is None else not free


def _opened(path: Path, flags: int, mode: int = 0o644) -> int:
    return os.open(path, FLAGS | flags, mode)


def _try(handle: int) -> bool | None:
    """Locks an open file: False where another has it, None where there are no locks."""
    try:
        library = _library()
        return library.lock_descriptor(handle, blocking=False) if library.has_fcntl else None
    except OSError as error:
        if error.errno in NO_LOCKS:
            return None
        raise


def _close(handle: int) -> None:
    """Unlocks first: a process that was forked meanwhile has the descriptor, too, and would keep the lock."""
    with suppress(OSError):
        _library().unlock_descriptor(handle)
    os.close(handle)


@cache
def _library() -> ModuleType:
    """Takes 0.05 s, for which a command that locks nothing need not wait."""
    import filelock

    return filelock


def _is_still(path: Path, ours: os.stat_result) -> bool:
    """Whether the file that was opened has its name yet: its holder may have removed it before it was locked."""
    try:
        there = os.stat(path)  # noqa: PTH116 - in half the time of a path's own method
    except FileNotFoundError:
        return False
    return (there.st_dev, there.st_ino) == (ours.st_dev, ours.st_ino)
