"""python -m harness study serving, and what `python -m harness run` does of it at its end."""

from pathlib import Path
from typing import Any

import pytest

from harness.__main__ import main
from harness.execution.progress import Quiet
from harness.playback.run_loader import FinishedRun
from harness.records.cells import read_cells
from harness.records.serving_record import SERVING_FILE, read_serving
from harness.studies.serving import serving_run
from harness.studies.serving.serving_run import ServingRequest
from tests.harness.shell import refused
from tests.harness.studies.serving.conftest import CPU, fail_with, with_study
from tests.harness.trained_runs import SIZE, in_this_process


def test_an_error_of_ours_is_not_hidden_by_the_command(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with_study(monkeypatch, "cache", fail_with(ZeroDivisionError("ours")))
    asked = ServingRequest(["ball"], ["nerf"], 0, SIZE, True)
    with pytest.raises(ZeroDivisionError):
        serving_run.run(FinishedRun.of(out), asked, CPU, out, Quiet())


def test_the_command_measures_what_is_asked(
    out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with_study(monkeypatch, "attention", lambda situation: None)
    assert main(["serving", str(out), "--quick", "--methods", "qnerf", "--width", "12"]) == 0
    record = read_serving(out / SERVING_FILE)
    assert record.cache is not None
    assert record.cache.width == 12
    assert {one.method for one in record.cache.latencies} == {"qnerf"}
    said = capsys.readouterr().out
    assert "about" in said.splitlines()[0], "an estimate comes first"
    assert str(out / SERVING_FILE) in said.splitlines()[-1]


def test_nothing_that_could_be_rendered_is_exit_code_3(out: Path) -> None:
    for file in (out / "checkpoints").iterdir():
        file.unlink()
    assert main(["serving", str(out), "--quick", "--quiet"]) == 3
    record = read_serving(out / SERVING_FILE)
    assert (record.cache, record.attention, record.first_frame) == (None, None, None)
    assert sum("is missing" in one for one in record.left_out) == 2


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--width", "4"], "--width 4"),
        (["--threads", "0"], "--threads 0"),
        (["--seed", "7"], "--seed 7"),
        (["--scenes", "lego"], "'lego'"),
        (["--methods", "nerv"], "'nerv'"),
    ],
)
def test_mistakes_are_said_in_one_line(
    trained: Path, capsys: pytest.CaptureFixture[str], options: list[str], said: str
) -> None:
    assert said in refused(capsys, trained, "--quiet", *options, command="serving")


def test_a_folder_without_a_run_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "holds no run" in refused(capsys, tmp_path, command="serving")


@pytest.mark.parametrize(("options", "measured"), [([], True), (["--no-serving"], False)])
def test_a_run_measures_it_at_its_end(
    ball_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: list[str], measured: bool
) -> None:
    asked: list[Path] = []

    def noted(out: Path, device: str, view_sets: Path, show: Any) -> None:
        assert [cell.status for cell in read_cells(out)] == ["done"], "after everything else"
        assert (out / "records/comparisons.json").exists()
        asked.append(out)

    monkeypatch.setattr("harness.execution.run.run_locally", in_this_process)
    monkeypatch.setattr(serving_run, "after_run", noted)
    monkeypatch.setattr("harness.machine.device.available_cores", lambda: 1)
    typed = "--profile smoke --resolution 8 --methods nerf --seeds 1 --budget-steps 2 --workers 1 --quiet --view-set"
    out = tmp_path / "run"
    assert main(["run", *typed.split(), str(ball_folder), "--out", str(out), *options]) == 0
    assert asked == ([out] if measured else [])
    phases = FinishedRun.of(out).run.phases
    assert ("serve" in phases) == measured
