"""Trainings that end without a picture, planted and counted."""

from pathlib import Path

import pytest

from harness.plan.profiles import PROFILES
from harness.records.cells import CellRecord
from harness.records.study import Check
from harness.studies.evidence.collapse import BOXES, collapse, end_of
from harness.studies.evidence.evidence_context import DENSITIES, TRAININGS
from tests.harness.cells import cell, checkpoint, diverged
from tests.harness.studies.evidence.planted import context_of, sentences, table


def trained(psnr: float, method: str = "nerf", seed: int = 0, warnings: tuple[str, ...] = ()) -> CellRecord:
    scores = {"psnr": psnr, "psnr_floor": 20.0}
    return cell("mic", method, seed, [checkpoint(200, 4.0, psnr)], scores=scores, warnings=list(warnings))


def test_what_counts_as_no_picture() -> None:
    assert end_of(trained(20.1)) is None
    assert end_of(trained(19.9)) == "below the floor"
    assert end_of(trained(25.0, warnings=("empty collapse: mean test opacity 0.000",))) == "empty collapse"
    assert end_of(diverged("mic", "nerf", 0)) == "diverged"


def test_every_end_is_counted_with_its_exact_interval(tmp_path: Path) -> None:
    own = [trained(25.0, seed=seed) for seed in range(7)]
    own += [trained(19.0, seed=7), diverged("mic", "nerf", 8), trained(25.0, seed=9, warnings=("empty collapse",))]
    own += [cell("mic", "nerf", 10, [], status="error", reason="the disk is full")]
    good = [trained(25.0, method, seed) for method in DENSITIES for seed in range(4)]
    findings = list(collapse(context_of(tmp_path, {name: good for name in BOXES} | {"box_own": own})))
    # Clopper and Pearson for 3 of 10 and 0 of 20
    assert "3 of 10 in the scene's own box (95 % interval 6.7 to 65.2 %); 0 of 20 in" in sentences(findings)[0]
    assert "(95 % interval 0.0 to 16.8 %)" in sentences(findings)[0]
    checks = {check.id: check for check in findings if isinstance(check, Check)}
    assert [name for name, check in checks.items() if check.status == "fail"] == ["lost.box_own"]
    rows = table(findings, "ends").rows
    assert rows[0] == ["the scene's own box", "nerf", "10", "1", "1", "1", "6.7 %", "65.2 %"]
    assert len(rows) == 1 + 3 * len(DENSITIES)


@pytest.mark.parametrize("name", BOXES[1:])
def test_larger_boxes_are_boxes_of_the_same_views(tmp_path: Path, name: str) -> None:
    """The box is larger, and the views are those of the default run."""
    views, default = context_of(tmp_path, {}).plan(name).views, PROFILES["reduced"].views
    assert views.region is not None
    half = TRAININGS[name].half_side
    assert views.region.bounds == (*[-(half or 0)] * 3, *[half] * 3)
    for field in ("resolution", "train", "test", "spp_test"):
        assert getattr(views, field) == getattr(default, field)
