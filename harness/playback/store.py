"""Rendered views by the digest of all that a picture depends on (`harness.playback.keys`), in memory and in files.

An entry is therefore never out of date; a removed or damaged one is a miss.
"""

import errno
import hashlib
import os
import re
import stat
from collections import OrderedDict
from contextlib import suppress
from pathlib import Path
from typing import Literal

import numpy as np

from scenes.files.atomic import write_atomically
from scenes.files.errors import InputError

MEMORY_BYTES = 256 << 20
DISK_BYTES = 2 << 30
OURS = re.compile(r"[0-9a-f]{64}|\.[0-9a-f]{64}\..*")
"""The names of pictures, and of incomplete files of writers."""
STEP = 0.05
"""The share of the bound that is written between two listings of the folder, into which other processes write too."""
CHECKSUM_BYTES = hashlib.sha256().digest_size

Place = Literal["memory", "disk"]


class ViewStore:
    """A least-recently-used store of pictures, float32 [height, width, channels], bit-identical and read-only.

    `memory_bytes` bounds the pictures in memory, `disk_bytes` the folder `disk`, which each further process may exceed
    by `STEP`. Several processes may share the folder; a store belongs to one thread. Raises `InputError` if the folder
    cannot be written.
    """

    def __init__(
        self, memory_bytes: int = MEMORY_BYTES, disk: Path | None = None, disk_bytes: int = DISK_BYTES
    ) -> None:
        self.failure: str | None = None
        """Why the last failed write failed."""
        self._memory: OrderedDict[str, np.ndarray] = OrderedDict()
        self._memory_bound, self._memory_bytes = memory_bytes, 0
        self._folder, self._bound, self._written = disk, disk_bytes, 0
        if disk is None:
            return
        try:
            write_atomically(disk / ".probe", b"", fsync=False)
            (disk / ".probe").unlink(missing_ok=True)
            self._evict(0)
        except OSError as error:
            raise InputError(
                f"{disk}: views cannot be kept there ({error.strerror or error}); give a folder that can be written"
            ) from error

    def store(self, key: str, picture: np.ndarray) -> None:
        """Keep a picture, which must not be changed afterwards. A failed write to disk only sets `failure`."""
        self._remember(key, picture)
        if self._folder is not None:
            try:
                self._write(self._folder / key, picture.tobytes())
            except OSError as error:
                self.failure = (error.strerror or str(error))[:300]

    def get(self, key: str, shape: tuple[int, int, int]) -> tuple[np.ndarray, Place] | None:
        """Return the picture and its place; None if there is none of this shape."""
        if (picture := self._memory.get(key)) is not None:
            self._memory.move_to_end(key)
            return (picture, "memory") if picture.shape == shape else None
        if self._folder is None or (pixels := self._read(self._folder / key, 4 * int(np.prod(shape)))) is None:
            return None
        picture = np.frombuffer(pixels, np.float32).reshape(shape)
        self._remember(key, picture)
        return picture, "disk"

    def _remember(self, key: str, picture: np.ndarray) -> None:
        if key in self._memory:
            self._memory_bytes -= self._memory.pop(key).nbytes
        self._memory[key] = picture
        self._memory_bytes += picture.nbytes
        while self._memory_bytes > self._memory_bound:
            self._memory_bytes -= self._memory.popitem(last=False)[1].nbytes

    def _write(self, file: Path, pixels: bytes) -> None:
        size = CHECKSUM_BYTES + len(pixels)
        if size > self._bound:
            raise OSError(errno.EFBIG, f"a picture of {size} bytes in a cache of {self._bound}")
        self._written += size
        if self._written > STEP * self._bound:
            self._evict(size)
        write_atomically(file, _checksum(file.name, pixels) + pixels, fsync=False)

    def _read(self, file: Path, size: int) -> bytes | None:
        """Return `size` bytes of pixels if the file is valid; removes an invalid one."""
        try:
            status = file.lstat()
            if stat.S_ISREG(status.st_mode) and status.st_size == CHECKSUM_BYTES + size:
                content = file.read_bytes()
                pixels = content[CHECKSUM_BYTES:]
                if content[:CHECKSUM_BYTES] == _checksum(file.name, pixels):
                    # marks the access: many file systems keep no access times
                    with suppress(OSError):
                        os.utime(file)
                    return pixels
            file.unlink()
        except OSError:
            pass
        return None

    def _evict(self, room: int) -> None:
        """Remove the least recently used files, so that `room` bytes and all writes until the next call fit."""
        assert self._folder is not None
        files = []
        with suppress(FileNotFoundError), os.scandir(self._folder) as entries:
            for entry in entries:
                if OURS.fullmatch(entry.name):
                    with suppress(FileNotFoundError):
                        status = entry.stat(follow_symlinks=False)
                        files.append((status.st_mtime_ns, status.st_size, Path(entry.path)))
        held, self._written = sum(size for _, size, _ in files) + room, 0
        for _, size, file in sorted(files):
            if held <= (1.0 - 2.0 * STEP) * self._bound:
                break
            with suppress(OSError):
                file.unlink(missing_ok=True)
                held -= size


def _checksum(key: str, pixels: bytes) -> bytes:
    return hashlib.sha256(key.encode() + pixels).digest()
