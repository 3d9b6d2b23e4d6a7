"""One file of each kind that a run writes, damaged in every way: what is said, and whether it comes out as before."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from tests.endurance.forked import run
from tests.endurance.kills import arguments_for
from tests.endurance.same_results import differences

KINDS = (
    "out/records/plan.json",
    "out/records/run.json",
    "out/records/comparisons.json",
    "out/records/targets.json",
    "out/records/cells/hotdog.nerf.0.json",
    "out/records/pictures/hotdog.safetensors",
    "out/records/pictures/hotdog.nerf.0.safetensors",
    "out/checkpoints/lego.qnerf.0.safetensors",
    "view_sets/hotdog-*/view_set.json",
    "view_sets/hotdog-*/train/r_3.png",
    "view_sets/hotdog-*/test/r_1.exr",
    "view_sets/hotdog-*/transforms_train.json",
    "view_sets/hotdog-*/rendered.jsonl",
)
"""Paths below the folder that holds a run and its view sets."""
BOMB = b"cposix\nsystem\n(S'touch UNPICKLED'\ntR."
"""A pickle that makes a file where it is read; nothing of ours reads one."""


class Row(NamedTuple):
    """One damage, and what came of it."""

    line: str
    wrong: list[str]


def _flip(place: float) -> Callable[[Path], None]:
    def flip(path: Path) -> None:
        data = bytearray(path.read_bytes())
        data[min(int(place * len(data)), len(data) - 1)] ^= 0x15
        path.write_bytes(data)

    return flip


def _folder(path: Path) -> None:
    path.unlink()
    path.mkdir()
    (path / "somebody's.txt").write_text("mine")


WAYS: dict[str, Callable[[Path], None]] = {
    "a byte near its start": _flip(0.01),
    "a byte in its middle": _flip(0.5),
    "its last byte but a few": _flip(0.99),
    "removed": Path.unlink,
    "cut off": lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 3]),
    "emptied": lambda path: path.write_bytes(b""),
    "a folder instead": _folder,
    "a pickle instead": lambda path: path.write_bytes(BOMB) and None,
}


def damages(reference: Path, scratch: Path, each: int | None = None) -> Iterator[Row]:
    """Damage every kind in every way, each on a copy of an undisturbed run; or `each` in so many ways, the next kind in
    the next ones.
    """
    ways = [*WAYS]
    for place, kind in enumerate(KINDS):
        for turn in range(len(ways) if each is None else each):
            yield damaged(reference, scratch, kind, ways[(place + turn) % len(ways)])


def damaged(reference: Path, scratch: Path, kind: str, how: str) -> Row:
    """Damage one file in one way, and resume the run."""
    shutil.rmtree(scratch, ignore_errors=True)
    shutil.copytree(reference, scratch)
    path = next(scratch.glob(kind))
    WAYS[how](path)
    ended = run([argument for argument in arguments_for(scratch, resume=True) if argument != "--quiet"], scratch)
    wrong = [f"unpickled: {file}" for file in (*scratch.rglob("UNPICKLED"), *Path.cwd().glob("UNPICKLED"))]
    wrong += differences(scratch, reference) if ended.code == 0 else [f"exit code {ended.code}: {ended.printed[-300:]}"]
    lines = [line for line in ended.printed.splitlines() if path.name in line or ": missing" in line]
    printed = " / ".join(lines).replace(f"{scratch}/", "")[:300]
    return Row(f"{kind}, {how}: {printed or 'nothing to say'}{' WRONG' if wrong else ''}", wrong)
