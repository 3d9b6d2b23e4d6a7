"""Several threads and several processes on one store, and processes that are killed while they write."""

import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from harness.view_cache import keys
from harness.view_cache.store import ViewStore
from tests.harness.view_cache.drawn import drawn, same_bits
from tests.harness.view_cache.storm import KEYS

BOUND = 8 * 1300
"""For two thirds of the keys: something has to go all the time."""


def storm(folder: Path, seed: int, seconds: float) -> subprocess.Popen[str]:
    """One that has opened the folder."""
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.harness.view_cache.storm", str(folder), f"{seed}", f"{seconds}", f"{BOUND}"],
        cwd=keys.ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n", process.communicate()[1]
    return process


def sound(folder: Path) -> ViewStore:
    """The folder as the next one finds it: only whole pictures, nothing half written, and it can be used."""
    store = ViewStore(0, folder, BOUND)
    assert store.statistics.damaged == 0
    for key in range(KEYS):
        found = store.get(f"{key}")
        assert found is None or same_bits(found, drawn(key))
    statistics = store.statistics
    assert (statistics.damaged, statistics.dangling) == (0, 0), "the sweep has found them all"
    assert statistics.bytes[2] <= BOUND
    assert list((folder / "parts").iterdir()) == []
    store.store("0", drawn(0), level=2)
    assert same_bits(store.get("0"), drawn(0))
    assert store.statistics.failed_writes == 0
    return store


def killed_writers(folder: Path, kills: int, seed: int) -> int:
    """Kills as many writers, each at a random moment of its first milliseconds; how many left something to sweep."""
    generator = np.random.default_rng(seed)
    left = 0
    for kill in range(kills):
        process = storm(folder, seed + kill, 60.0)
        time.sleep(float(generator.uniform(0.0, 0.06)))
        process.send_signal(signal.SIGKILL)
        process.communicate()
        assert process.returncode == -signal.SIGKILL
        left += (folder / "ledger").read_bytes() == b"" or any((folder / "parts").iterdir())
        sound(folder)
    return left


def test_a_killed_writer_leaves_whole_pictures(tmp_path: Path) -> None:
    killed_writers(tmp_path, 5, seed=100)


@pytest.mark.slow
def test_many_killed_writers(tmp_path: Path) -> None:
    assert killed_writers(tmp_path, 100, seed=1000) > 10, "kills that hit nothing show nothing"


def test_processes_at_once_on_one_folder(tmp_path: Path) -> None:
    processes = [storm(tmp_path, seed, 1.5) for seed in range(2)]
    killed = storm(tmp_path, 2, 60.0)
    time.sleep(0.5)
    killed.send_signal(signal.SIGKILL)
    killed.communicate()
    for process in processes:
        said, complaint = process.communicate()
        assert process.returncode == 0, said + complaint
        assert complaint == ""
        puts, gets, wrong, damaged, failed = map(int, said.split()[:5])
        assert puts > 5
        assert gets > 5
        assert (wrong, damaged, failed) == (0, 0, 0), said
    sound(tmp_path)


def test_threads_at_once_on_one_store(tmp_path: Path) -> None:
    """Of little memory, so that pictures move between all levels."""
    store = ViewStore(4 * drawn(0).nbytes, tmp_path, BOUND)
    errors: list[str] = []

    def work(seed: int) -> None:
        generator = np.random.default_rng(seed)
        try:
            for _ in range(60):
                key = int(generator.integers(KEYS))
                if generator.random() < 0.5:
                    store.store(f"{key}", drawn(key), int(generator.integers(3)))
                found = store.get(f"{key}")
                if found is not None and not same_bits(found, drawn(key)):
                    errors.append(f"another picture under {key}")
                store.where(f"{key}")
                store.statistics  # noqa: B018
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
    assert statistics.bytes[0] + statistics.bytes[1] <= 4 * drawn(0).nbytes
    assert statistics.bytes[2] <= BOUND
