"""The files of a run are checked before it is resumed; only damaged ones are named and quarantined."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from harness.command.plan_options import planned
from harness.plan.run_plan import Plan
from harness.records.cells import cell_path, checkpoint_name, read_cell, with_files, write_cell, write_comparisons
from harness.records.json_record import digest_of, load_record, write_record
from harness.records.pictures import Truth, truth_pictures, write_truth
from harness.records.snapshot import Unfinished, unfinished_path, write_unfinished
from harness.run_folder.folder_lock import scratch_folder
from harness.run_folder.integrity import DAMAGED, repair, sweep
from scenes.files.errors import DamagedRecord, InputError
from tests.harness.cells import diverged
from tests.harness.shell import ROOT

CELL = ("lego", "nerf", 0)


@pytest.fixture
def plan() -> Plan:
    return planned("smoke", scenes=["lego"], methods=["nerf", "qnerf"], seeds=1)


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """A folder with one finished cell, its weights, and the truth of its scene."""
    weights = tmp_path / checkpoint_name(*CELL)
    weights.parent.mkdir()
    weights.write_bytes(bytes(range(256)))
    cell = replace(diverged(*CELL), status="done", reason=None)
    write_cell(tmp_path, with_files(tmp_path, cell))
    half = np.full((4, 4), 0.5, dtype=np.float16)
    truth = Truth("test/r_0", np.repeat(half[..., None], 3, -1), half)
    write_truth(tmp_path / "records" / truth_pictures("lego"), [truth])
    write_comparisons(tmp_path, [])
    return tmp_path


def said(out: Path, plan: Plan) -> list[str]:
    lines: list[str] = []
    repair(out, plan, lines.append)
    return lines


def files(out: Path) -> dict[str, bytes]:
    return {str(path.relative_to(out)): path.read_bytes() for path in out.rglob("*") if path.is_file()}


def test_valid_files_are_not_changed(out: Path, plan: Plan) -> None:
    before = files(out)
    assert said(out, plan) == ["1 finished cells and their 1 files are valid"]
    assert files(out) == before


@pytest.mark.parametrize("place", [0.0, 0.3, 0.6, 0.97])
@pytest.mark.parametrize(
    ("name", "words", "quarantined"),
    [
        ("records/cells/lego.nerf.0.json", "lego, nerf, seed 0 is trained again", 2),
        ("checkpoints/lego.nerf.0.safetensors", "digest does not match", 2),
        ("records/pictures/lego.safetensors", "taken from the view set again", 1),
        ("records/comparisons.json", "computed again", 1),
        ("unfinished/lego.qnerf.0.safetensors", ": trained from the start", 1),
    ],
)
def test_a_damaged_file_is_named_and_quarantined(
    out: Path, plan: Plan, name: str, words: str, quarantined: int, place: float
) -> None:
    write_unfinished(unfinished_path(out, "lego", "qnerf", 0), Unfinished({"step": 3}, {"weight": np.arange(50.0)}))
    assert len(said(out, plan)) == 1
    data = bytearray((out / name).read_bytes())
    data[int(place * len(data))] ^= 0x55
    (out / name).write_bytes(data)
    line, *_ = said(out, plan)
    assert line.startswith(f"{name}: ")
    assert words in line
    assert not (out / name).exists()
    assert len(list((out / DAMAGED).iterdir())) == quarantined
    assert (out / DAMAGED / f"{name.replace('/', '.')}.1").read_bytes() == data


def test_missing_weights_cost_their_cell(out: Path, plan: Plan) -> None:
    (out / checkpoint_name(*CELL)).unlink()
    assert said(out, plan)[0] == "checkpoints/lego.nerf.0.safetensors: missing: lego, nerf, seed 0 is trained again"
    assert not cell_path(out, *CELL).exists()


def test_a_folder_in_place_of_a_file_keeps_its_content(out: Path, plan: Plan) -> None:
    (out / "records/comparisons.json").unlink()
    (out / "records/comparisons.json").mkdir()
    (out / "records/comparisons.json/mine.txt").write_text("mine")
    said(out, plan)
    assert b"mine" in files(out / DAMAGED).values()


@pytest.mark.parametrize("name", ["checkpoints", "records/cells", "records/pictures", "records", "unfinished"])
def test_a_file_in_place_of_a_folder_is_quarantined(out: Path, plan: Plan, name: str) -> None:
    shutil.rmtree(out / name, ignore_errors=True)
    (out / name).write_text("mine")
    assert said(out, plan)[0] == f"{name}: is not a folder; moved to damaged"
    assert not (out / name).exists()
    assert b"mine" in files(out / DAMAGED).values()


def test_a_file_in_place_of_the_quarantine_is_refused(out: Path, plan: Plan) -> None:
    (out / DAMAGED).write_text("mine")
    (out / checkpoint_name(*CELL)).unlink()
    with pytest.raises(InputError, match=f"{DAMAGED}: is a file, .* remove it"):
        said(out, plan)


def test_the_record_of_another_cell_is_damage(out: Path, plan: Plan) -> None:
    cell_path(out, *CELL).rename(cell_path(out, "lego", "qnerf", 0))
    assert "is the record of lego.nerf.0.json" in said(out, plan)[0]


def test_incomplete_files_are_removed(out: Path) -> None:
    for part in (".run.json.12.part", "records/cells/.a.json.12.part", "checkpoints/.b.safetensors.7.part"):
        (out / part).write_text("half")
    before = len(files(out))
    (out / ".scratch-abc" / "records").mkdir(parents=True)
    assert sweep(out) == 4
    assert not (out / ".scratch-abc").exists()
    assert len(files(out)) == before - 3


def test_a_scratch_folder_stays_while_its_owner_works_in_it(out: Path) -> None:
    with scratch_folder(out) as held:
        (held / "image").write_text("half")
        killed = subprocess.run([sys.executable, "-c", KILLED, str(out)], cwd=ROOT, capture_output=True, text=True)
        abandoned = Path(killed.stdout.strip())
        assert abandoned.is_dir()
        assert sweep(out) == 1
        assert not abandoned.exists()
        assert (held / "image").read_text() == "half"
    assert not list(out.glob(".scratch-*"))


KILLED = """
import os, pathlib, sys
from harness.run_folder.folder_lock import scratch_folder
with scratch_folder(pathlib.Path(sys.argv[1])) as folder:
    print(folder, flush=True)
    os.kill(os.getpid(), 9)
