"""Tries the readers for a given time, each in processes of its own, and prints what was tried and what went wrong.

    python -m tests.fuzz [--seconds 600] [--inputs N] [--targets NAME …] [--seed N] [--scratch DIR] [--keep]
                         [--no-guided | --guided-alone]

Half of the time inputs of files are made by chance, half guided by coverage (atheris, the dependency group `fuzz`).
With `--keep` each input that showed a fault goes to tests/fuzz/corpus/TARGET/, which the fast tests try again. Exit
code 1 if there was a fault.
"""

import argparse
import importlib.util
import json
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from tests.fuzz.campaign import Tally, keep_fault

CORPUS = Path(__file__).parent / "corpus"
SILENT_SECONDS = 120.0
"""A process that tells nothing new for so long hangs."""
STARTING_SECONDS = 600.0
"""To make the material, once, on a machine that has other things to do."""
LARGEST_KEPT = 32 << 10


def main(arguments: list[str]) -> int:
    from tests.fuzz.targets import TARGETS

    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0, help="in all (default: 600)")
    parser.add_argument("--inputs", type=int, default=1 << 40, help="at most, of each target")
    parser.add_argument("--targets", nargs="+", choices=sorted(TARGETS), default=list(TARGETS))
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--scratch", type=Path, default=Path(tempfile.gettempdir()) / "radiance-verdict-fuzz")
    parser.add_argument("--keep", action="store_true", help="put inputs that show a fault into tests/fuzz/corpus")
    way = parser.add_mutually_exclusive_group()
    way.add_argument("--no-guided", action="store_true", help="by chance alone")
    way.add_argument("--guided-alone", action="store_true", help="by coverage alone")
    options = parser.parse_args(arguments)
    can_be_guided = importlib.util.find_spec("atheris") is not None and not options.no_guided
    if options.guided_alone and not can_be_guided:
        parser.error("--guided-alone: atheris is not installed; install the dependency group fuzz")
    if not can_be_guided:
        print("by chance alone, without coverage to guide it: atheris is not installed or not wanted")
    jobs = [(name, False) for name in options.targets if not options.guided_alone]
    jobs += [(name, True) for name in options.targets if can_be_guided and TARGETS[name].files]
    each = options.seconds / max(len(jobs), 1)
    print(f"seed {options.seed}, {each:.0f} s of each target and way, in {options.scratch}")
    faults = []
    for name, guided in jobs:
        key = f"{name}-guided" if guided else name
        tally = tried(name, options.scratch / key, each, options.inputs, options.seed, guided)
        if options.keep:
            keep(name, options.scratch / key)
        print(tally.line(key), flush=True)
        faults += [f"{key}: {fault}: {count}" for fault, count in tally.faults.items()]
    print("\n".join(faults) or "no fault")
    return 1 if faults else 0


def tried(name: str, scratch: Path, seconds: float, inputs: int, seed: int, guided: bool) -> Tally:
    """Try a target in a process. One that ends by a signal or hangs is a fault of the input that it had."""
    scratch.mkdir(parents=True, exist_ok=True)
    for file in ("tally.json", "current"):
        (scratch / file).unlink(missing_ok=True)
    command = [sys.executable, "-m", "tests.fuzz.campaign", name, str(scratch), "--seconds", str(seconds)]
    command += ["--inputs", str(inputs), "--seed", str(seed), *(["--guided"] if guided else [])]
    with (scratch / "log").open("w", encoding="utf-8") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log, cwd=Path(__file__).parents[2])
        code = _waited(process, scratch, seconds)
    printed = (scratch / "log").read_text(encoding="utf-8", errors="replace")
    if not (scratch / "current").exists() and (code != 0 or not (scratch / "tally.json").exists()):
        return Tally(faults=Counter({f"could not be tried at all: {' '.join(printed[-300:].split())}": 1}))
    tally = Tally(**json.loads((scratch / "tally.json").read_text(encoding="utf-8")))
    # libraries may break off once libFuzzer has told that it is done; 77 is where a callback raised, which none does
    if code != 0 and not re.search(r"^Done \d+ runs", printed, re.MULTILINE):
        how = "hung" if code is None else f"ended the process with {code}"
        tally.faults[f"{how}, at input {tally.tried} or later"] += 1
        file, _, data = (scratch / "current").read_bytes().partition(b"\n")
        keep_fault(scratch, "ended", file.decode(), data, how)
    return tally


def _waited(process: subprocess.Popen[bytes], scratch: Path, seconds: float) -> int | None:
    """Return the exit code; None if it had to be killed."""
    began = last = time.monotonic()
    seen = None
    while process.poll() is None:
        time.sleep(0.2)
        current, now = scratch / "current", time.monotonic()
        stamp = current.stat().st_mtime_ns if current.exists() else None
        if stamp != seen:
            seen, last = stamp, now
        patience = SILENT_SECONDS if current.exists() else STARTING_SECONDS
        if now - last > patience or now - began > seconds + 2 * STARTING_SECONDS:
            process.kill()
            process.wait()
            return None
    return process.returncode


def keep(name: str, scratch: Path) -> None:
    """Keep small inputs that showed a fault, with the name of the file that they stand for."""
    for description in sorted((scratch / "faults").glob("*.json")):
        data = description.with_suffix("").read_bytes()
        if len(data) <= LARGEST_KEPT:
            folder = CORPUS / name
            folder.mkdir(parents=True, exist_ok=True)
            file = json.loads(description.read_text(encoding="ascii"))["file"]
            (folder / description.stem).write_bytes(file.encode() + b"\n" + data)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
