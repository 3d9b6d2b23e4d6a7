"""One process at a time writes into an output folder; files that outlive no command lie in a folder within it."""

import errno
import json
import os
import shutil
import socket
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from scenes.files.errors import InputError

LOCK_FILE = ".lock"
HOLDER_BYTES = 500
"""More is not read of what the holder says about itself."""
LEFT_SECONDS = 0.3
"""A holder that was killed has workers, which end by themselves within this."""
NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)
"""What file systems without locks answer."""


class LockedFolder:
    """Held until `release`, or until this process dies."""

    def __init__(self, path: Path, file: int | None) -> None:
        self._path = path
        self._file = file

    @property
    def is_held(self) -> bool:
        """False where the file system has no locks."""
        return self._file is not None

    def release(self) -> None:
        if self._file is not None:
            # while it is still held: nobody else can have made it theirs
            with suppress(OSError):
                self._path.unlink()
            os.close(self._file)
            self._file = None


@contextmanager
def locked_folder(out: Path, option: str = "--out") -> Iterator[LockedFolder]:
    """Holds the lock of a folder, which is made where it is not there; one that was made and stays empty is removed.

    Raises `InputError`, naming the `option` it is the value of, where another process has it, naming that, and where
    the folder cannot be written.
    """
    fresh = False
    with suppress(OSError):  # a name that cannot be is refused below
        fresh = not out.exists()
    lock = lock_folder(out, option)
    try:
        yield lock
    finally:
        lock.release()
        if fresh:
            with suppress(OSError):
                out.rmdir()


def lock_folder(out: Path, option: str = "--out") -> LockedFolder:
    """Errors as in `locked_folder`."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise InputError(f"{option} {out}: is a file; name a folder") from None
    except OSError as error:
        raise InputError(f"{option} {out}: cannot be written ({error.strerror}); name another folder") from error
    path = out / LOCK_FILE
    try:
        import fcntl
    except ImportError:  # not a system of the Unix kind
        return LockedFolder(path, None)
    while True:
        try:
            file = _opened(path, os.O_CREAT)
        except OSError as error:
            if error.errno == errno.ELOOP:
                raise InputError(f"{path}: is no plain file of this folder alone; remove it") from error
            raise InputError(f"{path}: cannot be written ({error.strerror}); name another folder") from error
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            holder = _holder(file)
            os.close(file)
            if error.errno in NO_LOCKS:
                return LockedFolder(path, None)
            raise InputError(
                f"{option} {out}: in use by {holder}; let that end first, or name another folder"
            ) from error
        if not _is_still(path, file):  # its holder removed it between our opening and our locking
            os.close(file)
            continue
        if os.fstat(file).st_size:
            time.sleep(LEFT_SECONDS)
        said = json.dumps({"process": os.getpid(), "host": socket.gethostname()}).encode()
        with suppress(OSError):  # on a full disk it holds all the same
            os.ftruncate(file, 0)
            os.pwrite(file, said, 0)
        return LockedFolder(path, file)


def is_locked(out: Path) -> bool:
    """Whether a process writes into the folder just now; False where that cannot be known."""
    try:
        import fcntl

        file = _opened(out / LOCK_FILE, 0)
    except (ImportError, OSError):
        return False
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno not in NO_LOCKS
    finally:
        os.close(file)
    return False


def is_abandoned(folder: Path) -> bool:
    """Whether it is certain that no process holds the folder's lock; False where the file system has no locks."""
    try:
        import fcntl

        file = _opened(folder / LOCK_FILE, os.O_CREAT)
    except (ImportError, OSError):
        return False
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    finally:
        os.close(file)
    return True


def _opened(path: Path, flags: int) -> int:
    """Raises `OSError`, `ELOOP` for a link of either kind or a device: what it leads to is not ours to write."""
    file = os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW | flags, 0o644)
    found = os.fstat(file)
    if stat.S_ISREG(found.st_mode) and found.st_nlink <= 1:  # none where its holder has just removed it
        return file
    os.close(file)
    raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))


def _is_still(path: Path, file: int) -> bool:
    try:
        there, ours = path.stat(), os.fstat(file)
    except OSError:
        return False
    return (there.st_dev, there.st_ino) == (ours.st_dev, ours.st_ino)


def _holder(file: int) -> str:
    try:
        said = json.loads(os.pread(file, HOLDER_BYTES, 0))
        return f"process {int(said['process'])} on {str(said['host'])[:100]!r}"
    except (OSError, ValueError, TypeError, KeyError):
        return "another process"


PREFIX = ".scratch-"


@contextmanager
def scratch_folder(out: Path) -> Iterator[Path]:
    """Makes a folder within `out` and removes it at the end. Raises `OSError` where `out` cannot be written."""
    folder = Path(tempfile.mkdtemp(prefix=PREFIX, dir=out))
    try:
        lock = lock_folder(folder)
        try:
            yield folder
        finally:
            lock.release()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def remove_abandoned(out: Path) -> int:
    """Removes the scratch folders whose owners were killed; how many."""
    found = [folder for folder in out.glob(f"{PREFIX}*") if folder.is_dir() and is_abandoned(folder)]
    for folder in found:
        shutil.rmtree(folder, ignore_errors=True)
    return len(found)
