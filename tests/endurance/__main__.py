"""python -m tests.endurance [--kills N] [--seed N]: kill runs, damage their files, and check that nothing is lost."""

import argparse
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from random import Random

from tests.endurance.runs import FORKED, FULL, PHASES, POINTS, TYPED, Ended, Way, phase_of, prepare, run
from tests.endurance.same_results import cells_resumed, differences
from tests.scenes.captures import flip

NO_RUN_YET = "holds no run to resume"
MANY_IN_TRAINING = 10
"""The number of kills in training after which some cell must have been resumed in the middle."""
MOST_KILLS = 5
"""The maximum number of kills of a folder before it is resumed to its end."""
FULL_AT = (0, 1, 2, 4, 5, 6, 7, 9, 12)
"""The write at which the disk becomes full: of plan, pictures, run, weights, records; 0: while rendering."""
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
"""The kinds of files of a run and its view sets."""
BOMB = b"cposix\nsystem\n(S'touch UNPICKLED'\ntR."
"""A pickle that creates a file when it is loaded; the harness must never load a pickle."""


def _flip(place: float) -> Callable[[Path], None]:
    return lambda path: flip(path, int(place * path.stat().st_size))


def _folder(path: Path) -> None:
    path.unlink()
    path.mkdir()
    (path / "user's.txt").write_text("mine")


DAMAGES: dict[str, Callable[[Path], object]] = {
    "a byte near its start": _flip(0.01),
    "a byte in its middle": _flip(0.5),
    "its last byte but a few": _flip(0.99),
    "removed": Path.unlink,
    "cut off": lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 3]),
    "emptied": lambda path: path.write_bytes(b""),
    "a folder instead": _folder,
    "a pickle instead": lambda path: path.write_bytes(BOMB),
}


def undisturbed(way: Way, scratch: Path) -> tuple[Path, float]:
    """Return the folder of an undisturbed run, and its seconds."""
    here, began = scratch / f"undisturbed-{way.name}", time.monotonic()
    here.mkdir(parents=True)
    ended = run(way, here)
    assert ended.code == 0, ended.printed
    say(f"{way.name}, undisturbed: {time.monotonic() - began:.1f} s; scratch {scratch}")
    return here, time.monotonic() - began


def kills(way: Way, count: int, seed: int, scratch: Path, reference: Path, seconds: float) -> list[str]:
    """Kill runs `count` times, up to `MOST_KILLS` times per folder; resume each and compare it with `reference`."""
    draws, wrong, phases = Random(f"{way.name} {seed}"), [], Counter[str]()
    folders = resumed = late = 0
    while phases.total() < count and late <= 10 + 3 * count:
        folders += 1
        here = scratch / way.name / str(folders)
        here.mkdir(parents=True)
        if draws.random() < way.rendered:
            shutil.copytree(reference / "view_sets", here / "view_sets")
        lines = []
        for _ in range(min(draws.randint(1, MOST_KILLS), count - phases.total())):
            ended = killed(way, here, draws, seconds)
            if ended.code == -signal.SIGKILL:
                phases[ended.phase] += 1
            else:
                late += 1
                if ended.code != 0 and NO_RUN_YET not in ended.printed:
                    lines.append(f"ended with {ended.code}: {ended.printed[-400:]}")
        lines += completed(way, here, reference)
        resumed += cells_resumed(here / "out")
        wrong += [f"{way.name}, folder {folders}: {line}" for line in lines]
        if not lines:
            shutil.rmtree(here)
    counts = ", ".join(f"{many} {phase}" for phase, many in phases.most_common())
    say(f"{phases.total()} {way.name} kills of {folders} runs ({counts}), {late} came too late")
    say(f"  {resumed} cells were resumed in the middle of their training")
    if phases["training"] >= MANY_IN_TRAINING and not resumed:
        wrong.append(f"{way.name}: no cell was resumed in the middle of its training")
    return wrong


def killed(way: Way, here: Path, draws: Random, seconds: float) -> Ended:
    """Run, and kill at a write, at a random time within `seconds`, or soon after a phase began; one of five kills
    spares the rest of the process group.

    A typed run spends most of its time on imports, so that few random kills would hit the later phases.
    """
    resume = has_begun(here)
    if draws.random() < way.at_points:
        return run(way, here, resume, point=(draws.choice(POINTS), draws.randint(1, 30)))
    alone, by_phase = draws.random() < 0.2, draws.random() < 0.5
    later = [phase for phase in PHASES[1:] if phase != "rendering" or not (here / "view_sets").exists()]
    awaited, after = draws.choice(later), draws.uniform(0.0, seconds * (0.02 if by_phase else 1.0))
    since = None if by_phase else time.monotonic()

    def moment() -> str:
        nonlocal since
        phase = phase_of(here, way)
        if since is None and phase == awaited:
            since = time.monotonic()
        return phase if since is not None and time.monotonic() >= since + after else ""

    return run(way, here, resume, moment=moment, alone=alone)


