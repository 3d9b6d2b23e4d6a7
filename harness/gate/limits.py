"""Limits of images and families derived from measurements (`gates/limits.json`), and how a figure is judged by a limit.

A limit is a prediction interval: for normal measurements, new renders of the same code lie outside with a probability
of `LEVEL`, including the uncertainty of the spread (Student). Few measurements do not show how well that holds in the
outer tail. No measurement is ever left out. The file holds for every processor, and is reviewed like code.
"""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
from msgspec import field, structs
from scipy.special import ndtri, stdtrit

from harness.gate.gates import Gate, Kind, gates, settings_of
from harness.records.json_record import Record, plain, read_record
from harness.records.study import Check, check
from harness.verdicts.statistics import POWER, shift_found
from scenes.files.atomic import write_atomically
from scenes.files.errors import DamagedRecord, InputError
from scenes.files.json_object import JsonObject

LEVEL = 0.01 / 80
EULER = 0.5772156649
SCHEMA = 1
DIGITS = 5


class Limit(Record, frozen=True):
    low: float | None
    high: float | None
    centre: float | None = None
    spread: float | None = None
    """The standard deviation of one measurement, in the gate's unit; of the logarithm for `largest`."""
    measured: int = 0
    detects: float | None = None
    """The change of the figure that 80 % of repetitions of renewal and gate find, if the true spread is `spread`; for
    `largest` the deviation itself."""

    def __post_init__(self) -> None:
        if self.low is None and self.high is None:
            raise ValueError("there is neither a lower nor an upper limit")


NONE_DIFFERS = Limit(None, 0.0)


def judge(gate: Gate, values: Sequence[float | None], limit: Limit | str, why: str = "") -> Check:
    """Judge the figure of the new measurements `values` by its limit; a text says why there is none.

    It fails without a limit, and without a figure: a missing or non-finite value is never left out.
    """
    sample = [value for value in values if value is not None and math.isfinite(value)]
    figure = None
    if sample and len(sample) == len(values):
        figure = float(np.max(sample) if gate.is_largest else np.mean(sample))
    if isinstance(limit, str):
        unlimited = check(gate.what, figure, unit=gate.unit, why=limit, subject=gate.name, id=gate.name)
        return structs.replace(unlimited, status="fail")
    detects = "" if limit.detects is None else f"detects {limit.detects:.3g}{gate.unit and f' {gate.unit}'}"
    why = "; ".join(filter(None, (why or ("no finite figure" if figure is None else ""), detects)))
    return check(gate.what, figure, limit.low, limit.high, gate.unit, why, subject=gate.name, id=gate.name)


def limit_from(gate: Gate, values: Sequence[float]) -> Limit:
    """Return the limit from three or more finite measurements, other than the gate's; raises `ValueError`."""
    sample = np.asarray(values, dtype=np.float64)
    if sample.size < 3 or not np.isfinite(sample).all():
        raise ValueError(f"{gate.name}: three or more finite measurements are needed, got {values}")
    if gate.is_largest:
        if sample.min() <= 0:
            raise ValueError(f"{gate.name}: measurements must be above 0, got {values}")
        sample = np.log(sample)
    centre, spread, many = float(sample.mean()), float(sample.std(ddof=1)), int(sample.size)
    if gate.is_largest:
        # the logarithm of the largest of very many pixels is taken as Gumbel-distributed; its scale is the upper end of
        # its 99 % interval, as the limit is far beyond the measurements
        scale = spread * math.sqrt(6) / math.pi
        upper = scale * (1 + float(ndtri(0.99)) * 1.05 / math.sqrt(many))
        high = math.exp(centre - EULER * scale + upper * (math.log(gate.new) - math.log(-math.log1p(-LEVEL))))
        # a deviation adds to noise of one standard deviation
        return Limit(None, high, math.exp(centre), spread, many, high + float(ndtri(POWER)))
    error = spread * math.sqrt(1 / gate.new + 1 / many)
    beyond = float(stdtrit(many - 1, 1 - LEVEL / 2))
    half = beyond * error
    return Limit(centre - half, centre + half, centre, spread, many, shift_found(beyond, many - 1) * error)


