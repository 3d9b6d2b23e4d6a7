"""docs/add-a-metric.md: its pieces of code, inserted where it says, add a metric; docs/add-a-study.md has a study."""

import importlib.util
import re
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from harness.command.main import main
from harness.records.study import read_studies
from harness.studies.evidence.evidence_studies import STUDIES
from harness.studies.framework import Shelf, asking
from reports.__main__ import main as report

ROOT = Path(__file__).parents[2]
USE = """
import sys
from pathlib import Path
import numpy as np
from msgspec.structs import replace
from harness.records.cells import read_cell, write_cell
from harness.training.scoring.evaluate import View, mean_scores, view_scores
from harness.verdicts.comparisons import compare
from harness.verdicts.tables.result_table import LOWER, MARGINS
from reports.data.load import read_records
from reports.run.curves import diagrams
from reports.run.run_page import page
from scenes.view_sets.view_set import Split
from tests.reports.fake_run import write_fake_run

rgba = np.ones((1, 12, 12, 4), dtype=np.float32)
truth = Split(("r_0",), np.eye(4)[None], rgba)
view = View(rgba[0, ..., :3] - 0.25, rgba[0, ..., 3], rgba[0, ..., 3])
assert view_scores(view, truth, 0).mae == mean_scores([view_scores(view, truth, 0)])["mae"] == 0.25

def scored(cell):
    scores = cell.scores if cell.status != "done" else {**cell.scores, "mae": 0.125}
    return replace(cell, scores=scores, curve=[replace(point, mae=0.125) for point in cell.curve])

out = write_fake_run(Path(sys.argv[1]), ("chair",), seeds=5, pictures=False, with_diverged=False, change_cell=scored)
records = read_records(out)
rows = [row for row in compare(records.cells, records.methods) if row.metric == "mae"]
assert {row.budget for row in rows} == {"steps", "core_seconds"}
assert {row.verdict.size for row in rows} == {"smaller than matters"}
assert "mae" in LOWER and MARGINS["mae"] == 0.002
assert "mae" in {panel.measure.name for panel in diagrams(records)}
text = page(records)
assert "MAE ↓" in text and "0.1250" in text and "mean absolute difference of display colour" in text
"""


@pytest.mark.slow
def test_a_metric_is_a_function_a_line_and_a_field(tmp_path: Path) -> None:
    for package in ("harness", "reports", "scenes", "baselines"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "tests").symlink_to(ROOT / "tests")
    text = (ROOT / "docs/add-a-metric.md").read_text(encoding="utf-8")
    function, line, field = (textwrap.dedent(code) for code in re.findall(r"```python\n(.*?)```", text, re.DOTALL))
    metrics = tmp_path / "harness/training/scoring/metrics.py"
    metrics.write_text(f"{metrics.read_text(encoding='utf-8')}\n\n{function}", encoding="utf-8")
    table = tmp_path / "harness/records/metric_table.py"
    before, after = table.read_text(encoding="utf-8").split("    )\n}  # fmt: skip")
    table.write_text(f"{before}        {line.strip()},\n    )\n}}  # fmt: skip{after}", encoding="utf-8")
    cells = tmp_path / "harness/records/cells.py"
    before, after = cells.read_text(encoding="utf-8").split("    lpips: float | None = None\n")
    cells.write_text(f"{before}    lpips: float | None = None\n    {field}{after}", encoding="utf-8")
    ended = subprocess.run(
        [sys.executable, "-c", USE, str(tmp_path / "run")], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, ended.stderr


def test_the_example_runs_by_its_line_and_has_a_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (ROOT / "docs/add-a-study.md").read_text(encoding="utf-8")
    line = re.search(r"```python\n(asking\(.*?\))\n```", text, re.DOTALL)
    study = eval(line[1], {"asking": asking})
    file, _, function = study.measure.partition(":")
    spec = importlib.util.spec_from_file_location(file, ROOT / "docs/examples" / f"{file}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setitem(STUDIES, study.info.id, study)
    monkeypatch.setattr(Shelf, "measure_of", lambda shelf, name: getattr(module, function))
    out = tmp_path / "mine"
    assert main(["evidence", "--quiet", "--studies", study.info.id, "--out", str(out)]) == 0
    (record,) = read_studies(out / "evidence.json").studies
    assert (record.info.question, len(record.answers), len(record.series)) == (study.info.question, 1, 2)
    assert [(check.status, check.value is not None) for check in record.checks] == [("pass", True)]
    assert report([str(out), "--quiet"]) == 0
    page = (out / "evidence.html").read_text(encoding="utf-8")
    assert study.info.question in page
    assert record.answers[0] in page
