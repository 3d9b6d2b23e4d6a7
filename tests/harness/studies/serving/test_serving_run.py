"""The record of serving: complete, never at the cost of the run, not measured twice; and the command."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from harness.command.main import main
from harness.execution.progress import Quiet
from harness.machine.provenance import PROGRAM
from harness.playback.run_loader import FinishedRun
from harness.records.cells import read_cells
from harness.records.study import Check, Studies, read_studies, write_studies
from harness.studies import framework
from harness.studies.framework import Found
from harness.studies.serving import serving_context, serving_run
from harness.studies.serving.serving_context import Measure, ServingContext, reason_of, study
from harness.studies.serving.serving_run import after_run
from harness.studies.serving.serving_studies import SHELF, STUDIES
from harness.training.trainer import Diverged
from tests.harness.shell import refused
from tests.harness.studies.serving.conftest import context_of
from tests.harness.trained_runs import SIZE, in_this_process

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def served(trained: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy with its record of serving; not to be changed."""
    out = Path(shutil.copytree(trained, tmp_path_factory.mktemp("finished") / "run"))
    after_run(out, "cpu", out, Quiet())
    return out


@pytest.fixture
def copy(served: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(served, tmp_path / "served"))


def record_of(out: Path) -> Studies:
    return read_studies(out / SHELF.file)


def with_studies(monkeypatch: pytest.MonkeyPatch, **measures: Measure) -> None:
    """Let studies measure something else; those that are not named only yield a sentence."""

    def measure_of(self: object, name: str) -> Measure:
        return study(measures.get(name, sentence))

    monkeypatch.setattr(serving_run.SHELF.__class__, "measure_of", measure_of)


def sentence(context: ServingContext) -> Iterator[Found]:
    yield "It was measured again."


def failing(error: BaseException) -> Measure:
    def measure(context: ServingContext) -> Iterator[Found]:
        yield "It begins."
        raise error

    return measure


def test_the_record_is_complete(served: Path) -> None:
    record = record_of(served)
    assert [each.info.id for each in record.studies] == list(STUDIES)
    assert record.finished
    assert not record.broken
    assert not any(each.cut_short for each in record.studies)
    assert all(each.answers for each in record.studies)
    ids = [each.id for _, each in record.checks() if each.id != "left_out"]
    assert len(set(ids)) == len(ids)
    assert {each.subject for _, each in record.checks() if each.id.startswith("hit.")} == {"nerf", "qnerf"}
    assert all((served / each.path).is_file() for study in record.studies for each in study.pictures)
    settings = record.settings
    assert (settings["scenes"], settings["methods"], settings["width"]) == (["ball"], ["nerf", "qnerf"], SIZE)
    assert not list(served.glob(".scratch-*")), "scratch files are gone"


