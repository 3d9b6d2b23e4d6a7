"""summary.json: its schema, which scripts rely on, and its numbers."""

import json
import math

import pytest

from reports.run.saving.publish import summary, write_summary
from tests.replacing import replace

CELL = {
    "scene", "method", "seed", "status", "reason", "steps", "train_seconds", "train_core_seconds", "psnr", "ssim",
    "flip", "delta_e", "rmse_linear", "depth_rmse", "opacity_iou", "psnr_train", "psnr_ceiling", "curve",
}  # fmt: skip
COMPARISON = {
    "scene", "method", "against", "metric", "budget", "difference", "interval", "verdict", "smallest_detectable",
}  # fmt: skip


def written(records, folder) -> dict:
    write_summary(records, folder / "summary.json")
    text = (folder / "summary.json").read_text(encoding="utf-8")
    return json.loads(text, parse_constant=lambda word: pytest.fail(f"{word} in JSON"))


def test_schema(records, tmp_path):
    data = written(records, tmp_path)
    assert {"schema", "profile", "provenance", "cells", "comparisons", "claims", "left_out"} <= set(data)
    assert set(data["cells"][0]) >= CELL
    assert set(data["cells"][0]["curve"]) >= {"steps", "seconds", "core_seconds", "psnr", "rmse_linear"}
    assert set(data["comparisons"][0]) >= COMPARISON
    assert set(data["claims"][0]) >= {"id", "source", "printed", "measured", "interval", "scale", "verdict", "kind"}
    assert set(data["left_out"][0]) >= {"scene", "what", "seconds_saved", "difference", "interval"}


def test_numbers_are_those_of_the_records(records):
    data = summary(records)
    first = data["cells"][0]
    assert (first["scene"], first["method"], first["seed"], first["status"]) == ("chair", "nerf", 0, "done")
    assert first["psnr"] == records.cells[0].scores["psnr"]
    assert first["curve"]["steps"] == [50, 100, 200, 400, 800, 1600]
    assert first["curve"]["core_seconds"] == [point.core_seconds for point in records.cells[0].curve]
    gains = {row["method"]: row["gain"] for row in data["last_doubling"]}
    # at half of the steps, a fake run has 4/5 of the logarithm of its steps: 3.2 dB × 0.2^1.4
    assert gains == pytest.approx(dict.fromkeys(records.methods, 3.2 * 0.2**1.4), abs=1e-3)
    lost = data["cells"][-1]
    assert (lost["status"], lost["reason"]) == ("diverged", "not finite at step 412: density_head.weight")
    assert (lost["psnr"], lost["curve"]["steps"]) == (None, [50, 100, 200, 400])


def test_a_number_that_is_not_finite_becomes_null(records, tmp_path):
    wild = replace(records.cells[0], scores={"psnr": math.inf, "ssim": math.nan})
    first = written(replace(records, cells=[wild, *records.cells[1:]]), tmp_path)["cells"][0]
    assert (first["psnr"], first["ssim"]) == (None, None)
