"""`python -m harness stability`: the table of cases, options, the folder, going on after a stop, the exit code."""

import json
import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from harness.__main__ import main
from harness.records.charts import Series, Table
from harness.records.json_record import DamagedRecord
from harness.records.stability_record import CHAPTERS, STABILITY_FILE, CaseInfo, Picture, broken, judged, read_stability
from harness.run_folder.integrity import DAMAGED, mend
from harness.studies.stability import cases, stability_run
from harness.studies.stability.cases import CASES, Case, measure_of
from harness.studies.stability.stability_context import METHODS, Finding, StabilityContext, whose
from tests.harness import shell

REQUIRED = (
    *(f"Q{number}" for number in range(1, 11)),
    "E1", "E2", "E3", "A1", "A2", "A3", "A4", "A5", "O1", "O2",
    *(f"S{number}" for number in range(1, 8)),
    "C1", "C2", "R1",
)  # fmt: skip


def test_every_case_of_the_catalogue_is_there_and_says_what_it_is() -> None:
    assert len(REQUIRED) == 30
    assert set(REQUIRED) <= set(CASES)
    for name, case in CASES.items():
        assert case.info.id == name
        assert all([case.info.title, case.info.input, case.info.danger, case.info.reference, case.info.bar])
        assert callable(measure_of(case))


def test_a_method_with_a_printed_part_is_the_papers() -> None:
    assert whose("nerf") == "ours"
    assert whose("qnerf") == "paper"
    assert whose("qnerf_listing4") == "paper"


@pytest.mark.parametrize(
    ("figure", "sense", "status"),
    [(0.5, "at_most", "pass"), (1.0, "at_most", "pass"), (1.5, "at_most", "fail"),
     (0.5, "at_least", "fail"), (1.5, "at_least", "pass")],
)  # fmt: skip
def test_a_figure_is_judged_by_its_bar(figure: float, sense: str, status: str) -> None:
    assert judged("Q1", "x", "ours", figure, 1.0, what="it", sense=sense).status == status  # type: ignore[arg-type]


