"""The results of one class of processor, `gates/classes/NAME.json`, which the same class must reproduce; and how well
the order of methods there predicts that of a complete run.
"""

import json
from collections import defaultdict
from dataclasses import asdict, dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import kendalltau, spearmanr

from harness.gate.gates import WIDER, Gate, Kind, settings_of
from harness.gate.limits import KindFacts, a_line_each
from harness.records.json_record import load_json, write_json
from scenes.files.atomic import write_atomically
from scenes.files.errors import InputError

SCHEMA = 1
USUAL = "avx2"
"""The class whose references a class without its own is compared with, with wider limits."""


@dataclass(frozen=True)
class Course:
    """The record of the first steps of one training."""

    losses: list[float]
    """The loss of each step, before it."""
    renders: dict[str, list[float]]
    """Red, green, blue and depth of some pixels of a test view, by number of steps."""


Courses = dict[str, dict[str, Course]]
"""Precision → start → its record."""


@dataclass(frozen=True)
class References:
    """The references of one class of processor."""

    name: str
    kinds: dict[str, KindFacts] = field(default_factory=dict)
    profiles: dict[str, Any] = field(default_factory=dict)
    """Setting of a profile → its value."""
    courses: Courses = field(default_factory=dict)
    reordered: dict[str, dict[str, float]] = field(default_factory=dict)
    """Precision → another order of the same sums → the largest deviation that it causes."""
    cells: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    """"scene/method/seed" → score → one value for each draw of the rounding."""
    statistics: dict[str, list[float]] = field(default_factory=dict)
    """Comparison → difference and ends of its intervals, of the cells above."""
    speed: dict[str, list[float]] = field(default_factory=dict)
    """Gate → quotients, one per process."""
    known: bool = True
    """False for the references of another class than the one that is measured."""

    def wider(self, kind: Kind) -> float:
        """Return by how much the limits of a kind are wider than on the class of these references."""
        return 1.0 if self.known else WIDER[kind]

    def missing(self, gate: Gate) -> str:
        """Return why a gate cannot be compared with these references, with the remedy; empty if it can."""
        remedy = f"renew with `python -m harness gate --renew --only {gate.kind}` and review what changed"
        facts = self.kinds.get(gate.kind)
        if facts is None:
            return f"class {self.name} has no references for it; {remedy}"
        if facts.settings != json.loads(json.dumps(settings_of(gate.kind))):
            return f"its references were measured with other settings of the gate; {remedy}"
        return ""


def references_file(folder: Path, name: str) -> Path:
    return folder / f"{name}.json"


def references_for(folder: Path, name: str) -> References:
    """Return those of class `name`, or else of the usual one, as not known. Raises `InputError` if there is neither."""
    if references_file(folder, name).exists():
        return read_references(folder, name)
    found = read_references(folder, USUAL)
    return References(**{**vars(found), "known": False})


