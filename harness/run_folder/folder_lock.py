"""A lock for output folders, so that one process at a time writes into one, and scratch folders within them."""

import errno
import json
import os
import shutil
import socket
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from scenes.files.errors import InputError
from scenes.files.lock import Lock, LockTaken, acquire, is_held

LOCK_FILE = ".lock"
LEFT_SECONDS = 0.3
"""The seconds within which the workers of a killed holder end by themselves."""


@contextmanager
def locked_folder(out: Path, option: str = "--out") -> Iterator[Lock]:
    """Hold the lock of a folder, which is created if missing, and then removed if it stays empty. Raises `InputError`
    with the `option` if another process, which is named, holds the lock, or if the folder cannot be written.
    """
    fresh = False
    with suppress(OSError):  # `lock_folder` refuses an impossible name
        fresh = not out.exists()
    lock = lock_folder(out, option)
    try:
        yield lock
    finally:
        lock.release(remove=True)
        if fresh:
            with suppress(OSError):
                out.rmdir()


def lock_folder(out: Path, option: str = "--out") -> Lock:
    """Lock a folder; raises errors as `locked_folder`."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise InputError(f"{option} {out}: is a file; name a folder") from None
    except OSError as error:
        raise InputError(f"{option} {out}: cannot be written ({error.strerror}); name another folder") from error
    path = out / LOCK_FILE
    try:
        lock = acquire(path)
    except LockTaken as error:
        raise InputError(
            f"{option} {out}: in use by {_holder(error.note)}; let that end first, or name another folder"
        ) from error
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise InputError(f"{path}: is a link or a device; remove it") from error
        raise InputError(f"{path}: cannot be written ({error.strerror}); name another folder") from error
    if lock.is_held:
        if os.fstat(lock.handle).st_size:
            time.sleep(LEFT_SECONDS)
        note = json.dumps({"process": os.getpid(), "host": socket.gethostname()}).encode()
        with suppress(OSError):  # on a full disk the lock holds without the note
            os.ftruncate(lock.handle, 0)
            os.pwrite(lock.handle, note, 0)
    return lock


def _holder(note: bytes) -> str:
    try:
        holder = json.loads(note)
        return f"process {int(holder['process'])} on {str(holder['host'])[:100]!r}"
    except (ValueError, TypeError, KeyError, OverflowError):
        return "another process"


PREFIX = ".scratch-"


@contextmanager
def scratch_folder(out: Path) -> Iterator[Path]:
    """Make a folder within `out`, and remove it at the end. Raises `OSError` if `out` cannot be written."""
    folder = Path(tempfile.mkdtemp(prefix=PREFIX, dir=out))
    try:
        with locked_folder(folder):
            yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def remove_abandoned(out: Path) -> int:
    """Remove the scratch folders whose owners were killed; returns their number."""
    folders = [folder for folder in out.glob(f"{PREFIX}*") if folder.is_dir()]
    abandoned = [folder for folder in folders if is_held(folder / LOCK_FILE, create=True) is False]
    for folder in abandoned:
        shutil.rmtree(folder, ignore_errors=True)
    return len(abandoned)
