"""Does the gate's order predict a run's? Correlations by hand, and the published file."""

import json
from pathlib import Path

import pytest

from harness.__main__ import main
from harness.gate.references import RANK_FILE, References, publish, ranks, write_references
from tests.harness.shell import refused

OURS = {("lego", "nerf"): 20.0, ("lego", "qnerf"): 18.0, ("hotdog", "nerf"): 25.0, ("hotdog", "qnerf"): 26.0}


def test_the_same_order_and_the_reverse() -> None:
    same = ranks(OURS, {key: 2 * value + 1 for key, value in OURS.items()})
    assert (same.spearman, same.kendall, same.same_order, same.compared) == (1.0, 1.0, 2, 2)
    reverse = ranks(OURS, {key: -value for key, value in OURS.items()})
    assert (reverse.spearman, reverse.kendall, reverse.same_order) == (-1.0, -1.0, 0)


def test_one_pair_that_changed_places() -> None:
    """Ranks 2 1 3 4 against 1 2 3 4: Spearman 1 − 6 · 2 / (4 · 15), Kendall (5 − 1) / 6."""
    found = ranks(OURS, {**OURS, ("lego", "nerf"): 17.0})
    assert found.spearman == pytest.approx(0.8)
    assert found.kendall == pytest.approx(2 / 3)
    assert (found.same_order, found.compared) == (1, 2)


def summary(folder: Path, scale: float = 1.0) -> Path:
    cells = [
        {"scene": scene, "method": method, "seed": seed, "status": "done", "psnr": scale * value}
        for (scene, method), value in OURS.items()
        for seed in (0, 1)
    ]
    cells.append({"scene": "lego", "method": "nerf", "seed": 2, "status": "diverged", "psnr": None})
    folder.mkdir()
    data = {"profile": "reduced", "provenance": {"commit": "abc"}, "cells": cells}
    (folder / "summary.json").write_text(json.dumps(data))
    return folder


def test_a_run_is_compared_and_published(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cells = {f"{scene}/{method}/1000": {"psnr": [value]} for (scene, method), value in OURS.items()}
    write_references(tmp_path / "classes", References("avx2", cells=cells))
    run = summary(tmp_path / "run", scale=1.5)
    said = publish(run, tmp_path)
    assert "Spearman 1.00, Kendall 1.00 over 4 pairs" in said
    data = json.loads((tmp_path / RANK_FILE).read_text())
    assert data["run"] == {"profile": "reduced", "commit": "abc"}
    assert data["scores"][0] == {"scene": "hotdog", "method": "nerf", "gate": 25.0, "run": 37.5}
    assert main(["gate", "--rank", str(run), "--limits", str(tmp_path / "limits.json")]) == 0
    (run / "summary.json").write_text('{"cells": []}')
    assert "no summary" in refused(capsys, "--rank", run, "--limits", tmp_path / "limits.json", command="gate")
