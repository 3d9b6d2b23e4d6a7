"""python -m reports: pages, exit codes, messages, published files and imports, for runs and records of studies."""

import dataclasses
import json
import re
from functools import reduce
from operator import getitem
from pathlib import Path

import pytest
from msgspec.structs import replace

from harness.records.study import SHELVES, Check, read_studies
from reports.__main__ import BAD_INPUT, OWN_ERROR, SOME_FAILED, STOPPED, main, parser
from reports.data.load import read_records
from reports.run.saving.archive import unpack
from reports.run.saving.publish import summary, without_folders, write_published
from reports.studies import publishing
from tests.reports.fake_history import fake_history
from tests.reports.fake_run import write_fake_run
from tests.reports.fake_studies import SETTINGS, fake_serving, fake_studies, write_fake_studies
from tests.reports.run.test_page import Outline
from tests.test_architecture import heavy_imports_of


def test_the_help_lists_every_exit_code():
    codes = re.findall(r"(?<= )\d+(?= )", parser().epilog)
    assert [int(code) for code in codes] == [0, OWN_ERROR, BAD_INPUT, SOME_FAILED, STOPPED]


@pytest.mark.slow
def test_diverged_cells_give_3_and_are_named_and_quiet_prints_the_path_alone(out, capsys):
    assert main([str(out)]) == 3
    *title, lost, path = capsys.readouterr().out.splitlines()
    assert all(len(line) <= 80 for line in title)
    assert "qnerf" in " ".join(title)
    assert lost.startswith("drums, qnerf, seed 2: diverged (not finite at step 412")
    assert path == str(out / "report.html")
    assert Path(path).is_file()
    assert main([str(out), "--quiet"]) == 3
    assert capsys.readouterr().out == f"{path}\n"


def test_a_folder_without_records_gives_2_and_one_line(tmp_path, capsys):
    assert main([str(tmp_path)]) == 2
    caught = capsys.readouterr()
    assert caught.out == ""
    assert ", ".join(["no records/", *(f"no {file}" for file in SHELVES.values())]) in caught.err
    assert len(caught.err.splitlines()) == 1


def test_a_folder_that_cannot_be_written_gives_2(out, capsys, monkeypatch):
    def read_only(*_):
        raise PermissionError(13, "Permission denied", str(out / "summary.json"))

    monkeypatch.setattr("reports.run.saving.publish.write_json", read_only)
    assert main([str(out)]) == 2
    assert capsys.readouterr().err == (
        f"{out / 'summary.json'}: Permission denied; make room or choose a folder that can be written\n"
    )


@pytest.mark.parametrize(
    ("options", "said"),
    [(["--export", "keep.json"], "ends in .zip"), (["--export", "records/a.zip"], "records of a run")],
)
def test_no_other_file_is_replaced_and_no_page_is_built_before_that_is_said(small, capsys, options, said):
    assert main([str(small), options[0], str(small / options[1])]) == 2
    assert said in capsys.readouterr().err
    assert not (small / "report.html").exists()


@pytest.mark.slow
def test_publish_writes_small_plots_and_the_numbers(tmp_path, pictured, capsys):
    main([str(pictured), "--quiet", "--publish", str(tmp_path / "docs")])
    sizes = {path.name: path.stat().st_size for path in (tmp_path / "docs").iterdir()}
    assert set(sizes) == {"psnr.png", "error_vs_time.png", "work_precision.png", "views.png", "summary.json", "run.zip"}
    assert all(1000 < size < 1_000_000 for size in sizes.values())
    assert (tmp_path / "docs" / "psnr.png").read_bytes().startswith(b"\x89PNG")
    assert str(tmp_path) not in (tmp_path / "docs" / "summary.json").read_text(encoding="utf-8")


def test_a_published_run_names_no_folder_of_the_machine(tmp_path, small):
    typed = "python -m harness run --view-set '/home/a=b/x' rel/y --out=/runs/z=1 --claim 'a - b >= 1.5 dB' --resume"
    kept = "python -m harness run --view-set x rel/y --out=z=1 --claim 'a - b >= 1.5 dB' --resume"
    assert without_folders(typed) == kept
    records = read_records(small)
    named = {**records.run.settings, "view_set": ["/home/a b/x"], "scene_file": "/home/a b/mine.xml"}
    write_published(dataclasses.replace(records, run=replace(records.run, settings=named)), tmp_path / "docs")
    unpack(tmp_path / "docs" / "run.zip", tmp_path / "out")
    for file in (tmp_path / "docs" / "summary.json", tmp_path / "out" / "records" / "run.json"):
        settings = json.loads(file.read_text(encoding="utf-8"))["settings"]
        assert (settings["view_set"], settings["scene_file"]) == (["x"], "mine.xml")


