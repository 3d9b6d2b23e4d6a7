"""The context in which a kind of gate is measured, the outcome of a gate, and all of them as JUnit XML."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

import numpy as np

from harness.execution.progress import Progress
from harness.gate.gates import KINDS, Gate
from harness.gate.limits import Limit, LimitsFile, excess_of, figure_of
from harness.gate.references import References
from scenes.files.atomic import write_atomically


@dataclass(frozen=True)
class Pictures:
    """The pictures of a failing gate, display colour [height, width, 3] each."""

    image: np.ndarray
    reference: np.ndarray
    difference: np.ndarray


@dataclass(frozen=True)
class Sample:
    """New measurements for one gate."""

    values: Sequence[float | None]
    why: str = ""
    """The reason why a value is missing."""
    pictures: Pictures | None = field(default=None, compare=False)
    limit: Limit | None = None
    """The limit of a gate whose limit depends on what was measured beside it, or on the class of the processor."""
    note: str = ""
    """A remark about the figure, shown whether it passes or not."""


@dataclass(frozen=True)
class GateOutcome:
    """One gate of one run."""

    gate: Gate
    status: Literal["pass", "fail"]
    figure: float | None
    limit: Limit | None
    excess: float | None
    """The amount by which the figure is beyond its limit; None if it passes, and if there is no figure."""
    why: str = ""
    pictures: Pictures | None = field(default=None, compare=False)


def judged(gate: Gate, sample: Sample | None, limit: Limit | None, no_limit: str) -> GateOutcome:
    """Judge a sample: it fails if it has no figure, no limit or lies beyond it; `no_limit` is why there is none."""
    figure = None if sample is None else figure_of(gate, sample.values)
    pictures = None if sample is None else sample.pictures
    limit = sample.limit if sample is not None and sample.limit is not None else limit
    if limit is None:
        why = no_limit or (sample.why if sample is not None else "")
        return GateOutcome(gate, "fail", figure, None, None, why, pictures)
    if sample is None or figure is None:
        why = sample.why if sample is not None else ""
        return GateOutcome(gate, "fail", None, limit, None, why or "no finite figure", pictures)
    excess = excess_of(figure, limit)
    # also what does not compare is beyond
    if not excess <= 0:
        return GateOutcome(gate, "fail", figure, limit, excess, sample.why or sample.note, pictures)
    return GateOutcome(gate, "pass", figure, limit, None, sample.note)


def limits_in_words(outcome: GateOutcome) -> str:
    """Return the limits as `22.9 … 24.1 dB` or `at most 0`."""
    limit, unit = outcome.limit, outcome.gate.unit and f" {outcome.gate.unit}"
    if limit is None:
        return "no limit"
    if limit.low is None:
        return f"at most {limit.high:.4g}{unit}"
    if limit.high is None:
        return f"at least {limit.low:.4g}{unit}"
    return f"{limit.low:.4g} … {limit.high:.4g}{unit}"


def line_of(outcome: GateOutcome) -> str:
    """Return one plain line: status, name, measured, limit, and what is beyond it."""
    unit = outcome.gate.unit and f" {outcome.gate.unit}"
    measured = "no figure" if outcome.figure is None else f"{outcome.figure:.4g}{unit}"
    line = f"{outcome.status.upper()}  {outcome.gate.name:34} {measured:>22}   {limits_in_words(outcome)}"
    excess = "" if outcome.excess is None else f"   excess {outcome.excess:.3g}{unit}"
    return line + excess + (f"   {outcome.why}" if outcome.why else "")


@dataclass(frozen=True)
class GateContext:
    """One run of the gates."""

    out: Path
    limits: LimitsFile
    references: References
    """The references of the class of processor that is measured, or of another class."""
    images: Path
    """The folder of the stored mean and variance of the reference renders."""
    view_sets: Path
    workers: int
    show: Progress


Measure = Callable[[GateContext, tuple[Gate, ...]], dict[str, Sample]]
"""New measurements for the gates requested; one that is missing fails."""


def write_junit(
    file: Path, outcomes: Sequence[GateOutcome], seconds: Mapping[str, float], replay: Mapping[str, str]
) -> None:
    """Write a suite per kind and a test case per gate; `seconds` is by kind, `replay` by name of a failing gate."""
    failed = sum(one.status == "fail" for one in outcomes)
    top = ElementTree.Element("testsuites", tests=str(len(outcomes)), failures=str(failed), errors="0")
    for kind in KINDS:
        of_kind = [one for one in outcomes if one.gate.kind == kind]
        if not of_kind:
            continue
        bad = sum(one.status == "fail" for one in of_kind)
        took = seconds.get(kind, 0.0)
        suite = ElementTree.SubElement(
            top, "testsuite", name=f"gate.{kind}", tests=str(len(of_kind)), failures=str(bad), errors="0",
            time=f"{took:.3f}",
        )  # fmt: skip
        for one in of_kind:
            # a kind is measured as a whole: its time is shared evenly
            case = ElementTree.SubElement(
                suite, "testcase", classname=f"gate.{kind}", name=one.gate.name, time=f"{took / len(of_kind):.3f}"
            )
            if one.status == "fail":
                figure = "no figure" if one.figure is None else f"{one.figure:.6g} {one.gate.unit}".strip()
                message = f"{one.gate.what}: {figure}, {limits_in_words(one)}"
                failure = ElementTree.SubElement(case, "failure", type="gate", message=message)
                failure.text = f"{line_of(one)}\n{replay.get(one.gate.name, '')}\n"
    ElementTree.indent(top)
    write_atomically(file, ElementTree.tostring(top, encoding="utf-8", xml_declaration=True))
