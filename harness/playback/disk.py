"""Pictures on disk, level 2 of the view cache: a file for each key, checked whenever it is read, bounded in bytes."""

import errno
import hashlib
import os
import re
import shutil
import stat
import struct
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

import numpy as np

from scenes.files.atomic import write_atomically
from scenes.files.errors import InputError

LARGEST_PIXELS = 64 * 1024 * 1024
"""The largest picture, 8192 × 8192, as everywhere (`scenes.view_sets.images`)."""
MOST_CHANNELS = 64
START = b"view 1\n"
SHAPE = struct.Struct("<qqq")
HEADER_BYTES = len(START) + hashlib.sha256().digest_size + SHAPE.size
OURS = re.compile(r"[0-9a-f]{64}|\.[0-9a-f]{64}\..*")
"""The names of pictures, and of what killed writers left: it is never read again, and so the first to be evicted."""
WRITING_NANOSECONDS = 60 * 10**9
"""The time within which a picture is written, unless its writer was killed."""
FILLED_AGAIN = 0.9
"""The share of the bound down to which pictures are evicted once it is reached."""
UNSEEN = 0.05
"""The share of the bound that is written before the folder is looked at again: other processes write as well."""


def frozen(value: np.ndarray) -> np.ndarray:
    """Return a copy of a picture, over memory that cannot be made writable again.

    Raises `TypeError` unless it is a float32 array and `ValueError` for another shape than [height, width, channels],
    for an empty or absurdly large one, and for NaN or infinities: a picture that is not finite is no picture.
    """
    if not isinstance(value, np.ndarray) or value.dtype != np.float32:
        kind = value.dtype if isinstance(value, np.ndarray) else type(value).__name__
        raise TypeError(f"a picture is a float32 array, not {kind}")
    height, width, channels = value.shape if value.ndim == 3 else (0, 0, 0)
    if not (0 < height * width <= LARGEST_PIXELS and 0 < channels <= MOST_CHANNELS):
        raise ValueError(f"a picture is [height, width, channels], not an array of shape {value.shape}")
    if not np.isfinite(value).all():
        raise ValueError(f"{int((~np.isfinite(value)).sum())} of {value.size} values of a picture are not finite")
    return np.frombuffer(value.tobytes(), dtype=np.float32).reshape(value.shape)


class DiskPictures:
    """A folder of at most `bound` bytes; of several processes each may exceed that by `UNSEEN` of it.

    Raises `InputError`, naming the folder, if nothing can be put there.
    """

    def __init__(self, folder: Path, bound: int) -> None:
        self.folder = folder
        self.bound = bound
        self.counts: Counter[str] = Counter()
        """Events since it was opened: files `evicted` for room, files `damaged` and dropped, `failed` writes."""
        self.failure: str | None = None
        self._held = self._unseen = 0
        try:
            write_atomically(folder / ".probe", b"", fsync=False)
            (folder / ".probe").unlink(missing_ok=True)
            self._look_and_evict(0)
        except OSError as error:
            raise InputError(
                f"{folder}: views cannot be kept there ({error.strerror or error}); give a folder that can be written"
            ) from error

    def put(self, key: str, picture: np.ndarray) -> bool:
        """Store a picture (of `frozen`). Returns False if that failed, which is counted and not raised; nothing is then
        under the key, if the system lets it be removed.
        """
        body, file = SHAPE.pack(*picture.shape) + picture.tobytes(), self._file(key)
        content = START + _digest(key, body) + body
        try:
            if len(content) > self.bound:
                raise OSError(errno.EFBIG, f"a picture of {len(content)} bytes in a cache of {self.bound}")
            self._unseen += len(content)
            if self._held + self._unseen > self.bound or self._unseen > UNSEEN * self.bound:
                self._look_and_evict(len(content))
            if file.is_dir() and not file.is_symlink():
                _remove(file)
            write_atomically(file, content, fsync=False)
            _touch(file)
        except OSError as error:
            self.counts["failed"] += 1
            self.failure = (error.strerror or str(error))[:300]
            self.drop(key)
            return False
        return True

    def get(self, key: str, use: bool = True) -> np.ndarray | None:
        """Return the picture, read-only; None without one, or if it is damaged, which drops it. `use` renews it."""
        file = self._file(key)
        try:
            picture = _decoded(key, _content(file, self.bound))
        except FileNotFoundError:
            return None
        except (OSError, ValueError):
            self.counts["damaged"] += 1
            _remove(file)
            return None
        if use:
            _touch(file)
        return picture

    def drop(self, key: str) -> None:
        """Remove what is under a key, if the system allows it."""
        _remove(self._file(key))

    def _file(self, key: str) -> Path:
        return self.folder / hashlib.sha256(key.encode("utf-8", "surrogatepass")).hexdigest()

    def _files(self) -> list[tuple[int, int, Path]]:
        """Return time of last use, bytes and path of every file of ours but those that are being written now."""
        files, lately = [], time.time_ns() - WRITING_NANOSECONDS
        with suppress(FileNotFoundError), os.scandir(self.folder) as entries:
            for entry in entries:
                if OURS.fullmatch(entry.name):
                    with suppress(FileNotFoundError):
                        status = entry.stat(follow_symlinks=False)
                        if not entry.name.startswith(".") or status.st_mtime_ns < lately:
                            files.append((status.st_mtime_ns, status.st_size, Path(entry.path)))
        return files

    def _look_and_evict(self, added: int) -> None:
        """Count the folder, and evict the least recently used files if so many more bytes need their room."""
        files = sorted(self._files())
        self._held, self._unseen = sum(size for _, size, _ in files) + added, 0
        if self._held > self.bound:
            for _, size, file in files:
                if self._held <= FILLED_AGAIN * self.bound:
                    break
                _remove(file)
                self.counts["evicted"] += 1
                self._held -= size


def _decoded(key: str, content: bytes) -> np.ndarray:
    """Return the picture of a file; raises `ValueError` unless it was written, just so, for this key."""
    body = content[HEADER_BYTES - SHAPE.size :]
    if content[: HEADER_BYTES - SHAPE.size] != START + _digest(key, body):
        raise ValueError("not the file that was written")
    return np.frombuffer(body, np.float32, offset=SHAPE.size).reshape(SHAPE.unpack_from(body))


def _digest(key: str, body: bytes) -> bytes:
    digest = hashlib.sha256(f"{len(key)} ".encode() + key.encode("utf-8", "surrogatepass"))
    digest.update(body)
    return digest.digest()


def _content(file: Path, most: int) -> bytes:
    """Read a file of at most so many bytes; raises `OSError`, also for a link, and `ValueError` for what is no file."""
    handle = os.open(file, os.O_RDONLY | os.O_CLOEXEC | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
    with os.fdopen(handle, "rb", buffering=0) as opened:
        status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode) or status.st_size > most:  # a pipe would keep us waiting for ever
            raise ValueError("not a file of ours")
        return opened.read()


def _touch(file: Path) -> None:
    """Set the time by our clock, as the system's stamps are coarse; not in a folder that can only be read."""
    now = time.time_ns()
    with suppress(OSError):
        os.utime(file, ns=(now, now))


def _remove(file: Path) -> None:
    """Remove an entry of any kind; one that cannot be removed stays, and is never taken for another picture."""
    try:
        file.unlink(missing_ok=True)
    except OSError:
        shutil.rmtree(file, ignore_errors=True)