@pytest.mark.slow
def test_pages_are_built_without_torch_and_mitsuba_and_with_colour_science_for_pictures_alone(tmp_path, out):
    pictured = write_fake_run(tmp_path / "pictured", ("chair",), seeds=1, with_diverged=False)
    for shelf in SETTINGS:
        write_fake_studies(pictured, shelf)
    code = f"from reports.__main__ import main; main([{str(out)!r}]); assert 'colour' not in sys.modules\n"
    code += f"main([{str(pictured)!r}, '--publish', {str(tmp_path / 'docs')!r}])"
    assert heavy_imports_of(code) & {"torch", "mitsuba", "drjit"} == set()


def test_ctrl_c_gives_130_and_one_line(out, capsys, monkeypatch):
    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("reports.__main__.build", stopped)
    assert main([str(out)]) == 130
    said = "interrupted: every page that was written is complete; run the command again\n"
    assert capsys.readouterr().err == said


GOOD = {shelf: fake_studies(shelf, charts=shelf == "speed") for shelf in ("evidence", "stability", "speed")}
BROKEN = {shelf: fake_studies(shelf, failing=True, charts=False) for shelf in ("evidence", "stability")}
FAILED = Check("this study", None, why="no weights", owner="machine", status="fail", id="failed")


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """Return a run of a scene and a seed, which the test may change."""
    return write_fake_run(tmp_path / "run", ("chair",), seeds=1, pictures=False, with_diverged=False)


