"""Whatever becomes of the folder or a file in it: a picture is bit for bit the one that was stored, or a miss."""

import multiprocessing
import os
import pickle
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.queues import SimpleQueue
from multiprocessing.synchronize import Event
from pathlib import Path

import numpy as np
import pytest

from harness.playback.disk import HEADER_BYTES, OURS, DiskPictures, frozen
from harness.playback.store import ViewStore
from scenes.files.errors import InputError
from tests.harness.playback.drawn import drawn, same_bits

ON_DISK = HEADER_BYTES + drawn(0).nbytes
BOUND = 8 * ON_DISK
"""For two thirds of the keys of a storm: something has to go all the time."""


def file_of(folder: Path) -> Path:
    """The file of the only picture."""
    (file,) = (file for file in folder.iterdir() if OURS.fullmatch(file.name))
    return file


def held(folder: Path) -> int:
    return sum(file.stat().st_size for file in folder.iterdir())


@pytest.mark.parametrize("shape", [(1, 1, 1), (5, 7, 5), (3, 2, 2), (100, 100, 5), (4, 5, 64)])
def test_a_picture_comes_back_bit_for_bit_and_cannot_be_written(tmp_path: Path, shape: tuple[int, int, int]) -> None:
    assert DiskPictures(tmp_path, 10**6).put("a", drawn(1, *shape))
    picture = DiskPictures(tmp_path, 10**6).get("a")
    assert same_bits(picture, drawn(1, *shape))
    assert picture is not None
    with pytest.raises(ValueError, match="WRITEABLE"):
        picture.setflags(write=True)


def test_a_frozen_picture_is_a_copy_of_what_is_one() -> None:
    picture = drawn(3)
    kept = frozen(picture)
    picture[:] = 0.0
    assert same_bits(kept, drawn(3))
    for value in (picture.astype(np.float64), picture.tolist()):
        with pytest.raises(TypeError, match="float32"):
            frozen(value)
    for shape in ((5, 7), (0, 7, 5), (1, 1, 65)):
        with pytest.raises(ValueError, match="height, width, channels"):
            frozen(np.zeros(shape, np.float32))
    with pytest.raises(ValueError, match="1 of 175 values of a picture are not finite"):
        frozen(np.where(np.arange(175).reshape(5, 7, 5) == 4, np.nan, picture).astype(np.float32))


def test_a_flipped_bit_in_any_byte_and_a_cut_at_any_place_are_found_out(tmp_path: Path) -> None:
    pictures, generator = DiskPictures(tmp_path, 10**6), np.random.default_rng(0)
    assert pictures.put("a", drawn(1))
    whole = file_of(tmp_path).read_bytes()
    places = [*range(HEADER_BYTES + 8), *range(HEADER_BYTES + 8, len(whole), 13)]
    for place in places:
        flipped = bytearray(whole)
        flipped[place] ^= 1 << int(generator.integers(8))
        for damaged in (bytes(flipped), whole[:place]):
            file_of(tmp_path).write_bytes(damaged)
            assert pictures.get("a") is None
            assert held(tmp_path) == 0
            assert pictures.put("a", drawn(1))
    assert pictures.counts["damaged"] == 2 * len(places)
    assert same_bits(pictures.get("a"), drawn(1))


def test_pictures_that_changed_places_are_dropped(tmp_path: Path) -> None:
    pictures = DiskPictures(tmp_path, 10**6)
    assert pictures.put("a", drawn(1))
    first = file_of(tmp_path)
    assert pictures.put("b", drawn(2))
    second = next(file for file in tmp_path.iterdir() if file != first)
    first.replace(second)
    assert pictures.get("a") is None
    assert pictures.get("b") is None
    assert pictures.counts["damaged"] == 1


def instead(make: Callable[[Path], object]) -> Callable[[Path], object]:
    def replace(file: Path) -> None:
        file.unlink()
        make(file)

    return replace


def folder_with_something(file: Path) -> None:
    file.mkdir()
    (file / "inside").write_text("x")


class Poison:
    def __reduce__(self) -> tuple[Callable[..., object], tuple[str, ...]]:
        return os.mkdir, (str(Path.cwd() / "poisoned"),)


INSTEAD: dict[str, Callable[[Path], object]] = {
    "nothing in it": lambda file: file.write_bytes(b""),
    "a folder": instead(folder_with_something),
    "a pipe": instead(os.mkfifo),
    "a link to a device": instead(lambda file: file.symlink_to("/dev/zero")),
    "a link to itself": instead(lambda file: file.symlink_to(file.name)),
    "a pickle": lambda file: file.write_bytes(pickle.dumps(Poison())),
    "noise": lambda file: file.write_bytes(np.random.default_rng(0).bytes(1000)),
    "more at its end": lambda file: file.write_bytes(file.read_bytes() + b"\0"),
    "a shape of other pixels": lambda file: file.write_bytes(b"view 1\n" + b"\xff" * 800),
}


