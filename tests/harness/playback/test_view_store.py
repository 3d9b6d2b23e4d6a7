"""A stored picture comes back bit-identical or is a miss, under any damage of the folder and its files."""

import hashlib
import multiprocessing
import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.queues import SimpleQueue
from multiprocessing.synchronize import Event
from pathlib import Path

import numpy as np
import pytest

from harness.playback.store import CHECKSUM_BYTES, Place, ViewStore
from scenes.files.errors import InputError

SHAPE = (5, 7, 5)


def drawn(seed: int) -> np.ndarray:
    """Return finite numbers of random bits, with zeros of both signs and denormals."""
    value = np.random.default_rng(seed).integers(0, 2**32, SHAPE, dtype=np.uint32).view(np.float32)
    value = np.where(np.isfinite(value), value, np.float32(0.5))
    value.reshape(-1)[:4] = [-0.0, 0.0, 1e-45, np.finfo(np.float32).max]
    value.setflags(write=False)
    return value


ON_DISK = CHECKSUM_BYTES + drawn(0).nbytes


def key(seed: int) -> str:
    return hashlib.sha256(bytes([seed])).hexdigest()


def put(store: ViewStore, seed: int) -> None:
    store.store(key(seed), drawn(seed))


def place_of(store: ViewStore, seed: int) -> Place | None:
    """Return the place of the picture; fails if another picture comes back."""
    if (hit := store.get(key(seed), SHAPE)) is None:
        return None
    assert (hit[0].dtype, hit[0].tobytes()) == (np.float32, drawn(seed).tobytes())
    with pytest.raises(ValueError, match="WRITEABLE"):
        hit[0][..., :3].setflags(write=True)
    return hit[1]


def held(folder: Path) -> int:
    return sum(file.stat().st_size for file in folder.iterdir())


def test_a_picture_comes_back_bit_for_bit_from_memory_and_from_disk(tmp_path: Path) -> None:
    first = ViewStore(disk=tmp_path)
    assert place_of(first, 1) is None
    put(first, 1)
    following = ViewStore(disk=tmp_path)
    assert [place_of(store, 1) for store in (first, following, following)] == ["memory", "disk", "memory"]
    assert following.get(key(1), (7, 5, 5)) is None, "another size"
    assert ViewStore(0, tmp_path).get(key(1), (5, 7, 4)) is None
    assert place_of(ViewStore(), 1) is None


def test_memory_stays_within_its_bound_and_the_least_recently_used_go() -> None:
    store = ViewStore(3 * drawn(0).nbytes)
    for seed in (0, 1, 2, 2):
        put(store, seed)
    assert place_of(store, 0) == "memory"
    put(store, 3)
    assert [place_of(store, seed) for seed in range(4)] == ["memory", None, "memory", "memory"]


def test_the_folder_stays_within_its_bound_and_the_least_recently_used_go(tmp_path: Path) -> None:
    half, mine = tmp_path / f".{key(0)}.1.part", tmp_path / "mine"
    half.write_bytes(b"half")  # of a writer that was killed
    mine.write_bytes(b"")
    store = ViewStore(0, tmp_path, 10 * ON_DISK)
    for seed in range(60):
        put(store, seed)
        for age, file in enumerate([half, *(tmp_path / key(seed) for seed in range(seed + 1))]):
            if file.exists():
                os.utime(file, (age, age))
        assert place_of(store, 0) == "disk", f"used at every step, gone after {seed}"
        assert held(tmp_path) <= 10 * ON_DISK
    assert not half.exists()
    assert mine.exists()
    kept = [seed for seed in range(1, 60) if place_of(store, seed)]
    assert kept == list(range(60 - len(kept), 60))
    assert len(kept) >= 6


def test_a_flipped_bit_in_any_byte_and_a_cut_at_any_place_are_found_out(tmp_path: Path) -> None:
    store, generator, file = ViewStore(0, tmp_path), np.random.default_rng(0), tmp_path / key(1)
    put(store, 1)
    whole = file.read_bytes()
    for place in [*range(CHECKSUM_BYTES + 8), *range(CHECKSUM_BYTES + 8, len(whole), 13)]:
        flipped = bytearray(whole)
        flipped[place] ^= 1 << int(generator.integers(8))
        for damaged in (bytes(flipped), whole[:place]):
            file.write_bytes(damaged)
            assert place_of(store, 1) is None
            assert not file.exists()