@pytest.mark.parametrize("figure", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("sense", ["at_most", "at_least"])
def test_what_is_not_finite_fails_whatever_the_bar(figure: float, sense: str) -> None:
    found = judged("Q1", "x", "ours", figure, 1.0, what="it", sense=sense)  # type: ignore[arg-type]
    assert (found.status, found.figure) == ("fail", None)
    assert str(figure) in found.why
    assert found.broke


def test_only_what_is_ours_must_pass() -> None:
    assert not judged("Q1", "listing4", "paper", 2.0, 1.0, what="it").broke
    assert not judged("Q1", "cumprod", "usual", 2.0, 1.0, what="it").broke


refused = partial(shell.refused, command="stability")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--cases Q1 Q99", "--cases: unknown 'Q99'; known: Q1 Q2"),
        ("--cases Q1 Q1", "--cases: Q1 named twice"),
        ("--methods nope", "--methods: unknown 'nope'; known: nerf"),
        ("--resume", "--resume: name the folder"),
    ],
)
def test_bad_options_are_said_in_one_line(
    options: str, said: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert said in refused(capsys, "--quiet", *options.split())
    assert list(tmp_path.iterdir()) == []


def test_a_folder_in_use_is_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    assert "is in use" in refused(capsys, "--quiet", "--out", tmp_path)
    assert "is a file" in refused(capsys, "--quiet", "--out", tmp_path / "mine.txt")
    assert f"holds no {STABILITY_FILE}" in refused(capsys, "--quiet", "--out", tmp_path, "--resume")


asked: list[str] = []


def made_up(case: str, whose_it_is: str = "ours", figure: float = 0.5) -> Iterator[Finding]:
    asked.append(case)
    yield judged(case, "harness", whose_it_is, figure, 1.0, what="a figure")  # type: ignore[arg-type]
    yield Series("panel", 1, "line", "x", "y", [1.0, 2.0], [3.0, 4.0])
    yield Table("table", 1, "title", ["a"], [["b"]])
    yield Picture(4, "title", "caption", "stability/a.png")


def passes(situation: StabilityContext) -> Iterator[Finding]:
    yield from made_up("X1")


def fails(situation: StabilityContext) -> Iterator[Finding]:
    yield from made_up("X2", figure=2.0)


def is_a_property(situation: StabilityContext) -> Iterator[Finding]:
    yield from made_up("X3", "paper", 2.0)


def stops(situation: StabilityContext) -> Iterator[Finding]:
    yield from made_up("X4")
    raise KeyboardInterrupt


def names_another(situation: StabilityContext) -> Iterator[Finding]:
    yield from made_up("X1")


def trains_in_the_same_folder(situation: StabilityContext) -> Iterator[Finding]:
    mend(situation.out, situation.plan("smoke"), lambda line: None)
    assert situation.scratch.is_dir()
    yield from made_up("X6")


MADE_UP = {
    "X1": passes,
    "X2": fails,
    "X3": is_a_property,
    "X4": stops,
    "X5": names_another,
    "X6": trains_in_the_same_folder,
}


@pytest.fixture
def _made_up_cases(monkeypatch: pytest.MonkeyPatch) -> None:
    """A catalogue of cases that cost nothing."""
    asked.clear()
    made_up = {name: Case(CaseInfo(name, "t", "i", "d", "r", "b"), "made:up", 1.0) for name in MADE_UP}
    monkeypatch.setattr(cases, "CASES", made_up)
    monkeypatch.setattr(stability_run, "CASES", made_up)
    monkeypatch.setattr(stability_run, "measure_of", lambda case: MADE_UP[case.info.id])


def run(out: Path, *cases: str, resume: bool = False) -> int:
    options = ["--resume"] if resume else []
    return main(["stability", "--quiet", "--out", str(out), "--cases", *cases, *options])


@pytest.mark.usefixtures("_made_up_cases")
def test_the_record_holds_what_the_cases_yield(tmp_path: Path) -> None:
    assert run(tmp_path / "out", "X1", "X3") == 0
    record = read_stability(tmp_path / "out" / STABILITY_FILE)
    assert [one.info.id for one in record.cases] == ["X1", "X3"]
    assert record.finished
    assert record.settings["methods"] == list(METHODS)
    first = record.cases[0]
    assert (len(first.outcomes), len(first.series), len(first.tables), len(first.pictures)) == (1, 1, 1, 1)
    assert first.series[0].item in CHAPTERS
    assert [one.status for one in record.outcomes()] == ["pass", "fail"]
    assert broken(record) == []
    assert list((tmp_path / "out").iterdir()) == [tmp_path / "out" / STABILITY_FILE]


@pytest.mark.usefixtures("_made_up_cases")
def test_a_training_that_tidies_the_folder_leaves_the_cases_scratch_alone(tmp_path: Path) -> None:
    assert run(tmp_path / "out", "X6") == 0


@pytest.mark.usefixtures("_made_up_cases")
def test_a_case_that_must_pass_and_does_not_is_exit_code_3(tmp_path: Path) -> None:
    assert run(tmp_path / "out", "X1", "X2") == 3
    assert [one.case for one in broken(read_stability(tmp_path / "out" / STABILITY_FILE))] == ["X2"]


@pytest.mark.usefixtures("_made_up_cases")
def test_a_stopped_run_keeps_whole_cases_and_goes_on(tmp_path: Path) -> None:
    assert run(tmp_path / "out", "X1", "X4") == 130
    record = read_stability(tmp_path / "out" / STABILITY_FILE)
    assert ([one.info.id for one in record.cases], record.finished) == (["X1"], False)
    assert run(tmp_path / "out", "X3", "X2", "X1", resume=True) == 3
    assert asked == ["X1", "X4", "X3", "X2"]
    record = read_stability(tmp_path / "out" / STABILITY_FILE)
    assert [one.info.id for one in record.cases] == ["X1", "X2", "X3"]


@pytest.mark.usefixtures("_made_up_cases")
def test_a_damaged_record_is_named_moved_aside_and_measured_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path / "out", "X1", "X3") == 0
    record, before = tmp_path / "out" / STABILITY_FILE, read_stability(tmp_path / "out" / STABILITY_FILE)
    spoilt = record.read_text().replace('"figure": 0.5', '"figure": 0.4')
    record.write_text(spoilt)
    capsys.readouterr()
    assert main(["stability", "--out", str(tmp_path / "out"), "--cases", "X1", "X3", "--resume"]) == 0
    said = capsys.readouterr().out
    assert f"{STABILITY_FILE}: its digest does not match" in said
    assert "everything in it is measured again" in said
    after = read_stability(record)
    assert list(after.outcomes()) == list(before.outcomes())
    assert (tmp_path / "out" / DAMAGED / f"{STABILITY_FILE}.1").read_text() == spoilt

    record.unlink()  # killed before the record was there again
    assert run(tmp_path / "out", "X1", resume=True) == 0
    assert [one.info.id for one in read_stability(record).cases] == ["X1"]


@pytest.mark.usefixtures("_made_up_cases")
def test_going_on_with_other_options_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(tmp_path / "out", "X1") == 0
    said = refused(capsys, "--quiet", "--out", tmp_path / "out", "--resume", "--methods", "nerf")
    assert "was made with other options" in said


@pytest.mark.usefixtures("_made_up_cases")
def test_an_outcome_under_another_case_is_our_own_error(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="case X5 gave an outcome of case X1"):
        run(tmp_path / "out", "X5")


@pytest.mark.usefixtures("_made_up_cases")
def test_a_record_that_was_changed_is_refused(tmp_path: Path) -> None:
    assert run(tmp_path / "out", "X1") == 0
    file = tmp_path / "out" / STABILITY_FILE
    data = json.loads(file.read_text())
    data.pop("digest", None)
    del data["cases"][0]["outcomes"][0]["status"]
    file.write_text(json.dumps(data))
    with pytest.raises(DamagedRecord, match="status"):
        read_stability(file)
