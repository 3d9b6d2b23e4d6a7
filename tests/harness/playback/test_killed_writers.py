"""Writers that are killed by a signal that nobody can catch, at each moment of a write and at random ones."""

import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from harness.playback import keys
from harness.playback.store import ViewStore
from tests.harness.playback.drawn import drawn, same_bits
from tests.harness.playback.killed import BOUND
from tests.harness.playback.storm import sound, storm


@dataclass(frozen=True)
class Left:
    """What a writer leaves that is killed while it puts picture 9 under a key."""

    parts: int
    """Files that were being written."""
    ledger_is_empty: bool
    pictures: int
    """More than before."""
    keys: int
    """More than before, where the key is new."""
    swept: int
    """By the next one who opens the folder."""


MOMENTS = {
    "while the EXR file is written": Left(2, False, 0, 0, 2),
    "before the lock": Left(2, False, 0, 0, 2),
    "after the ledger is emptied": Left(2, True, 0, 0, 2),
    "before the first rename": Left(2, True, 0, 0, 2),
    "between the two renames": Left(1, True, 1, 0, 2),
    "before the ledger is written": Left(0, True, 1, 1, 0),
}


@pytest.mark.parametrize("moment", MOMENTS)
@pytest.mark.parametrize("key", ["new", "0"])
def test_a_writer_that_is_killed_leaves_the_old_picture_or_the_new_one(tmp_path: Path, moment: str, key: str) -> None:
    before, left = filled(tmp_path, 3), MOMENTS[moment]
    kill(tmp_path, moment, key)
    assert len(list((tmp_path / "parts").iterdir())) == left.parts
    assert ((tmp_path / "ledger").read_bytes() == b"") == left.ledger_is_empty
    assert len(files(tmp_path / "objects")) == 3 + left.pictures
    assert len(files(tmp_path / "keys")) == 3 + (left.keys if key == "new" else 0)
    assert before.statistics.damaged == 0
    following = ViewStore(0, tmp_path, BOUND)
    # a picture that was under the key before has no key any more
    assert following.statistics.leftovers == left.swept + (1 if key == "0" and left.keys else 0)
    for store in (before, following):
        found = store.get(key)
        if left.keys:
            assert same_bits(found, drawn(9))
        else:
            assert found is None if key == "new" else same_bits(found, drawn(0))
    usable(tmp_path, following)


def test_a_writer_that_is_killed_while_it_makes_room_leaves_what_was_there(tmp_path: Path) -> None:
    pictures = len(files(fill_up(tmp_path) / "objects"))
    kill(tmp_path, "while room is made", "new")
    assert (tmp_path / "ledger").read_bytes() == b""
    assert len(files(tmp_path / "objects")) == pictures
    following = ViewStore(0, tmp_path, BOUND)
    assert following.statistics.leftovers == 2
    assert following.get("new") is None
    usable(tmp_path, following)


def kill(folder: Path, moment: str, key: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.harness.playback.killed", str(folder), moment, key, "9"],
        cwd=keys.ROOT, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == -signal.SIGKILL, done.stdout + done.stderr


def filled(folder: Path, pictures: int) -> ViewStore:
    store = ViewStore(0, folder, BOUND)
    for seed in range(pictures):
        store.store(f"{seed}", drawn(seed), level=2)
    return store


def fill_up(folder: Path) -> Path:
    """As full as it gets: one more picture has others go."""
    store, seed = ViewStore(0, folder, BOUND), 0
    while store.statistics.bytes[2] + 1200 < BOUND:
        store.store(f"{seed}", drawn(seed), level=2)
        seed += 1
    return folder


def usable(folder: Path, store: ViewStore) -> None:
    """Nothing is left behind, the bound holds, and a picture can be put and got."""
    assert list((folder / "parts").iterdir()) == []
    store.store("after", drawn(7), level=2)
    assert same_bits(store.get("after"), drawn(7))
    statistics = store.statistics
    assert (statistics.damaged, statistics.dangling, statistics.failed_writes) == (0, 0, 0)
    assert statistics.bytes[2] == sum(
        file.stat().st_size for name in ("objects", "keys") for file in files(folder / name)
    )
    assert statistics.bytes[2] <= BOUND


def files(folder: Path) -> list[Path]:
    return [file for file in folder.rglob("*") if file.is_file()]


@pytest.mark.thorough
@pytest.mark.slow
def test_many_writers_killed_at_random(tmp_path: Path) -> None:
    generator = np.random.default_rng(1000)
    left = 0
    for kill in range(100):
        process = storm(tmp_path, 1000 + kill, 60.0)
        time.sleep(float(generator.uniform(0.0, 0.06)))
        process.send_signal(signal.SIGKILL)
        process.communicate()
        assert process.returncode == -signal.SIGKILL
        left += (tmp_path / "ledger").read_bytes() == b"" or any((tmp_path / "parts").iterdir())
        sound(tmp_path)
    assert left > 10, "kills that hit nothing show nothing"
