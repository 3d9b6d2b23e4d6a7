"""A process that puts pictures into a folder and gets them again until its seconds are over or it is killed.

    python -m tests.harness.playback.storm FOLDER SEED SECONDS BOUND

It ends with 1 where a picture is another one than was put under its key, and prints what it counted.
"""

import sys
import time
from pathlib import Path

import numpy as np

from harness.playback.store import ViewStore
from tests.harness.playback.drawn import drawn, same_bits

KEYS = 12


def main(folder: str, seed: str, seconds: str, bound: str) -> int:
    generator = np.random.default_rng(int(seed))
    store = ViewStore(0, Path(folder), int(bound))
    sys.stdout.write("ready\n")
    sys.stdout.flush()
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
    counts = (puts, gets, wrong, statistics.damaged, statistics.failed_writes, statistics.last_failure)
    sys.stdout.write(" ".join(map(str, counts)))
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
