"""The levelled store: what is where, what is given back, and what its memory keeps against a slow list of it."""

import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from harness.playback.disk import DiskPictures
from harness.playback.store import PROTECTED, SegmentedMemory, ViewStore
from tests.harness.playback.drawn import drawn, same_bits

A, B = drawn(1), drawn(2)
LEVELS: tuple[int | tuple[int, ...], ...] = (0, 1, 2, (1, 2), (0, 2), (0, 1))


def test_listing_5_works_as_it_is_written(tmp_path: Path) -> None:
    for cache in (ViewStore(10 * A.nbytes), ViewStore(10 * A.nbytes, tmp_path / "cache")):
        assert "pose" not in cache
        assert cache.get("pose") is None
        cache.store("pose", A, level=1)
        assert "pose" in cache
        assert same_bits(cache.get("pose"), A)


def test_a_hit_goes_up_a_level(tmp_path: Path) -> None:
    store = ViewStore(10 * A.nbytes, tmp_path / "cache", 10**6)
    store.store("a", A, level=2)
    levels = []
    for _ in range(4):
        levels.append(store.where("a"))
        found = store.get_with_level("a")
        assert found is not None
        assert same_bits(found[0], A)
        assert found[1] == levels[-1]
    assert levels == [2, 1, 0, 0]
    statistics = store.statistics
    assert (statistics.hits, statistics.misses) == ({0: 2, 1: 1, 2: 1}, 0)
    assert statistics.bytes[0] == A.nbytes


def test_without_a_disk_level_2_is_level_1_and_without_memory_nothing_is_kept() -> None:
    store, nothing = ViewStore(10 * A.nbytes), ViewStore(0)
    store.store("a", A, level=2)
    assert store.where("a") == 1
    nothing.store("a", A)
    assert nothing.get("a") is None
    assert nothing.statistics.misses == 1


def test_what_is_no_level_and_no_picture_is_refused(tmp_path: Path) -> None:
    store = ViewStore(10 * A.nbytes, tmp_path, 10**6)
    for level in (-1, 3, (), (1, 3)):
        with pytest.raises(ValueError, match="level"):
            store.store("a", A, level)
    with pytest.raises(ValueError, match="not finite"):
        store.store("a", np.full((1, 1, 1), np.nan, dtype=np.float32), 2)
    assert "a" not in store


@pytest.mark.parametrize("first", LEVELS)
@pytest.mark.parametrize("then", LEVELS)
@pytest.mark.parametrize("room", [10 * A.nbytes, 0])
def test_the_last_one_stored_is_the_value_here_and_for_the_next_process(
    tmp_path: Path, first: int, then: int, room: int
) -> None:
    store = ViewStore(room, tmp_path, 10**6)
    store.store("k", A, first)
    store.store("k", B, then)
    to_disk = then == 2 or (isinstance(then, tuple) and 2 in then)
    if room or to_disk:
        assert same_bits(store.get("k"), B)
    else:
        assert store.get("k") is None
    following = ViewStore(0, tmp_path, 10**6).get("k")
    assert same_bits(following, B) if to_disk else following is None


STEPS = st.lists(
    st.tuples(st.booleans(), st.sampled_from("abc"), st.integers(0, 3), st.sampled_from(LEVELS)), max_size=25
)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(STEPS, st.integers(0, 4))
def test_every_sequence_only_ever_gives_the_value_stored_last(
    tmp_path: Path, steps: list[tuple[bool, str, int, int | tuple[int, ...]]], room: int
) -> None:
    folder = tmp_path / f"{time.time_ns()}"
    store = ViewStore(room * A.nbytes, folder, 10**6)
    value: dict[str, np.ndarray] = {}
    for is_stored, key, number, level in steps:
        if is_stored:
            value[key] = drawn(number, height=25 if number == 3 else 5)  # one is larger than memory
            store.store(key, value[key], level)
            if value[key].nbytes <= room * A.nbytes and level != 2:
                assert store.where(key) in (0, 1), "what was put last is there"
        else:
            found = store.get(key)
            assert found is None or same_bits(found, value[key])
        following = DiskPictures(folder, 10**6)
        for name, expected in value.items():
            found = following.get(name, use=False)
            assert found is None or same_bits(found, expected)


