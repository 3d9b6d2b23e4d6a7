"""python -m reports where there is an evidence.json: pages, exit codes, what is published, what is refused."""

import json

import pytest
from msgspec.structs import replace

from harness.records.study import SHELVES, read_studies
from reports.__main__ import main
from reports.studies import publishing
from tests.reports.fake_evidence import fake_evidence, write_fake_evidence
from tests.reports.fake_run import write_fake_run
from tests.reports.test_command import BUILD, HEAVY, fresh

EVIDENCE_FILE = SHELVES["evidence"]

GOOD = fake_evidence(with_failure=False, with_charts=False)
BAD = fake_evidence(with_charts=False)


def names(folder) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_evidence_alone_gives_its_page_alone(tmp_path, capsys):
    out = write_fake_evidence(tmp_path / "out", GOOD)
    assert main([str(out)]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "All 3 checks of the evidence hold",
        str(out / "evidence.html"),
    ]
    assert names(out) == ["evidence.html", EVIDENCE_FILE]


def test_a_check_that_does_not_hold_gives_3_and_is_named(tmp_path, capsys):
    out = write_fake_evidence(tmp_path / "out", BAD)
    assert main([str(out)]) == 3
    lines = capsys.readouterr().out.splitlines()
    assert lines[1].startswith("calibration: share of real A/A comparisons that are called better or worse: 0.0810")
    assert main([str(out), "--quiet"]) == 3
    assert capsys.readouterr().out == f"{out / 'evidence.html'}\n"


@pytest.mark.parametrize(("record", "code"), [(GOOD, 0), (BAD, 3)])
def test_beside_a_run_the_studies_stand_in_its_report(tmp_path, record, code):
    out = write_fake_run(tmp_path / "run", ("chair",), seeds=2, pictures=False, with_diverged=False)
    assert main([str(write_fake_evidence(out, record)), "--quiet"]) == code
    report = (out / "report.html").read_text(encoding="utf-8")
    assert '<section id="evidence">' in report
    assert 'id="study-factorial"' in report
    assert not (out / "evidence.html").exists()


@pytest.mark.parametrize("content", ["{", "[]", '{"schema": 99}', '{"schema": 1, "studies": 3}'])
def test_a_damaged_record_gives_2_and_writes_nothing(tmp_path, capsys, content):
    (tmp_path / EVIDENCE_FILE).write_text(content, encoding="utf-8")
    assert main([str(tmp_path)]) == 2
    caught = capsys.readouterr()
    assert caught.err.startswith(str(tmp_path / EVIDENCE_FILE))
    assert len(caught.err.splitlines()) == 1
    assert names(tmp_path) == [EVIDENCE_FILE]


def changed(place: list, value):
    """The record with what lies at `place` replaced."""

    def change(data: dict) -> None:
        *way, last = place
        for step in way:
            data = data[step]
        data[last] = value

    return change


def spoil(out, change) -> None:
    """Writes a record with a change."""
    write_fake_evidence(out, BAD)
    data = json.loads((out / EVIDENCE_FILE).read_text(encoding="utf-8"))
    data.pop("digest", None)
    change(data)
    (out / EVIDENCE_FILE).write_text(json.dumps(data), encoding="utf-8")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (changed(["studies", 1, "findings", 1, "difference"], float("nan")), "JSON is malformed"),
        (changed(["studies", 1, "findings", 1, "interval"], [2, 1]), "has interval [2.0, 1.0], which runs backwards"),
        (changed(["studies", 1, "info", "id"], "calibration"), "'calibration' is there twice"),
        (changed(["studies", 0, "findings", -1, "rows"], [["a"]]), "has 3 columns but a row of 1"),
        (
            changed(["settings", "smallest_of_interest"], {"psnr": None}),
            "smallest_of_interest: Expected `float`, got `null`",
        ),
        (changed(["studies", 0, "findings", -1, "item"], 4), "'Spread between seeds' belongs to item 4, not 0"),
    ],
)
def test_what_no_run_writes_is_named(tmp_path, capsys, change, said):
    spoil(tmp_path, change)
    assert main([str(tmp_path)]) == 2
    told = capsys.readouterr().err
    assert said in told
    assert "run `nox -s evidence` again" in told
    assert len(told.splitlines()) == 1


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (changed(["studies", 0, "findings", 3, "value"], "high"), "got `str` - at `$.studies[0].findings[3].value`"),
        (changed(["studies", 1, "findings", 1, "verdict"], "great"), "'great' - at `$.studies[1].findings[1].verdict`"),
    ],
)
def test_what_is_of_another_type_is_named(tmp_path, change, said, capsys):
    spoil(tmp_path, change)
    assert main([str(tmp_path)]) == 2
    told = capsys.readouterr().err
    assert said in told
    assert len(told.splitlines()) == 1


def test_publishing_writes_the_record_and_two_charts(tmp_path):
    record = fake_evidence(with_failure=False)
    out, docs = write_fake_evidence(tmp_path / "out", record), tmp_path / "docs"
    assert main([str(out), "--publish", str(docs)]) == 0
    assert names(docs) == ["bandwidth.png", EVIDENCE_FILE, "evidence_effects.png"]
    assert read_studies(docs / EVIDENCE_FILE) == read_studies(out / EVIDENCE_FILE)
    for name in ("bandwidth.png", "evidence_effects.png"):
        assert (docs / name).read_bytes().startswith(b"\x89PNG")
        assert 5_000 < (docs / name).stat().st_size < 300_000


def test_a_long_record_is_published_without_its_lines(tmp_path, monkeypatch):
    monkeypatch.setattr(publishing, "LARGEST", 1_000)
    publishing.write_published_evidence(fake_evidence(), tmp_path)
    published = read_studies(tmp_path / EVIDENCE_FILE)
    assert not any(study.series for study in published.studies)
    assert [study.checks for study in published.studies] == [study.checks for study in fake_evidence().studies]


def test_what_there_is_not_is_not_drawn(tmp_path):
    publishing.write_published_evidence(replace(GOOD, studies=[]), tmp_path)
    assert names(tmp_path) == [EVIDENCE_FILE]


def test_a_quick_run_is_not_published(tmp_path, capsys):
    out = write_fake_evidence(tmp_path / "out", replace(GOOD, settings={"quick": True}))
    assert main([str(out), "--publish", str(tmp_path / "docs")]) == 2
    assert "a quick run, too rough to publish" in capsys.readouterr().err
    assert not (tmp_path / "docs").exists()
    assert main([str(out)]) == 0


def test_unfinished_evidence_is_not_published(tmp_path, capsys):
    out = write_fake_evidence(tmp_path / "out", replace(GOOD, finished=False))
    assert main([str(out), "--publish", str(tmp_path / "docs")]) == 2
    assert "not finished" in capsys.readouterr().err
    assert not (tmp_path / "docs").exists()
    assert main([str(out)]) == 0


@pytest.mark.thorough
@pytest.mark.slow
def test_the_page_is_built_without_torch_and_mitsuba(tmp_path):
    out = write_fake_evidence(tmp_path / "out", GOOD)
    done = fresh(f"{BUILD} {HEAVY}", str(out), "--quiet", "--publish", str(tmp_path / "docs"))
    assert done.stderr == ""
    assert done.stdout.splitlines()[1:] == ["[]"]
