"""python -m tests.endurance [--kills N] [--seed N]: kill runs, damage what they wrote, and see that nothing is lost."""

import argparse
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tests.endurance.kills import Found

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
    from tests.endurance.kills import completed, on_a_full_disk, storm, undisturbed
    from tests.endurance.typed import typed_storm

    scratch = given.scratch or Path(tempfile.mkdtemp(prefix="endurance-"))
    wrong: list[str] = []
    if given.typed_kills:
        began = time.monotonic()
        typed = typed_storm(given.typed_kills, seed, scratch / "typed", say)
        tell("kills of the typed command", typed, time.monotonic() - began)
        wrong += typed.wrong
    prepare()
    reference = scratch / "undisturbed"
    first = undisturbed(reference)
    print(f"undisturbed: {first.seconds:.1f} s; scratch {scratch}", flush=True)
    if not given.no_damage:
        began = time.monotonic()
        for row in damages(reference, scratch / "damaged", each=1 if given.brief else None):
            print(row.line, flush=True)
            wrong += [f"{row.line}: {line}" for line in row.wrong]
        print(f"damages took {time.monotonic() - began:.0f} s", flush=True)
    for write in FULL_AT[::4] if given.brief else FULL_AT:
        here = scratch / "full" / str(write)
        here.mkdir(parents=True)
        ended = on_a_full_disk(here, rendering=write == 0, write=write)
        said = ended.said.strip().replace(f"{here}/", "")
        print(f"disk full at write {write or 'of a view'}, exit code {ended.code}: {said[-200:]}", flush=True)
        wrong += [f"full at {write}: {line}" for line in completed(here, reference)]
        if ended.code != 2 or str(here) not in ended.said or "Traceback" in ended.said:
            wrong.append(f"full at {write}: {ended.code}, {ended.said[-400:]}")
    began = time.monotonic()
    found = storm(given.kills, seed, scratch / "killed", reference, first.seconds, say)
    tell("kills", found, time.monotonic() - began)
    wrong += found.wrong
    for line in wrong:
        print(f"wrong: {line}")
    print(f"{len(wrong)} wrong")
    if not given.scratch and not wrong:
        shutil.rmtree(scratch)
    return 1 if wrong else 0


def say(text: str) -> None:
    print(text, flush=True)


def tell(what: str, found: "Found", seconds: float) -> None:
    say(f"{found.kills} {what} of {found.folders} runs in {seconds:.0f} s, {found.too_late} came too late")
    for phase, count in found.phases.most_common():
        say(f"  {count:4} {phase}")
    say(f"  {found.gone_on} cells went on in the middle of their training")


if __name__ == "__main__":
    sys.exit(main())
