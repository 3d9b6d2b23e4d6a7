"""C1 says what it found: ours pass, what is usual fails, and a check that is taken out is noticed."""

from pathlib import Path

import pytest
import torch

from harness.execution.progress import Quiet
from harness.records.study import Check
from harness.studies.stability.rays import camera_cases
from harness.studies.stability.stability_context import StabilityContext


def outcomes(scratch: Path) -> list[Check]:
    situation = StabilityContext((), scratch, scratch, scratch, 1, True, Quiet())
    found = list(camera_cases.cameras(situation))
    assert all(isinstance(one, Check) for one in found)
    return found  # type: ignore[return-value]


def test_ours_hold_and_the_dangers_are_real(tmp_path: Path) -> None:
    found = outcomes(tmp_path)
    assert [one.status for one in found if one.owner == "ours"] == ["pass"] * 6
    assert [one.status for one in found if one.owner == "usual"] == ["fail"] * 3
    mitsuba = next(one for one in found if one.subject == "Mitsuba alone")
    assert "origin on target" in mitsuba.why
    assert "NaN" in mitsuba.why


def test_a_check_that_is_gone_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera_cases, "check_poses", lambda poses, names: None)
    broken = [one for one in outcomes(tmp_path) if one.is_broken]
    assert len(broken) == 1
    assert broken[0].value == 7
    assert "pose: mirrored" in broken[0].why


def test_a_careless_slab_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera_cases, "ray_box", camera_cases.naive_slab)
    assert next(one.what for one in outcomes(tmp_path) if one.is_broken).startswith("axis-parallel rays")


def test_the_exact_interval_is_by_cases() -> None:
    inside = camera_cases._exact(torch.tensor([0.0, 1.0, -0.5]), torch.tensor([0.0, 0.0, -1.0]), 0.1, 6.0)
    assert inside == (0.1, 0.5)
    outside = camera_cases._exact(torch.tensor([0.0, 1.5, -2.0]), torch.tensor([0.0, 0.0, 1.0]), 0.1, 6.0)
    assert outside is None
