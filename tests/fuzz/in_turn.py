"""Many targets in one process, a few seconds each, round after round: what takes long to start is started once.

    python -m tests.fuzz.in_turn TALLY --scratch DIR [--seconds 600] [--slice 3] [--targets NAME …] [--seed N]

TALLY.json is written after each slice and read at the start, so that an end, of whatever kind, costs one slice and a
later call goes on with inputs of its own. A process that dies or hangs is a fault of the input that it had, and another
one goes on. Put DIR on a file system in memory: most time goes into small files.
"""

import argparse
import faulthandler
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

from tests.fuzz.campaign import Trial, by_chance
from tests.fuzz.tally import Tally, added, read, table, write

HANGING_SECONDS = 900.0


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz.in_turn", description=__doc__)
    parser.add_argument("tally", type=Path)
    parser.add_argument("--scratch", type=Path, required=True)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--slice", type=float, default=3.0)
    parser.add_argument("--targets", nargs="*", default=[])
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.inside:
        rounds(options)
        return 0
    until = time.monotonic() + options.seconds
    while (left := until - time.monotonic()) > 5:
        command = [sys.executable, "-m", "tests.fuzz.in_turn", str(options.tally), "--scratch", str(options.scratch)]
        command += ["--seconds", str(left), "--slice", str(options.slice), "--seed", str(options.seed), "--inside"]
        ended = subprocess.run([*command, "--targets", *options.targets], check=False).returncode
        if ended != 0:
            _note_end(options.tally, options.scratch, ended)
        options.seed += 1
    found = read(options.tally)
    sys.stdout.write(f"{table(found)}\n")
    return 1 if any(one.faults for one in found.values()) else 0


def rounds(options: argparse.Namespace) -> None:
    scratch = options.scratch.resolve()
    (scratch / "tmp").mkdir(parents=True, exist_ok=True)
    for name in ("TMPDIR", "MPLCONFIGDIR", "NUMBA_CACHE_DIR"):
        os.environ[name] = str(scratch / "tmp")
    os.environ["OMP_NUM_THREADS"] = "1"
    tempfile.tempdir, sys.dont_write_bytecode = str(scratch / "tmp"), True
    faulthandler.enable()
    from tests.fuzz.targets import TARGETS
    from tests.fuzz.watch import Guard, limit_memory

    found, trials, next_input = read(options.tally), {}, Counter[str]()
    guard, until = Guard(scratch), time.monotonic() + options.seconds
    names = options.targets or list(TARGETS)
    while time.monotonic() < until:
        for name in names:
            if time.monotonic() > until:
                break
            (scratch / "now").write_text(name, encoding="ascii")
            faulthandler.dump_traceback_later(HANGING_SECONDS + options.slice, exit=True)
            if name not in trials:
                guard.scratch = scratch
                trials[name] = started(name, scratch, guard)
                found[name] = trials[name].tally = added(found.get(name, Tally()), trials[name].tally)
            guard.scratch = trials[name].scratch
            limit_memory()
            next_input[name] = by_chance(trials[name], guard, options.slice, 1 << 40, options.seed, next_input[name])
            write(options.tally, found)
    faulthandler.cancel_dump_traceback_later()


def started(name: str, scratch: Path, guard: Any) -> Trial:
    """A target whose valid inputs are accepted."""
    folder = scratch / name
    (folder / "tmp").mkdir(parents=True, exist_ok=True)
    trial = Trial(name, folder)
    trial.warmed(guard)
    return trial


def _note_end(file: Path, scratch: Path, ended: int) -> None:
    name = (scratch / "now").read_text(encoding="ascii")
    found = read(file)
    found.setdefault(name, Tally()).faults[f"ended the process with {ended}"] += 1
    write(file, found)
    current = scratch / name / "current"
    if current.exists():
        current.replace(scratch / name / f"ended.{int(time.time())}")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