def completed(way: Way, here: Path, reference: Path) -> list[str]:
    """Resume a killed run to its end; return the differences from `reference`."""
    ended = run(way, here, has_begun(here))
    if ended.code == 2 and NO_RUN_YET in ended.printed:  # killed before anything was written
        ended = run(way, here, False)
    if ended.code != 0:
        return [f"--resume ended with {ended.code}: {ended.printed[-600:]}"]
    return differences(here, reference)


def has_begun(here: Path) -> bool:
    return (here / "out/records").exists()


def damaged(reference: Path, here: Path, kind: str, how: str) -> list[str]:
    """Damage one file of a copy in one way, and resume the run."""
    shutil.rmtree(here, ignore_errors=True)
    shutil.copytree(reference, here)
    path = next(here.glob(kind))
    DAMAGES[how](path)
    ended = run(FORKED, here, resume=True, quiet=False)
    wrong = [f"unpickled: {file}" for file in (*here.rglob("UNPICKLED"), *Path.cwd().glob("UNPICKLED"))]
    wrong += differences(here, reference) if ended.code == 0 else [f"exit code {ended.code}: {ended.printed[-300:]}"]
    lines = [line for line in ended.printed.splitlines() if path.name in line or ": missing" in line]
    say(f"{kind}, {how}: {' / '.join(lines).replace(f'{here}/', '')[:300] or 'nothing to say'}")
    return [f"{kind}, {how}: {line}" for line in wrong]


def on_a_full_disk(reference: Path, here: Path, write: int) -> list[str]:
    """Run until the disk is full, which must name the folder; then resume the run with free space."""
    here.mkdir(parents=True)
    ended = run(FORKED, here, point=(FULL, write))
    say(f"disk full at write {write or 'of a view'}: {ended.printed.strip().replace(f'{here}/', '')[-200:]}")
    wrong = completed(FORKED, here, reference)
    if ended.code != 2 or str(here) not in ended.printed or "Traceback" in ended.printed:
        wrong.append(f"exit code {ended.code}: {ended.printed[-400:]}")
    return [f"disk full at write {write}: {line}" for line in wrong]


def main() -> int:
    options = argparse.ArgumentParser(prog="python -m tests.endurance", description=__doc__)
    options.add_argument("--kills", type=int, default=100, metavar="N", help="default: 100")
    options.add_argument("--seed", type=int, default=int(time.time()), metavar="N", help="of the times of killing")
    options.add_argument("--typed-kills", type=int, default=20, metavar="N", help="of typed runs (default: 20)")
    options.add_argument("--no-damage", action="store_true", help="only kill")
    options.add_argument("--brief", action="store_true", help="one damage for each kind of file")
    options.add_argument("--scratch", type=Path, metavar="DIR", help="keep the folders of failures here")
    given = options.parse_args()
    say(f"seed {given.seed}")
    scratch = given.scratch or Path(tempfile.mkdtemp(prefix="endurance-"))
    wrong: list[str] = []
    if given.typed_kills:
        wrong += kills(TYPED, given.typed_kills, given.seed, scratch, *undisturbed(TYPED, scratch))
    prepare()
    reference, seconds = undisturbed(FORKED, scratch)
    wrong += kills(FORKED, given.kills, given.seed, scratch, reference, seconds)
    ways = [*DAMAGES]
    for place, kind in enumerate(() if given.no_damage else KINDS):
        for how in [ways[place % len(ways)]] if given.brief else ways:
            wrong += damaged(reference, scratch / "damaged", kind, how)
    for write in FULL_AT[::4] if given.brief else FULL_AT:
        wrong += on_a_full_disk(reference, scratch / "full" / str(write), write)
    for line in wrong:
        say(f"wrong: {line}")
    say(f"{len(wrong)} wrong")
    if not given.scratch and not wrong:
        shutil.rmtree(scratch)
    return 1 if wrong else 0


def say(text: str) -> None:
    print(text, flush=True)


if __name__ == "__main__":
    sys.exit(main())
