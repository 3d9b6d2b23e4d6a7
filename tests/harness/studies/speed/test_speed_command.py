"""`python -m harness study speed`: every question, at sizes at which no figure means anything."""

import json
import sys
from pathlib import Path

import pytest

from harness.command.main import main
from harness.records.study import Check, read_studies


def answers(out: Path, *items: int) -> dict[str, Check]:
    options = ["speed", "--quick", "--quiet", "--studies", *map(str, items), "--out", str(out)]
    assert main(options) == 0
    record = read_studies(out / "speed.json")
    assert [study.info.id for study in record.studies] == [str(item) for item in items]
    checks = {check.id: check for _, check in record.checks()}
    assert len(checks) == len(list(record.checks())), "every id is unique"
    assert all(check.value is not None or check.why for check in checks.values())
    json.dumps(json.loads((out / "speed.json").read_text()), allow_nan=False)
    assert [file.name for file in out.iterdir()] == ["speed.json"], "nothing is left behind"
    return checks


@pytest.mark.slow
@pytest.mark.thorough
def test_every_question_inside_the_process_is_answered(tmp_path: Path) -> None:
    checks = answers(tmp_path / "speed", 1, 2, 3, 4, 5, 6, 11)
    for id in (
        "training.dense.ratio",
        "matrix.paper.share",
        "matrix.reduced.share",
        "target.same.ratio",
        "target.reduced.ratio",
        "rendering.reduced.ratio",
        "encoding.phi.10.ratio",
        "quadrature.autograd.ratio",
        "accelerations.grid.step.ratio",
        "accelerations.none.view.ratio",
    ):
        assert id in checks
    record = read_studies(tmp_path / "speed" / "speed.json")
    assert {series.panel for study in record.studies for series in study.series} == {
        "PSNR against training seconds, lego"
    }
    (profile,) = (table for study in record.studies for table in study.tables)
    shares = [row[1] for row in profile.rows]
    assert sum(share for share in shares if isinstance(share, float)) == pytest.approx(100.0)


@pytest.mark.thorough
@pytest.mark.slow
def test_ground_truth_and_memory_are_measured_in_processes_of_their_own(tmp_path: Path) -> None:
    checks = answers(tmp_path / "speed", 7, 8)
    assert checks["render.lego.scalar_rgb.seconds"].value
    for id in ("memory.worker.nerf.peak", "memory.run.peak"):
        value = checks[id].value
        assert value is None or 0.1 < value < 8.0


@pytest.mark.slow
@pytest.mark.thorough
def test_growth_and_processes_are_measured(tmp_path: Path) -> None:
    checks = answers(tmp_path / "speed", 9, 10)
    assert {id for id in checks if id.startswith("growth")} == {
        f"growth.{name}.exponent" for name in ("rays", "samples", "width", "resolution", "seeds")
    }
    assert "processes.ratio" in checks


@pytest.mark.cluster
@pytest.mark.slow
def test_a_cluster_is_measured_against_processes(tmp_path: Path) -> None:
    pytest.importorskip("ray", reason="the extra `ray` is not installed")
    checks = answers(tmp_path / "speed", 12)
    for name in ("ratio", "ray.rate", "local.rate"):
        assert (checks[f"cluster.{name}"].value or 0.0) > 0.0


def test_without_ray_a_cluster_is_not_measured_and_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    monkeypatch.setattr("harness.studies.speed.clusters.physical_cores", lambda: 2)
    check = answers(tmp_path / "speed", 12)["cluster.ratio"]
    assert check.value is None
    assert "Ray is not installed" in check.why
