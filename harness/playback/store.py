"""A levelled store of rendered views, with the interface that Listing 5 needs of the paper's `HUAMMemory`, which is not
published: `key in store`, `store.get(key)`, `store.store(key, value, level=1)`.
"""

import threading
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.playback.disk import DiskPictures
from harness.playback.float_exr import frozen

PROTECTED = 0.75
"""The share of the bytes that level 0 may take; level 1 has the rest."""


class SegmentedMemory:
    """A memory of at most `bound` bytes of pictures in both levels together, at most `PROTECTED` of them in level 0.

    Safe to use from several threads. Bytes are those of the pixels.
    """

    def __init__(self, bound: int) -> None:
        self.bounds = (int(bound * PROTECTED), bound)
        """The bounds of level 0, and of both together."""
        self.evicted = 0
        """The number of pictures that were evicted from memory."""
        self._levels: tuple[OrderedDict[str, np.ndarray], OrderedDict[str, np.ndarray]] = (OrderedDict(), OrderedDict())
        self._bytes = [0, 0]
        self._lock = threading.Lock()

    def put(self, key: str, picture: np.ndarray, level: int) -> bool:
        """Store as the most recently used of `level`; in level 1 if it is too large for level 0. Returns False if it is
        too large for both: then nothing is kept under `key`.
        """
        with self._lock:
            self._take(key)
            if picture.nbytes > self.bounds[1]:
                return False
            self._insert(key, picture, level)
            return True

    def drop(self, key: str) -> None:
        with self._lock:
            self._take(key)

    def get(self, key: str) -> tuple[np.ndarray, int] | None:
        """Return the picture and the level in which it was found; it is then the most recently used of level 0."""
        with self._lock:
            first, second = self._levels
            if (picture := first.get(key)) is not None:
                first.move_to_end(key)
                return picture, 0
            if (picture := second.get(key)) is None:
                return None
            self._take(key)
            self._insert(key, picture, 0)
            return picture, 1

    def where(self, key: str) -> int | None:
        """Return the level, without using the picture."""
        with self._lock:
            return next((level for level in (0, 1) if key in self._levels[level]), None)

    def keys(self, level: int) -> list[str]:
        """Return the keys, the least recently used first."""
        with self._lock:
            return list(self._levels[level])

    def bytes(self) -> tuple[int, int]:
        with self._lock:
            return self._bytes[0], self._bytes[1]

    def _insert(self, key: str, picture: np.ndarray, level: int) -> None:
        if picture.nbytes > self.bounds[0]:
            level = 1
        self._levels[level][key] = picture
        self._bytes[level] += picture.nbytes
        while self._bytes[0] > self.bounds[0]:
            demoted, moved = self._oldest(0)
            self._levels[1][demoted] = moved
            self._bytes[1] += moved.nbytes
        while sum(self._bytes) > self.bounds[1]:
            # a picture so large that all of level 1 is not enough for it has room made in level 0
            self._oldest(1 if next(iter(self._levels[1])) != key else 0)
            self.evicted += 1

    def _oldest(self, level: int) -> tuple[str, np.ndarray]:
        key, picture = self._levels[level].popitem(last=False)
        self._bytes[level] -= picture.nbytes
        return key, picture

    def _take(self, key: str) -> None:
        for level in (0, 1):
            picture = self._levels[level].pop(key, None)
            if picture is not None:
                self._bytes[level] -= picture.nbytes


LEVELS = (0, 1, 2)
MEMORY_BYTES = 256 * 1024 * 1024
DISK_BYTES = 2 * 1024 * 1024 * 1024


@dataclass(frozen=True)
class StoreStatistics:
    """Counts of events in a store since it was opened, and its current contents."""

    hits: dict[int, int]
    """Map level → pictures that were found there."""
    misses: int
    stored: dict[int, int]
    """Map level → pictures that were put there; promotion does not count."""
    evicted: dict[int, int]
    """Map level → pictures that made room for others: 1 for those that left memory, 2 for those that left the disk."""
    bytes: dict[int, int]
    """Map level → bytes now: of pixels in memory, of files on disk, where other processes may have put some of them."""
    too_large: int
    """The number of pictures that memory could not hold."""
    damaged: int
    """The number of files with other bytes than those written: dropped, and a miss."""
    dangling: int
    """The number of keys on disk whose picture was gone."""
    leftovers: int
    """The number of files of killed writers that were removed."""
    unreadable: int
    """The number of reads that the system refused: a miss."""
    failed_writes: int
    last_failure: str | None
    """The reason why the last of them failed."""

    @property
    def hit_rate(self) -> float:
        asked = sum(self.hits.values()) + self.misses
        return sum(self.hits.values()) / asked if asked else 0.0


