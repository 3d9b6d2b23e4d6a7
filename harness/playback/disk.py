"""Pictures on disk, level 2: content-addressed float EXR files, bounded in bytes, checked whenever they are read.

A ledger file tells the users of the folder who may change it, and how many bytes are in it.
"""

import errno
import os
import re
import secrets
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from harness.playback.float_exr import Damaged, digest_of, read_exr, write_exr
from harness.playback.names import (
    KEY,
    KEY_BYTES,
    OBJECT,
    digest_named,
    entries,
    leads_to,
    name_of,
    remove,
    rename,
    size_of,
    touch,
)
from scenes.files.errors import InputError
from scenes.files.lock import LockTaken, acquire, is_held

LOCK_SECONDS = 5.0
"""The seconds after which a write gives up; the lock is held for milliseconds."""


@contextmanager
def locked(folder: Path, seconds: float | None = None) -> Iterator[int]:
    """The ledger of a folder, open and ours alone; raises `OSError` where somebody else does not let go of it within
    `seconds`, `LOCK_SECONDS` where that is None, and where there are no locks.
    """
    patience = LOCK_SECONDS if seconds is None else seconds
    try:
        lock = acquire(folder / "ledger", patience, 0o666)
    except LockTaken:
        raise OSError(errno.EAGAIN, f"another process held it for {patience:g} s") from None
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise OSError(errno.ELOOP, "ledger is a link; remove it") from error
        raise
    try:
        yield lock.handle
    finally:
        lock.release()


def read_ledger(ledger: int) -> int | None:
    """Read the ledger; None if its last user was killed, or nobody has counted yet."""
    line = os.pread(ledger, 32, 0)
    return int(line) if re.fullmatch(rb"[0-9]{1,30}\n", line) else None


def write_ledger(ledger: int, held: int) -> None:
    with suppress(OSError):  # on a full disk the next user counts for itself
        os.ftruncate(ledger, 0)
        os.pwrite(ledger, f"{max(held, 0)}\n".encode(), 0)


FILLED_AGAIN = 0.9
"""The share of the bound down to which pictures are evicted once it is reached: not every write has to look at every
file.
"""


@dataclass
class DiskCounts:
    """Counts of events in the folder since it was opened here."""

    evicted: int = 0
    """The number of pictures that made room."""
    damaged: int = 0
    """The number of pictures and keys with other bytes than those written; each was dropped."""
    dangling: int = 0
    """The number of keys whose picture was gone; each was dropped."""
    leftovers: int = 0
    """The number of files of writers that were killed, and pictures that no key names any more; each was removed."""
    unreadable: int = 0
    """The number of reads that the system refused, or of damaged files that could not be dropped."""
    failed: int = 0
    """The number of writes, and drops of outdated values, that failed."""
    reason: str | None = None
    """The reason of the last of them."""
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
    """The contents of the folder."""

    pictures: dict[str, tuple[int, int]]
    """Map digest → last use in nanoseconds, bytes."""
    keys: dict[str, list[Path]]
    """Map digest → files of the keys that name it."""

    @property
    def bytes(self) -> int:
        return sum(size for _, size in self.pictures.values()) + KEY_BYTES * sum(map(len, self.keys.values()))


