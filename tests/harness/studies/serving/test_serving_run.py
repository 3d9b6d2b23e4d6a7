"""The record of serving, and its command."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from baselines.numerics.attention.maps import MAPS
from harness.command.main import main
from harness.records.study import Check, Studies, read_studies
from harness.studies import framework
from harness.studies.framework import Found
from harness.studies.serving.attention import MEASURES, NOTHING, ORDERS
from harness.studies.serving.serving_context import Measure, ServingContext, study
from harness.studies.serving.serving_studies import SHELF, STUDIES
from harness.training.trainer import Diverged
from tests.harness.shell import refused
from tests.harness.studies.serving.conftest import context_of
from tests.harness.trained_runs import SIZE

pytestmark = pytest.mark.slow


def record_of(out: Path) -> Studies:
    return read_studies(out / SHELF.file)


def measured(out: Path, *studies: str, resume: bool = False) -> int:
    """The exit code of measuring these studies, by default all."""
    return framework.run(SHELF, list(studies or STUDIES), context_of(out, out), resume=resume)


def with_studies(monkeypatch: pytest.MonkeyPatch, **measures: Measure) -> None:
    """Let studies measure something else; those that are not named only yield a sentence."""

    def measure_of(self: object, name: str) -> Measure:
        return study(measures.get(name, sentence))

    monkeypatch.setattr(SHELF.__class__, "measure_of", measure_of)


def sentence(context: ServingContext) -> Iterator[Found]:
    yield "It was measured again."


def failing(error: BaseException) -> Measure:
    def measure(context: ServingContext) -> Iterator[Found]:
        yield "It begins."
        raise error

    return measure


def test_the_record_is_complete(out: Path) -> None:
    assert measured(out) == 0
    record = record_of(out)
    assert [each.info.id for each in record.studies] == list(STUDIES)
    assert record.is_complete
    assert not record.broken
    assert all(each.answers for each in record.studies)
    ids = [each.id for _, each in record.checks() if each.id != "left_out"]
    assert len(set(ids)) == len(ids)
    assert {each.subject for _, each in record.checks() if each.id.startswith("hit.")} == {"nerf", "qnerf"}
    checks = {each.id: each for _, each in record.checks()}
    assert {f"whole.{order}" for order in ORDERS} <= set(checks), "the last part leaves no error"
    assert checks["earlier.attended"].repeats == len(MAPS)
    assert (checks["phi.changed"].value, checks["phi.changed"].repeats) == (0.0, len(MAPS))
    (table,) = (table for study in record.studies if study.info.id == "attention" for table in study.tables)
    assert len(table.rows) == len(MAPS) * len(MEASURES)
    settings = record.settings
    assert (settings["scenes"], settings["methods"], settings["width"]) == (["ball"], ["nerf", "qnerf"], SIZE)
    assert not list(out.glob(".scratch-*")), "scratch files are gone"


def test_a_failing_study_costs_only_itself_and_is_tried_again(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with_studies(monkeypatch, attention=failing(Diverged(3, "colour")))
    assert measured(out) == 3
    record = record_of(out)
    assert [each.info.id for each in record.studies] == list(STUDIES)
    assert [study_record.info.id for study_record, _ in record.broken] == ["attention"]
    assert not record.is_complete
    with_studies(monkeypatch, latency=failing(ZeroDivisionError("unexpected")))
    assert measured(out, resume=True) == 0, "the others are not measured again"
    assert record_of(out).is_complete


def test_an_unexpected_error_is_not_hidden_by_the_command(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with_studies(monkeypatch, attention=failing(ZeroDivisionError("unexpected")))
    with pytest.raises(ZeroDivisionError):
        measured(out)
    assert [each.info.id for each in record_of(out).studies] == ["latency"], "what was finished is kept"


def test_a_cell_that_diverged_is_named(out: Path) -> None:
    path = out / "records/cells/ball.nerf.0.json"
    data = json.loads(path.read_text(encoding="utf-8"))
    data.pop("digest", None)
    path.write_text(json.dumps({**data, "status": "diverged", "reason": "not finite at step 3"}), encoding="utf-8")
    assert measured(out, "latency", "attention") == 0
    latency, attention = record_of(out).studies
    assert {each.subject for each in latency.checks if each.id.startswith("hit.")} == {"qnerf"}
    gaps = [each for each in latency.checks if each.status == "not_available"]
    assert any(each.what == "ball, nerf, seed 0" and "diverged" in each.why for each in gaps)
    assert attention.answers == [NOTHING]
    assert any("which points share a chunk" in each.why for each in attention.checks), "in qnerf"


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


def test_a_study_names_once_what_it_left_out(context: ServingContext) -> None:
    def leaves_out(context: ServingContext) -> Iterator[Found]:
        for _ in range(2):
            context.leave_out("this", "it is missing")
        yield "It was measured."

    gap = Check("this", None, why="it is missing", owner="machine", status="not_available", id="left_out")
    assert list(study(leaves_out)(context)) == ["It was measured.", gap]
