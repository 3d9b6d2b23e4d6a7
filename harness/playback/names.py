"""Names in the folder of the view cache: their meaning, and how they are taken and released."""

import hashlib
import os
import re
import shutil
import stat
import time
from collections.abc import Iterator
from pathlib import Path

from harness.playback.float_exr import Damaged

OBJECT = re.compile(r"([0-9a-f]{64})\.exr")
KEY = re.compile(r"[0-9a-f]{64}")
KEY_LINE = re.compile(rb"([0-9a-f]{64}) ([0-9a-f]{64})\n")
KEY_BYTES = 130


def name_of(key: str) -> str:
    """Return 64 hexadecimal digits, whatever the key: it may hold characters that no file name can."""
    return hashlib.sha256(key.encode("utf-8", "surrogatepass")).hexdigest()


def digest_named(key_file: Path) -> str | None:
    """Return the digest of the picture of a key; None if there is no such key. Raises `Damaged`, and `OSError`."""
    try:
        if not stat.S_ISREG(key_file.lstat().st_mode):
            raise Damaged("not a file")
        handle = os.open(key_file, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        return None
    try:
        line = KEY_LINE.fullmatch(os.read(handle, KEY_BYTES + 1))
    finally:
        os.close(handle)
    if line is None or line[1].decode() != key_file.name:
        raise Damaged("not the file of this key")
    return line[2].decode()


def leads_to(key_file: Path, digest: str) -> bool:
    """Return whether a key's file names this picture."""
    try:
        return digest_named(key_file) == digest
    except Damaged:
        return False


def entries(folder: Path, wanted: re.Pattern[str] | None = None) -> Iterator[os.DirEntry[str]]:
    """Yield files of a folder; with a pattern, those of its folders of two digits whose name begins with these and
    fits.
    """
    try:
        found = list(os.scandir(folder))
    except (FileNotFoundError, NotADirectoryError):
        return
    for entry in found:
        if wanted is None:
            yield entry
        elif len(entry.name) == 2 and not entry.is_symlink():
            inner = entries(Path(entry.path))
            yield from (one for one in inner if wanted.fullmatch(one.name) and one.name[:2] == entry.name)


def rename(part: Path, file: Path) -> None:
    drop_link(file.parent)
    if not file.parent.is_dir():  # as a rule it is, and `mkdir` takes longer to say so
        file.parent.mkdir(exist_ok=True)
    if file.is_dir() and not file.is_symlink():
        remove(file)
    part.replace(file)
    touch(file)


def drop_link(folder: Path) -> None:
    """Remove a link in the place of a folder of ours: its target is not ours to change."""
    if folder.is_symlink():
        folder.unlink()


def touch(file: Path) -> None:
    """Set the time by our clock: the system's own stamps are as coarse as its timer."""
    now = time.time_ns()
    os.utime(file, ns=(now, now))


def remove(file: Path) -> None:
    """Remove an entry of any kind; one that cannot be removed stays, and is found again later."""
    try:
        drop_link(file.parent)
        file.unlink(missing_ok=True)
    except OSError:
        if file.is_dir():
            shutil.rmtree(file, ignore_errors=True)


def size_of(file: Path) -> int:
    try:
        return file.lstat().st_size
    except OSError:
        return 0
