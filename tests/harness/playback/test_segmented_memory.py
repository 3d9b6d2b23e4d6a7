"""The two segments in memory against a slow list of what is where."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.playback.store import PROTECTED, SegmentedMemory


@dataclass
class Reference:
    """Both levels as lists of (key, bytes), the least recently used first."""

    bound: int
    levels: tuple[list[tuple[str, int]], list[tuple[str, int]]] = field(default_factory=lambda: ([], []))
    lost: int = 0

    def forget(self, key: str) -> int | None:
        for level in self.levels:
            for one in level:
                if one[0] == key:
                    level.remove(one)
                    return one[1]
        return None

    def place(self, key: str, size: int, level: int) -> None:
        if size > int(self.bound * PROTECTED):
            level = 1
        self.levels[level].append((key, size))
        while sum(size for _, size in self.levels[0]) > int(self.bound * PROTECTED):
            self.levels[1].append(self.levels[0].pop(0))
        while sum(size for level in self.levels for _, size in level) > self.bound:
            self.levels[1 if self.levels[1][0][0] != key else 0].pop(0)
            self.lost += 1

    def put(self, key: str, size: int, level: int) -> None:
        self.forget(key)
        if size <= self.bound:
            self.place(key, size, level)

    def get(self, key: str) -> int | None:
        level = next((index for index in (0, 1) if key in [name for name, _ in self.levels[index]]), None)
        if level is not None:
            size = self.forget(key)
            assert size is not None
            self.place(key, size, 0)
        return level


OPERATIONS = st.lists(
    st.tuples(st.sampled_from(["put 0", "put 1", "get", "where"]), st.sampled_from("abcdefgh"), st.integers(1, 12)),
    max_size=60,
)


@settings(max_examples=300, deadline=None)
@given(OPERATIONS, st.integers(0, 40))
def test_every_sequence_leaves_what_the_reference_has(steps: list[tuple[str, str, int]], floats: int) -> None:
    memory, reference = SegmentedMemory(4 * floats), Reference(4 * floats)
    for what, key, size in steps:
        if what == "get":
            found = memory.get(key)
            assert (None if found is None else found[1]) == reference.get(key)
        elif what == "where":
            assert memory.where(key) == next((i for i in (0, 1) if key in [n for n, _ in reference.levels[i]]), None)
        else:
            level = int(what[-1])
            kept = memory.put(key, np.full((1, size, 1), size, dtype=np.float32), level)
            reference.put(key, 4 * size, level)
            assert kept == (size <= floats) == (memory.where(key) is not None), "what was put last is there"
        for level in (0, 1):
            assert memory.keys(level) == [name for name, _ in reference.levels[level]]
            assert memory.bytes()[level] == sum(size for _, size in reference.levels[level])
        assert memory.bytes()[0] <= int(PROTECTED * 4 * floats)
        assert sum(memory.bytes()) <= 4 * floats
        assert memory.evicted == reference.lost


def one() -> np.ndarray:
    return np.zeros((1, 1, 1), dtype=np.float32)


@pytest.mark.parametrize(("floats", "level", "others"), [(6, 0, 1), (7, 1, 0), (8, 1, None), (9, None, 0)])
def test_what_level_0_cannot_hold_stays_in_1_and_what_memory_cannot_hold_is_not_kept(
    floats: int, level: int | None, others: int | None
) -> None:
    memory = SegmentedMemory(4 * 8)
    memory.put("a", one(), 0)
    memory.put("big", one(), 0)
    assert memory.put("big", np.zeros((1, floats, 1), dtype=np.float32), 0) == (level is not None)
    assert memory.where("big") == level
    assert memory.where("a") == others
