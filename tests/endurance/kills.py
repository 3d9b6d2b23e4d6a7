"""Runs that are killed again and again, resumed, and then compared with one that nobody disturbed."""

import resource
import shutil
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from random import Random
from typing import NamedTuple

from tests.endurance.forked import FULL, POINTS, Ended, run
from tests.endurance.same_results import cells_resumed, differences

SCENES = ("hotdog", "lego")
OPTIONS = ["run", "--profile", "smoke", "--methods", "nerf", "qnerf", "--seeds", "1", "--budget-steps", "6",
           "--workers", "1", "--quiet", "--device", "cpu", "--keep-every", "0"]  # fmt: skip
ROOM_BYTES = 4500
"""The size of a file at which the disk is full while rendering."""
NO_RUN_YET = "holds no run to go on with"
MANY_IN_TRAINING = 10
"""Kills: after so many in training, some cell must have been resumed in the middle."""
MOST_KILLS = 5
"""Of one folder, before it is resumed to its end."""


class Runs(NamedTuple):
    """How the runs of a storm are started; each gets the folder, and whether it resumes and measures serving."""

    name: str
    rendered: float
    """The share of folders that find their view sets rendered, so that more is trained."""
    complete: Callable[[Path, bool, bool], Ended]
    killed: Callable[[Path, bool, bool, Random], Ended]


@dataclass
class Storm:
    """What a storm met."""

    wrong: list[str] = field(default_factory=list)
    phases: Counter[str] = field(default_factory=Counter)
    """Where runs were when they were killed."""
    folders: int = 0
    resumed: int = 0
    """Cells that were resumed in the middle of their training."""
    too_late: int = 0
    """Runs that ended before they could be killed."""

    @property
    def kills(self) -> int:
        return sum(self.phases.values())


def arguments_for(
    here: Path, resume: bool = False, serving: bool = False, scenes: tuple[str, ...] = SCENES
) -> list[str]:
    folders = ["--scenes", *scenes, "--out", str(here / "out"), "--view-sets", str(here / "view_sets")]
    return [*OPTIONS, *folders, *(["--resume"] if resume else []), *([] if serving else ["--no-serving"])]


def forked(here: Path, resume: bool, serving: bool) -> Ended:
    return run(arguments_for(here, resume, serving), here)


def forked_runs(seconds: float) -> Runs:
    """Return runs of forked processes that take `seconds` undisturbed."""

    def killed(here: Path, resume: bool, serving: bool, draws: Random) -> Ended:
        """Kill three of ten at a write, the others at any time; one of five of those without its group."""
        start = partial(run, arguments_for(here, resume, serving), here)
        if draws.random() < 0.3:
            return start(point=(draws.choice(POINTS), draws.randint(1, 30)))
        after = draws.uniform(0.0, seconds * (2.0 if serving else 1.0))
        return start(after=after, alone=draws.random() < 0.2, phase_of=lambda: phase_of(here))

    return Runs("kills", 0.0, forked, killed)


def storm(count: int, seed: int, scratch: Path, reference: Path, runs: Runs, say: Callable[[str], None]) -> Storm:
    """Kill runs `count` times, at any moment; a folder is killed up to `MOST_KILLS` times, resumed and compared with
    what was undisturbed in `reference`.
    """
    met, draws = Storm(), Random(f"{runs.name} {seed}")
    while met.kills < count and met.too_late <= 10 + 3 * count:
        met.folders += 1
        here, serving = scratch / str(met.folders), draws.random() < 0.15
        here.mkdir(parents=True)
        if draws.random() < runs.rendered:
            shutil.copytree(reference / "view_sets", here / "view_sets")
        wrong = []
        for _ in range(min(draws.randint(1, MOST_KILLS), count - met.kills)):
            ended = runs.killed(here, has_begun(here), serving, draws)
            if ended.was_killed:
                met.phases[ended.phase] += 1
            else:
                met.too_late += 1
                if ended.code != 0 and NO_RUN_YET not in ended.printed:
                    wrong.append(f"ended with {ended.code}: {ended.printed[-400:]}")
        wrong += completed(here, reference, runs.complete, serving)
        met.resumed += cells_resumed(here / "out")
        met.wrong += [f"{runs.name}, folder {met.folders}: {line}" for line in wrong]
        phases = ", ".join(f"{many} {name}" for name, many in met.phases.most_common())
        say(f"{met.kills} {runs.name} ({phases}), {met.folders} folders, {len(met.wrong)} wrong")
        if not wrong:
            shutil.rmtree(here)
    if met.phases["training"] >= MANY_IN_TRAINING and not met.resumed:
        met.wrong.append(f"{runs.name}: no cell was resumed in the middle of its training")
    return met


def completed(
    here: Path, reference: Path, complete: Callable[[Path, bool, bool], Ended] = forked, serving: bool = False
) -> list[str]:
    """Resume what was killed, to its end; return what is then not as in `reference`."""
    ended = complete(here, has_begun(here), serving)
    if ended.code == 2 and NO_RUN_YET in ended.printed:  # killed before there was anything
        ended = complete(here, False, serving)
    if ended.code != 0:
        return [f"--resume ended with {ended.code}: {ended.printed[-600:]}"]
    return differences(here, reference)


def has_begun(here: Path) -> bool:
    return (here / "out" / "records").exists()


def phase_of(here: Path, scenes: tuple[str, ...] = SCENES) -> str:
    """Return where a run of these scenes and two methods is, by what lies there."""
    out, sets = here / "out", here / "view_sets"
    if list(out.rglob(".*.part")):
        return "writing"
    if not (out / "records" / "plan.json").exists():
        return "starting"
    if not (out / "records" / "run.json").exists():
        complete = [folder for folder in sets.glob("*") if not folder.name.startswith(".")]
        return "rendering" if len(complete) < len(scenes) else "reading view sets"
    if len(list((out / "records" / "cells").glob("*.json"))) < 2 * len(scenes):
        return "training"
    return "serving" if list(out.glob(".scratch-*")) else "after training"


def on_a_full_disk(here: Path, write: int) -> Ended:
    """Run with a disk that is full from the n-th `write` on, or while rendering if that is 0."""
    if write:
        return run(arguments_for(here), here, point=(FULL, write))
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM_BYTES, before[1]))
    try:
        return forked(here, False, False)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
