"""python -m reports where there is a stability.json: pages, exit codes, what is published, what is refused."""

import re

import pytest

from harness.records.study import SHELVES, read_studies
from reports.__main__ import main
from tests.reports.fake_run import write_fake_run
from tests.reports.fake_stability import fake_stability, write_fake_stability
from tests.reports.run.test_page import Outline
from tests.reports.test_command import BUILD, HEAVY, fresh

GOOD = fake_stability(with_failure=False, with_charts=False)
BROKEN = fake_stability(with_charts=False)


def names(folder) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_stability_record_alone_gives_its_page_alone(tmp_path, capsys):
    out = write_fake_stability(tmp_path / "out", GOOD)
    assert main([str(out)]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "All 30 stability checks of this harness pass",
        str(out / "stability.html"),
    ]
    assert names(out) == ["stability", "stability.html", SHELVES["stability"]]


def test_what_is_ours_and_fails_gives_3_and_is_named(tmp_path, capsys):
    out = write_fake_stability(tmp_path / "out", BROKEN)
    assert main([str(out)]) == 3
    assert "A2 harness: 3.00·10⁻⁴, wanted ≤ 2·10⁻⁶ (after a reload)" in capsys.readouterr().out.splitlines()
    assert main([str(out), "--quiet"]) == 3
    assert capsys.readouterr().out == f"{out / 'stability.html'}\n"


@pytest.mark.parametrize(("record", "diverged", "code"), [
    (GOOD, False, 0), (GOOD, True, 3), (BROKEN, False, 3),
])  # fmt: skip
def test_beside_a_run_there_are_both_and_either_may_fail(tmp_path, record, diverged, code):
    out = write_fake_run(tmp_path / "run", pictures=False, with_diverged=diverged)
    assert main([str(write_fake_stability(out, record)), "--quiet"]) == code
    report, own = ((out / name).read_text(encoding="utf-8") for name in ("report.html", "stability.html"))
    assert '<section id="stability">' in report
    assert "stability.html" in Outline(report).links
    assert "report.html" in Outline(own).links


def test_records_that_hold_no_finished_cell_do_not_stop_the_page(tmp_path):
    out = write_fake_run(tmp_path / "run", ("chair",), seeds=1, pictures=False)
    for path in (out / "records" / "cells").iterdir():
        path.unlink()
    assert main([str(write_fake_stability(out, GOOD))]) == 0
    assert not (out / "report.html").exists()


@pytest.mark.parametrize("content", ["{", "[]", '{"schema": 99}', '{"schema": 1, "cases": 3}'])
def test_a_damaged_record_gives_2_and_writes_nothing(out, capsys, content):
    (out / SHELVES["stability"]).write_text(content, encoding="utf-8")
    assert main([str(out)]) == 2
    caught = capsys.readouterr()
    assert caught.err.startswith(str(out / SHELVES["stability"]))
    assert len(caught.err.splitlines()) == 1
    assert not (out / "report.html").exists()
    assert not (out / "stability.html").exists()


@pytest.mark.parametrize(
    ("was", "becomes", "said"),
    [
        ('"value": 0.0003', '"value": "high"', "got `str` - at `$.studies[8].findings[5].value`"),
        ('"value": 0.0003', '"value": NaN', "JSON is malformed"),
        ('"status": "not_available"', '"status": "lost"', "Invalid enum value 'lost'"),
    ],
)
def test_what_no_type_allows_is_named(tmp_path, was, becomes, said, capsys):
    out = write_fake_stability(tmp_path)
    text = re.sub(r',\s*"digest": "[0-9a-f]{64}"', "", (out / SHELVES["stability"]).read_text(encoding="utf-8"))
    assert text.count(was) == 1
    (out / SHELVES["stability"]).write_text(text.replace(was, becomes), encoding="utf-8")
    assert main([str(out)]) == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.startswith(str(out / SHELVES["stability"]))
    assert len(told.splitlines()) == 1


def test_publishing_writes_the_record_and_two_charts(tmp_path):
    record = fake_stability(with_failure=False)
    out, docs = write_fake_stability(tmp_path / "out", record), tmp_path / "docs"
    assert main([str(out), "--publish", str(docs)]) == 0
    assert names(docs) == [SHELVES["stability"], "stability.png", "stability_curves.png"]
    published = read_studies(docs / SHELVES["stability"])
    assert [one for _, one in published.checks()] == [one for _, one in GOOD.checks()]
    assert not any(case.pictures for case in published.studies)
    for name in ("stability.png", "stability_curves.png"):
        assert (docs / name).read_bytes().startswith(b"\x89PNG")
        assert 5_000 < (docs / name).stat().st_size < 500_000


def test_what_there_is_not_is_not_drawn(tmp_path):
    out, docs = write_fake_stability(tmp_path / "out", fake_stability(studies=[])), tmp_path / "docs"
    assert main([str(out), "--publish", str(docs)]) == 0
    assert names(docs) == [SHELVES["stability"]]


def test_a_quick_run_is_not_published(tmp_path, capsys):
    out = write_fake_stability(
        tmp_path / "out", fake_stability(with_failure=False, with_charts=False, settings={"quick": True})
    )
    assert main([str(out), "--publish", str(tmp_path / "docs")]) == 2
    assert "a quick run, too rough to publish" in capsys.readouterr().err
    assert not (tmp_path / "docs").exists()
    assert main([str(out)]) == 0


@pytest.mark.slow
def test_the_page_is_built_without_torch_and_mitsuba(tmp_path):
    out = write_fake_stability(tmp_path / "out", GOOD)
    done = fresh(f"{BUILD} {HEAVY}", str(out), "--quiet", "--publish", str(tmp_path / "docs"))
    assert done.stderr == ""
    assert done.stdout.splitlines()[1:] == ["[]"]
