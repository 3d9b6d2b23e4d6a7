"""Times to a target: the record is read as written, and another one is refused."""

import json
from pathlib import Path

import pytest
from msgspec.structs import replace

from harness.records.cells import Estimate, records_folder
from harness.records.targets import (
    TARGETS_FILE,
    Reach,
    ReachCurve,
    TargetComparison,
    TargetsRecord,
    read_targets,
    write_targets,
)
from harness.records.verdict import OPEN, Verdict
from scenes.files.errors import DamagedRecord

HERE = Estimate((3.0, 31.0), (1.0, 33.0), 8, Verdict("above 0", "open"), 20.0, 1.0)
SAVING = TargetComparison(
    "all", "qnerf", "nerf", "steps", 1000.0, 18.0, (3.0, 31.0), (1.0, 33.0), 8, HERE.verdict, 20.0, -80.0,
    (-90.0, -70.0), 6, (0, 1), (2, 0), 0, 3.0, None, HERE, None,
)  # fmt: skip
NOTHING = replace(
    SAVING, scene="lego", saving=None, interval=None, simultaneous=None, smallest_detectable=None, difference=None,
    difference_interval=None, verdict=OPEN, pairs=0,
)  # fmt: skip
RECORD = TargetsRecord(
    24.0,
    False,
    "nerf",
    "24 dB",
    [Reach("lego", "nerf", 0, "steps", 312.5, "reached"), Reach("lego", "nerf", 1, "steps", 1000.0, "never", "ended")],
    [ReachCurve("nerf", "all", "steps", [312.5, 1000.0], [0.5, 0.5], [2, 1])],
    [SAVING, NOTHING],
)


def test_it_comes_back_as_it_was_written(tmp_path: Path) -> None:
    write_targets(tmp_path, RECORD)
    assert read_targets(tmp_path) == RECORD
    assert read_targets(tmp_path / "older") is None
    assert RECORD.comparison("all", "qnerf", "nerf", "steps") == SAVING
    assert RECORD.comparison("ship", "qnerf", "nerf", "steps") is None


def test_what_is_not_such_a_record_is_named(tmp_path: Path) -> None:
    write_targets(tmp_path, RECORD)
    path = records_folder(tmp_path) / TARGETS_FILE
    data = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps({**data, "comparisons": [{"scene": "all"}]}), encoding="utf-8")
    with pytest.raises(DamagedRecord, match=r"targets\.json"):
        read_targets(tmp_path)
