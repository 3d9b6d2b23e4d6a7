"""All of the machinery, as a user types it: the smoke profile rendered, trained, scored and reported, twice."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from harness.records import read_cells

ROOT = Path(__file__).parents[2]


def typed(words: str, cwd: Path) -> str:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    ran = subprocess.run(
        [sys.executable, "-m", *words.split()], cwd=cwd, env=environment, capture_output=True, text=True
    )
    assert ran.returncode == 0, ran.stderr
    assert "Traceback" not in ran.stderr
    return ran.stdout


@pytest.mark.slow
def test_the_smoke_profile_from_end_to_end(tmp_path: Path) -> None:
    said = typed("harness run --profile smoke --no-serving", tmp_path)
    assert "12 done" in said
    first = (tmp_path / "out" / "latest").resolve()
    page = typed("reports out/latest", tmp_path).splitlines()[-1]
    assert Path(page).name == "report.html"
    html = (first / "report.html").read_text(encoding="utf-8")
    for name in ("nerf_matched", "qnerf", "hotdog", "lego"):
        assert name in html
    assert "http://" not in html.replace("http://www.w3.org", ""), "the page works offline"
    summary = json.loads((first / "summary.json").read_text(encoding="utf-8"))
    assert [cell["status"] for cell in summary["cells"]] == ["done"] * 12
    scores = summary["cells"][0]
    measured = ("psnr", "ssim", "flip", "delta_e", "rmse_linear", "depth_rmse", "opacity_iou", "psnr_train")
    assert {name for name in (*measured, "psnr_ceiling") if scores[name] is None} == set()
    assert {row["scene"] for row in summary["comparisons"]} == {"hotdog", "lego", "all"}
    assert {(row["method"], row["against"]) for row in summary["comparisons"]} == {
        ("nerf_matched", "nerf"),
        ("qnerf", "nerf"),
        ("qnerf", "nerf_matched"),
    }

    rendered = {file: file.stat().st_mtime_ns for file in (tmp_path / "out" / "view_sets").rglob("*.exr")}
    assert len(rendered) == 2 * 27
    typed("harness run --profile smoke --quiet --scenes lego --methods nerf qnerf --no-serving", tmp_path)
    second = (tmp_path / "out" / "latest").resolve()
    assert second != first
    assert {file: file.stat().st_mtime_ns for file in rendered} == rendered, "the view sets came from the cache"
    trained = {(cell.scene, cell.method, cell.seed): cell for cell in read_cells(first)}
    again = {(cell.scene, cell.method, cell.seed): cell for cell in read_cells(second)}
    assert set(again) == {("lego", method, seed) for method in ("nerf", "qnerf") for seed in (0, 1)}
    for cell, after in again.items():
        before = trained[cell]
        assert before.scores == after.scores
        assert [point.psnr for point in before.curve] == [point.psnr for point in after.curve]
