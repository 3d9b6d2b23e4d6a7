"""One target, input after input, in this process: by chance, or guided by the coverage of our own code (atheris).

    python -m tests.fuzz.campaign TARGET SCRATCH --seconds S --seed N [--inputs N] [--guided]

Writes SCRATCH/tally.json, SCRATCH/current (the input that is being tried) and SCRATCH/faults/*.
"""

import argparse
import faulthandler
import hashlib
import json
import os
import sys
import tempfile
import time
from collections import Counter
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

PACKAGES = ["scenes", "harness", "reports"]
GUIDED_LENGTH = 1 << 18
WARMING = 12


@dataclass
class Tally:
    """What came of the inputs of one target and way."""

    tried: int = 0
    accepted: int = 0
    refused: int = 0
    seconds: float = 0.0
    refusals: Counter[str] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        self.refusals, self.faults = Counter(self.refusals), Counter(self.faults)

    def line(self, name: str) -> str:
        return (
            f"{name:26} {self.tried:8} tried in {self.seconds:6.0f} s {self.accepted:8} accepted {self.refused:8} "
            f"refused in {len(self.refusals):4} ways {sum(self.faults.values()):6} faults of {len(self.faults):3} kinds"
        )


def keep_fault(scratch: Path, stem: str, file: str, data: bytes, what: str) -> None:
    """Keep an input that showed a fault, for whoever repairs it."""
    folder = scratch / "faults"
    folder.mkdir(exist_ok=True)
    (folder / stem).write_bytes(data)
    (folder / f"{stem}.json").write_text(json.dumps({"file": file, "fault": what}, indent=1), encoding="ascii")


class Trial:
    """A target whose inputs are tried in `scratch`."""

    def __init__(self, name: str, scratch: Path) -> None:
        from tests.fuzz.targets import TARGETS, whole_folder

        self.name, self.target, self.scratch = name, TARGETS[name], scratch
        self.whole = whole_folder(self.target, scratch)
        self.folder: Path | None = None
        self.spoilt = ""
        files = sorted(file for file in self.whole.glob(self.target.files or "\0") if file.is_file())
        assert files or not self.target.files, f"{self.name}: nothing is {self.target.files}"
        self.valid = [(file.relative_to(self.whole).as_posix(), file.read_bytes()) for file in files[:12]]
        self.tally = Tally()

    def warmed(self, guard: Any) -> None:
        """Import what the reader imports, and see that what is whole is accepted: its faults alone are tallied.

        Raises `SystemExit` if it is not.
        """
        if self.valid:  # what is imported for it takes its time
            self.target.read(self.placed(*self.valid[0]))
            self.folder = None if self.target.renewed else self.folder
        # written over itself, every file leaves the same folder
        for file, data in self.valid[: None if self.target.place else 1]:
            outcome = self.tried(guard, file, data)
            if outcome.kind != "accepted":
                raise SystemExit(f"{self.name}: what is whole is {outcome.kind}: {outcome.why}")
        for number in range(0 if self.valid else WARMING):
            self.tried(guard, *self.input(Random(number)))
        self.tally = Tally(faults=self.tally.faults)

    def input(self, random: Random) -> tuple[str, bytes]:
        """Return a file and what it becomes; its checksums are right half of the time."""
        file, data = random.choice(self.valid or [("", b"[]")])
        data = self.target.mutate(random, data)
        return file, self.target.seal(data) if random.randrange(2) else data

    def placed(self, file: str, data: bytes) -> Path:
        """Return a folder in which the input is in its place."""
        from tests.fuzz.targets import fresh_copy

        if self.folder is None or self.target.renewed:
            self.folder, self.spoilt = fresh_copy(self.whole, self.scratch), ""
        if self.target.place:
            self.target.place(self.folder, file, data)
        else:
            if self.spoilt not in ("", file) and not self.target.renewed:
                (self.folder / self.spoilt).write_bytes(dict(self.valid)[self.spoilt])
            (self.folder / file).write_bytes(data)
            self.spoilt = file
        return self.folder

    def tried(self, guard: Any, file: str, data: bytes) -> Any:
        """Return the outcome of one input, which is also in the tally."""
        from tests.fuzz.targets import REFUSALS, NotTried
        from tests.fuzz.watch import Outcome, kind_of_fault, kind_of_refusal

        folder, target, tally = self.placed(file, data), self.target, self.tally
        left_out = False

        def read() -> None:
            nonlocal left_out
            try:
                target.read(folder)
            except NotTried:
                left_out = True

        outcome = guard.tried(read, REFUSALS, target.names or Path(file).name)
        if left_out:
            return Outcome("left out")
        if outcome.kind == "refused" and target.accepts_all:
            outcome = Outcome("fault", f"refused, where damage is a miss: {outcome.why[:200]}")
        tally.tried += 1
        if outcome.kind == "accepted":
            tally.accepted += 1
        elif outcome.kind == "refused":
            tally.refused += 1
            tally.refusals[kind_of_refusal(outcome.why)] += 1
        else:
            kind = kind_of_fault(outcome.why)
            tally.faults[kind] += 1
            if tally.faults[kind] == 1:
                keep_fault(self.scratch, hashlib.sha256(data).hexdigest()[:12], file, data, outcome.why)
            self.folder = None
        return outcome

    def note(self) -> None:
        (self.scratch / "tally.json").write_text(json.dumps(vars(self.tally)), encoding="utf-8")