def test_threads_at_once_on_one_store(tmp_path: Path) -> None:
    """Of little memory, so that pictures move between all levels."""
    store = ViewStore(4 * A.nbytes, tmp_path, 6000)
    errors: list[str] = []

    def work(seed: int) -> None:
        generator = np.random.default_rng(seed)
        try:
            for _ in range(60):
                key = int(generator.integers(12))
                if generator.random() < 0.5:
                    store.store(f"{key}", drawn(key), int(generator.integers(3)))
                found = store.get(f"{key}")
                if found is not None and not same_bits(found, drawn(key)):
                    errors.append(f"another picture under {key}")
        except Exception as error:
            errors.append(repr(error))

    threads = [threading.Thread(target=work, args=(seed,)) for seed in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors == []
    statistics = store.statistics
    assert sum(statistics.hits.values()) + statistics.misses == 240
    assert statistics.failed_writes == statistics.damaged == 0
    assert statistics.bytes[0] + statistics.bytes[1] <= 4 * A.nbytes
    assert statistics.bytes[2] <= 6000


@dataclass
class Reference:
    """Both levels as lists of (key, bytes), the least recently used first."""

    bound: int
    levels: tuple[list[tuple[str, int]], list[tuple[str, int]]] = field(default_factory=lambda: ([], []))
    lost: int = 0

    def where(self, key: str) -> int | None:
        return next((level for level in (0, 1) if key in [name for name, _ in self.levels[level]]), None)

    def put(self, key: str, size: int, level: int) -> None:
        for one in self.levels:
            one[:] = [pair for pair in one if pair[0] != key]
        if size > self.bound:
            return
        self.levels[1 if size > int(self.bound * PROTECTED) else level].append((key, size))
        while self.bytes(0) > int(self.bound * PROTECTED):
            self.levels[1].append(self.levels[0].pop(0))
        while self.bytes(0) + self.bytes(1) > self.bound:
            self.levels[1 if self.levels[1][0][0] != key else 0].pop(0)
            self.lost += 1

    def get(self, key: str) -> int | None:
        level = self.where(key)
        if level is not None:
            self.put(key, dict(self.levels[level])[key], 0)
        return level

    def bytes(self, level: int) -> int:
        return sum(size for _, size in self.levels[level])


OPERATIONS = st.lists(
    st.tuples(st.sampled_from(["put 0", "put 1", "get"]), st.sampled_from("abcdefgh"), st.integers(1, 12)), max_size=60
)


@settings(max_examples=300, deadline=None)
@given(OPERATIONS, st.integers(0, 40))
def test_memory_has_after_every_sequence_what_the_reference_has(steps: list[tuple[str, str, int]], floats: int) -> None:
    memory, reference = SegmentedMemory(4 * floats), Reference(4 * floats)
    for what, key, size in steps:
        if what == "get":
            found = memory.get(key)
            assert (None if found is None else found[1]) == reference.get(key)
        else:
            kept = memory.put(key, np.full((1, size, 1), size, dtype=np.float32), int(what[-1]))
            reference.put(key, 4 * size, int(what[-1]))
            assert kept == (size <= floats) == (memory.where(key) is not None), "what was put last is there"
        for level in (0, 1):
            assert list(memory.levels[level]) == [name for name, _ in reference.levels[level]]
            assert memory.bytes[level] == reference.bytes(level)
        assert memory.bytes[0] <= int(PROTECTED * 4 * floats)
        assert sum(memory.bytes) <= 4 * floats
        assert memory.evicted == reference.lost
