"""Pictures on disk, level 2: content-addressed float EXR files, bounded in bytes, checked whenever they are read.

    objects/ab/<digest of shape and pixels>.exr     pictures
    keys/cd/<digest of the key>                     one line: the same digest, and that of its picture
    parts/                                          what is being written
    ledger                                          bytes of all pictures and keys; empty while they change

A name is taken by renaming a file that is whole, so that a process may be killed at any time. Several processes and
threads may have the folder: names and the ledger change under a lock that the system releases when its holder dies;
reading needs none, as a file that goes meanwhile is a miss. A picture is taken for what a key asks for only if the
key's file names that key and the pixels have the digest that it names. Nothing is unpickled.
"""

import errno
import fcntl
import hashlib
import os
import re
import secrets
import shutil
import stat
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from harness.view_cache.float_exr import Damaged, read_exr, write_exr
from harness.view_cache.ledger import is_abandoned, let_go, locked, read_ledger, write_ledger
from harness.view_cache.pictures import digest_of
from scenes.errors import InputError

FILLED_AGAIN = 0.9
"""Share of the bound down to which pictures go once it is reached: not every write has to look at every file."""
OBJECT = re.compile(r"([0-9a-f]{64})\.exr")
KEY = re.compile(r"[0-9a-f]{64}")
KEY_LINE = re.compile(rb"([0-9a-f]{64}) ([0-9a-f]{64})\n")
KEY_BYTES = 130


@dataclass
class DiskCounts:
    """What happened to files since the folder was opened here."""

    evicted: int = 0
    """Pictures that made room."""
    damaged: int = 0
    """Pictures and keys that were not what had been written; each was dropped."""
    dangling: int = 0
    """Keys whose picture was gone; each was dropped."""
    leftovers: int = 0
    """Files of writers that were killed; each was removed."""
    unreadable: int = 0
    """Reads that the system refused."""
    failed: int = 0
    """Writes that did not come to their end."""
    reason: str | None = None
    """Of the last of them."""
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False)

    def add(self, what: str) -> None:
        with self._lock:
            setattr(self, what, getattr(self, what) + 1)

    def fail(self, reason: str) -> None:
        with self._lock:
            self.failed += 1
            self.reason = reason[:300]


@dataclass(frozen=True)
class _Found:
    """All that is in the folder."""

    pictures: dict[str, tuple[int, int]]
    """Digest → last use in nanoseconds, bytes."""
    keys: dict[str, list[Path]]
    """Digest → files of the keys that name it."""

    @property
    def bytes(self) -> int:
        return sum(size for _, size in self.pictures.values()) + KEY_BYTES * sum(map(len, self.keys.values()))


