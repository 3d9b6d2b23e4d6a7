"""The command as it is typed: nothing is forked and nothing replaced, every start imports and compiles anew.

A start takes many times as long as a forked one, so that there are fewer; their runs are one scene and two methods.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from random import Random

from scenes.rendering.variant import FORCE
from tests.endurance.forked import Ended
from tests.endurance.kills import Runs, arguments_for, phase_of

ROOT = Path(__file__).parents[2]
SCENES = ("hotdog",)
PHASES = ("rendering", "reading view sets", "training", "after training", "serving")
LOOK_SECONDS = 0.02


def typed(here: Path, resume: bool = False, serving: bool = False, moment: Callable[[], str] | None = None) -> Ended:
    """Run `python -m harness run …` into `here/out`, to its end; or kill it with its whole group as soon as `moment`
    gives a phase and not an empty string.
    """
    arguments = [*arguments_for(here, resume, serving, SCENES), "--resolution", "16"]
    began, phase, log = time.monotonic(), "", here / "printed.txt"
    with log.open("w") as printed:
        process = subprocess.Popen(
            [sys.executable, "-m", "harness", *arguments],
            cwd=ROOT,
            env={**os.environ, FORCE: "scalar_rgb"},  # it repeats its bits; LLVM adds up in no fixed order
            stdout=printed,
            stderr=printed,
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


def typed_runs(seconds: float) -> Runs:
    """Return runs of the typed command that take `seconds` undisturbed."""

    def killed(here: Path, resume: bool, serving: bool, draws: Random) -> Ended:
        return typed(here, resume, serving, _moment(here, serving, draws, seconds))

    return Runs("kills of the typed command", 0.5, typed, killed)


def _moment(here: Path, serving: bool, draws: Random, seconds: float) -> Callable[[], str]:
    """Give the phase once it is time to kill: half of them at any time of a run, half soon after a phase began."""
    if draws.random() < 0.5:
        at = time.monotonic() + draws.uniform(0.0, seconds)
        return lambda: phase_of(here, SCENES) if time.monotonic() >= at else ""
    rendered = (here / "view_sets").exists()
    ahead = [name for name in PHASES if name != ("rendering" if rendered else "") and (serving or name != "serving")]
    phase, soon = draws.choice(ahead), draws.uniform(0.0, 0.02 * seconds)
    since: list[float] = []

    def moment() -> str:
        now = phase_of(here, SCENES)
        if now == phase and not since:
            since.append(time.monotonic())
        return now if since and time.monotonic() >= since[0] + soon else ""

    return moment
