"""Runs that are killed again and again, gone on with, and then compared with one that nobody disturbed."""

import random
import shutil
import signal
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from tests.endurance.forked import FULL, POINTS, Ended, run
from tests.endurance.same_results import cells_gone_on, left_behind, same_results, same_view_sets

SCENES = ["hotdog", "lego"]
OPTIONS = ["run", "--profile", "smoke", "--scenes", *SCENES, "--methods", "nerf", "qnerf", "--seeds", "1",
           "--budget-steps", "6", "--workers", "1", "--quiet", "--device", "cpu", "--keep-every", "0"]  # fmt: skip
CELLS = 4
ROOM_BYTES = 4500
"""Of a file, where the disk is full while rendering."""
NO_RUN_YET = "holds no run to go on with"
MANY_IN_TRAINING = 10
"""Kills: after so many in training, some cell must have gone on in the middle."""
MOST_KILLS = 6
"""Of one folder, before it is let go on to its end."""


@dataclass
class Found:
    """What a storm met."""

    phases: Counter[str] = field(default_factory=Counter)
    """Where runs were when they were killed."""
    wrong: list[str] = field(default_factory=list)
    folders: int = 0
    gone_on: int = 0
    """Cells that went on in the middle of their training."""
    too_late: int = 0
    """Runs that ended before they could be killed."""

    @property
    def kills(self) -> int:
        return sum(self.phases.values())


def undisturbed(scratch: Path) -> Ended:
    """Into `scratch/out`, with view sets in `scratch/view_sets`; raises `AssertionError` where it fails."""
    scratch.mkdir(parents=True)
    ended = run(arguments_for(scratch), scratch)
    assert ended.code == 0, ended.said
    return ended


def arguments_for(scratch: Path, resume: bool = False, serving: bool = False) -> list[str]:
    folders = ["--out", str(scratch / "out"), "--view-sets", str(scratch / "view_sets")]
    return [*OPTIONS, *folders, *(["--resume"] if resume else []), *([] if serving else ["--no-serving"])]


def storm(count: int, seed: int, scratch: Path, reference: Path, seconds: float, say: Callable[[str], None]) -> Found:
    """`count` kills of runs that take `seconds` each undisturbed; what was undisturbed is in `reference`."""
    found, draws = Found(), random.Random(seed)
    while found.kills < count:
        found.folders += 1
        here = scratch / f"{found.folders}"
        here.mkdir(parents=True)
        serving = draws.random() < 0.1
        planned = min(draws.randint(1, MOST_KILLS), count - found.kills)
        began = False
        for _ in range(planned):
            ended = _killed(here, began, serving, draws, seconds)
            began = _says_on(ended, began)
            if ended.was_killed:
                found.phases[ended.phase] += 1
            else:
                found.too_late += 1
                if ended.code != 0 and NO_RUN_YET not in ended.said:
                    found.wrong.append(f"folder {found.folders}: ended with {ended.code}: {ended.said[-400:]}")
        found.wrong += [f"folder {found.folders}: {line}" for line in completed(here, reference, serving)]
        found.gone_on += cells_gone_on(here / "out")
        phases = ", ".join(f"{many} {name}" for name, many in found.phases.most_common())
        say(f"{found.kills} kills ({phases}), {found.folders} folders, {len(found.wrong)} wrong")
        if not any(line.startswith(f"folder {found.folders}:") for line in found.wrong):
            shutil.rmtree(here)
    if found.phases["training"] >= MANY_IN_TRAINING and not found.gone_on:
        found.wrong.append("no cell went on in the middle of its training")
    return found


def completed(here: Path, reference: Path, serving: bool = False) -> list[str]:
    """Goes on with what was killed, to its end, and what is then not as in `reference`."""
    ended = run(arguments_for(here, resume=True, serving=serving), here)
    if ended.code == 2 and NO_RUN_YET in ended.said:  # killed before there was anything
        ended = run(arguments_for(here, serving=serving), here)
    if ended.code != 0:
        return [f"--resume ended with {ended.code}: {ended.said[-600:]}"]
    return differences(here, reference)


def differences(here: Path, reference: Path) -> list[str]:
    """Between a run that was killed and gone on with and one that nobody disturbed, and what the first left behind."""
    left = [f"left behind: {name}" for name in left_behind(here)]
    return (
        left
        + same_results(reference / "out", here / "out")
        + same_view_sets(reference / "view_sets", here / "view_sets")
    )


def _killed(here: Path, began: bool, serving: bool, draws: random.Random, seconds: float) -> Ended:
    """Three of ten at a write, the others at any time; one of five of those without its group."""
    arguments = arguments_for(here, resume=began, serving=serving)
    if draws.random() < 0.3:
        return run(arguments, here, point=(draws.choice(POINTS), draws.randint(1, 30)))
    after = draws.uniform(0.0, seconds * (2.0 if serving else 1.0))
    return run(arguments, here, after=after, alone=draws.random() < 0.2, phase_of=lambda: phase_of(here))


def _says_on(ended: Ended, began: bool) -> bool:
    """Whether the next run goes on; before a run has made its folder there is nothing to go on with."""
    return NO_RUN_YET not in ended.said and (began or ended.phase != "starting")


def phase_of(here: Path, scenes: list[str] = SCENES, every_cell: int = CELLS) -> str:
    """Where a run of these scenes and so many cells is, by what lies there."""
    out, sets = here / "out", here / "view_sets"
    if list(out.rglob(".*.part")):
        return "writing"
    if not (out / "records" / "plan.json").exists():
        return "starting"
    if not (out / "records" / "run.json").exists():
        whole = [one for one in sets.glob("*") if not one.name.startswith(".")] if sets.exists() else []
        return "rendering" if len(whole) < len(scenes) else "reading view sets"
    cells = len(list((out / "records" / "cells").glob("*.json")))
    if cells < every_cell:
        return "training"
    return "serving" if list(out.glob(".scratch-*")) else "after training"


def on_a_full_disk(here: Path, rendering: bool, write: int) -> Ended:
    """A run whose disk is full while it is `rendering`, or from its n-th `write` on."""
    import resource

    if not rendering:
        return run(arguments_for(here), here, point=(FULL, write))
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM_BYTES, before[1]))
    try:
        return run(arguments_for(here), here)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def stopped(here: Path, after: float, number: int = signal.SIGINT) -> Ended:
    """A run that is asked to stop."""
    return run(arguments_for(here), here, after=after, signals=(number,), phase_of=lambda: phase_of(here))