class DiskPictures:
    """A folder of at most `bound` bytes, besides files that are being written at the moment.

    Raises `InputError`, naming the folder, if nothing can be put there.
    """

    def __init__(self, folder: Path, bound: int) -> None:
        self.folder = folder
        self.bound = bound
        self.counts = DiskCounts()
        self._overruled: set[str] = set()
        """The names whose file has another value than was stored last, and could not be dropped."""
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
        """Store a picture (of `pictures.frozen`). Returns False if that failed, which is counted and not raised;
        nothing else is then under the key.
        """
        digest, name = digest_of(picture), name_of(key)
        try:
            try:
                self._put(name, digest, picture)
            except FileNotFoundError:  # somebody removed the folder meanwhile
                self._make_folders()
                self._put(name, digest, picture)
        except OSError as error:
            self.counts.fail(error.strerror or str(error))
            self.drop_others(key, picture)
            return False
        self._overruled.discard(name)
        return True

    def drop_others(self, key: str, picture: np.ndarray) -> None:
        """Drop everything under a key except, if it is there, this picture. If the system refuses that it is counted as
        a failed write, and the key is a miss here until a value is stored under it.
        """
        name = name_of(key)
        try:
            if os.path.lexists(self._key(name)):  # usually not: most keys are digests of all that a picture depends on
                self._drop_unless(name, digest_of(picture))
            self._overruled.discard(name)
        except OSError as error:
            self._overruled.add(name)
            self.counts.fail(error.strerror or str(error))

    def get(self, key: str, use: bool = True) -> np.ndarray | None:
        """Return the picture, read-only and checked; None if there is none or it is damaged, and a damaged one is
        dropped. Refusals by the system are not raised either. `use` makes it the most recently used.
        """
        name = name_of(key)
        if name in self._overruled:
            return None
        try:
            try:
                found = self._read(name)
            except (Damaged, _Dangling):
                # a lock that is not free at once is not waited for: this is a miss in any case
                with locked(self.folder, 0.0):
                    found = self._read_or_drop(name)
        except (OSError, MemoryError):
            self.counts.add("unreadable")
            return None
        if found is None:
            return None
        digest, picture = found
        if use:
            with suppress(OSError):  # a folder that can only be read
                touch(self._object(digest))
        return picture

    def bytes(self) -> int:
        """Return the bytes of the pictures and keys that are there now."""
        folders = (self._objects, OBJECT), (self._keys, KEY)
        return sum(size_of(Path(entry.path)) for folder, name in folders for entry in entries(folder, name))

    def _read(self, name: str) -> tuple[str, np.ndarray] | None:
        """Return digest and picture; None if there is no such key. Raises `Damaged`, `_Dangling` and `OSError`."""
        digest = digest_named(self._key(name))
        if digest is None:
            return None
        try:
            picture = read_exr(self._object(digest))
            if digest_of(picture) != digest:
                raise Damaged("other pixels")
        except Damaged as error:
            raise _DamagedPicture(digest) from error
        except FileNotFoundError as error:
            raise _Dangling(digest) from error
        return digest, picture

    def _read_or_drop(self, name: str) -> tuple[str, np.ndarray] | None:
        """Read under the lock, as somebody may have repaired it since it was found damaged, or drop it."""
        try:
            return self._read(name)
        except _Dangling:
            self.counts.add("dangling")
        except Damaged as error:
            if isinstance(error, _DamagedPicture):
                remove(self._object(error.digest))
            self.counts.add("damaged")
        remove(self._key(name))
        return None

    def _drop_unless(self, name: str, digest: str) -> None:
        """Drop a key that leads to another picture; raises `OSError`."""
        key_file = self._key(name)
        if leads_to(key_file, digest):
            return
        with locked(self.folder):
            if not leads_to(key_file, digest):
                remove(key_file)
                if os.path.lexists(key_file):
                    raise OSError(errno.EACCES, "an older picture cannot be removed", str(key_file))

    def _put(self, name: str, digest: str, picture: np.ndarray) -> None:
        """Store a picture; raises `OSError`, and no name then leads to an incomplete file."""
        with self._part() as new_picture, self._part() as new_key:
            write_exr(new_picture, picture)
            new_key.write_bytes(f"{name} {digest}\n".encode())
            added = new_picture.stat().st_size + KEY_BYTES
            if added > self.bound:
                raise OSError(errno.EFBIG, f"a picture of {added} bytes in a cache of {self.bound}")
            with locked(self.folder) as ledger:
                held = read_ledger(ledger)
                os.ftruncate(ledger, 0)  # if we are killed from here on, the next user counts for itself
                if held is None or held + added > self.bound:
                    held = self._made_room(added)
                file, key_file = self._object(digest), self._key(name)
                held -= size_of(file) + size_of(key_file)
                rename(new_picture, file)
                rename(new_key, key_file)
                write_ledger(ledger, held + added)

    def _made_room(self, added: int) -> int:
        """Evict as many pictures as `added` more bytes need; returns the bytes held. Needs the lock."""
        found = self._swept()
        held = found.bytes
        if held + added <= self.bound:
            return held
        for digest, (_, size) in sorted(found.pictures.items(), key=lambda one: one[1]):
            if held + added <= FILLED_AGAIN * self.bound:
                break
            for key_file in found.keys[digest]:
                remove(key_file)
            remove(self._object(digest))
            self.counts.add("evicted")
            held -= size + KEY_BYTES * len(found.keys[digest])
        return held

    def _swept(self) -> _Found:
        """Remove all pictures that no key leads to and all keys that lead nowhere; returns the rest. Needs the lock."""
        for entry in entries(self._parts):
            with suppress(OSError):
                if entry.is_symlink() or is_held(Path(entry.path)) is False:
                    Path(entry.path).unlink()
                    self.counts.add("leftovers")
        pictures = {}
        for entry in entries(self._objects, OBJECT):
            with suppress(FileNotFoundError):
                found = entry.stat(follow_symlinks=False)
                pictures[entry.name[:64]] = (found.st_mtime_ns, found.st_size)
        keys: dict[str, list[Path]] = {digest: [] for digest in pictures}
        for entry in entries(self._keys, KEY):
            key_file = Path(entry.path)
            try:
                digest = digest_named(key_file)
            except Damaged:
                remove(key_file)
                self.counts.add("damaged")
                continue
            if digest in keys:
                keys[digest].append(key_file)
            elif digest is not None:
                remove(key_file)
                self.counts.add("dangling")
        for digest in [digest for digest, files in keys.items() if not files]:
            remove(self._object(digest))
            self.counts.add("leftovers")
            del pictures[digest]
        return _Found(pictures, keys)

    def _object(self, digest: str) -> Path:
        return Path(f"{self._objects}/{digest[:2]}/{digest}.exr")

    def _key(self, name: str) -> Path:
        return Path(f"{self._keys}/{name[:2]}/{name}")

    def _make_folders(self) -> None:
        for folder in (self._objects, self._keys, self._parts):
            if folder.is_symlink():  # the whole cache may lie elsewhere, no part of it
                raise OSError(errno.ELOOP, f"{folder.name} is a link; remove it")
            folder.mkdir(parents=True, exist_ok=True)

    @contextmanager
    def _part(self) -> Iterator[Path]:
        """A new empty file, ours for as long as we live, gone at the end unless it was renamed."""
        lock = acquire(self._parts / f"{secrets.token_hex(16)}.exr", LOCK_SECONDS, 0o666)
        try:
            yield lock.path
        finally:
            lock.release(remove=True)


class _DamagedPicture(Damaged):
    """The file of the picture that a key names is damaged."""

    def __init__(self, digest: str) -> None:
        super().__init__(digest)
        self.digest = digest


class _Dangling(LookupError):
    """The picture that a key names is gone."""