def read_references(folder: Path, name: str) -> References:
    """Read references. Raises `InputError`, with the remedy, for a file that is missing or damaged."""
    file = references_file(folder, name)
    remedy = "get it back from version control, or make it with `python -m harness gate --renew`"
    try:
        data = load_json(file)
        if data["schema"] != SCHEMA:
            raise ValueError(f"schema {data['schema']}, this version reads {SCHEMA}")
        return References(
            name=str(data["name"]),
            kinds={kind: KindFacts(**facts) for kind, facts in data["kinds"].items()},
            profiles=dict(data["profiles"]),
            courses={
                precision: {start: _course(found) for start, found in starts.items()}
                for precision, starts in data["courses"].items()
            },
            reordered={precision: _numbers_by_name(found) for precision, found in data["reordered"].items()},
            cells={
                cell: {score: _numbers(draws) for score, draws in scores.items()}
                for cell, scores in data["cells"].items()
            },
            statistics={row: _numbers(found) for row, found in data["statistics"].items()},
            speed={gate: _numbers(found) for gate, found in data["speed"].items()},
        )
    except FileNotFoundError as error:
        raise InputError(f"{file}: there is no such file; {remedy}") from error
    except (OSError, KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise InputError(f"{file}: damaged ({error}); {remedy}") from error


def write_references(folder: Path, found: References) -> None:
    """Write references. Raises `OSError` if they cannot be written."""
    data = {"schema": SCHEMA, **asdict(found)}
    del data["known"]
    write_atomically(references_file(folder, found.name), a_line_each(data))


def _course(found: dict[str, Any]) -> Course:
    return Course(_numbers(found["losses"]), {str(step): _numbers(seen) for step, seen in found["renders"].items()})


def _numbers_by_name(found: dict[str, Any]) -> dict[str, float]:
    return {name: _numbers([value])[0] for name, value in found.items()}


def _numbers(found: Any) -> list[float]:
    if not isinstance(found, list) or not found or any(type(one) not in (int, float) for one in found):
        raise ValueError(f"{str(found)[:40]} is no list of numbers")
    return [float(one) for one in found]


RANK_FILE = "rank.json"
FEWEST = 4
"""The fewest pairs of a scene and a method that a correlation needs."""
Scores = dict[tuple[str, str], float]
"""(scene, method) → PSNR, mean over seeds."""


@dataclass(frozen=True)
class Ranks:
    """The similarity of the orders of scenes and methods at two scales."""

    spearman: float
    """The rank correlation over all pairs of a scene and a method."""
    kendall: float
    pairs: int
    compared: int
    """The number of pairs of methods on the same scene."""
    same_order: int
    """The number of these in the same order at both scales."""


def ranks(ours: Scores, theirs: Scores) -> Ranks:
    """Compare two scales. Raises `ValueError` if there are too few pairs in common."""
    common = sorted(ours.keys() & theirs.keys())
    if len(common) < FEWEST:
        raise ValueError(f"{len(common)} pairs of a scene and a method in common, {FEWEST} are needed")
    a, b = (np.array([scores[key] for key in common]) for scores in (ours, theirs))
    same = [
        (ours[first] - ours[second]) * (theirs[first] - theirs[second]) > 0
        for first, second in combinations(common, 2)
        if first[0] == second[0]
    ]
    return Ranks(
        float(spearmanr(a, b).statistic), float(kendalltau(a, b).statistic), len(common), len(same), int(sum(same))
    )


def gate_scores(references: References) -> Scores:
    """Return the stored cells of the gate."""
    found = defaultdict(list)
    for key, scores in references.cells.items():
        scene, method, _ = key.split("/")
        found[scene, method].append(scores["psnr"][0])
    return {key: float(np.mean(values)) for key, values in found.items()}


def run_scores(summary: dict[str, Any]) -> Scores:
    """Return the finished cells of a run's `summary.json`."""
    found = defaultdict(list)
    for cell in summary["cells"]:
        if cell["status"] == "done" and cell["psnr"] is not None:
            found[cell["scene"], cell["method"]].append(float(cell["psnr"]))
    return {key: float(np.mean(values)) for key, values in found.items()}


def publish(run: Path, folder: Path) -> str:
    """Write `rank.json` beside the limits and return it in words. Raises `InputError` for a run that has no summary."""
    file = run / "summary.json" if run.is_dir() else run
    try:
        summary = load_json(file)
        theirs = run_scores(summary)
        plan = {"profile": str(summary["profile"]), "commit": str(summary["provenance"]["commit"])}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"--rank {run}: no summary of a finished run ({error}); give a run's output folder") from error
    ours = gate_scores(read_references(folder / "classes", USUAL))
    try:
        found = ranks(ours, theirs)
    except ValueError as error:
        raise InputError(f"--rank {run}: {error}; a default run has them") from error
    rows = [
        {"scene": scene, "method": method, "gate": round(ours[scene, method], 3), "run": round(score, 3)}
        for (scene, method), score in sorted(theirs.items())
        if (scene, method) in ours
    ]
    numbers = {name: round(value, 3) for name, value in vars(found).items()}
    write_json(folder / RANK_FILE, {"schema": 1, "run": plan, **numbers, "scores": rows})
    return (
        f"Spearman {found.spearman:.2f}, Kendall {found.kendall:.2f} over {found.pairs} pairs of a scene and a method; "
        f"{found.same_order} of {found.compared} pairs of methods in the same order; {folder / RANK_FILE}"
    )
