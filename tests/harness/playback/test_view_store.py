"""The levelled store: what is where, what is given back, and what its memory keeps against a slow list of it."""

import threading
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

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
        hit = store.get_with_level("a")
        assert hit is not None
        assert same_bits(hit[0], A)
        assert hit[1] == levels[-1]
    assert levels == [2, 1, 0, 0]
    assert store.hits == {0: 2, 1: 1, 2: 1}


def test_without_a_disk_level_2_is_level_1_and_without_memory_nothing_is_kept() -> None:
    store, nothing = ViewStore(10 * A.nbytes), ViewStore(0)
    store.store("a", A, level=2)
    assert store.where("a") == 1
    nothing.store("a", A)
    assert nothing.get("a") is None


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


def test_threads_at_once_on_one_store(tmp_path: Path) -> None:
    """Memory is small, so that pictures move between all levels."""
    store = ViewStore(4 * A.nbytes, tmp_path, 6000)
    errors: list[str] = []

    def work(seed: int) -> None:
        generator = np.random.default_rng(seed)
        try:
            for _ in range(60):
                key = int(generator.integers(12))
                if generator.random() < 0.5:
                    store.store(f"{key}", drawn(key), int(generator.integers(3)))
                picture = store.get(f"{key}")
                if picture is not None and not same_bits(picture, drawn(key)):
                    errors.append(f"another picture under {key}")
        except Exception as error:
            errors.append(repr(error))

    threads = [threading.Thread(target=work, args=(seed,)) for seed in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors == []
    assert store.failure is None
    assert sum(file.stat().st_size for file in tmp_path.iterdir()) <= 6000


def one(floats: int = 1) -> np.ndarray:
    return np.full((1, floats, 1), floats, dtype=np.float32)


def test_what_is_used_again_outlives_what_is_new() -> None:
    """Six of eight pictures fit into level 0; the least recently used goes down, and from level 1 out."""
    memory = SegmentedMemory(8 * one().nbytes)
    for key in "abcdefg":
        memory.put(key, one(), 0)
    assert [list(level) for level in memory.levels] == [list("bcdefg"), ["a"]]
    memory.put("h", one(), 1)
    assert memory.get("b") is not None
    memory.put("i", one(), 1)
    assert [list(level) for level in memory.levels] == [list("cdefgb"), ["h", "i"]]
    assert memory.get("h") is not None, "from level 1 it goes up, and another one down"
    assert [list(level) for level in memory.levels] == [list("defgbh"), ["i", "c"]]


OPERATIONS = st.lists(
    st.tuples(st.sampled_from(["put 0", "put 1", "get"]), st.sampled_from("abcdefgh"), st.integers(1, 12)), max_size=60
)


@settings(max_examples=200, deadline=None)
@given(OPERATIONS, st.integers(0, 40))
def test_memory_stays_within_its_bounds_and_has_what_was_put_last(steps: list[tuple[str, str, int]], room: int) -> None:
    memory = SegmentedMemory(4 * room)
    value: dict[str, int] = {}
    for what, key, size in steps:
        if what == "get":
            hit = memory.get(key)
            assert hit is None or hit[0].shape == (1, value[key], 1)
        else:
            value[key] = size
            assert memory.put(key, one(size), int(what[-1])) == (size <= room) == (memory.where(key) is not None)
        sizes = [sum(picture.nbytes for picture in level.values()) for level in memory.levels]
        assert memory.bytes == sizes
        assert sizes[0] <= int(PROTECTED * 4 * room)
        assert sum(sizes) <= 4 * room
        assert not set(memory.levels[0]) & set(memory.levels[1])
