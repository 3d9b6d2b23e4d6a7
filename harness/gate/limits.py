"""Limits of images derived from measurements (`gates/limits.json`), and the changes that they detect.

A limit is a prediction interval: new renders of the same code lie outside with a probability of `LEVEL`, if spreads are
normal, their own uncertainty included (Student). How far that holds in the outer tail is not known from a few
measurements; no measurement is ever left out. The file holds for every processor, and is reviewed like code.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from harness.gate.gates import Gate, Kind, settings_of
from harness.records.json_record import load_json
from harness.verdicts.statistics import POWER, shift_found
from scenes.files.atomic import write_atomically
from scenes.files.errors import InputError

LEVEL = 0.01 / 80
EULER = 0.5772156649


@dataclass(frozen=True)
class Limit:
    """The limits of one gate: at least `low`, at most `high`."""

    low: float | None
    high: float | None
    centre: float | None = None
    spread: float | None = None
    """The standard deviation of one measurement, in the gate's unit; of the logarithm for `largest`."""
    measured: int = 0
    """The number of measurements that it is made of."""
    detects: float | None = None
    """The change of the figure that is found in 80 % of repetitions of renewal and gate, if the true spread is
    `spread`; for `largest` the deviation itself."""


NONE_DIFFERS = Limit(None, 0.0, detects=1.0)


def limit_from(gate: Gate, values: Sequence[float]) -> Limit:
    """Return the limit from independent measurements that are not those of the gate.

    Raises `ValueError` for fewer than three, and for one that is not finite.
    """
    sample = np.asarray(values, dtype=np.float64)
    if sample.size < 3 or not np.isfinite(sample).all():
        raise ValueError(f"{gate.name}: three or more finite measurements are needed, got {values}")
    if gate.rule == "largest":
        if sample.min() <= 0:
            raise ValueError(f"{gate.name}: measurements must be above 0, got {values}")
        sample = np.log(sample)
    centre, spread, many = float(sample.mean()), float(sample.std(ddof=1)), int(sample.size)
    if gate.rule == "largest":
        return _largest(centre, spread, many, gate.new)
    error = spread * math.sqrt(1 / gate.new + 1 / many)
    beyond = _quantile(1 - LEVEL / 2, many - 1)
    wide = beyond * error
    return Limit(centre - wide, centre + wide, centre, spread, many, shift_found(beyond, many - 1) * error)


def _largest(centre: float, spread: float, many: int, new: int) -> Limit:
    """Return a limit by moments of a Fréchet distribution: the logarithm of the largest of very many pixels is taken to
    be Gumbel's.

    Its scale is taken at the upper end of its 99 % interval, as the limit is far beyond what was measured.
    """
    scale = spread * math.sqrt(6) / math.pi
    upper = scale * (1 + float(norm.ppf(0.99)) * 1.05 / math.sqrt(many))
    high = centre - EULER * scale + upper * (math.log(new) - math.log(-math.log1p(-LEVEL)))
    # a deviation is on top of noise of one standard deviation
    return Limit(None, math.exp(high), math.exp(centre), spread, many, math.exp(high) + float(norm.ppf(POWER)))


@cache
def _quantile(share: float, freedom: int) -> float:
    """Return Student's quantile."""
    return float(student.ppf(share, freedom))


def figure_of(gate: Gate, values: Sequence[float | None]) -> float | None:
    """Return the gate's figure from its new measurements; None if one is missing or not finite: that is never left
    out.
    """
    sample = [value for value in values if value is not None and math.isfinite(value)]
    if len(sample) != len(values) or not sample:
        return None
    return float(np.max(sample) if gate.rule == "largest" else np.mean(sample))


def excess_of(figure: float, limit: Limit) -> float:
    """Return by how much the figure is beyond its limit; 0 or less if it is within."""
    beyond = [limit.low - figure] if limit.low is not None else []
    beyond += [figure - limit.high] if limit.high is not None else []
    return max(beyond)


SCHEMA = 1
DIGITS = 5


@dataclass(frozen=True)
class KindFacts:
    """The place and the tools with which the limits of a kind were measured."""

    settings: dict[str, Any]
    provenance: dict[str, Any]
    seconds: float
    files: dict[str, str] = field(default_factory=dict)
    """File that belongs to them → SHA-256."""


