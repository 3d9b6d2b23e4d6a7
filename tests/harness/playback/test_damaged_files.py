"""Whatever became of a file on disk: it is dropped and a miss, or the picture is bit for bit the right one."""

import os
import pickle
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from harness.playback.disk import DiskPictures
from harness.playback.names import name_of
from harness.playback.store import ViewStore
from tests.harness.playback.drawn import drawn, same_bits


def object_of(folder: Path, key: str) -> Path:
    digest = key_file_of(folder, key).read_text().split()[1]
    return folder / "objects" / digest[:2] / f"{digest}.exr"


def key_file_of(folder: Path, key: str) -> Path:
    return folder / "keys" / name_of(key)[:2] / name_of(key)


def put_back(store: DiskPictures, key: str, seed: int) -> None:
    """What rendering again does: it has to work whatever lies there."""
    assert store.put(key, drawn(seed))
    assert same_bits(store.get(key), drawn(seed))


def flipped_everywhere(tmp_path: Path, count: int | None, of: Callable[[Path, str], Path], seed: int) -> dict[str, int]:
    """Flips one bit at a time, of each byte or of `count` random ones, and reads; how it went."""
    store = DiskPictures(tmp_path, 10**6)
    store.put("a", drawn(1))
    generator = np.random.default_rng(seed)
    whole = of(tmp_path, "a").read_bytes()
    places = np.arange(len(whole)) if count is None else generator.integers(0, len(whole), count)
    outcomes = {"dropped": 0, "right": 0}
    for place in places:
        data = bytearray(whole)
        data[place] ^= 1 << int(generator.integers(8))
        of(tmp_path, "a").write_bytes(data)
        before = store.counts.damaged + store.counts.dangling
        found = store.get("a")
        if found is None:
            assert store.counts.damaged + store.counts.dangling == before + 1
            assert not key_file_of(tmp_path, "a").exists()
            assert store.get("a") is None
            outcomes["dropped"] += 1
            put_back(store, "a", 1)
        else:
            assert same_bits(found, drawn(1)), f"another picture with byte {place} flipped"
            outcomes["right"] += 1
            of(tmp_path, "a").write_bytes(whole)
    return outcomes


def test_a_flipped_bit_of_a_picture_never_gives_another_one(tmp_path: Path) -> None:
    outcomes = flipped_everywhere(tmp_path, 300, object_of, seed=0)
    # a date, an aspect ratio and the like say nothing about pixels
    assert outcomes["dropped"] > 180
    assert sum(outcomes.values()) == 300


def test_a_flipped_bit_in_any_byte_of_a_key_is_found_out(tmp_path: Path) -> None:
    assert flipped_everywhere(tmp_path, None, key_file_of, seed=0) == {"dropped": 130, "right": 0}


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_flipped_bit_in_any_byte_of_a_picture_never_gives_another_one(tmp_path: Path, seed: int) -> None:
    outcomes = flipped_everywhere(tmp_path, None, object_of, seed)
    assert sum(outcomes.values()) > 1100
    assert outcomes["dropped"] > 700


@pytest.mark.parametrize("of", [object_of, key_file_of])
def test_a_file_cut_off_anywhere_is_found_out(tmp_path: Path, of: Callable[[Path, str], Path]) -> None:
    store = DiskPictures(tmp_path, 10**6)
    store.put("a", drawn(1))
    length = of(tmp_path, "a").stat().st_size
    for end in range(0, length, 7 if of is object_of else 1):
        os.truncate(of(tmp_path, "a"), end)
        assert store.get("a") is None
        assert not key_file_of(tmp_path, "a").exists()
        put_back(store, "a", 1)


def folder_instead(file: Path) -> None:
    file.unlink()
    file.mkdir()
    (file / "inside").write_text("x")


def pipe_instead(file: Path) -> None:
    file.unlink()
    os.mkfifo(file)


def link_instead(file: Path) -> None:
    file.unlink()
    file.symlink_to("/dev/zero")


def loop_instead(file: Path) -> None:
    file.unlink()
    file.symlink_to(file.name)


class Poison:
    def __reduce__(self) -> tuple[Callable[..., object], tuple[str, ...]]:
        return os.mkdir, (str(Path.cwd() / "poisoned"),)


INSTEAD: dict[str, Callable[[Path], object]] = {
    "nothing in it": lambda file: file.write_bytes(b""),
    "a folder": folder_instead,
    "a pipe": pipe_instead,
    "a link to a device": link_instead,
    "a link to itself": loop_instead,
    "a pickle": lambda file: file.write_bytes(pickle.dumps(Poison())),
    "text": lambda file: file.write_text("not a picture"),
    "noise": lambda file: file.write_bytes(np.random.default_rng(0).bytes(1000)),
    "more at its end": lambda file: file.write_bytes(b"\0" * 5000),
}


