"""Commands with unusable input: exit code 2, one line that names the file, the value and the remedy, and no change on
disk. The tests of each reader try further tables, records and options.
"""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from harness.command.main import main as harness
from harness.verdicts.judging.judgement import judge, lines
from harness.verdicts.tables.result_table import read_table
from reports.__main__ import main as reports
from reports.data.load import read_records
from scenes.__main__ import main as scenes
from tests.harness.ball import write_ball
from tests.reports.fake_run import write_fake_run

PROGRAMS: dict[str, Callable[[list[str]], int]] = {"harness": harness, "reports": reports, "scenes": scenes}
ROWS = [(scene, method, seed) for scene in "xyz" for method in "ab" for seed in range(3)]
TABLE = "scene,method,seed,psnr\n" + "".join(f"{s},{m},{k},{20 + ord(s) % 5 + k / 10}\n" for s, m, k in ROWS)


def refusal(capsys: pytest.CaptureFixture[str], program: str, *words: str | Path) -> str:
    assert PROGRAMS[program]([str(word) for word in words]) == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1, line
    assert line.rstrip("\n").isprintable()
    return line


TABLES: dict[str, tuple[str | bytes, str]] = {
    "UTF-16 without its mark": (TABLE.encode("utf-16")[2:], "is not text"),
    "a page": ("<html></html>", "is a page or a drawn table; save the table as CSV"),
    "a score below any": (TABLE.replace("20.0", "-5", 1), "psnr is -5, but lies between 0 and 400"),
    "a similarity of 20": (TABLE.replace("psnr", "ssim"), "ssim is 20, but lies between -1 and 1"),
    "a quote that never ends": (TABLE + '"x,a,9,20\n', "line 20: has 1 fields, the header has 4"),
    "a field without an end": (TABLE + "x" * 200_000 + ",a,0,1\n", "is not a CSV file (field larger"),
}


