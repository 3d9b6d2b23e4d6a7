"""`gates/classes/NAME.json`: what one class of processor gave, which the same class is to give again."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from harness.gate.catalog import WIDER, Gate, Kind, settings_of
from harness.gate.limits_file import KindFacts, a_line_each
from harness.json_record import load_json, write_whole
from scenes.errors import InputError

SCHEMA = 1
USUAL = "avx2"
"""The class that a class without references is held to, with wider limits."""


@dataclass(frozen=True)
class Course:
    """What was seen of the first steps of one training."""

    losses: list[float]
    """Of each step, before it."""
    renders: dict[str, list[float]]
    """After so many steps: red, green, blue and depth of some pixels of a test view."""


Courses = dict[str, dict[str, Course]]
"""Precision → start → what was seen."""


@dataclass(frozen=True)
class References:
    """One class of processor."""

    name: str
    kinds: dict[str, KindFacts] = field(default_factory=dict)
    profiles: dict[str, Any] = field(default_factory=dict)
    """Setting of a profile → its value."""
    courses: Courses = field(default_factory=dict)
    reordered: dict[str, dict[str, float]] = field(default_factory=dict)
    """Precision → another order of the same sums → the largest deviation that it makes."""
    cells: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    """"scene/method/seed" → score → one value for each draw of the rounding."""
    statistics: dict[str, list[float]] = field(default_factory=dict)
    """Comparison → difference and ends of its intervals, of the cells above."""
    speed: dict[str, list[float]] = field(default_factory=dict)
    """Gate → quotients, one a process."""
    known: bool = True
    """False for the references of another class than the one that is measured."""

    def wider(self, kind: Kind) -> float:
        """By how much the limits of a kind are wider than on the class of these references."""
        return 1.0 if self.known else WIDER[kind]

    def missing(self, gate: Gate) -> str:
        """Why a gate cannot be held to these references, with the remedy; empty where it can."""
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
    """Those of class `name`, or else of the usual one, as not known. Raises `InputError` where there is neither."""
    if references_file(folder, name).exists():
        return read_references(folder, name)
    found = read_references(folder, USUAL)
    return References(**{**vars(found), "known": False})


def read_references(folder: Path, name: str) -> References:
    """Raises `InputError`, with the remedy, for a file that is missing or damaged."""
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
    """Raises `OSError` where it cannot be written."""
    data = {"schema": SCHEMA, **asdict(found)}
    del data["known"]
    write_whole(references_file(folder, found.name), a_line_each(data).encode())


def _course(found: dict[str, Any]) -> Course:
    return Course(_numbers(found["losses"]), {str(step): _numbers(seen) for step, seen in found["renders"].items()})


def _numbers_by_name(found: dict[str, Any]) -> dict[str, float]:
    return {name: _numbers([value])[0] for name, value in found.items()}


def _numbers(found: Any) -> list[float]:
    if not isinstance(found, list) or not found or any(type(one) not in (int, float) for one in found):
        raise ValueError(f"{str(found)[:40]} is no list of numbers")
    return [float(one) for one in found]