class ViewStore:
    """Pictures (finite float32 [height, width, channels]) under arbitrary keys, returned bit for bit and read-only.

    Level 0 holds reused pictures in memory, level 1 those seen once in memory, level 2 on disk those that shall outlive
    the process. A hit in 1 moves up to 0; pictures evicted from 0 move down to 1, and from there out of memory; a hit
    in 2 is put into 1 as well. A stored picture is the value of its key from then on, at whatever levels: no other is
    left on disk or in the memory of this store. Another process keeps the pictures in its memory. `memory_bytes` bounds
    both levels in memory together, `disk_bytes` the folder. Safe to use from several threads, and the folder from
    several processes. Raises `InputError` where `disk` cannot be used.
    """

    def __init__(
        self, memory_bytes: int = MEMORY_BYTES, disk: Path | None = None, disk_bytes: int = DISK_BYTES
    ) -> None:
        if memory_bytes < 0 or disk_bytes < 0:
            raise ValueError(f"{memory_bytes} bytes of memory, {disk_bytes} on disk: cannot be negative")
        self._memory = SegmentedMemory(memory_bytes)
        self._disk = None if disk is None else DiskPictures(disk, disk_bytes)
        self._storing = threading.Lock()
        """The lock that orders stores, so that all levels have the value of the same one."""
        self._lock = threading.Lock()
        self._changes = 0
        """The number of values stored so far: a value read from disk meanwhile may be outdated."""
        self._hits = dict.fromkeys(LEVELS, 0)
        self._stored = dict.fromkeys(LEVELS, 0)
        self._misses = self._too_large = 0

    def __contains__(self, key: str) -> bool:
        return self.where(key) is not None

    def where(self, key: str) -> int | None:
        """Return the level at which `get` would find it now; this uses nothing, but damaged files on disk are dropped.

        On disk the complete picture is read and checked for that, as `get` does. An evicted picture may be gone before
        it is asked for: `get` can return None although `in` was true.
        """
        level = self._memory.where(_checked(key))
        if level is None and self._disk is not None and self._disk.get(key, use=False) is not None:
            return 2
        return level

    def get(self, key: str) -> np.ndarray | None:
        found = self.get_with_level(key)
        return None if found is None else found[0]

    def get_with_level(self, key: str) -> tuple[np.ndarray, int] | None:
        """Return the picture, and the level at which it was found."""
        changes = self._changes
        found = self._memory.get(_checked(key))
        if found is None and self._disk is not None and (picture := self._disk.get(key)) is not None:
            found = picture, 2
            with self._lock:
                if changes == self._changes:
                    self._memory.put(key, picture, 1)
        with self._lock:
            if found is None:
                self._misses += 1
            else:
                self._hits[found[1]] += 1
        return found

    def store(self, key: str, value: np.ndarray, level: int | tuple[int, ...] = 1) -> None:
        """Make a copy of `value` the picture under `key`, at a level or at several; a picture that the disk refuses, or
        without a disk, goes to level 1. Of 0 and 1 the first has it.

        Raises `TypeError` and `ValueError` for a value that is no picture (`pictures.frozen`) and another level.
        """
        levels = {level} if isinstance(level, int) else set(level)
        if not levels or not levels <= set(LEVELS):
            raise ValueError(f"level {level}: there are {LEVELS}")
        _checked(key)
        picture = frozen(value)
        with self._storing:
            on_disk = False
            if self._disk is not None and 2 in levels:
                on_disk = self._disk.put(key, picture)
            elif self._disk is not None:
                self._disk.drop_others(key, picture)
            in_memory = min(levels) if min(levels) < 2 else None if on_disk else 1
            with self._lock:
                self._changes += 1
                if on_disk:
                    self._stored[2] += 1
                if in_memory is None:
                    self._memory.drop(key)
                elif self._memory.put(key, picture, in_memory):
                    self._stored[in_memory] += 1
                else:
                    self._too_large += 1

    @property
    def statistics(self) -> StoreStatistics:
        """Return the statistics now; looks at every file on disk."""
        first, second = self._memory.bytes()
        disk = self._disk
        counts = None if disk is None else disk.counts
        with self._lock:
            return StoreStatistics(
                hits=dict(self._hits),
                misses=self._misses,
                stored=dict(self._stored),
                evicted={1: self._memory.evicted, 2: counts.evicted if counts else 0},
                bytes={0: first, 1: second, 2: disk.bytes() if disk else 0},
                too_large=self._too_large,
                damaged=counts.damaged if counts else 0,
                dangling=counts.dangling if counts else 0,
                leftovers=counts.leftovers if counts else 0,
                unreadable=counts.unreadable if counts else 0,
                failed_writes=counts.failed if counts else 0,
                last_failure=counts.reason if counts else None,
            )


def _checked(key: str) -> str:
    if not isinstance(key, str):
        raise TypeError(f"a key is a string, not {type(key).__name__}")
    return key
