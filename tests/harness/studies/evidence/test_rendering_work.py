"""Rendering of fields in closed form by every rule and sampler, and what is concluded from given errors and times."""

import math
from pathlib import Path

import pytest
import torch

from baselines.contract import Rays
from baselines.numerics.quadrature import QUADRATURES
from baselines.occupancy import OccupancyGrid
from harness.execution.progress import Quiet
from harness.plan.run_plan import Machine
from harness.records.study import Check, Table
from harness.studies.evidence.evidence_context import EvidenceContext
from harness.studies.evidence.work import rendering_work as study
from harness.studies.evidence.work.rendering_work import (
    SAMPLERS,
    EmptyOutside,
    Frame,
    Line,
    Sampler,
    fastest,
    measure_lines,
)
from harness.training.lockstep import trained_alone
from harness.training.trainer import Trainer
from scenes.view_sets.view_set import ViewSet
from tests.baselines.analytic import AnalyticField, cube, gaussian, homogeneous
from tests.baselines.test_rendering import gaussian_opacity
from tests.harness.tiny import BUDGET, CPU, TRAIN

BOX = cube(dtype=torch.float32)
BLOB = AnalyticField(gaussian(3.0, 0.3), (0.5, 0.5, 0.5))
FOG = AnalyticField(homogeneous(1.0), (0.5, 0.5, 0.5))
NAMED = {sampler.name: sampler for sampler in SAMPLERS}
OURS = [name for name, rule in QUADRATURES.items() if not rule.of_the_paper]


def axial(offsets: tuple[float, ...] = (0.0, 0.2, 0.5)) -> Rays:
    """Rays along −z from z = 4, at `offsets` from the axis."""
    origins = torch.tensor([[offset, 0.0, 4.0] for offset in offsets])
    return Rays(origins, torch.tensor([[0.0, 0.0, -1.0]]).expand(len(offsets), 3).contiguous(), 2.0, 6.0)


def frame(field: AnalyticField = BLOB, rays: Rays | None = None) -> Frame:
    return Frame(EmptyOutside(field, BOX), rays or axial(), BOX, OccupancyGrid(8, BOX, 0.01), torch.ones(3), 2)


@pytest.mark.parametrize("sampler", SAMPLERS, ids=lambda sampler: sampler.name)
@pytest.mark.parametrize("rule", OURS)
def test_every_rule_and_sampler_tends_to_the_closed_form(rule: str, sampler: Sampler) -> None:
    pictures, _ = frame().render(rule, sampler, 512)
    expected = torch.tensor([gaussian_opacity(3.0, 0.3, offset) for offset in (0.0, 0.2, 0.5)])
    bar = 2e-2 if sampler.random or sampler.two_passes else 5e-3
    assert pictures["opacity"] == pytest.approx(expected, abs=bar)
    assert pictures["colour"][:, 0] == pytest.approx(1.0 - 0.5 * expected, abs=bar)


@pytest.mark.parametrize("name", ["near to far", "box"])
def test_nothing_outside_of_the_box_is_seen(name: str) -> None:
    """Two units of fog of density 1, though the field extends further; a ray that misses the box sees none."""
    pictures, _ = frame(FOG, axial((0.0, 0.9, 1.5))).render("midpoint", NAMED[name], 256)
    assert pictures["opacity"] == pytest.approx(torch.tensor([1 - math.exp(-2), 1 - math.exp(-2), 0.0]), abs=5e-3)


@pytest.mark.parametrize(
    ("name", "rule", "evaluations"),
    [
        ("near to far", "midpoint", 64), ("box, random", "left", 64), ("box, coarse and fine", "midpoint", 16 + 48),
        ("box", "trapezoid", 65),
    ],
)  # fmt: skip
def test_what_is_counted_is_what_was_asked_for(name: str, rule: str, evaluations: int) -> None:
    assert frame().render(rule, NAMED[name], 64)[1] == 3 * evaluations


