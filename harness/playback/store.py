"""A levelled store of rendered views, with the interface that Listing 5 needs of the paper's `HUAMMemory`, which is not
published: `key in store`, `store.get(key)`, `store.store(key, value, level=1)`.
"""

import threading
from collections import OrderedDict
from pathlib import Path

import numpy as np

from harness.playback.disk import DiskPictures, frozen

PROTECTED = 0.75
"""The share of the bytes in memory that level 0 may take; level 1 has the rest."""
LEVELS = (0, 1, 2)
MEMORY_BYTES = 256 * 1024 * 1024
DISK_BYTES = 2 * 1024 * 1024 * 1024


class SegmentedMemory:
    """At most `bound` bytes of pixels in both levels together, at most `PROTECTED` of them in level 0."""

    def __init__(self, bound: int) -> None:
        self.bounds = (int(bound * PROTECTED), bound)
        """The bounds of level 0, and of both together."""
        self.bytes = [0, 0]
        self.levels: tuple[OrderedDict[str, np.ndarray], OrderedDict[str, np.ndarray]] = (OrderedDict(), OrderedDict())
        """The pictures of each level, the least recently used first."""

    def put(self, key: str, picture: np.ndarray, level: int) -> bool:
        """Store as the most recently used of `level`; in level 1 if it is too large for level 0. Returns False if it is
        too large for both: then nothing is kept under `key`.
        """
        self.drop(key)
        if picture.nbytes > self.bounds[1]:
            return False
        if picture.nbytes > self.bounds[0]:
            level = 1
        self._add(key, picture, level)
        while self.bytes[0] > self.bounds[0]:
            self._add(*self._take_oldest(0), 1)
        while sum(self.bytes) > self.bounds[1]:
            # a picture so large that all of level 1 is not enough for it has room made in level 0
            self._take_oldest(1 if next(iter(self.levels[1])) != key else 0)
        return True

    def get(self, key: str) -> tuple[np.ndarray, int] | None:
        """Return the picture and the level in which it was found; it is then the most recently used of level 0."""
        level = self.where(key)
        if level is None:
            return None
        picture = self.levels[level][key]
        if level == 0:
            self.levels[0].move_to_end(key)
        else:
            self.put(key, picture, 0)
        return picture, level

    def where(self, key: str) -> int | None:
        return next((level for level in (0, 1) if key in self.levels[level]), None)

    def drop(self, key: str) -> None:
        level = self.where(key)
        if level is not None:
            self.bytes[level] -= self.levels[level].pop(key).nbytes

    def _add(self, key: str, picture: np.ndarray, level: int) -> None:
        self.levels[level][key] = picture
        self.bytes[level] += picture.nbytes

    def _take_oldest(self, level: int) -> tuple[str, np.ndarray]:
        key, picture = self.levels[level].popitem(last=False)
        self.bytes[level] -= picture.nbytes
        return key, picture


class ViewStore:
    """Pictures (finite float32 [height, width, channels]) under arbitrary keys, returned bit for bit and read-only.

    Level 0 holds reused pictures in memory, level 1 those seen once in memory, level 2 on disk those that shall outlive
    the process. A hit in 1 moves up to 0; pictures evicted from 0 move down to 1, and from there out of memory; a hit
    in 2 is put into 1 as well. A stored picture is the value of its key from then on, at whatever levels. Another
    process keeps the pictures in its memory. `memory_bytes` bounds both levels in memory together, `disk_bytes` the
    folder. Safe to use from several threads, and the folder from several processes. Raises `InputError` where `disk`
    cannot be used.
    """

    def __init__(
        self, memory_bytes: int = MEMORY_BYTES, disk: Path | None = None, disk_bytes: int = DISK_BYTES
    ) -> None:
        self._memory = SegmentedMemory(memory_bytes)
        self._disk = None if disk is None else DiskPictures(disk, disk_bytes)
        self._lock = threading.Lock()
        self._hits = dict.fromkeys(LEVELS, 0)

    def __contains__(self, key: str) -> bool:
        return self.where(key) is not None

    def where(self, key: str) -> int | None:
        """Return the level at which `get` would find it now; on disk the complete picture is read and checked."""
        with self._lock:
            level = self._memory.where(key)
            if level is None and self._disk is not None and self._disk.get(key, use=False) is not None:
                return 2
            return level

    def get(self, key: str) -> np.ndarray | None:
        return (self.get_with_level(key) or (None,))[0]

    def get_with_level(self, key: str) -> tuple[np.ndarray, int] | None:
        with self._lock:
            hit = self._memory.get(key)
            if hit is None and self._disk is not None and (picture := self._disk.get(key)) is not None:
                self._memory.put(key, picture, 1)
                hit = picture, 2
            if hit is not None:
                self._hits[hit[1]] += 1
            return hit

    def store(self, key: str, value: np.ndarray, level: int | tuple[int, ...] = 1) -> None:
        """Make a copy of `value` the picture under `key`, at a level or at several; a picture that the disk refuses, or
        without a disk, goes to level 1. Of 0 and 1 the first has it.

        Raises `TypeError` and `ValueError` for a value that is no picture (`frozen`).
        """
        levels = {level} if isinstance(level, int) else set(level)
        picture = frozen(value)
        with self._lock:
            on_disk = False
            if self._disk is not None and 2 in levels:
                on_disk = self._disk.put(key, picture)
            elif self._disk is not None:
                self._disk.drop(key)
            if levels == {2} and on_disk:
                self._memory.drop(key)
            else:
                self._memory.put(key, picture, min(1, *levels))

    @property
    def hits(self) -> dict[int, int]:
        """Return level → pictures that were found there since the store was opened."""
        with self._lock:
            return dict(self._hits)

    @property
    def failure(self) -> str | None:
        """Return why the last write to disk failed that did; None if all succeeded."""
        return self._disk.failure if self._disk is not None else None
