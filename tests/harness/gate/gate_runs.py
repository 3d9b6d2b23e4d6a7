"""Limits, references and figures that make every gate pass, in place of measurements."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.command.main import main
from harness.execution.progress import Progress
from harness.gate import early, fairness, gate_families, gate_speed, images
from harness.gate.gate_context import REFERENCED, GateContext, complete
from harness.gate.gates import KINDS, Gate, Kind, Scatter, gates, settings_of
from harness.gate.limits import NONE_DIFFERS, KindFacts, Limit, LimitsFile, judge, read_stored, write_stored
from harness.gate.quality import worse
from harness.gate.quality.losses import Judge
from harness.gate.references import REFERENCES_FILE, Course, Courses, Quotients, References
from harness.machine.processor_class import class_here
from harness.plan.run_plan import Machine
from harness.records.study import Check

GATES = Path(__file__).parents[3] / "gates"
"""The committed limits and references."""
CENTRE = 25.0
LIMITED: tuple[Kind, ...] = ("families", "images")
MODULES: dict[Kind, Any] = dict(zip(KINDS, (early, worse, gate_families, images, fairness, gate_speed), strict=True))


def facts(kind: Kind) -> KindFacts:
    return KindFacts(settings_of(kind), {}, 1.0)


COURSES: Courses = {"double": {"nerf": Course([0.5], {"1": [0.25]})}}


def references() -> References:
    return References(
        kinds={kind: facts(kind) for kind in REFERENCED},
        courses=COURSES,
        cells={"lego/nerf/1000": {"psnr": [20.0, 20.1, 20.2]}},
        statistics={"qnerf_nerf": [0.5, 0.25, 0.75]},
        speed={class_here(): Quotients(facts("speed"), {"speed.score": [2.0, 2.1]})},
    )


@pytest.fixture(scope="session")
def stored() -> References:
    """The committed references."""
    return read_stored(GATES / REFERENCES_FILE, References)


def usual_judge(stored: References, scatter: Scatter = "rounding") -> Judge:
    """Return the judge of the first draw of each stored cell."""
    cells = {key: {score: draws[0] for score, draws in scores.items()} for key, scores in stored.cells.items()}
    return replace(Judge.of(stored, cells, has_changed=False), scatter=scatter)  # type: ignore[arg-type]


@pytest.fixture
def limits(tmp_path: Path) -> Path:
    file = tmp_path / "gates" / "limits.json"
    stored = LimitsFile()
    for kind in LIMITED:
        generator, names = np.random.default_rng(1), [gate.name for gate in gates() if gate.kind == kind]
        values = {name: (CENTRE + 0.1 * generator.standard_normal(12)).tolist() for name in names}
        stored = stored.renewed(kind, values, facts(kind))
    write_stored(file, stored)
    write_stored(tmp_path / "gates" / REFERENCES_FILE, references())
    return file


def sound(gate: Gate, limits: LimitsFile, values: list[float | None] | None = None, why: str = "") -> Check:
    """Return the check of values within the limit of the gate's kind, or of the given values."""
    counts = gate.kind == "fairness" or gate.name in ("changed.settings", "worse.headline.statistics")
    limit = NONE_DIFFERS if counts else Limit(CENTRE - 1.0, CENTRE + 1.0)
    values = [0.0 if counts else CENTRE] * gate.new if values is None else values
    return judge(gate, values, limits.limit_of(gate) if gate.kind in LIMITED else limit, why)


@pytest.fixture
def measuring(monkeypatch: pytest.MonkeyPatch) -> dict[str, tuple[list[float | None], str]]:
    """Return the changes of sound measurements, gate → its values and the reason, which a test fills."""
    changed: dict[str, tuple[list[float | None], str]] = {}

    def measured(kind: Kind, context: GateContext) -> Iterator[Check]:
        for name, gate in context.of_kind(kind).items():
            yield sound(gate, context.limits, *changed.get(name, ()))

    for kind in KINDS:
        answer = getattr(MODULES[kind], "_answer", lambda checks: "")
        monkeypatch.setattr(MODULES[kind], "measure", complete(kind, answer)(partial(measured, kind)))
    monkeypatch.setattr(images, "references_for", lambda context: {})
    return changed


def context_of(chosen: tuple[Gate, ...], limits: Path) -> GateContext:
    stored, here = read_stored(limits, LimitsFile), limits.parent
    machine = Machine("cpu", 1, 1)
    return GateContext(
        here, here, here, False, Progress(), machine, chosen, stored, references(), limits, lambda: COURSES
    )


def gate_line(limits: Path, out: Path, *others: str) -> int:
    return main(["gate", "--limits", str(limits), "--out", str(out), *others])