@dataclass(frozen=True)
class LimitsFile:
    kinds: dict[str, KindFacts] = field(default_factory=dict)
    values: dict[str, list[float]] = field(default_factory=dict)
    """Gate → the measurements at renewal; limits follow from them (`harness.gate.limits.limit_from`)."""
    limits: dict[str, Limit] = field(default_factory=dict)
    """The limits in force."""

    def limit_of(self, gate: Gate) -> tuple[Limit | None, str]:
        """Return the limit, or None and why there is none, with the remedy."""
        remedy = f"renew with `python -m harness gate --renew --only {gate.name}` and review what changed"
        if gate.name not in self.limits:
            return None, f"there is no limit for it; {remedy}"
        facts = self.kinds.get(gate.kind)
        if facts is None or facts.settings != json.loads(json.dumps(settings_of(gate.kind))):
            return None, f"its limit was measured with other settings of the gate; {remedy}"
        return self.limits[gate.name], ""

    def renewed(
        self, kind: Kind, values: Mapping[str, Sequence[float]], facts: KindFacts, table: Sequence[Gate]
    ) -> "LimitsFile":
        """Return the file with new measurements of one kind; every limit is computed anew."""
        kept = self.values | {name: [_rounded(one) for one in found] for name, found in values.items()}
        kept = {gate.name: kept[gate.name] for gate in table if gate.name in kept}
        limits = {gate.name: _tidy(limit_from(gate, kept[gate.name])) for gate in table if gate.name in kept}
        return replace(self, kinds={**self.kinds, kind: facts}, values=kept, limits=limits)


def read_limits(file: Path) -> LimitsFile:
    """Read the limits. Raises `InputError`, with the remedy, for a file that is missing or damaged."""
    remedy = "make it with `python -m harness gate --renew`, review it, and commit it"
    restore = f"get it back from version control, or {remedy}"
    try:
        data = load_json(file)
    except FileNotFoundError as error:
        raise InputError(f"--limits {file}: there is no such file; {remedy}") from error
    except (OSError, ValueError) as error:
        raise InputError(f"--limits {file}: {error}; {restore}") from error
    try:
        if data["schema"] != SCHEMA:
            raise ValueError(f"schema {data['schema']}, this version reads {SCHEMA}")
        kinds = {name: KindFacts(**facts) for name, facts in data["kinds"].items()}
        limits = {name: Limit(**{key: _number(value) for key, value in one.items()}) for name, one in
                  data["limits"].items()}  # fmt: skip
        values = {name: [float(one) for one in found] for name, found in data["values"].items()}
        for name, limit in limits.items():
            if limit.low is None and limit.high is None:
                raise ValueError(f"{name} has neither a lower nor an upper limit")
        return LimitsFile(kinds, values, limits)
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise InputError(f"--limits {file}: damaged ({error}); {restore}") from error


def write_limits(file: Path, limits: LimitsFile) -> None:
    """Write the limits. Raises `OSError` if they cannot be written."""
    text = {
        "schema": SCHEMA,
        "kinds": {name: asdict(facts) for name, facts in sorted(limits.kinds.items())},
        "limits": {name: asdict(limit) for name, limit in limits.limits.items()},
        "values": limits.values,
    }
    write_atomically(file, a_line_each(text))


def a_line_each(data: dict[str, Any]) -> str:
    """Return JSON in which each entry of an object has its line, so that a renewal reads as a diff."""

    def rows(found: dict[str, Any]) -> str:
        lines = [f"  {json.dumps(name)}: {json.dumps(one, allow_nan=False)}" for name, one in found.items()]
        return "{\n" + ",\n".join(lines) + "\n }" if lines else "{}"

    parts = [
        f" {json.dumps(key)}: {rows(value) if isinstance(value, dict) else json.dumps(value, ensure_ascii=False)}"
        for key, value in data.items()
    ]
    return "{\n" + ",\n".join(parts) + "\n}\n"


def changes(before: LimitsFile, after: LimitsFile) -> list[str]:
    """Return old → new, a line for each gate whose limits changed."""
    lines = []
    for name in dict.fromkeys([*before.limits, *after.limits]):
        old, new = (_words(found.limits.get(name)) for found in (before, after))
        if old != new:
            lines.append(f"{name}: {old} → {new}")
    return lines


def _words(limit: Limit | None) -> str:
    if limit is None:
        return "none"
    low, high = ("" if value is None else f"{value:.5g}" for value in (limit.low, limit.high))
    return f"{low} … {high}"


def _number(value: Any) -> Any:
    if value is not None and (
        isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value)
    ):
        raise ValueError(f"{value!r} is not a finite number")
    return value


def _tidy(limit: Limit) -> Limit:
    return Limit(**{name: value if name == "measured" else _rounded(value) for name, value in asdict(limit).items()})


def _rounded(value: Any) -> Any:
    return None if value is None else float(f"{value:.{DIGITS}g}")
