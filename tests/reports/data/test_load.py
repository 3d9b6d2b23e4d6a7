"""Records are read completely, in order, or refused with the name of the file; --partial leaves damaged files out."""

import html
import shutil
from pathlib import Path

import pytest

from harness.records.cells import cell_path
from harness.records.targets import ReachCurve, TargetsRecord, write_targets
from reports.__main__ import main
from reports.data.load import NoRecords, read_records
from reports.data.saved_pictures import NOT_KEPT, damaged
from reports.run.pictures import picture_data, views
from reports.run.saving.publish import summary
from scenes.files.errors import DamagedRecord
from tests.replacing import replace
from tests.reports.fake_run import fake_records, write_fake_run


def test_cells_come_in_the_order_of_the_run_and_a_scene_that_it_does_not_list_comes_last(records, tmp_path):
    first = [(cell.scene, cell.method, cell.seed) for cell in records.cells[:4]]
    assert first == [("chair", "nerf", 0), ("chair", "nerf", 1), ("chair", "nerf", 2), ("chair", "nerf_matched", 0)]
    assert records.methods == ["nerf", "nerf_matched", "qnerf"]
    options = {"scenes": ("drums", "attic"), "change": lambda run: replace(run, scenes=run.scenes[:1])}
    assert fake_records(tmp_path / "run", **options).scenes == ["drums", "attic"]


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
    shutil.rmtree(out / gone) if (out / gone).is_dir() else (out / gone).unlink()
    with pytest.raises(NoRecords, match=said):
        read_records(out)


def test_half_written_parts_are_not_cells_and_comparisons_may_be_missing(out):
    (out / "records" / "cells" / ".chair.nerf.0.json.123.part").write_text("{", encoding="utf-8")
    (out / "records" / "comparisons.json").unlink()
    assert (len(read_records(out).cells), read_records(out).comparisons) == (18, [])


def test_other_damaged_records_and_targets_of_an_unknown_method_are_named(out):
    for file, content in (("comparisons", '[{"scene": 1}]'), ("targets", '{"schema": 1}')):
        (out / "records" / f"{file}.json").write_text(content, encoding="utf-8")
        with pytest.raises(DamagedRecord, match=rf"{file}\.json"):
            read_records(out)
        (out / "records" / f"{file}.json").unlink()
    curve = ReachCurve("nerv", "all", "steps", [100.0], [0.5], [2])
    write_targets(out, TargetsRecord(24.0, False, "nerf", "24 dB, because.", [], [curve], []))
    with pytest.raises(DamagedRecord, match=r"targets\.json: a curve is of 'nerv', which is not a method of the run"):
        read_records(out)


CELL, TRUTH, RENDERS = "chair.nerf.0.json", "drums.safetensors", "chair.qnerf.0.safetensors"


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Return a run of two scenes × three methods, finished and valid."""
    return write_fake_run(tmp_path / "run", seeds=1, size=4, with_diverged=False)


def spoil(out: Path, *names: str) -> None:
    for name in names:
        kind = "cells" if name.endswith(".json") else "pictures"
        (out / "records" / kind / name).write_bytes(b"?")


def test_a_damaged_cell_is_left_out_and_named_and_verdicts_use_the_others(run):
    before = read_records(run)
    spoil(run, CELL)
    with pytest.raises(DamagedRecord, match=CELL):
        read_records(run)
    records = read_records(run, partly=True)
    (line,) = records.left_out
    assert str(cell_path(run, "chair", "nerf", 0)) in line
    assert len(records.cells) == 5
    assert records.cells_of("chair", "nerf") == []
    assert records.run.finished
    assert any(row.scene == "chair" for row in before.comparisons)
    assert records.comparisons
    assert not any(row.scene == "chair" for row in records.comparisons)
    assert records.targets is None
    assert summary(records)["damaged"] == records.left_out


def test_missing_and_damaged_pictures_are_not_reported_as_not_kept(run):
    spoil(run, RENDERS, TRUTH)
    (run / "records/pictures/chair.nerf.0.safetensors").unlink()
    records = read_records(run, partly=True)
    missing, broken, truth = damaged(records)
    assert "chair.nerf.0.safetensors: not the pictures of a run (missing)" in missing
    assert RENDERS in broken
    assert TRUTH in truth
    data = picture_data(records).data
    (chair,) = data["scenes"]
    lost = {cell["method"]: (cell["status"], cell["reason"]) for cell in chair["missing"]}
    assert lost == {
        "nerf": ("done", f"{run}/records/pictures/chair.nerf.0.safetensors: missing"),
        "qnerf": ("done", broken),
    }
    assert any("drums" in line and "ground truth" in line for line in data["left_out"])
    chair, drums = views(records)
    assert [cell.caption for cell in chair.methods[::2]] == [reason for _, reason in lost.values()]
    assert chair.methods[1].render
    assert drums.truth is None
    assert all(cell.render and cell.caption == "no ground truth of this size" for cell in drums.methods)


@pytest.mark.slow
def test_the_page_names_all_that_is_damaged(run, capsys):
    spoil(run, CELL, TRUTH, RENDERS)
    assert main([str(run)]) == 2
    capsys.readouterr()
    assert main([str(run), "--partial"]) == 0
    said = [line for line in capsys.readouterr().out.splitlines() if line.startswith("left out: ")]
    text = html.unescape((run / "report.html").read_text(encoding="utf-8"))
    alert = text[text.index("3 damaged files left out:") :].split("</div>")[0]
    assert len(said) == alert.count("<li>") == 3
    for name in (CELL, TRUTH, RENDERS):
        (line,) = (line for line in said if name in line)
        assert f"<li>{line.removeprefix('left out: ')}</li>" in alert
    assert "Comparisons and verdicts use only" in alert
    assert NOT_KEPT not in text


@pytest.mark.slow
def test_of_several_outputs_each_names_its_damaged_files(run, tmp_path, capsys):
    other = write_fake_run(tmp_path / "other", seeds=1, pictures=False, with_diverged=False)
    spoil(other, CELL)
    assert main([str(run), str(other)]) == 2
    assert main([str(run), str(other), "--partial"]) == 0
    assert f"left out: {cell_path(other, 'chair', 'nerf', 0)}" in capsys.readouterr().out
    text = html.unescape((run / "outputs.html").read_text(encoding="utf-8"))
    assert f"<li>{cell_path(other, 'chair', 'nerf', 0)}" in text[text.index("1 damaged file of B · other left out:") :]