@pytest.mark.parametrize("shelf", SHELVES)
def test_a_record_without_a_run_has_only_its_page_and_is_published_with_charts(tmp_path, capsys, shelf):
    record = fake_history() if shelf == "history" else fake_studies(shelf)
    out, docs = write_fake_studies(tmp_path / "out", record), tmp_path / "docs"
    assert main([str(out), "--publish", str(docs)]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == str(out / f"{shelf}.html")
    assert names(out) == [f"{shelf}.html", SHELVES[shelf]]
    assert "report.html" not in (out / f"{shelf}.html").read_text(encoding="utf-8")
    pictures = [name for name, *_ in publishing.PICTURES[shelf]]
    assert names(docs) == sorted([SHELVES[shelf], *pictures])
    assert read_studies(docs / SHELVES[shelf]) == read_studies(out / SHELVES[shelf])
    for name in pictures:
        assert (docs / name).read_bytes().startswith(b"\x89PNG")
        assert 5_000 < (docs / name).stat().st_size < 500_000
    publishing.write_published(replace(record, studies=[]), tmp_path / "nothing")
    assert names(tmp_path / "nothing") == [SHELVES[shelf]], "an empty record has no pictures"


def test_a_failed_check_of_our_own_code_gives_3_and_is_named_and_quiet_prints_the_path_alone(tmp_path, capsys):
    named = {
        "evidence": "calibration share of real A/A comparisons that are called better or worse: 0.0810, ",
        "stability": "A2 harness: after a reload: 3.00·10⁻⁴, wanted ≤ 2·10⁻⁶",
    }
    for shelf, line in named.items():
        out = write_fake_studies(tmp_path / shelf, BROKEN[shelf])
        assert main([str(out)]) == 3
        assert capsys.readouterr().out.splitlines()[1].startswith(line)
    assert main([str(out), "--quiet"]) == 3
    assert capsys.readouterr().out == f"{out / f'{shelf}.html'}\n"


@pytest.mark.parametrize(
    ("records", "code"), [([GOOD["stability"], GOOD["evidence"], GOOD["speed"]], 0), ([BROKEN["evidence"]], 3)]
)
def test_with_a_run_both_pages_are_written_and_linked(small, records, code):
    for record in records:
        write_fake_studies(small, record)
    assert main([str(small), "--quiet"]) == code
    report = (small / "report.html").read_text(encoding="utf-8")
    for record in records:
        own = (small / f"{record.shelf}.html").read_text(encoding="utf-8")
        assert f"{record.shelf}.html" in Outline(report).links
        assert "report.html" in Outline(own).links
        assert (f'<section id="{record.shelf}">' in report) == (record.shelf != "speed")


@pytest.mark.parametrize("lost", ["records/cells", "records/run.json"])
def test_an_incomplete_run_does_not_stop_the_page(small, lost):
    for path in (small / lost).iterdir() if lost.endswith("cells") else [small / lost]:
        path.unlink()
    assert main([str(write_fake_studies(small, GOOD["stability"]))]) == 0
    assert not (small / "report.html").exists()


@pytest.mark.parametrize("content", ["{", "[]", "{}", '{"schema": 99}', "\udcff", '{"schema": 1, "studies": 3}'])
@pytest.mark.parametrize("shelf", ["evidence", "history"])
def test_a_damaged_record_gives_2_and_writes_nothing(out, capsys, shelf, content):
    (out / SHELVES[shelf]).write_bytes(content.encode("utf-8", "surrogateescape"))
    assert main([str(out)]) == 2
    caught = capsys.readouterr()
    assert caught.err.startswith(str(out / SHELVES[shelf]))
    assert len(caught.err.splitlines()) == 1
    assert not any((out / page).exists() for page in ("report.html", f"{shelf}.html"))


@pytest.mark.parametrize(
    ("shelf", "place", "value", "said"),
    [
        ("evidence", "studies.1.findings.1.difference", float("nan"), "JSON is malformed"),
        ("evidence", "studies.1.findings.1.interval", [2, 1], "has interval [2.0, 1.0], which runs backwards"),
        ("evidence", "studies.1.info.id", "calibration", "'calibration' is there twice"),
        ("evidence", "studies.0.findings.-1.rows", [["a"]], "has 3 columns but a row of 1"),
        ("evidence", "settings.smallest_of_interest", {"psnr": None}, "smallest_of_interest: Expected `float`"),
        ("evidence", "studies.0.findings.3.value", "high", "at `$.studies[0].findings[3].value`"),
        ("evidence", "studies.1.findings.1.verdict", "great", "`str` - at `$.studies[1].findings[1].verdict`"),
        ("stability", "studies.3.findings.3.status", "lost", "Invalid enum value 'lost'"),
        ("speed", "studies.2.findings.2.y", [], "series 'plain' has 4 x but 0 y"),
        ("speed", "studies.2.findings.2.low", [1.0], "series 'plain' has 4 x but 1 low"),
    ],
)
def test_an_invalid_value_is_named_with_the_remedy(tmp_path, capsys, shelf, place, value, said):
    path = write_fake_studies(tmp_path, GOOD[shelf]) / SHELVES[shelf]
    data = json.loads(path.read_text(encoding="utf-8"))
    data.pop("digest")
    *way, last = (int(part) if part.lstrip("-").isdigit() else part for part in place.split("."))
    parent = reduce(getitem, way, data)
    parent[last] = value
    path.write_text(json.dumps(data), encoding="utf-8")
    assert main([str(tmp_path)]) == 2
    told = capsys.readouterr().err
    assert told.startswith(str(path))
    assert said in told
    assert f"run `nox -s {shelf}` again" in told
    assert len(told.splitlines()) == 1


def test_a_long_record_is_published_without_its_lines(tmp_path, monkeypatch):
    monkeypatch.setattr(publishing, "LARGEST", 1_000)
    publishing.write_published(fake_studies("evidence"), tmp_path)
    assert read_studies(tmp_path / SHELVES["evidence"]) == fake_studies("evidence", charts=False)


@pytest.mark.parametrize(
    ("record", "said"),
    [
        (replace(GOOD["speed"], settings={"quick": True}), "a quick run, too rough to publish"),
        (replace(GOOD["evidence"], finished=False), "not finished"),
        (fake_serving(priorities=[FAILED]), "not finished"),
    ],
)
def test_a_quick_or_unfinished_record_is_shown_and_not_published(tmp_path, capsys, record, said):
    out = write_fake_studies(tmp_path / "out", record)
    assert main([str(out), "--publish", str(tmp_path / "docs")]) == 2
    caught = capsys.readouterr()
    assert said in caught.err
    assert len(caught.err.splitlines()) == 1
    assert not (tmp_path / "docs").exists()
    assert main([str(out)]) == 0


def test_serving_is_in_report_and_summary_or_listed_as_not_tested(small, whole, whole_page):
    without = summary(whole)
    assert without["serving"] is None
    assert any("python -m harness study serving OUT" in words for words in without["not_tested"])
    assert not any(words in whole_page for words in ('id="serving"', *(f"{shelf}.html" for shelf in SHELVES)))
    assert main([str(write_fake_studies(small, "serving"))]) == 0
    report = (small / "report.html").read_text(encoding="utf-8")
    for words in ('<section id="serving"', "Rendering takes 3000 times as long", "more &lt;b&gt;steps"):
        assert words in report
    told = json.loads((small / "summary.json").read_text(encoding="utf-8"))
    hit = next(check for check in told["serving"] if check["id"] == "hit.memory.0.nerf")
    assert (hit["study"], hit["value"]) == ("latency", 3000.0)
    assert not any("serving" in words for words in told["not_tested"])
