"""The levelled store: what is where, what is given back, and that a folder stays within its bound."""

import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from harness.playback import disk
from harness.playback.disk import DiskPictures
from harness.playback.store import ViewStore
from scenes.files.errors import InputError
from tests.harness.playback.drawn import drawn, same_bits

ONE = drawn(0).nbytes
ON_DISK = 1300
"""Bytes of a drawn picture and its key on disk, or a little less."""


def test_listing_5_works_as_it_is_written(tmp_path: Path) -> None:
    for cache in (ViewStore(10 * ONE), ViewStore(10 * ONE, tmp_path / "cache")):
        assert "pose" not in cache
        assert cache.get("pose") is None
        cache.store("pose", drawn(1), level=1)
        assert "pose" in cache
        assert same_bits(cache.get("pose"), drawn(1))


def test_a_hit_goes_up_a_level(tmp_path: Path) -> None:
    store = ViewStore(10 * ONE, tmp_path / "cache", 10**6)
    store.store("a", drawn(1), level=2)
    levels = []
    for _ in range(4):
        levels.append(store.where("a"))
        found = store.get_with_level("a")
        assert found is not None
        assert same_bits(found[0], drawn(1))
        assert found[1] == levels[-1]
    assert levels == [2, 1, 0, 0]
    statistics = store.statistics
    assert statistics.hits == {0: 2, 1: 1, 2: 1}
    assert (statistics.misses, statistics.stored) == (0, {0: 0, 1: 0, 2: 1})
    assert statistics.bytes[0] == ONE
    assert statistics.hit_rate == 1.0


def test_without_a_disk_level_2_is_level_1_and_without_memory_nothing_is_kept() -> None:
    store = ViewStore(10 * ONE)
    store.store("a", drawn(1), level=2)
    assert store.where("a") == 1
    nothing = ViewStore(0)
    nothing.store("a", drawn(1))
    assert nothing.get("a") is None
    assert nothing.statistics.too_large == 1


def test_a_second_store_finds_what_the_first_one_left(tmp_path: Path) -> None:
    first = ViewStore(0, tmp_path, 10**6)
    for seed in range(10):
        first.store(f"view {seed}", drawn(seed), level=2)
    second = ViewStore(0, tmp_path, 10**6)
    assert all(same_bits(second.get(f"view {seed}"), drawn(seed)) for seed in range(10))
    assert second.get("view 10") is None
    assert second.statistics.bytes[2] == first.statistics.bytes[2] == sum(map(size, files_in(tmp_path)))


def test_equal_pictures_are_one_file_under_two_keys(tmp_path: Path) -> None:
    store = ViewStore(0, tmp_path, 10**6)
    store.store("a", drawn(1), level=2)
    store.store("b", drawn(1), level=2)
    assert len(list((tmp_path / "objects").rglob("*.exr"))) == 1
    store.store("a", drawn(2), level=2)
    assert same_bits(store.get("a"), drawn(2))
    assert same_bits(store.get("b"), drawn(1))


@pytest.mark.parametrize(
    "key", ["", "/", "../../../etc/passwd", "a\0b", "ä🙂", "\ud800", "x" * 100_000, ".", "-rf", "a/b\\c", "\n"]
)
def test_any_string_is_a_key(tmp_path: Path, key: str) -> None:
    store = ViewStore(0, tmp_path / "cache", 10**6)
    store.store(key, drawn(1), level=2)
    assert same_bits(ViewStore(0, tmp_path / "cache", 10**6).get(key), drawn(1))
    assert [entry.name for entry in tmp_path.iterdir()] == ["cache"]
    assert key + "x" not in store


def test_what_is_no_key_no_level_and_no_picture_is_refused(tmp_path: Path) -> None:
    store = ViewStore(10 * ONE, tmp_path, 10**6)
    for use in (store.get, store.where, store.__contains__, lambda key: store.store(key, drawn(1))):
        with pytest.raises(TypeError, match=r"string|str"):
            use(7)  # type: ignore[arg-type]
    for level in (-1, 3):
        with pytest.raises(ValueError, match="level"):
            store.store("a", drawn(1), level)
    with pytest.raises(ValueError, match="not finite"):
        store.store("a", np.full((1, 1, 1), np.nan, dtype=np.float32), 2)
    with pytest.raises(ValueError, match="negative"):
        ViewStore(-1)
    assert "a" not in store


def test_the_folder_stays_within_its_bound_and_the_least_recently_used_go(tmp_path: Path) -> None:
    bound = 10 * ON_DISK
    store = ViewStore(0, tmp_path, bound)
    for seed in range(60):
        store.store(f"{seed}", drawn(seed), level=2)
        assert same_bits(store.get("0"), drawn(0)), f"used at every step, gone after {seed}"
        assert sum(map(size, files_in(tmp_path))) <= bound
    statistics = store.statistics
    assert statistics.evicted[2] == 60 - len(files_in(tmp_path)) // 2 > 40
    assert statistics.failed_writes == statistics.damaged == statistics.dangling == 0
    kept = [seed for seed in range(1, 60) if f"{seed}" in store]
    assert kept == list(range(60 - len(kept), 60))
    assert len(kept) >= 6


def test_writers_that_never_come_to_the_ledger_do_not_fill_the_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As if each were killed once its names are taken."""
    store = DiskPictures(tmp_path, 5 * ON_DISK)
    with monkeypatch.context() as patch:
        patch.setattr(disk, "write_ledger", lambda *arguments: None)
        for seed in range(12):
            store.put(f"{seed}", drawn(seed))
            assert sum(map(size, files_in(tmp_path))) <= 5 * ON_DISK
    assert same_bits(store.get("11"), drawn(11))


def test_a_picture_larger_than_the_folder_may_be_stays_in_memory(tmp_path: Path) -> None:
    store = ViewStore(10 * ONE, tmp_path, 500)
    store.store("a", drawn(1), level=2)
    assert store.where("a") == 1
    assert store.statistics.failed_writes == 1
    assert "in a cache of 500" in str(store.statistics.last_failure)
    assert files_in(tmp_path) == []


@pytest.mark.parametrize("where", ["file", "file/below", "/proc/views"])
def test_a_folder_that_cannot_be_one_is_an_error_that_names_it(tmp_path: Path, where: str) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=where):
        ViewStore(10, tmp_path / where)


DISK_STEPS = st.lists(st.tuples(st.sampled_from(["put", "get", "other"]), st.integers(0, 9)), max_size=25)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(DISK_STEPS, st.integers(2, 8))
def test_two_stores_on_one_folder_only_ever_give_what_was_put(
    tmp_path: Path, steps: list[tuple[str, int]], pictures: int
) -> None:
    folder = tmp_path / f"{time.time_ns()}"
    one, other = (DiskPictures(folder, pictures * ON_DISK) for _ in range(2))
    known: dict[int, int] = {}
    for index, (what, key) in enumerate(steps):
        if what == "get":
            found = one.get(f"{key}")
            assert found is None or same_bits(found, drawn(known[key]))
        else:
            assert (one if what == "put" else other).put(f"{key}", drawn(index))
            known[key] = index
            assert same_bits(other.get(f"{key}"), drawn(index)), "what was put last is there"
        assert sum(map(size, files_in(folder))) <= pictures * ON_DISK
    for each in (one, other):
        assert (each.counts.damaged, each.counts.dangling, each.counts.failed) == (0, 0, 0)


def files_in(folder: Path) -> list[Path]:
    """Pictures and keys."""
    return [file for name in ("objects", "keys") for file in (folder / name).rglob("*") if file.is_file()]


def size(file: Path) -> int:
    return file.stat().st_size
