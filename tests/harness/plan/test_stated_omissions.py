"""What a run says of omissions that it did not measure itself."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from msgspec import structs

from harness.plan.profiles import Plan, planned
from harness.plan.stated_omissions import with_stated
from harness.records.cells import LeftOut, SceneRecord

ROW: dict[str, Any] = {
    "scene": "lego", "method": "nerf", "name": "outside_box", "what": "samples outside the box", "seconds_saved": 6.0,
    "difference": -0.5, "interval": [-0.7, -0.3], "clock": "training", "verdict": "costs more", "pairs": 3,
}  # fmt: skip
PLAIN = LeftOut("samples outside the box", "all is inside", None, None, None, name="outside_box", bound=0.2, unit="dB")


def scene(name: str, row: LeftOut = PLAIN) -> SceneRecord:
    return SceneRecord(name, name, "", 8, 8, {}, 2.0, 6.0, [[-1.0] * 3, [1.0] * 3], None, None, {}, [row])


@pytest.fixture
def study(tmp_path: Path) -> Path:
    of = replace(planned("reduced", methods=["nerf"]).in_float32(), scenes=("lego",))
    (tmp_path / "docs").mkdir()
    file = tmp_path / "docs/left_out.json"
    file.write_text(json.dumps({"settings": of.settings(), "omissions": [ROW]}))
    return file


def test_a_run_of_the_same_settings_states_the_study(study: Path) -> None:
    lego, mic = with_stated([scene("lego"), scene("mic")], planned("reduced", seeds=1), study)
    (row,) = lego.left_out
    assert (row.seconds_saved, row.difference, row.verdict) == (6.0, -0.5, "costs more")
    assert row.study == "docs/left_out.json"
    assert (row.reason, row.bound) == (PLAIN.reason, PLAIN.bound)
    assert not lego.costs_more, "the exit code is of what this run measured"
    assert mic.left_out == [PLAIN]


def test_what_the_run_measured_itself_stands(study: Path) -> None:
    own = structs.replace(PLAIN, difference=0.1, verdict="within its bound")
    (lego,) = with_stated([scene("lego", own)], planned("reduced"), study)
    assert lego.left_out == [own]


@pytest.mark.parametrize(
    "other",
    [
        planned("smoke", scenes=["lego"]),
        planned("reduced", budget_steps=500),
        planned("reduced", resolution=64),
        planned("reduced", optimiser="adam"),
    ],
)
def test_a_study_of_other_settings_says_nothing(study: Path, other: Plan) -> None:
    assert with_stated([scene("lego")], other, study) == [scene("lego")]
