"""One target, input after input, in this process: by chance, or guided by the coverage of our own code (atheris).

    python -m tests.fuzz.campaign TARGET SCRATCH --seconds S --seed N [--inputs N] [--guided]

Writes SCRATCH/tally.json, SCRATCH/current (the input that is being tried) and SCRATCH/faults/*.
"""

import argparse
import faulthandler
import hashlib
import importlib
import json
import os
import pkgutil
import sys
import tempfile
import time
from collections import Counter
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass, field, fields
from pathlib import Path
from random import Random
from typing import Any, cast

from tests.fuzz.mutations import Choices

PACKAGES = ("scenes", "harness", "reports")
GUIDED_LENGTH = 1 << 18
LONGEST_CHOICES = 512
"""Bytes of which an input without a file is made."""
WARMING = 12
BEGINNINGS = 32
"""Strings of bytes by chance that a guided campaign without files begins with."""


GUIDED = "-guided"
"""After a target's name: its inputs were guided by coverage."""


@dataclass
class Tally:
    """Of one target and way."""

    tried: int = 0
    accepted: int = 0
    refused: int = 0
    seconds: float = 0.0
    refusals: Counter[str] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)
    features: list[int] = field(default_factory=list)
    """Coverage as libFuzzer counts it: when it had tried the inputs that it began with, and at the end."""

    def as_json(self) -> dict[str, Any]:
        return {**self.__dict__, "refusals": dict(self.refusals), "faults": dict(self.faults)}

    @staticmethod
    def of_json(data: dict[str, Any]) -> "Tally":
        return Tally(**{**data, "refusals": Counter(data["refusals"]), "faults": Counter(data["faults"])})


def added(one: Tally, other: Tally) -> Tally:
    """Both together; of two guided ones from the first's beginning to the second's end."""
    sums = {f.name: getattr(one, f.name) + getattr(other, f.name) for f in fields(Tally) if f.name != "features"}
    features = [*one.features, *other.features]
    return Tally(**sums, features=[features[0], features[-1]] if features else [])


def row(name: str, tally: Tally) -> str:
    grown = f", coverage {tally.features[0]} → {tally.features[-1]}" if tally.features else ""
    return (
        f"{name:26} {tally.tried:8} tried in {tally.seconds:6.0f} s {tally.accepted:8} accepted {tally.refused:8} "
        f"refused in {len(tally.refusals):4} ways {sum(tally.faults.values()):6} faults of {len(tally.faults):3} kinds"
        f"{grown}"
    )


def table(found: dict[str, Tally]) -> str:
    """A line for each target and way, their sum, and every fault."""
    whole = Tally()
    for one in found.values():
        whole = added(whole, one)
    whole.features = []
    rows = [row(name, one) for name, one in {**dict(sorted(found.items())), "all": whole}.items()]
    return "\n".join([*rows, *(f"{name}: {fault}: {n}" for name, t in found.items() for fault, n in t.faults.items())])


class Trial:
    """A target whose inputs are tried in `scratch`."""

    def __init__(self, name: str, scratch: Path) -> None:
        from tests.fuzz.targets import TARGETS, whole_folder

        self.name, self.target, self.scratch = name, TARGETS[name], scratch
        self.whole = whole_folder(self.target, scratch)
        self.folder: Path | None = None
        self.spoilt = ""
        self.valid = self._valid()
        self.tally = Tally()

    def _valid(self) -> list[tuple[str, bytes]]:
        if not self.target.files:
            return [("", b"[]")]
        files = sorted(file for file in self.whole.glob(self.target.files) if file.is_file())
        assert files, f"{self.name}: nothing is {self.target.files}"
        return [(file.relative_to(self.whole).as_posix(), file.read_bytes()) for file in files[:12]]

    def warmed(self, guard: Any) -> None:
        """What the reader imports is imported, and what is whole is accepted. Faults alone of it are in the tally.

        Raises `SystemExit` where it is not.
        """
        from tests.fuzz.targets import refusals

        refusals()
        if self.target.files:  # what is imported for it takes its time
            self.placed(*self.valid[0])
            assert self.folder is not None
            self.target.read(self.folder)
            self.folder = None if self.target.renewed else self.folder
        # written over itself, every file leaves the same folder
        whole = self.valid[: None if self.target.place else 1] if self.target.files else []
        for file, data in whole:
            outcome = self.tried(guard, file, data)
            if outcome.kind != "accepted":
                raise SystemExit(f"{self.name}: what is whole is {outcome.kind}: {outcome.said}")
        for number in range(0 if whole else WARMING):
            self.tried(guard, *self.input(Random(number)))
        self.tally = Tally(faults=self.tally.faults)

    def input(self, random: Random) -> tuple[str, bytes]:
        """One whose checksums are right half of the time."""
        file, data = random.choice(self.valid)
        data = self.target.mutate(random, data)
        return file, self.target.seal(data) if random.randrange(2) else data

    def placed(self, file: str, data: bytes) -> None:
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

    def tried(self, guard: Any, file: str, data: bytes) -> Any:
        """The outcome of one input, which is also in the tally."""
        from tests.fuzz.targets import NotTried, refusals
        from tests.fuzz.watch import Outcome, kind_of_fault, kind_of_refusal

        self.placed(file, data)
        folder, target, tally = self.folder, self.target, self.tally
        assert folder is not None
        left_out = False

        def read() -> None:
            nonlocal left_out
            try:
                target.read(folder)
            except NotTried:
                left_out = True

        outcome = guard.tried(read, refusals(), target.names or Path(file).name)
        if left_out:
            return Outcome("left out")
        if outcome.kind == "refused" and target.accepts_all:
            outcome = Outcome("fault", f"refused, where damage is a miss: {outcome.said[:200]}")
        tally.tried += 1
        if outcome.kind == "accepted":
            tally.accepted += 1
        elif outcome.kind == "refused":
            tally.refused += 1
            tally.refusals[kind_of_refusal(outcome.said)] += 1
        else:
            kind = kind_of_fault(outcome.said)
            tally.faults[kind] += 1
            if tally.faults[kind] == 1:
                self.keep(file, data, outcome.said)
            if target.renewed is False:
                self.folder = None
        return outcome

    def keep(self, file: str, data: bytes, said: str) -> None:
        """An input that showed a fault, for whoever mends it."""
        folder = self.scratch / "faults"
        folder.mkdir(exist_ok=True)
        stem = hashlib.sha256(data).hexdigest()[:12]
        (folder / stem).write_bytes(data)
        text = json.dumps({"target": self.name, "file": file, "said": said}, ensure_ascii=True, indent=1)
        (folder / f"{stem}.json").write_text(text, encoding="ascii")

    def chosen(self, data: bytes) -> tuple[str, bytes]:
        """An input without a file, of bytes that stand for choices."""
        return "", self.target.mutate(Choices(data), b"")

    def note(self) -> None:
        (self.scratch / "tally.json").write_text(json.dumps(self.tally.as_json()), encoding="utf-8")


