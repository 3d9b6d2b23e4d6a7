"""What a run that is gone on with says of the part before it, and keeps of it."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from harness.__main__ import main
from harness.records import CellRecord, cell_path, read_cell, read_run, write_cell
from tests.harness.trained_runs import in_this_process

TYPED = "run --profile smoke --resolution 8 --methods nerf qnerf --seeds 1 --budget-steps 2 --workers 1 --no-serving"


def go_on(out: Path, ball_folder: Path, *more: str) -> int:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("harness.runner.run_locally", in_this_process)
        patch.setattr("harness.device.available_cores", lambda: 1)
        return main([*TYPED.split(), "--view-set", str(ball_folder), "--out", str(out), *more])


@pytest.fixture(scope="module")
def finished(ball_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Not to be changed."""
    out = tmp_path_factory.mktemp("finished") / "run"
    assert go_on(out, ball_folder) == 0
    return out


@pytest.fixture
def out(finished: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    return Path(shutil.copytree(finished, tmp_path / "run"))


def cell(out: Path, method: str) -> CellRecord:
    return read_cell(cell_path(out, "ball", method, 0))


def test_cells_of_other_code_are_named_and_stand_in_the_record(
    ball_folder: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    new = cell(out, "nerf").provenance["sources"]
    assert new == read_run(out).provenance["sources"]
    old = cell(out, "qnerf")
    write_cell(out, replace(old, provenance={**old.provenance, "sources": "0123456789abcdef", "commit": "0ld"}))
    cell_path(out, "ball", "nerf", 0).unlink()
    assert go_on(out, ball_folder, "--resume") == 0
    said = capsys.readouterr().out
    assert "1 of 1 finished cells were made by other code or packages (ball.qnerf.0: sources 0123456789abcdef" in said
    (sentence,) = [one for one in read_run(out).not_tested if one.startswith("One code")]
    assert f"sources {new} (1 cells), 0123456789abcdef (1 cells)" in sentence
    assert cell(out, "qnerf").provenance["commit"] == "0ld", "not trained again"
    cell_path(out, "ball", "qnerf", 0).unlink()  # what the line says to do
    assert go_on(out, ball_folder, "--resume") == 0
    assert "other code" not in capsys.readouterr().out
    assert not any(one.startswith("One code") for one in read_run(out).not_tested)


def test_a_finished_run_of_one_code_is_looked_at_by_another_in_silence(
    ball_folder: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for old in (cell(out, "nerf"), cell(out, "qnerf")):
        write_cell(out, replace(old, provenance={**old.provenance, "sources": "0123456789abcdef"}))
    assert go_on(out, ball_folder, "--resume") == 0
    assert "other code" not in capsys.readouterr().out
