"""Output of an earlier version, kept in `tests/former`, still opens and is reported."""

import json
import shutil
from pathlib import Path

import pytest

from harness.command.main import main
from harness.playback.run_loader import FinishedRun
from harness.records.cells import read_cells
from reports.__main__ import main as report
from scenes.view_sets.view_set import read_view_set

FORMER = Path(__file__).parent / "former"
OPTIONS = ["run", "--profile", "smoke", "--view-set", "ball", "--resolution", "12", "--methods", "nerf", "qnerf",
           "--seeds", "1", "--budget-steps", "3", "--quiet", "--workers", "1", "--threads", "1", "--precision",
           "float32", "--device", "cpu", "--resume", "--out", "run"]  # fmt: skip


@pytest.fixture
def former(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(FORMER, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_run_of_other_settings_is_not_resumed_but_reported(former: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cells = former / "run/records/cells"
    kept = (cells / "ball.nerf.0.json").read_bytes()
    assert main(OPTIONS) == 2
    assert "train.learning_rate was 0.02, is 0.01" in capsys.readouterr().err
    assert (cells / "ball.nerf.0.json").read_bytes() == kept, "finished cells are unchanged"
    assert [cell.status for cell in read_cells(former / "run")] == ["done", "done"]
    assert report(["run", "--quiet"]) == 0
    summary = json.loads((former / "run/summary.json").read_text())
    before = json.loads(kept)["scores"]["psnr"]
    assert [cell["psnr"] for cell in summary["cells"] if cell["method"] == "nerf"] == [before]


def test_view_set_and_checkpoint_open(former: Path) -> None:
    assert len(read_view_set(former / "ball").train.names) == 3
    run = FinishedRun.of(former / "run")
    assert run.methods(None) == ["nerf", "qnerf"]