"""


def test_the_snapshot_of_a_finished_cell_is_removed(out: Path, plan: Plan) -> None:
    path = unfinished_path(out, *CELL)
    write_unfinished(path, Unfinished({"step": 3}, {}))
    said(out, plan)
    assert not path.exists()
    assert not (out / DAMAGED).exists()


def test_a_digest_depends_on_content_and_order_not_on_spaces(tmp_path: Path) -> None:
    path, data = tmp_path / "a.json", {"b": 1.5, "a": [None, "é"]}
    write_record(path, data)
    assert load_record(path) == data
    assert json.loads(path.read_text(encoding="utf-8"))["digest"] == digest_of(data)
    path.write_text(json.dumps(json.loads(path.read_text(encoding="utf-8"))), encoding="utf-8")
    assert load_record(path) == data
    assert digest_of(data) != digest_of(dict(reversed(data.items())))
    path.write_text(path.read_text(encoding="utf-8").replace("1.5", "1.6"), encoding="utf-8")
    with pytest.raises(ValueError, match="digest does not match"):
        load_record(path)


def test_a_removed_digest_is_damage(out: Path) -> None:
    path = cell_path(out, *CELL)
    data = json.loads(path.read_text(encoding="utf-8"))
    del data["digest"]
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(DamagedRecord, match="its digest is missing, so it was changed by hand"):
        read_cell(path)
