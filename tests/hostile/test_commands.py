"""Commands given what they cannot use: exit code 2, one line that names the file, the value and the remedy, and what
was there stays. A table for each kind: tables of results, folders of runs, and options.
"""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from harness.command.main import main as harness
from reports.__main__ import main as reports
from scenes.__main__ import main as scenes
from tests.harness.ball import write_ball
from tests.reports.fake_run import write_fake_run

PROGRAMS: dict[str, Callable[[list[str]], int]] = {"harness": harness, "reports": reports, "scenes": scenes}
ROWS = [(scene, method, seed) for scene in "xyz" for method in "ab" for seed in range(3)]
TABLE = "scene,method,seed,psnr\n" + "".join(f"{s},{m},{k},{20 + ord(s) % 5 + k / 10}\n" for s, m, k in ROWS)


def refusal(capsys: pytest.CaptureFixture[str], program: str, *words: str | Path) -> str:
    assert PROGRAMS[program]([str(word) for word in words]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1, said
    assert said.rstrip("\n").isprintable()
    return said


def cut(line: int) -> str:
    return "\n".join(TABLE.splitlines()[:line]) + "\n"


TABLES: dict[str, tuple[str | bytes, str]] = {
    "nothing": ("", "has no column scene and no column method"),
    "a head alone": (cut(1), "has a head and no rows"),
    "one row": (cut(2), "has 1 method with results; a comparison needs two"),
    "one method": ("\n".join(row for row in TABLE.splitlines() if ",b," not in row), "a comparison needs two"),
    "decimal commas": (TABLE.replace(",", ";").replace(".", ","), "line 2: psnr is '20,0', no finite number"),
    "UTF-16": (TABLE.encode("utf-16"), "is no CSV file in UTF-8"),
    "bytes": (bytes(range(256)), "is no CSV file in UTF-8"),
    "a page": ("<html></html>", "has no column scene and no column method (columns: <html></html>)"),
    "each row twice": (TABLE + TABLE.split("\n", 1)[1], "line 20: repeats scene, method and seed of"),
    "another name for methods": (TABLE.replace("method", "who"), "has no column method"),
    "a word for a score": (TABLE.replace("20.0", "n/a", 1), "psnr is 'n/a', no finite number"),
    "NaN": (TABLE.replace("20.0", "nan", 1), "psnr is 'nan', no finite number"),
    "infinity": (TABLE.replace("20.0", "inf", 1), "psnr is 'inf', no finite number"),
    "1e308": (TABLE.replace("20.0", "1e308", 1), "psnr is '1e308', no finite number"),
    "a score below any": (TABLE.replace("20.0", "-5", 1), "psnr is -5, and lies between 0 and 400"),
    "a similarity of 20": (TABLE.replace("psnr", "ssim"), "ssim is 20, and lies between -1 and 1"),
    "per cent": (TABLE.replace("20.0", "20%", 1), "psnr is '20%', no finite number"),
    "units": (TABLE.replace("20.0", "20 dB", 1), "psnr is '20 dB', no finite number"),
    "a short row": (TABLE + "x,a\n", "line 20: has 2 fields, the head has 4"),
    "a long row": (TABLE + "x,a,9,20,30,40\n", "line 20: has 6 fields, the head has 4"),
    "a quote that never ends": (TABLE + '"x,a,9,20\n', "line 20: has 1 fields, the head has 4"),
    "a field without an end": (TABLE + "x" * 200_000 + ",a,0,1\n", "is no CSV file in UTF-8 (field larger"),
    "a column twice": (TABLE.replace("psnr", "psnr,psnr"), "has 4 fields, the head has 5"),
}


@pytest.mark.parametrize("name", TABLES)
def test_a_table_that_cannot_be_judged(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content, said = TABLES[name]
    table, out = tmp_path / "table.csv", tmp_path / "out"
    table.write_bytes(content if isinstance(content, bytes) else content.encode())
    assert said in (line := refusal(capsys, "harness", "judge", table, "--out", out))
    assert str(table) in line
    assert not out.exists()


READ: dict[str, str] = {
    "a byte order mark": "\ufeff" + TABLE,
    "semicolons": TABLE.replace(",", ";"),
    "tabs": TABLE.replace(",", "\t"),
    "spaces": TABLE.replace(",", " , "),
    "seeds by name": TABLE.replace(",0,", ",first,"),
    "a formula": TABLE.replace("x,", "=cmd|'/C calc'!A0,"),
    "right to left": TABLE.replace("x,", "x\u202e,"),
    "a name of two lines": TABLE.replace("x,", '"x\ny",'),
    "pairs that are missing": "\n".join(row for row in TABLE.splitlines() if not row.startswith("z,b")),
}


@pytest.mark.parametrize("name", READ)
def test_a_table_as_programs_write_it(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from harness.verdicts.judging.judgement import judge, lines
    from harness.verdicts.judging.result_table import read_table

    table = tmp_path / "table.csv"
    table.write_text(READ[name], encoding="utf-8")
    found = read_table([table])
    assert (len(found.methods), len(found.scenes)) == (2, 3)
    assert lines(judge(found, None, None, {}))


def edited(file: str, **changes: Any) -> Callable[[Path], Any]:
    def change(out: Path) -> None:
        data = json.loads((out / file).read_text(encoding="utf-8"))
        (out / file).write_text(json.dumps(data | changes), encoding="utf-8")

    return change


def replaced(file: str, make: Callable[[Path], Any]) -> Callable[[Path], Any]:
    def change(out: Path) -> None:
        path = out / file
        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
        make(path)

    return change


CELL, OTHER = "records/cells/chair.nerf.0.json", "records/cells/chair.nerf.1.json"
BY_HAND = "its digest does not match its content"
RUNS: dict[str, tuple[Callable[[Path], Any], str, bool]] = {
    "no record of the run": (replaced("records/run.json", lambda path: None), "run.json: missing", False),
    "an empty one": (replaced("records/run.json", Path.touch), "run.json: Input data was truncated", False),
    "no cells": (replaced("records/cells", Path.mkdir), "no finished cell yet", False),
    "records that are a file": (replaced("records", Path.touch), "give the output folder of a run", False),
    "records that are themselves": (replaced("records", lambda path: path.symlink_to(path)), "give the output", False),
    "half a cell": (replaced(CELL, lambda path: path.write_text('{"scene": "cha')), "chair.nerf.0.json: ", True),
    "an empty cell": (replaced(CELL, Path.touch), "Input data was truncated", True),
    "a cell that is a folder": (replaced(CELL, Path.mkdir), "is no file", True),
    "a cell that is a pipe": (replaced(CELL, os.mkfifo), "is no file", True),
    "a cell in another's place": (
        lambda out: shutil.copy(out / CELL, out / OTHER),
        "chair.nerf.1.json: is the record of chair.nerf.0.json",
        True,
    ),
    "a cell of another machine's scene": (
        lambda out: shutil.copy(out / CELL, out / "records/cells/lego.nerf.0.json"),
        "lego.nerf.0.json: is the record of chair.nerf.0.json",
        True,
    ),
    "a cell of nothing": (lambda out: (out / "records/cells/zebra.nerf.0.json").write_text("{}"), "schema None", True),
    "a score by hand": (edited(CELL, scores={"psnr": 99.0}), BY_HAND, True),
    "another version": (edited(CELL, schema=99), BY_HAND, True),
    "a key more": (edited(CELL, hello=1), BY_HAND, True),
    "a verdict by hand": (edited("records/comparisons.json", rows=[]), BY_HAND, True),
}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_fake_run(tmp_path_factory.mktemp("fake") / "run", scenes=("chair",), seeds=2, pictures=False)


@pytest.mark.parametrize("name", RUNS)
def test_a_run_that_is_damaged(name: str, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spoil, said, partly = RUNS[name]
    out = shutil.copytree(run, tmp_path / "run")
    spoil(out)
    assert said in refusal(capsys, "reports", out)
    assert not (out / "report.html").exists()
    if partly:
        from reports.data.load import read_records

        assert read_records(out, partly=True).left_out


def test_what_other_systems_leave_is_no_damage(run: Path, tmp_path: Path) -> None:
    from reports.data.load import read_records

    out = shutil.copytree(run, tmp_path / "run")
    for name in ("._chair.nerf.0.json", ".DS_Store"):
        (out / "records/cells" / name).write_bytes(b"\0\5\x16\7")
    assert len(read_records(out).cells) == 6


SCORE = "harness score {}/set/test --view-set {}/set --method x"
OPTIONS: dict[str, tuple[str, str]] = {
    "no table": ("harness judge {}/none.csv", "no such file; give a table as CSV, Parquet or JSON"),
    "a folder without results": ("harness judge {}/empty", "{}/empty"),
    "no such metric": (
        "harness judge {}/t.csv --metric nope",
        "--metric nope: no such column",
    ),
    "no such baseline": ("harness judge {}/t.csv --baseline nope", "--baseline nope: no such method"),
    "no such lower one": ("harness judge {}/t.csv --lower nope", "--lower nope: no such column"),
    "a margin below 0": ("harness judge {}/t.csv --margin -1", "--margin -1.0: must be 0 or more"),
    "a margin of nothing": ("harness judge {}/t.csv --margin nan", "--margin nan: must be 0 or more"),
    "a file for a folder": ("harness judge {}/t.csv --out {}/t.csv", "t.csv: is a file; name a folder"),
    "a device for a folder": ("harness judge {}/t.csv --out /dev/null", "/dev/null: is a file; name a folder"),
    "no run to compare": ("harness compare {}/run {}/none", "none: no run in it"),
    "no history": ("harness history {}/none.jsonl --out {}/h", "no such file; `python -m harness gate`"),
    "a history of nonsense": ("harness history {}/t.csv --out {}/h", "name a file that gate or speed appended to"),
    "no run for a board": ("harness tensorboard {}/none", "holds no cell of a run"),
    "no run to look at": ("harness view {}/none --no-browser", "holds no run; give the output folder of one"),
    "no such port": ("harness view {}/run --port 99999", "--port 99999: must lie between 0 and 65535"),
    "no frames": ("harness render {}/run --frames 0", "--frames 0: must lie between 1 and 10000"),
    "no pixels": ("harness render {}/run --resolution 0", "--resolution 0: must lie between 1 and 4096"),
    "a film that stands": ("harness render {}/run --fps 0", "--fps 0: must lie between 1 and 60"),
    "an orbit overhead": ("harness render {}/run --elevation 900", "--elevation 900: must lie between -90 and 90"),
    "no pictures": (
        "harness score {}/none --view-set {}/set --method x",
        "is no folder; give the one with",
    ),
    "an empty folder": ("harness score {}/empty --view-set {}/set --method x", "has no picture; name one folder"),
    "pictures of nothing": (
        "harness score {}/set/test --view-set {}/none --method x",
        "none: no such folder; a view",
    ),
    "a seed below 0": (
        f"{SCORE} --seed -1",
        "--seed -1: must lie between",
    ),
    "no time": (f"{SCORE} --seconds nan", "--seconds nan: must lie"),
    "a table that is a folder": (f"{SCORE} --to {{}}/empty", "is no file"),
    "no such study": ("harness evidence --studies nope --out {}/e", "--studies: unknown 'nope'; known: calibration"),
    "no such case": ("harness stability --cases Z9 --out {}/s", "unknown 'Z9'; known: Q1 Q2"),
    "a study in a file": ("harness evidence --studies ceilings --quick --out {}/t.csv", "--out {}/t.csv"),
    "a pick of nothing": ("harness frontier --pick lego --out {}/none", "name a file that `nox -s frontier` wrote"),
    "a budget below 0": ("harness frontier --budgets -1 --out {}/f", "--budgets -1: must lie between 0.1 and 1e6"),
    "a budget of nothing": ("harness frontier --budgets nan --out {}/f", "--budgets nan: must lie between"),
    "no such family": ("harness frontier --methods nope --out {}/f", "--methods: unknown 'nope'; known: nerf"),
    "no such method": ("harness conformance nope", "unknown 'nope'; known: nerf"),
    "no such gate": ("harness gate --only nope --out {}/g", "no gate's name begins with 'nope'"),
    "no limits": ("harness gate --limits {}/none --out {}/g", "there is no such file; get it back"),
    "a rank of nothing": ("harness gate --rank {}/none --out {}/g", "no summary of a finished run"),
    "no such folder": ("reports {}/none", "no such folder; give the output folder of a run"),
    "a file": ("reports {}/t.csv", "no such folder; give the output folder of a run"),
    "one run twice": ("reports {}/run {}/run", "named twice; name each output once"),
    "figures of two": ("reports {}/run {}/run-2 --export {}/x.zip", "--export: goes with one output alone"),
    "a page of one": ("reports {}/run --page {}/x.html", "--page: goes with several outputs alone"),
    "no such scene": ("scenes render teapot", "teapot"),
    "views of no pixels": ("scenes render lego --resolution 0", "--resolution 0: choose 1 to 4096 pixels"),
    "no scene file": ("scenes render --scene-file {}/no.py", "--scene-file {}/no.py: no such file"),
    "an export of nothing": (
        "scenes export {}/none --format npz --out {}/x.npz",
        "none: no such folder; a view set is",
    ),
    "an export onto itself": (
        "scenes export {}/set --format blender --out {}/set",
        "is there already; name a new folder",
    ),
}


@pytest.fixture(scope="module")
def place(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("place")
    for name in ("run", "run-2"):
        shutil.copytree(run, folder / name)
    write_ball(folder / "set")
    (folder / "empty").mkdir()
    (folder / "t.csv").write_text(TABLE, encoding="utf-8")
    return folder


@pytest.mark.parametrize("name", OPTIONS)
def test_an_option_that_cannot_be(
    name: str, place: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(place)
    typed, said = (text.replace("{}", str(place)) for text in OPTIONS[name])
    before = sorted(path for path in place.rglob("*") if "." not in path.name[:1])
    assert said in refusal(capsys, *typed.split())
    assert sorted(path for path in place.rglob("*") if "." not in path.name[:1]) == before, "nothing was written"