@pytest.mark.parametrize("what", INSTEAD)
@pytest.mark.parametrize("of", [object_of, key_file_of])
def test_something_else_in_its_place_is_dropped(
    tmp_path: Path, what: str, of: Callable[[Path, str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    folder = tmp_path / "cache"
    store = ViewStore(0, folder, 10**6)
    store.store("a", drawn(1), level=2)
    INSTEAD[what](of(folder, "a"))
    assert "a" not in store
    assert store.get("a") is None
    assert store.where("a") is None
    assert store.statistics.damaged == 1
    assert not os.path.lexists(key_file_of(folder, "a"))
    store.store("a", drawn(1), level=2)
    assert same_bits(store.get("a"), drawn(1))
    INSTEAD[what](of(folder, "a"))
    fresh = ViewStore(0, folder, 10**6)  # sweeps
    assert fresh.get("a") is None
    fresh.store("a", drawn(1), level=2)
    assert same_bits(fresh.get("a"), drawn(1))
    INSTEAD[what](of(folder, "a"))
    fresh.store("a", drawn(2), level=2)  # over whatever lies there
    assert same_bits(fresh.get("a"), drawn(2))
    assert fresh.statistics.failed_writes == 0
    assert list((tmp_path / "here").iterdir()) == []


def test_two_pictures_that_changed_places_are_both_dropped(tmp_path: Path) -> None:
    store = DiskPictures(tmp_path, 10**6)
    for of in (object_of, key_file_of):
        for key, seed in (("a", 1), ("b", 2)):
            put_back(store, key, seed)
        one, other = of(tmp_path, "a"), of(tmp_path, "b")
        one.rename(tmp_path / "aside")
        other.rename(one)
        (tmp_path / "aside").rename(other)
        assert store.get("a") is None
        assert store.get("b") is None
    assert store.counts.damaged == 4


def test_a_key_whose_picture_is_gone_is_dropped(tmp_path: Path) -> None:
    store = DiskPictures(tmp_path, 10**6)
    store.put("a", drawn(1))
    store.put("b", drawn(1))
    object_of(tmp_path, "a").unlink()
    assert store.get("a") is None
    assert store.get("b") is None
    assert (store.counts.dangling, store.counts.damaged) == (2, 0)
    put_back(store, "a", 1)


def test_what_no_key_leads_to_and_what_was_left_half_written_is_swept(tmp_path: Path) -> None:
    store = DiskPictures(tmp_path, 10**6)
    for seed in range(4):
        store.put(f"{seed}", drawn(seed))
    key_file_of(tmp_path, "1").unlink()
    object_of(tmp_path, "2").unlink()
    (tmp_path / "parts" / "left.exr").write_bytes(b"half")
    fresh = DiskPictures(tmp_path, 10**6)
    assert (fresh.counts.leftovers, fresh.counts.dangling) == (2, 1)
    assert [fresh.get(f"{seed}") is not None for seed in range(4)] == [True, False, False, True]
    files = [file for file in tmp_path.rglob("*") if file.is_file()]
    assert len(files) == 5  # two pictures, two keys, and the ledger
    assert fresh.bytes() == sum(file.stat().st_size for file in files if file.name != "ledger")


@pytest.mark.parametrize("ledger", [b"", b"x", b"-5\n", b"7", b"\xff" * 40, b"0\n", b"99999999999999\n"])
def test_a_wrong_ledger_costs_time_at_most(tmp_path: Path, ledger: bytes) -> None:
    store = DiskPictures(tmp_path, 6000)
    for seed in range(3):
        store.put(f"{seed}", drawn(seed))
    (tmp_path / "ledger").write_bytes(ledger)
    store.put("3", drawn(3))
    for seed in range(0 if ledger != b"0\n" else 3, 4):
        assert same_bits(store.get(f"{seed}"), drawn(seed))
    assert DiskPictures(tmp_path, 6000).bytes() <= 6000


def test_the_folder_may_be_removed_meanwhile(tmp_path: Path) -> None:
    store = ViewStore(0, tmp_path / "cache", 10**6)
    for part in ("", "objects", "keys", "parts"):
        store.store("a", drawn(1), level=2)
        shutil.rmtree(tmp_path / "cache" / part)
        assert part == "parts" or store.get("a") is None
        store.store("b", drawn(2), level=2)
        assert same_bits(store.get("b"), drawn(2))
    assert store.statistics.failed_writes == 0
