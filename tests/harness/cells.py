"""Hand-written cell records."""

from typing import Any

from harness.records.cells import CellRecord, Checkpoint, ViewScore
from tests.replacing import replace


def checkpoint(step: int, seconds: float, psnr: float | None, **others: float | None) -> Checkpoint:
    scores: dict[str, Any] = {"rmse_linear": None, "ssim": None, **others}
    return Checkpoint(step=step, seconds=seconds, network_evaluations=step * 100, psnr=psnr, **scores)


def cell(scene: str, method: str, seed: int, curve: list[Checkpoint], **changes: Any) -> CellRecord:
    """Return a finished cell whose score is the last point of its curve."""
    facts: dict[str, Any] = {
        "status": "done",
        "reason": None,
        "steps": curve[-1].step if curve else 0,
        "train_seconds": curve[-1].seconds if curve else 0.0,
        "scores": {"psnr": curve[-1].psnr} if curve else {},
        "views": [ViewScore("test/r_0", psnr=20.0, ssim=0.9, flip=0.1, delta_e=2.0, rmse_linear=0.05, opacity_iou=0.8)],
        "trace": {"step": [1.0, 20.0], "loss": [0.5, None]},
        "parameters": {"total": 3},
        "properties": {"occupied_share": 0.5, "largest_density": None, "note": "φ"},
        "warnings": [],
        "settings": {"rays": 64},
        "provenance": {"threads": 1},
        **changes,
    }
    return CellRecord(scene=scene, method=method, seed=seed, curve=curve, **facts)


def without_time(cell: CellRecord) -> CellRecord:
    """Return the part of a record that must be bit-identical, which clocks and places are not."""
    curve = [replace(point, seconds=0.0, core_seconds=0.0) for point in cell.curve]
    return replace(cell, train_seconds=0.0, train_core_seconds=0.0, costs={}, curve=curve, provenance={})


def with_core_seconds(cell: CellRecord, factor: float) -> CellRecord:
    """Return the cell with core seconds of `factor` times its wall seconds."""
    curve = [replace(point, core_seconds=factor * point.seconds) for point in cell.curve]
    return replace(cell, curve=curve, train_core_seconds=factor * cell.train_seconds)


def diverged(scene: str, method: str, seed: int) -> CellRecord:
    return cell(scene, method, seed, [], status="diverged", reason="not finite at step 7: loss", steps=7)