@pytest.mark.parametrize("what", INSTEAD)
def test_something_else_in_its_place_is_dropped_or_written_over(
    tmp_path: Path, what: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    pictures = DiskPictures(tmp_path / "cache", 10**6)
    assert pictures.put("a", drawn(1))
    INSTEAD[what](file_of(tmp_path / "cache"))
    assert pictures.get("a", use=False) is None
    assert pictures.counts["damaged"] == 1
    assert not list((tmp_path / "cache").iterdir())
    assert pictures.put("a", drawn(1))
    INSTEAD[what](file_of(tmp_path / "cache"))
    assert pictures.put("a", drawn(2))
    assert same_bits(pictures.get("a"), drawn(2))
    assert pictures.counts["failed"] == 0
    assert not list((tmp_path / "here").iterdir())


def test_the_folder_may_be_removed_meanwhile(tmp_path: Path) -> None:
    pictures = DiskPictures(tmp_path / "cache", 10**6)
    assert pictures.put("a", drawn(1))
    shutil.rmtree(tmp_path / "cache")
    assert pictures.get("a") is None
    assert pictures.put("b", drawn(2))
    assert same_bits(pictures.get("b"), drawn(2))


@pytest.mark.parametrize(
    "key", ["", "/", "../../../etc/passwd", "a\0b", "ä🙂", "\ud800", "x" * 100_000, ".", "-rf", "a/b\\c", "\n"]
)
def test_any_string_is_a_key(tmp_path: Path, key: str) -> None:
    assert DiskPictures(tmp_path / "cache", 10**6).put(key, drawn(1))
    fresh = DiskPictures(tmp_path / "cache", 10**6)
    assert same_bits(fresh.get(key), drawn(1))
    assert fresh.get(key + "x") is None
    assert [entry.name for entry in tmp_path.iterdir()] == ["cache"]


@pytest.mark.parametrize("where", ["file", "file/below", "/proc/views"])
def test_a_folder_that_cannot_be_one_is_an_error_that_names_it(tmp_path: Path, where: str) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=where):
        ViewStore(10, tmp_path / where)


def test_the_folder_stays_within_its_bound_and_the_least_recently_used_go(tmp_path: Path) -> None:
    pictures = DiskPictures(tmp_path, 10 * ON_DISK)
    left = tmp_path / f".{'a' * 64}.1.part"
    left.write_bytes(b"half")  # of a writer that was killed
    os.utime(left, (1.0, 1.0))
    for seed in range(60):
        assert pictures.put(f"{seed}", drawn(seed))
        assert same_bits(pictures.get("0"), drawn(0)), f"used at every step, gone after {seed}"
        assert held(tmp_path) <= 10 * ON_DISK
    assert not left.exists()
    kept = [seed for seed in range(1, 60) if pictures.get(f"{seed}") is not None]
    assert kept == list(range(60 - len(kept), 60))
    assert len(kept) >= 6
    assert pictures.counts["evicted"] == 61 - len(kept) - 1


def test_a_picture_larger_than_the_folder_may_be_is_refused(tmp_path: Path) -> None:
    pictures = DiskPictures(tmp_path, 500)
    assert not pictures.put("a", drawn(1))
    assert "in a cache of 500" in str(pictures.failure)
    assert held(tmp_path) == 0


@contextmanager
def files_of_at_most(limit: int) -> Iterator[None]:
    """What is beyond is refused by the system, after what still fits was taken: as on a full disk."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("limit", [0, 1, 100, 600])
def test_a_disk_that_is_full_costs_no_picture(tmp_path: Path, limit: int) -> None:
    store = ViewStore(10**6, tmp_path, 10**6)
    store.store("before", drawn(1), level=2)
    store.store("again", drawn(2), level=2)
    with files_of_at_most(limit):
        for seed, key in ((3, "again"), (4, "new")):
            store.store(key, drawn(seed), level=2)
            assert store.where(key) == 1
            assert same_bits(store.get(key), drawn(seed))
    assert store.failure
    following = ViewStore(0, tmp_path, 10**6)
    assert same_bits(following.get("before"), drawn(1))
    assert following.get("again") is None, "no older picture is left"
    assert len(list(tmp_path.iterdir())) == 1


KEYS = 12
SPAWN = multiprocessing.get_context("spawn")


def storm(folder: Path, seed: int, seconds: float, began: Event, counts: SimpleQueue[tuple[int, ...]]) -> None:
    """Put pictures and get them again, in a process of its own."""
    generator = np.random.default_rng(seed)
    pictures = DiskPictures(folder, BOUND)
    began.set()
    until = time.monotonic() + seconds
    wrong = puts = gets = 0
    while time.monotonic() < until:
        key = int(generator.integers(KEYS))
        if generator.random() < 0.5:
            pictures.put(f"{key}", drawn(key))
            puts += 1
        else:
            picture = pictures.get(f"{key}")
            wrong += picture is not None and not same_bits(picture, drawn(key))
            gets += 1
    counts.put((puts, gets, wrong, pictures.counts["damaged"], pictures.counts["failed"]))


def found_in(folder: Path) -> None:
    """The folder as the next user finds it: nothing but complete pictures, and it can be used."""
    pictures = DiskPictures(folder, BOUND)
    for key in range(KEYS):
        picture = pictures.get(f"{key}")
        assert picture is None or same_bits(picture, drawn(key))
    assert held(folder) <= 1.2 * BOUND
    assert pictures.put("0", drawn(0))
    assert same_bits(pictures.get("0"), drawn(0))
    assert (pictures.counts["damaged"], pictures.counts["failed"]) == (0, 0)


def test_processes_at_once_on_one_folder(tmp_path: Path) -> None:
    """With one more that is killed at some moment."""
    counts: SimpleQueue[tuple[int, ...]] = SPAWN.SimpleQueue()
    processes = []
    for seed, seconds in enumerate((1.5, 1.5, 60.0)):
        began = SPAWN.Event()
        processes.append(SPAWN.Process(target=storm, args=(tmp_path, seed, seconds, began, counts)))
        processes[-1].start()
        assert began.wait(120)
    processes[-1].kill()
    for process in processes:
        process.join()
    for _ in processes[:-1]:
        puts, gets, *faults = counts.get()
        assert min(puts, gets) > 5
        assert faults == [0, 0, 0]
    found_in(tmp_path)
