"""C1: the checks of this harness pass, the usual forms fail, and a removed check is detected."""

from pathlib import Path

import pytest

from harness.studies.stability.rays import camera_cases
from tests.harness.studies.stability.made_up import checks, context_in


def test_this_harness_passes_and_the_usual_forms_fail(tmp_path: Path) -> None:
    made = checks("C1", context_in(tmp_path))
    assert [check.status for check in made if check.owner == "ours"] == ["pass"] * 6
    assert [check.status for check in made if check.owner == "usual"] == ["fail"] * 3
    mitsuba = next(check for check in made if check.subject == "Mitsuba without checks")
    assert "origin on target" in mitsuba.why
    assert "NaN" in mitsuba.why


def test_a_removed_check_and_the_usual_slab_test_are_detected(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera_cases, "check_poses", lambda poses, names: None)
    monkeypatch.setattr(camera_cases, "ray_box", camera_cases.naive_slab)
    poses, slab = (check for check in checks("C1", context_in(tmp_path)) if check.is_broken)
    assert poses.value == 7
    assert "pose: mirrored" in poses.why
    assert slab.what.startswith("axis-parallel rays")