@pytest.mark.parametrize("name", TABLES)
def test_a_table_that_cannot_be_judged(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content, message = TABLES[name]
    table, out = tmp_path / "table.csv", tmp_path / "out"
    table.write_bytes(content if isinstance(content, bytes) else content.encode())
    assert message in (line := refusal(capsys, "harness", "judge", table, "--out", out))
    assert str(table) in line
    assert not out.exists()


READ: dict[str, str] = {
    "a byte order mark": "\ufeff" + TABLE,
    "tabs": TABLE.replace(",", "\t"),
    "spaces": TABLE.replace(",", " , "),
    "seeds by name": TABLE.replace(",0,", ",first,"),
    "a formula": TABLE.replace("x,", "=cmd|'/C calc'!A0,"),
    "right to left": TABLE.replace("x,", "x\u202e,"),
    "a name of two lines": TABLE.replace("x,", '"x\ny",'),
    "pairs that are missing": "\n".join(row for row in TABLE.splitlines() if not row.startswith("z,b")),
}


@pytest.mark.parametrize("name", READ)
def test_a_table_as_programs_write_it(name: str, tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    table.write_text(READ[name], encoding="utf-8")
    results = read_table([table])
    assert (len(results.methods), len(results.scenes)) == (2, 3)
    assert lines(judge(results, None, None))


def replaced(file: str, make: Callable[[Path], Any]) -> Callable[[Path], Any]:
    def change(out: Path) -> None:
        path = out / file
        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
        make(path)

    return change


def by_hand(out: Path) -> None:
    file = out / "records/comparisons.json"
    file.write_text(json.dumps(json.loads(file.read_text(encoding="utf-8")) | {"rows": []}), encoding="utf-8")


CELL, OTHER = "records/cells/chair.nerf.0.json", "records/cells/chair.nerf.1.json"
RUNS: dict[str, tuple[Callable[[Path], Any], str, bool]] = {
    "an empty run record": (replaced("records/run.json", Path.touch), "run.json: Input data was truncated", False),
    "records that are a file": (replaced("records", Path.touch), "give the output folder of a run", False),
    "records that are themselves": (replaced("records", lambda path: path.symlink_to(path)), "give the output", False),
    "a cell that is a folder": (replaced(CELL, Path.mkdir), "is not a file", True),
    "a cell that is a pipe": (replaced(CELL, os.mkfifo), "is not a file", True),
    "a cell in another's place": (lambda out: shutil.copy(out / CELL, out / OTHER),
                                  "chair.nerf.1.json: is the record of chair.nerf.0.json", True),
    "a cell of nothing": (lambda out: (out / "records/cells/zebra.nerf.0.json").write_text("{}"), "schema None", True),
    "a verdict by hand": (by_hand, "its digest does not match its content", True),
}  # fmt: skip
"""How to damage a run, the message, and whether `--partial` shows the rest."""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with two runs, a view set, a table and an empty folder."""
    folder = tmp_path_factory.mktemp("place")
    write_fake_run(folder / "run", scenes=("chair",), seeds=2, pictures=False)
    shutil.copytree(folder / "run", folder / "run-2")
    write_ball(folder / "set")
    (folder / "empty").mkdir()
    (folder / "t.csv").write_text(TABLE, encoding="utf-8")
    return folder


@pytest.mark.parametrize("name", RUNS)
def test_a_run_that_is_damaged(name: str, place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spoil, message, partly = RUNS[name]
    out = shutil.copytree(place / "run", tmp_path / "run")
    spoil(out)
    assert message in refusal(capsys, "reports", out)
    assert not (out / "report.html").exists()
    if partly:
        assert read_records(out, partly=True).left_out


SCORE = "harness score {}/set/test --view-set {}/set --method x"
OPTIONS: dict[str, tuple[str, str]] = {
    "a folder without results": ("harness judge {}/empty", "{}/empty"),
    "no such lower one": ("harness judge {}/t.csv --lower nope", "--lower nope: no such column"),
    "a margin below 0": ("harness judge {}/t.csv --margin -1", "--margin -1.0: must be 0 or more"),
    "a device for a folder": ("harness judge {}/t.csv --out /dev/null", "/dev/null: is a file; name a folder"),
    "no run to compare": ("harness compare {}/run {}/none", "none: no run in it"),
    "no history": ("harness history {}/none.jsonl --out {}/h", "no such file; `python -m harness gate`"),
    "a history of nonsense": ("harness history {}/t.csv --out {}/h", "name a file that gate or speed appended to"),
    "no run for a board": ("harness tensorboard {}/none", "holds no cell of a run"),
    "no pictures": ("harness score {}/none --view-set {}/set --method x", "is not a folder; give the one with"),
    "an empty folder": ("harness score {}/empty --view-set {}/set --method x", "has no picture; name one folder"),
    "pictures of nothing": ("harness score {}/set/test --view-set {}/none --method x", "none: no such folder; a view"),
    "a seed below 0": (f"{SCORE} --seed -1", "--seed -1: must lie between"),
    "no time": (f"{SCORE} --seconds nan", "--seconds nan: must lie"),
    "a table that is a folder": (f"{SCORE} --to {{}}/empty", "is not a file"),
    "no such study": ("harness evidence --studies nope --out {}/e", "--studies: unknown 'nope'; known: calibration"),
    "no such case": ("harness stability --cases Z9 --out {}/s", "unknown 'Z9'; known: Q1 Q2"),
    "a study in a file": ("harness evidence --studies ceilings --quick --out {}/t.csv", "--out {}/t.csv"),
    "a pick of nothing": ("harness frontier --pick lego --out {}/none", "name a file that `nox -s frontier` wrote"),
    "a budget below 0": (
        "harness frontier --budgets -1 --out {}/f",
        "--budgets -1: must lie between 0.1 and 1e6 core seconds",
    ),
    "a budget of nothing": ("harness frontier --budgets nan --out {}/f", "--budgets nan: must lie between"),
    "no such family": ("harness frontier --methods nope --out {}/f", "--methods: unknown 'nope'; known: nerf"),
    "no such method": ("harness conformance nope", "unknown 'nope'; known: nerf"),
    "a file": ("reports {}/t.csv", "no such folder; give the output folder of a run"),
    "figures of two": ("reports {}/run {}/run-2 --export {}/x.zip", "--export: works with only one output"),
    "a page of one": ("reports {}/run --page {}/x.html", "--page: needs several outputs"),
    "no such scene": ("scenes render teapot", "teapot"),
    "views of no pixels": ("scenes render lego --resolution 0", "--resolution 0: choose 1 to 4096 pixels"),
    "no scene file": ("scenes render --scene-file {}/no.py", "--scene-file {}/no.py: no such file"),
    "an export of nothing": ("scenes export {}/none --format npz --out {}/x.npz", "none: no such folder; a view set"),
    "an export onto itself": ("scenes export {}/set --format blender --out {}/set", "exists already; name a new"),
}


@pytest.mark.parametrize("name", OPTIONS)
def test_an_option_that_cannot_be(
    name: str, place: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(place)
    typed, message = (text.replace("{}", str(place)) for text in OPTIONS[name])
    before = sorted(path for path in place.rglob("*") if "." not in path.name[:1])
    assert message in refusal(capsys, *typed.split())
    assert sorted(path for path in place.rglob("*") if "." not in path.name[:1]) == before, "nothing was written"
