"""The loop that runs studies, tried by commands with scripted studies: what it records, resumes, refuses and prints."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import pytest

from harness.command.main import main
from harness.records.json_record import load_record, write_record
from harness.records.study import SHELVES, Check, Owner, Series, Table, check, read_studies, write_studies
from harness.run_folder.integrity import DAMAGED, repair
from harness.studies.evidence.evidence_studies import SHELF as EVIDENCE
from harness.studies.framework import Found, Shelf, line_of, list_lines
from harness.studies.speed.questions import SHELF as SPEED
from harness.studies.stability.cases import SHELF as STABILITY
from harness.studies.stability.stability_context import METHODS, StabilityContext
from scenes.files.errors import DamagedRecord
from tests.harness.shell import refused
from tests.replacing import replace
from tests.reports.fake_studies import fake_studies

ALL = (EVIDENCE, STABILITY, SPEED)


def scripted(monkeypatch: pytest.MonkeyPatch, stop_in: str = "", fail_in: str = "", owner: Owner = "ours") -> list[str]:
    """Let studies answer at once, and stop or fail in a given study; return those that will have been measured."""
    asked: list[str] = []

    def measure(name: str) -> Iterator[Found]:
        asked.append(name)
        yield f"{name} is answered"
        yield check("a figure", 2.0 if name == fail_in else 1.0, high=1.0, owner=owner, id=name)
        if name == stop_in:
            raise KeyboardInterrupt
        yield Series("panel", 0, "line", "x", "y", [1.0], [math.inf])
        yield Table("t", 0, "table", ["a"], [["b", math.nan]])

    monkeypatch.setattr(Shelf, "measure_of", lambda shelf, name: lambda context: measure(name))
    return asked


def run(out: Path, *names: str, resume: bool = False, shelf: str = "speed") -> int:
    options = ["--resume"] if resume else []
    return main([shelf, "--quick", "--quiet", "--studies", *names, "--out", str(out), *options])


def done(out: Path, shelf: str = "speed") -> list[str]:
    return [study.info.id for study in read_studies(out / SHELVES[shelf]).studies]


@pytest.mark.parametrize("shelf", ALL, ids=lambda shelf: shelf.name)
def test_every_study_of_a_catalogue_is_a_generator_that_can_be_imported(shelf: Shelf) -> None:
    assert shelf.name in SHELVES
    for name, study in shelf.studies.items():
        assert study.info.id == name
        assert study.info.title
        assert study.seconds > 0
        assert callable(shelf.measure_of(name))
    assert len(list_lines(shelf)) == len(shelf.studies)


@pytest.mark.parametrize("shelf", ["speed", "stability", "evidence"])
def test_studies_are_done_in_the_order_of_their_catalogue_and_recorded(
    shelf: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second, *_ = next(known for known in ALL if known.name == shelf).studies
    asked = scripted(monkeypatch)
    assert run(tmp_path / "out", second, first, shelf=shelf) == 0
    assert asked == done(tmp_path / "out", shelf) == [first, second]
    record = read_studies(tmp_path / "out" / SHELVES[shelf])
    assert (record.shelf, record.finished, record.is_quick) == (shelf, True, True)
    study = record.studies[0]
    assert (study.answers, len(study.checks), study.seconds >= 0) == ([f"{first} is answered"], 1, True)
    bars = study.info.facts.get("bar")
    assert bars == ("a figure at most 1" if shelf == "stability" else None), "the limits are read from the checks"
    assert study.series[0].y == [None], "a figure that is not finite is a gap"
    assert study.tables[0].rows == [["b", "not finite (nan)"]]
    assert [file.name for file in (tmp_path / "out").iterdir()] == [SHELVES[shelf]], "no other file remains"


def test_a_stopped_run_keeps_complete_studies_and_is_resumed_with_the_same_options(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scripted(monkeypatch, stop_in="4")
    assert run(tmp_path / "out", "2", "4", "7") == 130
    assert "1 of 3 questions are kept" in capsys.readouterr().err
    assert done(tmp_path / "out") == ["2"]
    assert not read_studies(tmp_path / "out/speed.json").finished
    again = scripted(monkeypatch)
    assert run(tmp_path / "out", "2", "4", "7", resume=True) == 0
    assert again == ["4", "7"]
    others = ("--quiet", "--quick", "--plain-seconds", "7", "--resume", "--out", tmp_path / "out")
    assert "other options" in refused(capsys, *others, command="speed")
    assert done(tmp_path / "out") == ["2", "4", "7"]


def test_a_study_of_a_resumed_record_names_its_own_commit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scripted(monkeypatch)
    run(tmp_path / "out", "2")
    record = read_studies(path := tmp_path / "out/speed.json")
    write_studies(path, replace(record, provenance={**record.provenance, "commit": "of another"}))
    run(tmp_path / "out", "2", "4", resume=True)
    first, second = read_studies(path).studies
    assert not first.scale
    assert second.scale == f"Measured at commit {record.provenance['commit']}"


@pytest.mark.parametrize(("owner", "code"), [("ours", 3), ("paper", 0), ("usual", 0), ("machine", 0)])
def test_only_our_checks_fail_the_run(owner: Owner, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scripted(monkeypatch, fail_in="4", owner=owner)
    assert run(tmp_path / "out", "2", "4") == code
    broken = read_studies(tmp_path / "out/speed.json").broken
    assert [study.info.id for study, _ in broken] == (["4"] if code else [])


def test_a_damaged_record_is_named_moved_aside_and_measured_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scripted(monkeypatch)
    assert run(tmp_path / "out", "2") == 0
    file = tmp_path / "out" / "speed.json"
    spoilt = bytearray(file.read_bytes())
    spoilt[len(spoilt) // 2] ^= 1
    file.write_bytes(spoilt)
    again = scripted(monkeypatch)
    capsys.readouterr()
    assert main(["speed", "--quick", "--studies", "2", "--out", str(tmp_path / "out"), "--resume"]) == 0
    assert "speed.json: " in capsys.readouterr().out
    assert again == ["2"]
    assert (tmp_path / "out" / DAMAGED / "speed.json.1").read_bytes() == spoilt


@pytest.mark.parametrize(
    ("shelf", "options", "said"),
    [
        ("stability", "--cases Q1 Q1", "--studies: Q1 named twice"),
        ("stability", "--methods nope", "--methods: unknown 'nope'; known: nerf"),
        ("speed", "--items 0", "--studies: unknown '0'; known: 1 2 3"),
        ("speed", "--plain-seconds 0", "--plain-seconds 0: must lie between"),
        ("speed", "--plain-seconds nan", "--plain-seconds nan"),
        ("speed", "--plain-seconds 1e9", "--plain-seconds 1e+09"),
        *((shelf, options, said) for shelf in ("speed", "stability", "evidence") for options, said in (
            ("--studies none", "--studies: unknown 'none'"),
            ("--resume", "--resume: name the folder"),
            ("--out .", "is in use"),
            ("--out mine.txt", "is a file"),
            ("--out mine.txt/run", "cannot be written"),
            ("--out . --resume", f"holds no {SHELVES[shelf]}"),
        )),
    ],
)  # fmt: skip
def test_bad_options_and_folders_are_refused(
    shelf: str, options: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    (tmp_path / "mine.txt").write_text("mine")
    monkeypatch.chdir(tmp_path)
    assert said in refused(capsys, "--quiet", *options.split(), command=shelf)
    assert [file.name for file in tmp_path.iterdir()] == ["mine.txt"]


def test_a_training_that_repairs_the_folder_keeps_the_scratch_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def trains_in_the_same_folder(context: StabilityContext) -> Iterator[Found]:
        repair(context.out, context.plan("smoke"), lambda line: None)
        assert context.scratch.is_dir()
        yield check("a figure", 0.5, high=1.0)

    monkeypatch.setattr(Shelf, "measure_of", lambda shelf, name: trains_in_the_same_folder)
    assert main(["stability", "--quiet", "--out", str(tmp_path / "out"), "--studies", "Q1"]) == 0
    record = read_studies(tmp_path / "out/stability.json")
    assert record.settings["methods"] == list(METHODS)
    assert len(record.studies[0].checks) == 1


@pytest.mark.parametrize(
    ("value", "end", "status"),
    [(0.5, "high", "pass"), (1.0, "high", "pass"), (1.5, "high", "fail"), (0.5, "low", "fail"), (1.5, "low", "pass"),
     (None, "high", "fail"), (math.nan, "low", "fail"), (math.inf, "low", "fail"), (-math.inf, "high", "fail")],
)  # fmt: skip
def test_a_figure_is_compared_with_its_limit(value: float | None, end: Literal["low", "high"], status: str) -> None:
    outcome = check("it", value, 1.0) if end == "low" else check("it", value, high=1.0)
    assert outcome.status == status
    if value is not None and not math.isfinite(value):
        assert (outcome.value, str(value) in outcome.why) == (None, True)
    assert check("it", 3.0).status == "measured"


def test_a_line_holds_status_figure_limits_and_reason_of_a_check() -> None:
    passed = check("error", 2.1e-7, high=1e-6, subject="midpoint")
    assert line_of(passed) == "midpoint: pass: error 2.1e-07 (at most 1e-06)"
    missed = check("ratio", 7.4, 10.0, unit="×", why="plain", owner="machine", spread=(7.1, 7.6))
    assert line_of(missed) == "missed: ratio 7.4 × [7.1, 7.6] (at least 10); plain"
    assert line_of(check("share", None, high=0.05, why="nothing to see")) == (
        "FAIL: share, no figure (at most 0.05); nothing to see"
    )
    absent = Check("", None, why="no LLVM", subject="volpath", status="not_available")
    assert line_of(absent) == "volpath: not available; no LLVM"


@pytest.mark.parametrize("shelf", ["evidence", "serving", "speed"])
def test_a_record_comes_back_as_it_was_written(shelf: str, tmp_path: Path) -> None:
    write_studies(tmp_path / SHELVES[shelf], fake_studies(shelf))
    assert read_studies(tmp_path / SHELVES[shelf]) == fake_studies(shelf)


@pytest.mark.parametrize(("change", "said"), [({"more": 1}, "more"), ({"type": "poem"}, "poem")])
def test_a_finding_with_an_unknown_field_or_of_an_unknown_type_is_refused(
    change: dict[str, object], said: str, tmp_path: Path
) -> None:
    path = tmp_path / "stability.json"
    write_studies(path, fake_studies("stability"))
    data = load_record(path)
    data["studies"][0]["findings"][0].update(change)
    write_record(path, data)
    with pytest.raises(DamagedRecord, match="nox -s stability") as caught:
        read_studies(path)
    assert said in str(caught.value)
