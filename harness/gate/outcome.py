"""What became of a gate."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from harness.gate.catalog import Gate
from harness.gate.limits import Limit, excess_of, figure_of


@dataclass(frozen=True)
class Pictures:
    """Display colour [height, width, 3] each: what a failing gate leaves behind."""

    image: np.ndarray
    reference: np.ndarray
    difference: np.ndarray


@dataclass(frozen=True)
class Sample:
    """New measurements for one gate."""

    values: Sequence[float | None]
    why: str = ""
    """Of a value that is missing."""
    pictures: Pictures | None = field(default=None, compare=False)
    limit: Limit | None = None
    """Of a gate whose limit depends on what was measured beside it, or on the class of the processor."""
    note: str = ""
    """What is to be said of the figure whether it passes or not."""


@dataclass(frozen=True)
class Outcome:
    """One gate of one run."""

    gate: Gate
    status: Literal["pass", "fail"]
    figure: float | None
    limit: Limit | None
    excess: float | None
    """By how much the figure is beyond its limit; None where it passes, and where there is no figure."""
    why: str = ""
    pictures: Pictures | None = field(default=None, compare=False)


def judged(gate: Gate, sample: Sample | None, limit: Limit | None, no_limit: str) -> Outcome:
    """Fails whatever has no figure, no limit or lies beyond it; `no_limit` is why there is none."""
    figure = None if sample is None else figure_of(gate, sample.values)
    pictures = None if sample is None else sample.pictures
    limit = sample.limit if sample is not None and sample.limit is not None else limit
    if limit is None:
        why = no_limit or (sample.why if sample is not None else "")
        return Outcome(gate, "fail", figure, None, None, why, pictures)
    if sample is None or figure is None:
        why = sample.why if sample is not None else ""
        return Outcome(gate, "fail", None, limit, None, why or "no finite figure", pictures)
    excess = excess_of(figure, limit)
    # also what does not compare is beyond
    if not excess <= 0:
        return Outcome(gate, "fail", figure, limit, excess, sample.why or sample.note, pictures)
    return Outcome(gate, "pass", figure, limit, None, sample.note)


def limits_in_words(outcome: Outcome) -> str:
    """`22.9 … 24.1 dB`, `at most 0`"""
    limit, unit = outcome.limit, outcome.gate.unit and f" {outcome.gate.unit}"
    if limit is None:
        return "no limit"
    if limit.low is None:
        return f"at most {limit.high:.4g}{unit}"
    if limit.high is None:
        return f"at least {limit.low:.4g}{unit}"
    return f"{limit.low:.4g} … {limit.high:.4g}{unit}"


def line_of(outcome: Outcome) -> str:
    """One plain line: status, name, measured, limit, and what is beyond it."""
    unit = outcome.gate.unit and f" {outcome.gate.unit}"
    measured = "no figure" if outcome.figure is None else f"{outcome.figure:.4g}{unit}"
    line = f"{outcome.status.upper()}  {outcome.gate.name:34} {measured:>22}   {limits_in_words(outcome)}"
    excess = "" if outcome.excess is None else f"   excess {outcome.excess:.3g}{unit}"
    return line + excess + (f"   {outcome.why}" if outcome.why else "")