class KindFacts(Record, frozen=True):
    settings: JsonObject
    provenance: JsonObject
    seconds: float
    files: dict[str, str] = field(default_factory=dict)


def unfit(kind: Kind, kinds: Mapping[Kind, KindFacts]) -> str:
    """Return why a kind cannot be compared with the stored values, with the remedy; empty if it can."""
    remedy = f"renew with `python -m harness gate --renew --only {kind}` and review what changed"
    if kind not in kinds:
        return f"nothing is stored for it; {remedy}"
    if kinds[kind].settings != settings_of(kind):
        return f"what is stored was measured with other settings of the gate; {remedy}"
    return ""


class LimitsFile(Record, frozen=True):
    kinds: dict[Kind, KindFacts] = field(default_factory=dict)
    limits: dict[str, Limit] = field(default_factory=dict)
    values: dict[str, list[float]] = field(default_factory=dict)
    """Gate → the measurements at renewal, from which its limit follows (`limit_from`)."""
    schema: int = SCHEMA

    def limit_of(self, gate: Gate) -> Limit | str:
        """Return the limit, or why there is none, with the remedy."""
        return unfit(gate.kind, self.kinds) or self.limits.get(gate.name) or unfit(gate.kind, {})

    def renewed(self, kind: Kind, values: Mapping[str, Sequence[float]], facts: KindFacts) -> "LimitsFile":
        """Return the file with new measurements of one kind; every limit is computed again."""
        measured = self.values | {name: [_rounded(value) for value in some] for name, some in values.items()}
        measured = {gate.name: measured[gate.name] for gate in gates() if gate.name in measured}
        limits = {}
        for gate in gates():
            if gate.name in measured:
                limit = limit_from(gate, measured[gate.name])
                numbers = {name: _rounded(end) for name, end in structs.asdict(limit).items() if isinstance(end, float)}
                limits[gate.name] = structs.replace(limit, **numbers)
        return LimitsFile({**self.kinds, kind: facts}, limits, measured)


Stored = TypeVar("Stored")


def read_stored(file: Path, kind: type[Stored]) -> Stored:
    """Read a reviewed file of gates; raises `InputError`, with the remedy, for a missing or damaged file."""
    remedy = "get it back from version control, or make it with `python -m harness gate --renew`, review and commit it"
    if not file.exists():
        raise InputError(f"{file}: there is no such file; {remedy}")
    try:
        return read_record(file, kind, SCHEMA, remedy=remedy, by_hand=True)
    except DamagedRecord as error:
        raise InputError(error) from error


def write_stored(file: Path, record: Record) -> None:
    """Write JSON with one line per entry of an object, so that a renewal has a readable diff."""

    def rows(value: object) -> str:
        if not isinstance(value, dict):
            return json.dumps(value, ensure_ascii=False)
        lines = [f"  {json.dumps(name)}: {json.dumps(entry, allow_nan=False)}" for name, entry in value.items()]
        return "{\n" + ",\n".join(lines) + "\n }" if lines else "{}"

    parts = [f" {json.dumps(key)}: {rows(value)}" for key, value in plain(record).items()]
    write_atomically(file, "{\n" + ",\n".join(parts) + "\n}\n")


def changes(before: LimitsFile, after: LimitsFile) -> list[str]:
    """Return a line, old → new, for each gate whose limits changed."""

    def shown(limit: Limit | None) -> str:
        if limit is None:
            return "none"
        return " … ".join("" if end is None else f"{end:.5g}" for end in (limit.low, limit.high))

    names = dict.fromkeys([*before.limits, *after.limits])
    pairs = {name: [shown(file.limits.get(name)) for file in (before, after)] for name in names}
    return [f"{name}: {old} → {new}" for name, (old, new) in pairs.items() if old != new]


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
