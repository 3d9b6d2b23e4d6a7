"""`python -m harness judge` as a user types it, the record that it leaves, and the page made from that."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from harness.command.main import main
from harness.records.judgements import JUDGEMENT_FILE, JudgementRecord, read_judgement, write_judgement
from harness.verdicts.judging.judgement import judge
from harness.verdicts.judging.printed import write_tables
from harness.verdicts.tables.result_table import read_table
from reports.__main__ import main as report
from reports.studies.judgement import judgement_page, matrix, methods_grid, panel, suspects_grid
from scenes.files.errors import DamagedRecord
from tests.harness.shell import refused
from tests.harness.verdicts.test_judgement import collapsed, drawn, table_of
from tests.replacing import replace


def table_file(folder: Path, values: np.ndarray) -> Path:
    path = folder / "t.csv"
    rows = [f"s{j},m{i},{value:.4f}\n" for (i, j), value in np.ndenumerate(values)]
    path.write_text("scene,method,psnr\n" + "".join(rows))
    return path


@pytest.fixture
def record() -> JudgementRecord:
    return replace(judge(table_of(collapsed()), None, None), digests={"t.csv": "0" * 64})


def test_a_table_gives_a_table_a_record_and_a_page(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = table_file(tmp_path, collapsed())
    assert main(["judge", str(path), "--out", str(tmp_path / "out")]) == 0
    said = capfd.readouterr().out.splitlines()
    assert said[0] == "Read as 5 methods × 8 scenes, psnr ↑."
    assert said[1].startswith("5 methods on 8 scenes: ")
    assert said[3].split()[0] == "m4"
    assert any(line.startswith("suspect: m2 on s6: ") for line in said)
    assert said[-1] == str(tmp_path / "out" / "judgement.html")
    suffixes = ("csv", "html", JUDGEMENT_FILE.partition(".")[2], "md", "tex")
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == [f"judgement.{each}" for each in suffixes]
    page = (tmp_path / "out" / "judgement.html").read_text(encoding="utf-8")
    assert re.findall(r'(?:src|href)="(?!#|data:)[^"]+"', page) == []
    assert "default-src &#39;none&#39;" in page


def test_metrics_are_judged_each_by_itself_on_one_page(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    values = drawn(0, methods=3, effect=1.0)
    path = tmp_path / "t.csv"
    lines = [f"s{j},m{i},{v:.4f},{-v / 100:.4f},paper\n" for (i, j), v in np.ndenumerate(values)]
    path.write_text("scene,method,psnr,lpips loss,source\n" + "".join(lines).replace(",-", ","))
    assert main(["judge", str(path), "--metric", "psnr", "lpips loss", "--out", str(tmp_path / "out")]) == 0
    said = capfd.readouterr().out
    assert "psnr ↑.\n" in said
    assert "lpips loss ↓.\n" in said
    assert "not judged here" not in said
    both = read_judgement(tmp_path / "out" / JUDGEMENT_FILE)
    (other,) = both.other_metrics
    assert other.given == judge(read_table([path], "lpips loss"), None, None).given
    assert [place.origin for place in both.given.places] == ["paper"] * 3
    page = (tmp_path / "out" / "judgement.html").read_text(encoding="utf-8")
    assert 'id="metric-2"' in page
    assert (tmp_path / "out" / "judgement.lpips_loss.tex").is_file()
    alike = [replace(other, metric=name) for name in ("f@1", "f%1")]
    write_tables(tmp_path, replace(both, other_metrics=alike))
    assert {file.name for file in tmp_path.glob("judgement*.csv")} == {
        f"judgement{name}.csv" for name in ("", ".f_1", ".f_1.2")
    }
    wrong = refused(capfd, path, "--metric", "psnr", "lpips loss", "--margin", "1", command="judge")
    assert "--margin 1.0: has the unit of one metric" in wrong


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("", "no such file; give a table as CSV, Markdown, LaTeX, Parquet or JSON"),
        ("--metric ssim", "--metric ssim: no such column; metrics of the table: psnr"),
        ("--baseline nerf", "--baseline nerf: no such method"),
        ("--methods m0 m1 --baseline m2", "--baseline m2: is not among --methods m0 m1; add it to them"),
    ],
)
def test_what_cannot_be_judged_is_said_in_a_line(
    options: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = table_file(tmp_path, collapsed()) if options else tmp_path / "t.csv"
    assert said in refused(capsys, path, *options.split(), "--out", tmp_path / "out", command="judge")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("change", [{"schema": 9}, {"given": {}}, {"margin": "much"}, {"suspects": 3}, {"more": 1}])
def test_a_damaged_record_is_refused(change: dict, tmp_path: Path, record: JudgementRecord) -> None:
    path = tmp_path / JUDGEMENT_FILE
    write_judgement(path, record)
    data = json.loads(path.read_text())
    del data["digest"]
    path.write_text(json.dumps(data | change))
    with pytest.raises(DamagedRecord, match="run `python -m harness judge` again"):
        read_judgement(path)
    assert report([str(tmp_path)]) == 2
    assert not (tmp_path / "judgement.html").exists()


def test_the_page_shows_every_method_pair_and_suspect(record: JudgementRecord) -> None:
    page = judgement_page(record)
    assert page.count('title="m') == 5 * 4
    assert all(page.count(f'<span class="turned">m{number}</span>') == 1 for number in range(5))
    assert [row[0].text for row in methods_grid(record, record.given, "").rows] == ["m4", "m3", "m1", "m0", "m2"]
    assert [row[0].text for row in suspects_grid(record).rows] == ["m2 on s6"]
    squares = matrix(record)
    marks = [[square.mark for square in row] for _, row in squares]
    turned = str.maketrans("▲▼", "▼▲")
    assert all(marks[a][b] == marks[b][a].translate(turned) for a in range(5) for b in range(5))
    assert any("▲" in mark for row in marks for mark in row)
    assert "Without the suspect results" in page


def test_a_picture_leaves_out_what_would_have_its_axis_to_itself(record: JudgementRecord) -> None:
    values = drawn(0, methods=8)
    values[3] -= 25
    limits = panel(judge(table_of(values), None, None)).x_limits
    assert limits
    assert limits[0] > values[3].mean()
    assert panel(record).x_limits is None
    rows = panel(judge(table_of(values), None, None)).rows
    assert rows[7] == f"m3 ({values[3].mean():.2f})"


def test_against_a_baseline_the_page_has_no_groups_and_no_matrix() -> None:
    result = judge(table_of(drawn(0, effect=0.5)), None, "m0")
    page = judgement_page(result)
    assert 'id="pairs"' not in page
    assert "minus m0" in page
    assert "groups" not in [column.label for column in methods_grid(result, result.given, "").columns]


def test_names_from_a_table_run_nothing() -> None:
    hostile = "<script>alert(1)</script>"
    table = table_of(drawn(0, methods=3))
    table.methods[0] = table.scenes[0] = hostile
    record = replace(judge(table, None, None), digests={hostile: hostile})
    assert hostile not in judgement_page(record)
