"""Records are read completely, in order, or refused with a message that names the file."""

import json
import shutil
from pathlib import Path

import pytest

from harness.records.cells import cell_path
from harness.records.json_record import write_record
from harness.records.targets import ReachCurve, TargetsRecord, write_targets
from reports.data.load import NoRecords, Records, read_records
from scenes.files.errors import DamagedRecord
from tests.reports.fake_run import write_fake_run


def test_cells_come_in_the_order_of_the_run(records: Records):
    first = [(cell.scene, cell.method, cell.seed) for cell in records.cells[:4]]
    assert first == [("chair", "nerf", 0), ("chair", "nerf", 1), ("chair", "nerf", 2), ("chair", "nerf_matched", 0)]
    assert records.methods == ["nerf", "nerf_matched", "qnerf"]


def remove(path: Path) -> None:
    shutil.rmtree(path) if path.is_dir() else path.unlink()


@pytest.mark.parametrize(
    ("gone", "said"),
    [
        (".", r"no such folder; give the output folder"),
        ("records", r"no records/ in it"),
        ("records/cells", "no finished cell yet"),
        ("records/run.json", r"run\.json: missing"),
    ],
)
def test_what_is_missing_is_named(out, gone, said):
    remove(out / gone)
    with pytest.raises(NoRecords, match=said):
        read_records(out)


def test_half_written_parts_are_not_cells_and_comparisons_may_be_missing(out):
    (out / "records" / "cells" / ".chair.nerf.0.json.123.part").write_text("{", encoding="utf-8")
    (out / "records" / "comparisons.json").unlink()
    assert (len(read_records(out).cells), read_records(out).comparisons) == (18, [])


def test_a_damaged_cell_is_named_with_its_remedy(out):
    path = cell_path(out, "chair", "nerf", 0)
    path.write_text(path.read_text(encoding="utf-8").replace('"train_seconds": 32.0', '"train_seconds": 33.0'))
    with pytest.raises(DamagedRecord, match=r"its digest does not match its content.*run again") as caught:
        read_records(out)
    assert str(path) in str(caught.value)


def test_damaged_comparisons_are_named(out):
    (out / "records" / "comparisons.json").write_text('[{"scene": 1}]', encoding="utf-8")
    with pytest.raises(DamagedRecord, match=r"comparisons\.json"):
        read_records(out)


def test_targets_of_a_method_that_the_run_has_not_are_refused(out):
    curve = ReachCurve("nerv", "all", "steps", [100.0], [0.5], [2])
    write_targets(out, TargetsRecord(24.0, False, "nerf", "24 dB, because.", [], [curve], []))
    with pytest.raises(DamagedRecord, match=r"targets\.json: a curve is of 'nerv', which is not a method of the run"):
        read_records(out)


def test_a_scene_that_the_run_does_not_list_comes_last(tmp_path):
    out = write_fake_run(tmp_path / "run", scenes=("drums", "attic"), pictures=False)
    run = json.loads((out / "records" / "run.json").read_text(encoding="utf-8"))
    del run["digest"]
    run["scenes"] = [scene for scene in run["scenes"] if scene["name"] != "attic"]
    write_record(out / "records" / "run.json", run)
    assert read_records(out).scenes == ["drums", "attic"]
