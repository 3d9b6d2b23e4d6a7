"""A process that kills itself at one moment of putting a picture into a folder.

    python -m tests.harness.playback.killed FOLDER MOMENT KEY SEED

It ends with 3 where the moment never came.
"""

import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from harness.playback import disk
from harness.playback.store import ViewStore
from tests.harness.playback.drawn import drawn

BOUND = 8 * 1300


def die(*arguments: object) -> NoReturn:
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError("still alive")


def after(works: Callable[..., Any]) -> Callable[..., None]:
    def call(*arguments: Any) -> None:
        works(*arguments)
        die()

    return call


def half_written(file: Path, picture: np.ndarray) -> None:
    WRITE(file, picture)
    os.truncate(file, file.stat().st_size // 2)
    die()


def at_second(works: Callable[..., Any]) -> Callable[..., None]:
    calls: list[object] = []

    def call(*arguments: Any) -> None:
        calls.append(arguments)
        if len(calls) == 2:
            die()
        works(*arguments)

    return call


WRITE = disk.write_exr
MOMENTS: dict[str, tuple[Any, str, Callable[..., None]]] = {
    "while the EXR file is written": (disk, "write_exr", half_written),
    "before the lock": (disk, "locked", die),
    "after the ledger is emptied": (os, "ftruncate", after(os.ftruncate)),
    "while room is made": (disk.DiskPictures, "_swept", die),
    "before the first rename": (disk, "rename", die),
    "between the two renames": (disk, "rename", at_second(disk.rename)),
    "before the ledger is written": (disk, "write_ledger", die),
}
"""Moment → what is replaced once the folder is open, and by what."""


def main(folder: str, moment: str, key: str, seed: str) -> int:
    store = ViewStore(0, Path(folder), BOUND)
    setattr(*MOMENTS[moment])
    store.store(key, drawn(int(seed)), level=2)
    return 3


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
