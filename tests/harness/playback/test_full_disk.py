"""Where nothing more can be written the picture stays in memory, and the store says why it is not on disk."""

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from harness.playback import disk
from harness.playback.disk import DiskPictures, locked
from harness.playback.store import ViewStore
from tests.harness.playback.drawn import drawn, same_bits

resource = pytest.importorskip("resource")


@contextmanager
def files_of_at_most(limit: int) -> Iterator[None]:
    """What is beyond is refused by the system, after what still fits was taken: as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def names_in(folder: Path) -> set[Path]:
    return {file for file in folder.rglob("*") if file.is_file() and file.name != "ledger"}


@pytest.mark.parametrize("limit", [0, 1, 100, 129, 131, 600, 1100])
def test_a_disk_that_is_full_costs_no_picture(tmp_path: Path, limit: int) -> None:
    """A drawn picture takes 1143 bytes, and its key 130."""
    store = ViewStore(10**6, tmp_path, 10**6)
    store.store("before", drawn(1), level=2)
    there = names_in(tmp_path)
    with files_of_at_most(limit):
        for seed in range(2, 6):
            store.store(f"{seed}", drawn(seed), level=2)
            assert store.where(f"{seed}") == 1
            assert same_bits(store.get(f"{seed}"), drawn(seed))
        assert same_bits(store.get("before"), drawn(1))
    assert names_in(tmp_path) == there
    statistics = store.statistics
    assert statistics.failed_writes == 4
    assert statistics.last_failure
    assert (statistics.damaged, statistics.stored[1]) == (0, 4)
    store.store("after", drawn(7), level=2)
    fresh = ViewStore(0, tmp_path, 10**6)
    assert same_bits(fresh.get("after"), drawn(7))
    assert same_bits(fresh.get("before"), drawn(1))
    assert fresh.get("3") is None
    assert fresh.statistics.damaged == fresh.statistics.leftovers == 0


@pytest.mark.parametrize(
    ("call", "at"), [("replace", 1), ("replace", 2), ("write_bytes", 1), ("stat", 1), ("unlink", 1), ("unlink", 2)]
)
def test_a_system_that_refuses_at_any_call_leaves_no_half_file(
    tmp_path: Path, call: str, at: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Picture and key are renamed, the key is written; what is not renamed is removed, which may be refused as well."""
    store = ViewStore(10**6, tmp_path, 10**6)
    works = getattr(Path, call)
    calls: list[Path] = []

    def refuses(path: Path, *arguments: object, **options: object) -> object:
        calls.append(path)
        if len(calls) == at:
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        return works(path, *arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(Path, call, refuses)
        store.store("a", drawn(1), level=2)
    assert len(calls) >= at, "a call that is never made shows nothing"
    fresh = DiskPictures(tmp_path, 10**6)
    if call == "unlink":  # of what was renamed before, and is no longer there
        assert (store.where("a"), store.statistics.failed_writes) == (2, 0)
        assert same_bits(fresh.get("a"), drawn(1))
    else:
        assert (store.where("a"), store.statistics.last_failure) == (1, "No space left on device")
        assert fresh.get("a") is None
    assert fresh.counts.damaged == 0
    assert not list((tmp_path / "parts").iterdir())
    assert same_bits(store.get("a"), drawn(1))


def test_a_lock_that_nobody_lets_go_costs_a_write_and_no_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(disk, "LOCK_SECONDS", 0.05)
    store = ViewStore(10**6, tmp_path, 10**6)
    store.store("a", drawn(1), level=2)
    with locked(tmp_path):
        store.store("b", drawn(2), level=2)
        assert store.where("b") == 1
        assert same_bits(store.get("a"), drawn(1))
    assert "another process" in str(store.statistics.last_failure)
    store.store("c", drawn(3), level=2)
    assert store.where("c") == 2
    assert store.statistics.failed_writes == 1
    fresh = ViewStore(0, tmp_path, 10**6)
    assert same_bits(fresh.get("c"), drawn(3))
    assert fresh.get("b") is None