def test_errors_are_taken_from_the_reference_and_seconds_are_medians() -> None:
    """The calls take 1, 4, 9 … seconds by the clock: the two counts of two lines are timed in turn."""
    ticks = iter(range(10**6))
    now = 0.0

    def clock() -> float:
        nonlocal now
        tick = next(ticks)
        now += ((tick + 1) / 2) ** 2 if tick % 2 else 0.0
        return now

    shown = frame()
    reference, _ = shown.render("midpoint", NAMED["box"], 256)
    reference["colour"] += 0.25
    lines = measure_lines(shown, ("midpoint", "left"), (NAMED["box"],), (128, 256), reference, 3, clock=clock)
    assert [(line.rule, line.sampler, line.samples) for line in lines] == [
        ("midpoint", "box", [128, 256]), ("left", "box", [128, 256]),
    ]  # fmt: skip
    # of calls 1 to 12, each count has three: 1 5 9, 2 6 10, 3 7 11, 4 8 12
    assert [line.seconds for line in lines] == [[25.0, 36.0], [49.0, 64.0]]
    assert lines[0].error["colour"][1] == pytest.approx(0.25)
    assert lines[0].error["opacity"] == pytest.approx([0.0, 0.0], abs=1e-4)
    assert lines[0].evaluations == [3 * 128, 3 * 256]
    reference["colour"][0] = math.nan
    with pytest.raises(ValueError, match=r"midpoint \(box\): an error is not finite"):
        measure_lines(shown, ("midpoint",), (NAMED["box"],), (128,), reference, 1)


def test_orders_are_fitted_to_errors_above_the_reference_s() -> None:
    counts = [4, 8, 16, 32, 64, 128, 256, 512]
    line = Line("midpoint", "box", counts, {"colour": [n**-2.0 for n in counts], "opacity": [1e-6] * 8})
    assert line.order("colour", 0.0) == pytest.approx(2.0)
    line.error["colour"][-2:] = [1e-5, 1e-5]
    assert line.order("colour", 1e-5) == pytest.approx(2.0)
    assert line.order("opacity", 1e-6) is None


def a_line(rule: str, sampler: str, errors: list[float], seconds: list[float], work: list[int]) -> Line:
    return Line(rule, sampler, [4, 8, 16], {"colour": errors, "opacity": errors}, work, seconds)


LINES = [
    a_line("midpoint", "box", [2e-2, 9e-3, 2e-3], [1.0, 2.0, 3.0], [40, 80, 160]),
    a_line("linear", "box", [5e-2, 2e-2, 9e-4], [1.0, 2.0, 2.5], [41, 81, 161]),
    a_line("midpoint", "box, grid", [2e-2, 1.5e-2, 1.2e-2], [0.5, 0.6, 0.7], [20, 40, 80]),
    a_line("listing4", "box", [0.5, 0.4, 0.4], [0.1, 0.2, 0.3], [40, 80, 160]),
]


def test_the_first_to_reach_an_error() -> None:
    assert fastest(LINES, 2e-2) == (LINES[2], 0.5)
    assert fastest(LINES, 1e-2) == (LINES[0], 2.0)
    assert fastest(LINES, 2e-3) == (LINES[1], 2.5)
    assert fastest(LINES, 1e-4) is None


def test_the_study_on_a_small_field(ball: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trained = trained_alone("nerf", ball, "ball/0", TRAIN, BUDGET, CPU)
    assert isinstance(trained, Trainer)
    monkeypatch.setattr(study, "trained_field", lambda context: (trained, ball))
    context = EvidenceContext(tmp_path, tmp_path, tmp_path, True, Quiet(), Machine("cpu", 1, 1), False)
    findings = list(study.rendering_work(context))
    assert isinstance(findings[0], str)
    assert "8 × 8 rays of a test view of lego (nerf, " in findings[0]
    (check,) = (finding for finding in findings if isinstance(finding, Check))
    assert 0.0 < (check.value or 0.0) < 1e-3
    (table,) = (finding for finding in findings if isinstance(finding, Table))
    assert len(table.rows) == len(QUADRATURES) * len(SAMPLERS)
