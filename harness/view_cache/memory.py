"""Pictures in memory, the least recently used out first, in two segments (SLRU: Karedla, Love & Wherry 1994).

Level 1 holds what was seen once, level 0 what was used again: a camera that flies past a thousand views once does not
push out those that somebody comes back to.
"""

import threading
from collections import OrderedDict

import numpy as np

PROTECTED = 0.75
"""Share of the bytes that level 0 may take; level 1 has all that it leaves."""


class SegmentedMemory:
    """At most `bound` bytes of pictures in both levels together, at most `PROTECTED` of them in level 0.

    Safe to use from several threads. Bytes are those of the pixels.
    """

    def __init__(self, bound: int) -> None:
        self.bounds = (int(bound * PROTECTED), bound)
        """Of level 0, and of both together."""
        self.evicted = 0
        """Pictures that fell out of memory."""
        self._levels: tuple[OrderedDict[str, np.ndarray], OrderedDict[str, np.ndarray]] = (OrderedDict(), OrderedDict())
        self._bytes = [0, 0]
        self._lock = threading.Lock()

    def put(self, key: str, picture: np.ndarray, level: int) -> bool:
        """As the most recently used of `level`; in level 1 where it is too large for level 0. False where it is too
        large for both: then nothing is kept under `key`.
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
        """The picture and the level in which it was found; it is then the most recently used of level 0."""
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
        """The level, without using the picture."""
        with self._lock:
            return next((level for level in (0, 1) if key in self._levels[level]), None)

    def keys(self, level: int) -> list[str]:
        """The least recently used first."""
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
