"""What is stored under a key is its value from then on, whatever level had another one before."""

import errno
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from harness.playback import disk
from harness.playback.disk import DiskPictures, locked
from harness.playback.float_exr import Damaged, read_exr
from harness.playback.store import ViewStore
from tests.harness.playback.drawn import drawn, same_bits
from tests.harness.playback.test_damaged_files import key_file_of, object_of

A, B = drawn(1), drawn(2)
LEVELS: tuple[int | tuple[int, ...], ...] = (0, 1, 2, (1, 2), (0, 2), (0, 1))
Fault = Literal["none", "full", "refused"]


@contextmanager
def fault_of_the_disk(fault: Fault) -> Iterator[None]:
    """Full: nothing can be written, but removed; refused: nothing can be changed."""

    def refuse(*arguments: object) -> None:
        raise OSError(errno.ENOSPC, "refused")

    with pytest.MonkeyPatch.context() as patch:
        if fault != "none":
            patch.setattr(disk, "write_exr" if fault == "full" else "locked", refuse)
        yield


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


def test_several_levels_are_one_value_counted_at_each(tmp_path: Path) -> None:
    store = ViewStore(10 * A.nbytes, tmp_path, 10**6)
    store.store("k", A, (1, 2))
    assert store.where("k") == 1
    assert store.statistics.stored == {0: 0, 1: 1, 2: 1}
    store.store("k", A, 0)
    assert same_bits(ViewStore(0, tmp_path, 10**6).get("k"), A), "the same picture stays on disk"
    for level in ((), (1, 3)):
        with pytest.raises(ValueError, match="level"):
            store.store("k", B, level)
    assert same_bits(store.get("k"), A)


def test_a_write_that_fails_leaves_no_older_picture(tmp_path: Path) -> None:
    store = ViewStore(10 * A.nbytes, tmp_path, 10**6)
    store.store("k", A, 2)
    with fault_of_the_disk("full"):
        store.store("k", B, 2)
    assert store.where("k") == 1
    assert same_bits(store.get("k"), B)
    assert ViewStore(0, tmp_path, 10**6).get("k") is None
    assert (store.statistics.failed_writes, store.statistics.last_failure) == (1, "refused")


@pytest.mark.parametrize("level", [1, 2])
def test_an_older_picture_that_cannot_be_dropped_is_not_found_here(
    tmp_path: Path, level: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(disk, "LOCK_SECONDS", 0.05)
    store = ViewStore(0, tmp_path, 10**6)
    store.store("k", A, 2)
    with locked(tmp_path):
        store.store("k", B, level)
    assert store.get("k") is None
    assert store.where("k") is None
    assert store.statistics.failed_writes == level
    assert "another process" in str(store.statistics.last_failure)
    store.store("k", B, 2)
    assert same_bits(store.get("k"), B)


STEPS = st.lists(
    st.tuples(
        st.sampled_from(["store", "store", "get"]),
        st.sampled_from("abc"),
        st.integers(0, 3),
        st.sampled_from(LEVELS),
        st.sampled_from(["none", "none", "none", "full", "refused"]),
    ),
    max_size=25,
)


def picture(number: int) -> np.ndarray:
    """The last one is larger than memory is here."""
    return drawn(number, height=25 if number == 3 else 5)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(STEPS, st.integers(0, 4))
def test_every_sequence_only_ever_gives_the_value_stored_last(
    tmp_path: Path, steps: list[tuple[str, str, int, int | tuple[int, ...], Fault]], room: int
) -> None:
    folder = tmp_path / f"{time.time_ns()}"
    store = ViewStore(room * A.nbytes, folder, 10**6)
    value: dict[str, np.ndarray] = {}
    left: set[str] = set()  # where another process may find an older one, as nothing could be changed
    for what, key, number, level, fault in steps:
        if what == "store":
            value[key] = picture(number)
            with fault_of_the_disk(fault):
                store.store(key, value[key], level)
            if fault == "refused":
                left.add(key)
            else:
                left.discard(key)
            if fault == "none" and 2 in (level if isinstance(level, tuple) else (level,)):
                assert same_bits(DiskPictures(folder, 10**6).get(key, use=False), value[key])
            if value[key].nbytes <= room * A.nbytes and level != 2:
                assert store.where(key) in (0, 1), "what was put last is there"
        else:
            found = store.get(key)
            assert found is None or same_bits(found, value[key])
        after = DiskPictures(folder, 10**6)
        for name, expected in value.items():
            following = after.get(name, use=False)
            assert following is None or name in left or same_bits(following, expected)
    for name, expected in value.items():
        found = store.get(name)
        assert found is None or same_bits(found, expected)


def test_what_is_read_from_disk_meanwhile_is_not_put_before_a_newer_value(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One thread has read A; before it has put it into memory, another stores B on disk."""
    store = ViewStore(10 * A.nbytes, tmp_path, 10**6)
    store.store("k", A, 2)

    def slow(self: DiskPictures, key: str, use: bool = True) -> np.ndarray | None:
        found = works(self, key, use)
        monkeypatch.setattr(DiskPictures, "get", works)
        other = threading.Thread(target=store.store, args=("k", B, 2))
        other.start()
        other.join()
        return found

    works = DiskPictures.get
    monkeypatch.setattr(DiskPictures, "get", slow)
    assert same_bits(store.get("k"), A)
    assert same_bits(store.get("k"), B)


@pytest.mark.parametrize("was", ["damaged", "dangling"])
def test_a_reader_does_not_drop_what_was_put_right_meanwhile(
    tmp_path: Path, was: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    reader, writer = DiskPictures(tmp_path, 10**6), DiskPictures(tmp_path, 10**6)
    writer.put("k", A)
    if was == "damaged":
        object_of(tmp_path, "k").write_bytes(b"noise")
    else:
        object_of(tmp_path, "k").unlink()

    def too_late(file: Path) -> np.ndarray:
        monkeypatch.setattr(disk, "read_exr", read_exr)
        try:
            return read_exr(file)
        except (Damaged, FileNotFoundError):
            assert writer.put("k", B)
            raise

    monkeypatch.setattr(disk, "read_exr", too_late)
    assert same_bits(reader.get("k"), B)
    assert same_bits(writer.get("k"), B)
    assert (reader.counts.damaged, reader.counts.dangling, reader.counts.unreadable) == (0, 0, 0)


def test_a_reader_that_does_not_get_the_lock_misses_and_drops_nothing(tmp_path: Path) -> None:
    store = DiskPictures(tmp_path, 10**6)
    store.put("k", A)
    object_of(tmp_path, "k").write_bytes(b"noise")
    with locked(tmp_path):
        assert store.get("k") is None
        assert key_file_of(tmp_path, "k").exists()
    assert (store.counts.damaged, store.counts.unreadable) == (0, 1)
    assert store.get("k") is None
    assert not key_file_of(tmp_path, "k").exists()
    assert (store.counts.damaged, store.counts.unreadable) == (1, 1)
