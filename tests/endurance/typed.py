"""Kills of the command as it is typed: nothing is forked and nothing replaced, every start imports and compiles anew.

A start takes many times as long as a forked one, so that there are fewer; their runs are one scene and two methods.
"""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from scenes.rendering.variant import FORCE
from tests.endurance.forked import Ended
from tests.endurance.kills import NO_RUN_YET, Found, differences, phase_of
from tests.endurance.same_results import cells_gone_on

ROOT = Path(__file__).parents[2]
SCENE = "hotdog"
OPTIONS = ["run", "--profile", "smoke", "--scenes", SCENE, "--methods", "nerf", "qnerf", "--seeds", "1",
           "--budget-steps", "6", "--resolution", "16", "--workers", "1", "--quiet", "--device", "cpu",
           "--keep-every", "0"]  # fmt: skip
CELLS = 2
PHASES = ("rendering", "reading view sets", "training", "after training", "serving")
MOST_KILLS = 4
"""Of one folder, before it is let go on to its end."""
LOOK_SECONDS = 0.02


def typed(here: Path, resume: bool = False, serving: bool = False, moment: Callable[[], str] | None = None) -> Ended:
    """`python -m harness run …` into `here/out`, to its end; or killed with its whole group as soon as `moment` gives
    a phase and not an empty string."""
    options = [*OPTIONS, "--out", str(here / "out"), "--view-sets", str(here / "view_sets")]
    options += [*(["--resume"] if resume else []), *([] if serving else ["--no-serving"])]
    began, phase, log = time.monotonic(), "", here / "said.txt"
    with log.open("w") as said:
        process = subprocess.Popen(
            [sys.executable, "-m", "harness", *options],
            cwd=ROOT,
            env={**os.environ, FORCE: "scalar_rgb"},  # it repeats its bits; LLVM adds up in no fixed order
            stdout=said,
            stderr=said,
            start_new_session=True,
        )
        try:
            while moment is not None and process.poll() is None and not (phase := moment()):
                time.sleep(LOOK_SECONDS)
            if phase:
                os.killpg(process.pid, signal.SIGKILL)
            code = process.wait()
        finally:
            process.kill()
    return Ended(code, time.monotonic() - began, log.read_text(encoding="utf-8", errors="replace"), phase)


def typed_storm(count: int, seed: int, scratch: Path, say: Callable[[str], None]) -> Found:
    """`count` kills, at any moment of a run or a moment into one of its phases; a folder is killed up to `MOST_KILLS`
    times, gone on with and compared. Half of the folders find their view sets rendered, so that more is trained."""
    if not count:
        return Found()
    draws, found, reference = random.Random(f"typed {seed}"), Found(), scratch / "undisturbed"
    reference.mkdir(parents=True)
    whole = typed(reference)
    if whole.code != 0:
        found.wrong.append(f"undisturbed: ended with {whole.code}: {whole.said[-600:]}")
        return found
    say(f"typed, undisturbed: {whole.seconds:.1f} s")
    while found.kills < count and found.too_late <= count:
        found.folders += 1
        here = scratch / str(found.folders)
        here.mkdir()
        if draws.random() < 0.5:
            shutil.copytree(reference / "view_sets", here / "view_sets")
        serving = draws.random() < 0.2
        for _ in range(min(draws.randint(1, MOST_KILLS), count - found.kills)):
            ended = typed(here, _has_begun(here), serving, _moment(here, serving, draws, whole.seconds))
            if ended.was_killed:
                found.phases[ended.phase] += 1
            else:
                found.too_late += 1
                if ended.code != 0:
                    found.wrong.append(f"typed {found.folders}: ended with {ended.code}: {ended.said[-400:]}")
        found.wrong += [f"typed {found.folders}: {line}" for line in _completed(here, reference, serving)]
        found.gone_on += cells_gone_on(here / "out")
        phases = ", ".join(f"{many} {name}" for name, many in found.phases.most_common())
        say(f"{found.kills} kills of the typed command ({phases}), {found.folders} folders, {len(found.wrong)} wrong")
        if not any(line.startswith(f"typed {found.folders}:") for line in found.wrong):
            shutil.rmtree(here)
    return found


def _moment(here: Path, serving: bool, draws: random.Random, seconds: float) -> Callable[[], str]:
    """Gives the phase once it is time to kill: half of them at any time of a run, half soon after a phase began."""
    if draws.random() < 0.5:
        at = time.monotonic() + draws.uniform(0.0, seconds)
        return lambda: phase_of(here, [SCENE], CELLS) if time.monotonic() >= at else ""
    rendered = (here / "view_sets").exists()
    ahead = [one for one in PHASES if one != ("rendering" if rendered else "") and (serving or one != "serving")]
    phase, soon = draws.choice(ahead), draws.uniform(0.0, 0.02 * seconds)
    since: list[float] = []

    def moment() -> str:
        now = phase_of(here, [SCENE], CELLS)
        if now == phase and not since:
            since.append(time.monotonic())
        return now if since and time.monotonic() >= since[0] + soon else ""

    return moment


def _has_begun(here: Path) -> bool:
    return (here / "out" / "records").exists()


def _completed(here: Path, reference: Path, serving: bool) -> list[str]:
    ended = typed(here, _has_begun(here), serving)
    if ended.code == 2 and NO_RUN_YET in ended.said:
        ended = typed(here, serving=serving)
    if ended.code != 0:
        return [f"--resume ended with {ended.code}: {ended.said[-600:]}"]
    return differences(here, reference)
