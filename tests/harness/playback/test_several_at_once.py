"""Several threads and several processes on one store."""

import signal
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from harness.playback.store import ViewStore
from tests.harness.playback.drawn import drawn, same_bits
from tests.harness.playback.storm import BOUND, KEYS, sound, storm


@pytest.mark.parametrize("killed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_processes_at_once_on_one_folder(tmp_path: Path, killed: int) -> None:
    """With one more that is killed at some moment."""
    processes = [storm(tmp_path, seed, 1.5) for seed in range(2)]
    for seed in range(killed):
        process = storm(tmp_path, 2 + seed, 60.0)
        time.sleep(0.5)
        process.send_signal(signal.SIGKILL)
        process.communicate()
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
