"""C1 says what it found: ours pass, what is usual fails, and a check that is taken out is noticed."""

from pathlib import Path

import pytest

from harness.studies.stability.rays import camera_cases
from tests.harness.studies.stability.made_up import checks, context_in


def test_ours_hold_and_the_dangers_are_real(tmp_path: Path) -> None:
    made = checks("C1", context_in(tmp_path))
    assert [check.status for check in made if check.owner == "ours"] == ["pass"] * 6
    assert [check.status for check in made if check.owner == "usual"] == ["fail"] * 3
    mitsuba = next(check for check in made if check.subject == "Mitsuba alone")
    assert "origin on target" in mitsuba.why
    assert "NaN" in mitsuba.why


def test_a_check_that_is_gone_and_a_careless_slab_are_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera_cases, "check_poses", lambda poses, names: None)
    monkeypatch.setattr(camera_cases, "ray_box", camera_cases.naive_slab)
    poses, slab = (check for check in checks("C1", context_in(tmp_path)) if check.is_broken)
    assert poses.value == 7
    assert "pose: mirrored" in poses.why
    assert slab.what.startswith("axis-parallel rays")