def by_chance(trial: Trial, guard: Any, seconds: float, inputs: int, seed: int) -> None:
    """Try inputs by chance; each is the same for the same seed and number."""
    began, current, number = time.monotonic(), trial.scratch / "current", 0
    while number < inputs and time.monotonic() < began + seconds:
        file, data = trial.input(Random(f"{trial.name} {seed} {number}"))
        current.write_bytes(file.encode() + b"\n" + data)
        trial.tried(guard, file, data)
        trial.tally.seconds = time.monotonic() - began
        if number % 50 == 0:
            trial.note()
        number += 1
    trial.note()


def guided(trial: Trial, guard: Any, seconds: float, inputs: int, seed: int) -> None:
    """Never returns: libFuzzer ends the process. What reaches new code is changed further."""
    import atheris

    file = trial.valid[0][0]
    corpus = trial.scratch / "guided"
    corpus.mkdir(exist_ok=True)
    for number, (_, data) in enumerate(trial.valid):
        (corpus / f"valid{number}").write_bytes(data)
    began, current = time.monotonic(), trial.scratch / "current"

    def changed(data: bytes, most: int, chosen: int) -> bytes:
        random = Random(chosen)
        try:
            made = trial.target.mutate(random, data or trial.valid[0][1])
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError, IndexError):  # too far from valid
            made = atheris.Mutate(data, most)
        return (trial.target.seal(made) if random.randrange(2) else made)[:most]

    def read(data: bytes) -> None:
        current.write_bytes(file.encode() + b"\n" + data)
        trial.tried(guard, file, data)
        trial.tally.seconds = time.monotonic() - began
        if trial.tally.tried % 50 == 0 or trial.tally.seconds > seconds - 2.0:
            trial.note()

    limits = {"max_total_time": max(1, int(seconds)), "runs": min(inputs, (1 << 31) - 1), "max_len": GUIDED_LENGTH}
    # time and memory are watched here
    limits |= {"timeout": 0, "rss_limit_mb": 0, "seed": seed + 1, "print_final_stats": 1, "len_control": 0}
    options = [f"-{name}={value}" for name, value in limits.items()]
    atheris.Setup([sys.argv[0], *options, str(corpus)], read, custom_mutator=changed, internal_libfuzzer=True)
    atheris.Fuzz()


def _followed() -> Any:
    """Modules of ours that are imported within tell atheris where they have been."""
    import atheris

    return atheris.instrument_imports(include=PACKAGES, enable_loader_override=False)


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("target")
    parser.add_argument("scratch", type=Path)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--inputs", type=int, default=1 << 40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--guided", action="store_true")
    options = parser.parse_args(arguments)
    scratch = options.scratch.resolve()
    (scratch / "tmp").mkdir(parents=True, exist_ok=True)
    os.environ["TMPDIR"] = os.environ["MPLCONFIGDIR"] = tempfile.tempdir = str(scratch / "tmp")
    os.environ["NUMBA_CACHE_DIR"] = str(scratch / "tmp")
    sys.dont_write_bytecode = True
    faulthandler.enable()
    from tests.fuzz.watch import Guard, limit_memory

    with _followed() if options.guided else nullcontext():  # what is imported later is not followed
        trial = Trial(options.target, scratch)
        guard = Guard(scratch)
        trial.note()
        trial.warmed(guard)
    if "torch" in sys.modules:
        import torch

        torch.set_num_threads(1)
    limit_memory()
    (guided if options.guided else by_chance)(trial, guard, options.seconds, options.inputs, options.seed)


if __name__ == "__main__":
    main(sys.argv[1:])
