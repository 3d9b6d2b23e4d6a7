"""python -m tests.endurance [--kills N] [--seed N]: kill runs, damage what they wrote, and see that nothing is lost."""

import argparse
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

FULL_AT = (0, 1, 2, 4, 5, 6, 7, 9, 12)
"""Writes from which on the disk is full: of plan, pictures, run, weights, records; 0: while rendering."""


def main() -> int:
    options = argparse.ArgumentParser(prog="python -m tests.endurance", description=__doc__)
    options.add_argument("--kills", type=int, default=100, metavar="N", help="default: 100")
    options.add_argument("--seed", type=int, default=None, metavar="N", help="of the times of killing (default: any)")
    options.add_argument(
        "--typed-kills", type=int, default=20, metavar="N", help="of the command as it is typed (default: 20)"
    )
    options.add_argument("--no-damage", action="store_true", help="kill alone")
    options.add_argument("--brief", action="store_true", help="of each kind of file one damage")
    options.add_argument("--scratch", type=Path, metavar="DIR", help="where what went wrong stays to be looked at")
    given = options.parse_args()
    seed = int(time.time()) if given.seed is None else given.seed
    print(f"seed {seed}", flush=True)

    from tests.endurance.damage import damages
    from tests.endurance.forked import prepare
    from tests.endurance.kills import completed, forked, forked_runs, on_a_full_disk, storm
    from tests.endurance.typed import typed, typed_runs

    scratch = given.scratch or Path(tempfile.mkdtemp(prefix="endurance-"))
    wrong: list[str] = []

    def killed(count: int, name: str, complete: Any, runs_of: Any) -> Path:
        """Run once undisturbed, and kill others `count` times; return what was undisturbed."""
        reference = scratch / f"undisturbed-{name}"
        reference.mkdir(parents=True)
        first = complete(reference, False, False)
        assert first.code == 0, first.printed
        say(f"{name}, undisturbed: {first.seconds:.1f} s; scratch {scratch}")
        began, runs = time.monotonic(), runs_of(first.seconds)
        met = storm(count, seed, scratch / name, reference, runs, say)
        seconds = time.monotonic() - began
        say(f"{met.kills} {runs.name} of {met.folders} runs in {seconds:.0f} s, {met.too_late} came too late")
        for phase, number in met.phases.most_common():
            say(f"  {number:4} {phase}")
        say(f"  {met.resumed} cells were resumed in the middle of their training")
        wrong.extend(met.wrong)
        return reference

    if given.typed_kills:
        killed(given.typed_kills, "typed", typed, typed_runs)
    prepare()
    reference = killed(given.kills, "forked", forked, forked_runs)
    if not given.no_damage:
        began = time.monotonic()
        for row in damages(reference, scratch / "damaged", each=1 if given.brief else None):
            say(row.line)
            wrong += [f"{row.line}: {line}" for line in row.wrong]
        say(f"damages took {time.monotonic() - began:.0f} s")
    for write in FULL_AT[::4] if given.brief else FULL_AT:
        here = scratch / "full" / str(write)
        here.mkdir(parents=True)
        ended = on_a_full_disk(here, write)
        printed = ended.printed.strip().replace(f"{here}/", "")
        say(f"disk full at write {write or 'of a view'}, exit code {ended.code}: {printed[-200:]}")
        wrong += [f"full at {write}: {line}" for line in completed(here, reference)]
        if ended.code != 2 or str(here) not in ended.printed or "Traceback" in ended.printed:
            wrong.append(f"full at {write}: {ended.code}, {ended.printed[-400:]}")
    for line in wrong:
        print(f"wrong: {line}")
    print(f"{len(wrong)} wrong")
    if not given.scratch and not wrong:
        shutil.rmtree(scratch)
    return 1 if wrong else 0


def say(text: str) -> None:
    print(text, flush=True)


if __name__ == "__main__":
    sys.exit(main())