@pytest.fixture
def lines(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The lines that any `Quiet` receives."""
    received: list[str] = []
    monkeypatch.setattr(Quiet, "line", lambda self, text: received.append(text))
    return received


def test_a_complete_record_is_not_measured_again(copy: Path, lines: list[str]) -> None:
    before = (copy / SHELF.file).read_bytes()
    after_run(copy, "cpu", copy, Quiet())
    assert lines == ["serving: measured before"]
    assert (copy / SHELF.file).read_bytes() == before


@pytest.mark.parametrize("change", ["weights", "code", "processor", "packages", "damaged", "former"])
def test_an_incompatible_record_is_measured_again(copy: Path, monkeypatch: pytest.MonkeyPatch, change: str) -> None:
    path, before = copy / SHELF.file, record_of(copy)
    with_studies(monkeypatch)
    if change == "code":
        monkeypatch.setattr(serving_context, "versions", lambda: {PROGRAM: "other sources"})
    elif change == "weights":
        shutil.copy(copy / "checkpoints/ball.nerf.0.safetensors", copy / "checkpoints/ball.qnerf.0.safetensors")
    elif change in ("processor", "packages"):
        write_studies(path, msgspec.structs.replace(before, provenance={**before.provenance, change: "another"}))
    else:
        path.write_text("{" if change == "damaged" else '{"schema": 2, "cache": null}', encoding="utf-8")
    after_run(copy, "cpu", copy, Quiet())
    assert [each.answers for each in record_of(copy).studies] == [["It was measured again."]] * len(STUDIES)
    assert len(list((copy / "damaged").glob("*"))) == (change in ("damaged", "former"))


@pytest.mark.parametrize("error", [RuntimeError("no memory"), OSError(28, "No space left"), Diverged(3, "colour")])
def test_a_failing_study_costs_only_itself_and_is_tried_again(
    out: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    with_studies(monkeypatch, anytime=failing(error))
    after_run(out, "cpu", out, Quiet())
    record = record_of(out)
    assert [each.info.id for each in record.studies] == list(STUDIES)
    assert [(study_record.info.id, each.why) for study_record, each in record.broken] == [("anytime", reason_of(error))]
    with_studies(monkeypatch, latency=failing(error))
    after_run(out, "cpu", out, Quiet())
    assert record_of(out).broken == [], "the others were not measured again"


def test_an_unexpected_error_is_not_hidden_by_the_command(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with_studies(monkeypatch, confusions=failing(ZeroDivisionError("unexpected")))
    with pytest.raises(ZeroDivisionError):
        framework.run(SHELF, list(STUDIES), context_of(out, out), resume=False)
    assert [each.info.id for each in record_of(out).studies] == ["latency"], "what was finished is kept"
    with_studies(monkeypatch, confusions=failing(Diverged(3, "colour")))
    assert framework.run(SHELF, list(STUDIES), context_of(out, out), resume=True) == 3


def test_once_the_time_is_over_nothing_is_begun_and_the_rest_is_measured_later(
    out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def takes_all(context: ServingContext) -> Iterator[Found]:
        object.__setattr__(context, "deadline", context.clock())  # it is the context of all studies
        yield "It took long."

    with_studies(monkeypatch, latency=takes_all)
    after_run(out, "cpu", out, Quiet())
    late = [each for each in record_of(out).studies if each.cut_short]
    assert [each.info.id for each in late] == list(STUDIES)[1:]
    assert {each.checks[0].why for each in late} == {"the time for it was over"}
    after_run(out, "cpu", out, Quiet())
    assert not any(each.cut_short for each in record_of(out).studies)


def test_a_failure_outside_of_a_study_is_reported(out: Path, monkeypatch: pytest.MonkeyPatch, lines: list[str]) -> None:
    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("harness.studies.framework.write_studies", full)
    after_run(out, "cpu", out, Quiet())
    assert "serving was not measured" in lines[-1]
    assert "No space left" in lines[-1]


def test_a_cell_that_diverged_is_named(out: Path) -> None:
    path = out / "records/cells/ball.nerf.0.json"
    data = json.loads(path.read_text(encoding="utf-8"))
    data.pop("digest", None)
    path.write_text(json.dumps({**data, "status": "diverged", "reason": "not finite at step 3"}), encoding="utf-8")
    assert framework.run(SHELF, ["latency", "anytime"], context_of(out, out), resume=False) == 0
    latency, anytime = record_of(out).studies
    assert {each.subject for each in latency.checks if each.id.startswith("hit.")} == {"qnerf"}
    gaps = [each for each in latency.checks if each.status == "not_available"]
    assert any(each.what == "ball, nerf, seed 0" and "diverged" in each.why for each in gaps)
    assert anytime.answers == ["No method of the run can be rendered by regions here."]


def test_the_command_measures_what_is_requested(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    typed = ["serving", str(out), "--quick", "--methods", "qnerf", "--width", "12", "--studies", "latency"]
    assert main(typed) == 0
    (latency,) = record_of(out).studies
    assert {each.subject for each in latency.checks if each.id.startswith("hit.")} == {"qnerf"}
    assert latency.answers[0].startswith("Rendering a view 12 px wide takes")
    printed = capsys.readouterr().out
    assert "about" in printed.splitlines()[0], "an estimate comes first"
    assert str(out / SHELF.file) in printed.splitlines()[-1]
    for file in (out / "checkpoints").iterdir():
        file.unlink()
    assert main([*typed[:3], "--quiet"]) == 0
    assert {each.status for _, each in record_of(out).checks()} == {"not_available"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--width", "4"], "--width 4"),
        (["--threads", "0"], "--threads 0"),
        (["--seed", "7"], "--seed 7"),
        (["--scenes", "lego"], "'lego'"),
        (["--methods", "nerv"], "'nerv'"),
        (["--studies", "latencies"], "'latencies'"),
    ],
)
def test_mistakes_are_refused_in_one_line(
    trained: Path, capsys: pytest.CaptureFixture[str], options: list[str], words: str
) -> None:
    assert words in refused(capsys, trained, "--quiet", *options, command="serving")


def test_a_folder_without_a_run_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "holds no run" in refused(capsys, tmp_path, command="serving")


@pytest.mark.parametrize(("options", "measured"), [([], True), (["--no-serving"], False)])
def test_a_run_measures_it_at_its_end(
    ball_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: list[str], measured: bool
) -> None:
    measured_in: list[Path] = []

    def noted(out: Path, device: str, view_sets: Path, show: Any) -> None:
        assert [cell.status for cell in read_cells(out)] == ["done"], "after everything else"
        assert (out / "records/comparisons.json").exists()
        measured_in.append(out)

    monkeypatch.setattr("harness.execution.run.run_locally", in_this_process)
    monkeypatch.setattr(serving_run, "after_run", noted)
    monkeypatch.setattr("harness.machine.device.available_cores", lambda: 1)
    typed = "--profile smoke --resolution 8 --methods nerf --seeds 1 --budget-steps 2 --workers 1 --quiet --view-set"
    out = tmp_path / "run"
    assert main(["run", *typed.split(), str(ball_folder), "--out", str(out), *options]) == 0
    assert measured_in == ([out] if measured else [])
    phases = FinishedRun.of(out).run.phases
    assert ("serve" in phases) == measured


def test_a_study_names_once_what_it_left_out(context: ServingContext) -> None:
    def leaves_out(context: ServingContext) -> Iterator[Found]:
        for _ in range(2):
            context.leave_out("this", "it is missing")
        yield "It was measured."

    gap = Check("this", None, why="it is missing", owner="machine", status="not_available", id="left_out")
    assert list(study(leaves_out)(context)) == ["It was measured.", gap]