class DiskPictures:
    """A folder of at most `bound` bytes, besides what is being written at the moment.

    Raises `InputError`, naming the folder, where nothing can be put there.
    """

    def __init__(self, folder: Path, bound: int) -> None:
        self.folder = folder
        self.bound = bound
        self.counts = DiskCounts()
        self._objects, self._keys, self._parts = (folder / name for name in ("objects", "keys", "parts"))
        try:
            self._make_folders()
            with self._part() as probe:
                probe.write_bytes(b"")
            with locked(self.folder) as ledger:
                write_ledger(ledger, self._made_room(0))
        except OSError as error:
            raise InputError(
                f"{folder}: views cannot be kept there ({error.strerror or error}); give a folder that can be written"
            ) from error

    def put(self, key: str, picture: np.ndarray) -> bool:
        """Keeps a picture (of `pictures.frozen`). False where that failed, which is counted and not raised."""
        digest, name = digest_of(picture), name_of(key)
        try:
            try:
                self._put(name, digest, picture)
            except FileNotFoundError:  # somebody removed the folder meanwhile
                self._make_folders()
                self._put(name, digest, picture)
        except OSError as error:
            self.counts.fail(error.strerror or str(error))
            return False
        return True

    def get(self, key: str, use: bool = True) -> np.ndarray | None:
        """The picture, read-only and checked; None where there is none, or none that is whole, and what is not whole is
        dropped. Not raised either is what the system refuses. `use` makes it the most recently used.
        """
        name = name_of(key)
        key_file = self._key(name)
        try:
            digest = _digest_named(key_file, name)
            if digest is None:
                return None
            file = self._object(digest)
            try:
                picture = read_exr(file)
                if digest_of(picture) != digest:
                    raise Damaged("other pixels")
            except Damaged:
                _remove(file)
                raise
            except FileNotFoundError:
                _remove(key_file)
                self.counts.add("dangling")
                return None
        except Damaged:
            _remove(key_file)
            self.counts.add("damaged")
            return None
        except (OSError, MemoryError):
            self.counts.add("unreadable")
            return None
        if use:
            with suppress(OSError):  # a folder that can only be read
                _touch(file)
        return picture

    def bytes(self) -> int:
        """Of the pictures and keys that are there now."""
        folders = (self._objects, OBJECT), (self._keys, KEY)
        return sum(_size(Path(entry.path)) for folder, name in folders for entry in _entries(folder, name))

    def _put(self, name: str, digest: str, picture: np.ndarray) -> None:
        """Raises `OSError`; no name is then taken by anything that is not whole."""
        with self._part() as new_picture, self._part() as new_key:
            write_exr(new_picture, picture)
            new_key.write_bytes(f"{name} {digest}\n".encode())
            added = new_picture.stat().st_size + KEY_BYTES
            if added > self.bound:
                raise OSError(errno.EFBIG, f"a picture of {added} bytes in a cache of {self.bound}")
            with locked(self.folder) as ledger:
                held = read_ledger(ledger)
                os.ftruncate(ledger, 0)  # if we are killed from here on, the next one counts for itself
                if held is None or held + added > self.bound:
                    held = self._made_room(added)
                file, key_file = self._object(digest), self._key(name)
                held -= _size(file) + _size(key_file)
                _rename(new_picture, file)
                _rename(new_key, key_file)
                write_ledger(ledger, held + added)

    def _made_room(self, added: int) -> int:
        """Bytes held once as many pictures have gone as `added` more bytes need; under the lock."""
        found = self._swept()
        held = found.bytes
        if held + added <= self.bound:
            return held
        for digest, (_, size) in sorted(found.pictures.items(), key=lambda one: one[1]):
            if held + added <= FILLED_AGAIN * self.bound:
                break
            for key_file in found.keys[digest]:
                _remove(key_file)
            _remove(self._object(digest))
            self.counts.add("evicted")
            held -= size + KEY_BYTES * len(found.keys[digest])
        return held

    def _swept(self) -> _Found:
        """What is there, once all that no key leads to and all that leads nowhere is gone; under the lock."""
        for entry in _entries(self._parts):
            with suppress(OSError):
                if is_abandoned(entry.path):
                    Path(entry.path).unlink()
                    self.counts.add("leftovers")
        pictures = {}
        for entry in _entries(self._objects, OBJECT):
            with suppress(FileNotFoundError):
                found = entry.stat(follow_symlinks=False)
                pictures[entry.name[:64]] = (found.st_mtime_ns, found.st_size)
        keys: dict[str, list[Path]] = {digest: [] for digest in pictures}
        for entry in _entries(self._keys, KEY):
            key_file = Path(entry.path)
            try:
                digest = _digest_named(key_file, entry.name)
            except Damaged:
                _remove(key_file)
                self.counts.add("damaged")
                continue
            if digest in keys:
                keys[digest].append(key_file)
            elif digest is not None:
                _remove(key_file)
                self.counts.add("dangling")
        for digest in [digest for digest, files in keys.items() if not files]:
            _remove(self._object(digest))
            self.counts.add("leftovers")
            del pictures[digest]
        return _Found(pictures, keys)

    def _object(self, digest: str) -> Path:
        return Path(f"{self._objects}/{digest[:2]}/{digest}.exr")

    def _key(self, name: str) -> Path:
        return Path(f"{self._keys}/{name[:2]}/{name}")

    def _make_folders(self) -> None:
        for folder in (self._objects, self._keys, self._parts):
            folder.mkdir(parents=True, exist_ok=True)

    @contextmanager
    def _part(self) -> Iterator[Path]:
        """A new empty file, ours for as long as we live, gone at the end unless it was renamed."""
        path = self._parts / f"{secrets.token_hex(16)}.exr"
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX)
            yield path
        finally:
            with suppress(OSError):
                path.unlink()
            let_go(handle)


def name_of(key: str) -> str:
    """64 hexadecimal digits, whatever the key: it may hold what no file name can."""
    return hashlib.sha256(key.encode("utf-8", "surrogatepass")).hexdigest()


def _digest_named(key_file: Path, name: str) -> str | None:
    """Digest of the picture of a key; None where there is no such key. Raises `Damaged`, and `OSError`."""
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
    if line is None or line[1].decode() != name:
        raise Damaged("not the file of this key")
    return line[2].decode()


def _entries(folder: Path, wanted: re.Pattern[str] | None = None) -> Iterator[os.DirEntry[str]]:
    """Files of a folder; with a pattern, those of its folders of two digits whose name begins with these and fits."""
    try:
        entries = list(os.scandir(folder))
    except (FileNotFoundError, NotADirectoryError):
        return
    for entry in entries:
        if wanted is None:
            yield entry
        elif len(entry.name) == 2:
            inner = _entries(Path(entry.path))
            yield from (one for one in inner if wanted.fullmatch(one.name) and one.name[:2] == entry.name)


def _rename(part: Path, file: Path) -> None:
    file.parent.mkdir(exist_ok=True)
    if file.is_dir() and not file.is_symlink():
        _remove(file)
    part.replace(file)
    _touch(file)


def _touch(file: Path) -> None:
    """By our clock: the system's own stamps are as coarse as its timer."""
    now = time.time_ns()
    os.utime(file, ns=(now, now))


def _remove(file: Path) -> None:
    """Whatever it is; what cannot be removed stays, and is found out again."""
    try:
        file.unlink(missing_ok=True)
    except OSError:
        if file.is_dir():
            shutil.rmtree(file, ignore_errors=True)


def _size(file: Path) -> int:
    try:
        return file.lstat().st_size
    except OSError:
        return 0
