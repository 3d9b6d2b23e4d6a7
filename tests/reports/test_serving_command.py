"""python -m reports where there is a serving.json: page, summary, what is published, what is refused."""

import json
import shutil
from pathlib import Path

import pytest

from harness.records.study import SHELVES, Check
from reports.__main__ import main
from tests.reports.fake_run import write_fake_run
from tests.reports.fake_serving import fake_serving, write_fake_serving

SERVING_FILE = SHELVES["serving"]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out: Path = write_fake_run(
        tmp_path_factory.mktemp("serving") / "run", ("chair",), seeds=2, pictures=False, with_diverged=False
    )
    return out


@pytest.fixture
def out(run: Path, tmp_path: Path) -> Path:
    """A run with everything beside it, to be changed."""
    return write_fake_serving(Path(shutil.copytree(run, tmp_path / "run")))


def test_it_stands_in_the_report_and_in_the_summary(out: Path) -> None:
    assert main([str(out), "--quiet"]) == 0
    report = (out / "report.html").read_text(encoding="utf-8")
    assert '<section id="serving"' in report
    assert "Rendering takes 3000 times as long as a hit in memory." in report
    assert "24.1 dB against the finished picture" in report
    assert "more &lt;b&gt;steps" in report
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["schema"] == 1
    found = {one["id"]: one for one in summary["serving"]}
    assert (found["hit.memory.0.nerf"]["study"], found["hit.memory.0.nerf"]["value"]) == ("latency", 3000.0)
    assert not any("serving" in one for one in summary["not_tested"])


def test_without_it_the_key_is_there_and_empty_and_the_remedy_is_named(run: Path, tmp_path: Path) -> None:
    out = shutil.copytree(run, tmp_path / "run")
    assert main([str(out), "--quiet"]) == 0
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["serving"] is None
    assert any("python -m harness study serving OUT" in one for one in summary["not_tested"])
    assert 'id="serving"' not in (out / "report.html").read_text(encoding="utf-8")


def test_a_record_of_an_earlier_version_is_left_out_with_its_remedy(
    out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (out / SERVING_FILE).write_text('{"schema": 2, "cache": null, "attention": null}', encoding="utf-8")
    assert main([str(out)]) == 0
    printed = capsys.readouterr().out
    assert f"by an earlier version; run `python -m harness study serving {out}` again" in printed
    assert json.loads((out / "summary.json").read_text(encoding="utf-8"))["serving"] is None


def test_what_was_cut_short_is_not_published(out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    late = Check("the rest", None, why="the time was over", owner="machine", status="not_available", id="late")
    write_fake_serving(out, fake_serving(priorities=[late]))
    assert main([str(out), "--publish", str(tmp_path / "docs")]) == 2
    assert "not finished" in capsys.readouterr().err
    assert not (tmp_path / "docs").exists()