INSTEAD: dict[str, Callable[[Path], object]] = {
    "a pipe": lambda file: (file.unlink(), os.mkfifo(file)),
    "a link to a device": lambda file: (file.unlink(), file.symlink_to("/dev/zero")),
    "a link to itself": lambda file: (file.unlink(), file.symlink_to(file)),
    "more at its end": lambda file: file.write_bytes(file.read_bytes() + b"\0"),
    "another picture": lambda file: (file.parent / key(2)).replace(file),
}


@pytest.mark.parametrize("stored_again", [False, True])
@pytest.mark.parametrize("what", INSTEAD)
def test_something_else_in_its_place_is_dropped_or_written_over(tmp_path: Path, what: str, stored_again: bool) -> None:
    store = ViewStore(0, tmp_path)
    put(store, 1)
    put(store, 2)
    INSTEAD[what](tmp_path / key(1))
    if stored_again:
        put(store, 1)
    assert (place_of(store, 1), store.failure) == ("disk" if stored_again else None, None)
    assert (tmp_path / key(1)).exists() == stored_again


def test_the_folder_may_be_removed_meanwhile(tmp_path: Path) -> None:
    store = ViewStore(0, tmp_path / "cache", 10 * ON_DISK)
    put(store, 1)
    shutil.rmtree(tmp_path / "cache")
    assert place_of(store, 1) is None
    put(store, 1)
    assert (place_of(store, 1), store.failure) == ("disk", None)


@pytest.mark.parametrize("where", ["file", "file/below", "/proc/views"])
def test_a_folder_that_cannot_be_one_is_an_error_that_names_it(tmp_path: Path, where: str) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=where):
        ViewStore(10, tmp_path / where)


@contextmanager
def files_of_at_most(limit: int) -> Iterator[None]:
    """Let the system refuse bytes beyond the limit after it has taken those before, as on a full disk."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize(("bound", "limit"), [(10**6, 0), (10**6, 600), (500, 10**6)])
def test_a_picture_that_the_disk_refuses_is_kept_in_memory(tmp_path: Path, bound: int, limit: int) -> None:
    put(ViewStore(0, tmp_path), 0)
    store = ViewStore(disk=tmp_path, disk_bytes=bound)
    with files_of_at_most(limit):
        put(store, 1)
    assert place_of(store, 1) == "memory"
    assert store.failure
    following = ViewStore(0, tmp_path)
    assert place_of(following, 1) is None
    assert place_of(following, 0) == ("disk" if bound > 500 else None)
    assert not list(tmp_path.glob(".*"))


BOUND = 8 * ON_DISK
"""Room for two thirds of the keys of a storm, so that pictures are evicted all the time."""
KEYS = 12
SPAWN = multiprocessing.get_context("spawn")


def storm(folder: Path, seed: int, seconds: float, began: Event, counts: SimpleQueue[tuple[int, int]]) -> None:
    generator, store = np.random.default_rng(seed), ViewStore(0, folder, BOUND)
    began.set()
    until, steps, hits = time.monotonic() + seconds, 0, 0
    while time.monotonic() < until:
        number, steps = int(generator.integers(KEYS)), steps + 1
        if generator.random() < 0.5:
            put(store, number)
        else:
            hits += place_of(store, number) == "disk"
    counts.put((steps, hits))


def test_processes_at_once_on_one_folder(tmp_path: Path) -> None:
    """One of three processes is killed; the folder is valid afterwards."""
    counts: SimpleQueue[tuple[int, int]] = SPAWN.SimpleQueue()
    processes = []
    for seed, seconds in enumerate((1.0, 1.0, 60.0)):
        began = SPAWN.Event()
        processes.append(SPAWN.Process(target=storm, args=(tmp_path, seed, seconds, began, counts)))
        processes[-1].start()
        assert began.wait(120)
    processes[-1].kill()
    for process in processes:
        process.join()
    assert [process.exitcode for process in processes[:-1]] == [0, 0], "no other picture, and no error"
    assert min(min(counts.get()) for _ in processes[:-1]) > 5
    assert held(tmp_path) <= 1.2 * BOUND
    store = ViewStore(0, tmp_path, BOUND)
    for number in range(KEYS):
        place_of(store, number)
    put(store, 0)
    assert (place_of(store, 0), store.failure) == ("disk", None)
