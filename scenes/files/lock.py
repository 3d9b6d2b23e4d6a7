"""A lock on a file, which the system releases when its holder dies; containers that share the disk see it.

The file is opened here and its descriptor locked by `filelock`: no link is followed, a query creates no file, and it
takes 0.015 ms, not 0.12 ms as with `filelock.FileLock`. Locks belong to descriptors, so threads exclude each other.
"""

import errno
import os
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)
"""The error numbers of systems and file systems without locks."""
FLAGS = os.O_RDWR | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
"""Flags for opening: no link is followed, a pipe does not block."""
POLL_SECONDS = 0.1
NOTE_BYTES = 500
"""The number of bytes that are read of the holder's note."""


class LockTaken(BlockingIOError):
    def __init__(self, path: Path, note: bytes) -> None:
        super().__init__(errno.EAGAIN, "locked by another process", str(path))
        self.note = note


class Lock:
    """A lock that is held until `release` or the end of this process; not held if there are no locks."""

    def __init__(self, path: Path, handle: int | None) -> None:
        self.path = path
        self._handle = handle

    @property
    def is_held(self) -> bool:
        """False if the system or its file system has no locks."""
        return self._handle is not None

    @property
    def handle(self) -> int:
        """Return the locked file, open for reading and writing."""
        if self._handle is None:
            raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK), str(self.path))
        return self._handle

    def release(self, remove: bool = False) -> None:
        """Release the lock; `remove` removes the file first, while no other process can hold its lock."""
        if self._handle is None:
            return
        if remove:
            with suppress(OSError):
                self.path.unlink()
        _close(self._handle)
        self._handle = None


def acquire(path: Path) -> Lock:
    """Lock a file, created if it is missing. Raises `LockTaken` if it has another holder, and `OSError` if it cannot be
    opened: `ELOOP` for a symbolic or hard link or a device, which must not be written to.
    """
    while True:
        handle = os.open(path, FLAGS | os.O_CREAT, 0o644)
        held = False
        try:
            opened = os.fstat(handle)
            if not stat.S_ISREG(opened.st_mode) or opened.st_nlink > 1:
                raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
            free = _try(handle)
            if free is None:
                return Lock(path, None)
            if not free:
                raise LockTaken(path, os.pread(handle, NOTE_BYTES, 0))
            # its holder may have removed the file before it was locked here
            held = _identity(path) == (opened.st_dev, opened.st_ino)
            if held:
                return Lock(path, handle)
        finally:
            if not held:
                os.close(handle)


@contextmanager
def waited_for(path: Path) -> Iterator[None]:
    """Hold the lock of a file, after waiting for its holders, and remove the file at the end. Raises `OSError`."""
    while True:
        try:
            lock = acquire(path)
            break
        except LockTaken:
            time.sleep(POLL_SECONDS)
    try:
        yield
    finally:
        lock.release(remove=True)


def is_held(path: Path, create: bool = False) -> bool | None:
    """Return whether the lock is held; None if that cannot be known, such as without a file and `create`."""
    try:
        handle = os.open(path, FLAGS | (os.O_CREAT if create else 0), 0o644)
    except OSError:
        return None
    try:
        free = _try(handle)
    except OSError:
        free = None
    finally:
        _close(handle)
    return None if free is None else not free


def _try(handle: int) -> bool | None:
    """Lock an open file; False if another holder has the lock, None if there are no locks."""
    import filelock  # takes 0.05 s that a command without locks need not wait for

    try:
        return filelock.lock_descriptor(handle, blocking=False) if filelock.has_fcntl else None
    except OSError as error:
        if error.errno in NO_LOCKS:
            return None
        raise


def _close(handle: int) -> None:
    """Unlock first: a process forked meanwhile has the descriptor too, and would keep the lock."""
    import filelock

    with suppress(OSError):
        filelock.unlock_descriptor(handle)
    os.close(handle)


def _identity(path: Path) -> tuple[int, int] | None:
    try:
        status = os.stat(path)  # noqa: PTH116 - in half the time of a path's own method
    except FileNotFoundError:
        return None
    return status.st_dev, status.st_ino