def by_chance(trial: Trial, guard: Any, seconds: float, inputs: int, seed: int, first: int = 0) -> int:
    """The number of the next input; each is the same for the same seed and number."""
    began, current, number = time.monotonic(), trial.scratch / "current", first - 1
    until, before = began + seconds, trial.tally.seconds
    for number in range(first, inputs):
        if time.monotonic() > until:
            break
        file, data = trial.input(Random(f"{trial.name} {seed} {number}"))
        current.write_bytes(file.encode() + b"\n" + data)
        trial.tried(guard, file, data)
        trial.tally.seconds = before + time.monotonic() - began
        if number % 50 == 0:
            trial.note()
    trial.note()
    return number + 1


def guided(trial: Trial, guard: Any, seconds: float, inputs: int, seed: int) -> None:
    """Never returns: libFuzzer ends the process. What reaches new code is changed further."""
    import atheris

    file, by_choices = trial.valid[0][0], not trial.target.files
    corpus = trial.scratch / "guided"
    corpus.mkdir(exist_ok=True)
    random = Random(f"{trial.name} {seed}")
    beginnings = [random.randbytes(64) for _ in range(BEGINNINGS)] if by_choices else [data for _, data in trial.valid]
    for number, data in enumerate(beginnings):
        (corpus / f"valid{number}").write_bytes(data)
    began, current = time.monotonic(), trial.scratch / "current"

    def changed(data: bytes, most: int, chosen: int) -> bytes:
        random = Random(chosen)
        try:
            found = trial.target.mutate(random, data or trial.valid[0][1])
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError, IndexError):  # too far from valid
            found = atheris.Mutate(data, most)
        return (trial.target.seal(found) if random.randrange(2) else found)[:most]

    def one(given: bytes) -> None:
        name, data = trial.chosen(given) if by_choices else (file, given)
        current.write_bytes(name.encode() + b"\n" + data)
        trial.tried(guard, name, data)
        trial.tally.seconds = time.monotonic() - began
        if trial.tally.tried % 50 == 0 or trial.tally.seconds > seconds - 2.0:
            trial.note()

    longest = LONGEST_CHOICES if by_choices else GUIDED_LENGTH
    limits = {"max_total_time": max(1, int(seconds)), "runs": min(inputs, (1 << 31) - 1), "max_len": longest}
    # time and memory are watched here
    limits |= {"timeout": 0, "rss_limit_mb": 0, "seed": seed + 1, "print_final_stats": 1, "len_control": 0}
    options = [f"-{name}={value}" for name, value in limits.items()]
    own = {} if by_choices else {"custom_mutator": changed}
    atheris.Setup([sys.argv[0], *options, str(corpus)], one, **own, internal_libfuzzer=True)
    atheris.Fuzz()


def _followed() -> AbstractContextManager[Any]:
    """Modules of ours that are imported within tell atheris where they have been."""
    import atheris

    return cast(Any, atheris.instrument_imports(include=list(PACKAGES), enable_loader_override=False))


def _import_all() -> None:
    """Commands import what they need when they need it."""
    for package in PACKAGES:
        for found in pkgutil.walk_packages(importlib.import_module(package).__path__, f"{package}."):
            with suppress(ImportError):  # of an extra that is not installed
                importlib.import_module(found.name)


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
        if options.guided and not trial.target.files:
            _import_all()
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
