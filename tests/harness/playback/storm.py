"""A process that puts pictures into a folder and gets them again until its seconds are over or it is killed.

    python -m tests.harness.playback.storm FOLDER SEED SECONDS BOUND

It ends with 1 where a picture is another one than was put under its key, and prints what it counted.
"""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from harness.playback.store import ViewStore
from tests.harness.playback.drawn import drawn, same_bits

ROOT = Path(__file__).parents[3]
KEYS = 12
BOUND = 8 * 1300
"""For two thirds of the keys: something has to go all the time."""


def say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def storm(folder: Path, seed: int, seconds: float) -> subprocess.Popen[str]:
    """One that has opened the folder."""
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.harness.playback.storm", str(folder), f"{seed}", f"{seconds}", f"{BOUND}"],
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
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


def main(folder: str, seed: str, seconds: str, bound: str) -> int:
    generator = np.random.default_rng(int(seed))
    store = ViewStore(0, Path(folder), int(bound))
    say("ready")
    until = time.monotonic() + float(seconds)
    wrong = puts = gets = 0
    while time.monotonic() < until:
        key = int(generator.integers(KEYS))
        if generator.random() < 0.5:
            store.store(f"{key}", drawn(key), level=2)
            puts += 1
        else:
            found = store.get(f"{key}")
            wrong += found is not None and not same_bits(found, drawn(key))
            gets += 1
    statistics = store.statistics
    say(f"{puts} {gets} {wrong} {statistics.damaged} {statistics.failed_writes} {statistics.last_failure}")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
