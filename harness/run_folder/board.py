"""A finished cell for TensorBoard: OUT/tensorboard/<scene>/<method>/<seed>, made from its records only.

Times are training seconds, so that TensorBoard's *Relative* axis is the clock on which methods are compared; its *Wall*
axis means nothing. Missing scores are left out.
"""

import importlib.util
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from harness.records.cells import CellRecord, Checkpoint, records_folder
from harness.records.metric_table import METRICS
from harness.records.pictures import read_renders, read_truth, truth_pictures
from scenes.files.atomic import replacing
from scenes.files.errors import InputError

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter

TRACED = ("loss", "gradient_norm", "clipped_norm", "samples_per_ray", "alpha", "beta")
POINTS = 32**3
"""The number of points of a density histogram (`harness.training.scoring.evaluate.density_histogram`)."""


def require_tensorboard(option: str) -> None:
    """Raise `InputError` if the package is missing; called before anything is trained."""
    if importlib.util.find_spec("tensorboard") is None:
        raise InputError(
            f"{option}: the package tensorboard is not installed; install the extra of pyproject.toml, or leave the "
            "option out and run python -m harness tensorboard OUT later"
        )


def board_folder(out: Path, cell: CellRecord) -> Path:
    return out / "tensorboard" / cell.scene / cell.method / str(cell.seed)


def write_board(out: Path, cell: CellRecord) -> Path:
    """Write the cell, atomically; return its folder. Raises `OSError`, and `DamagedRecord` for unreadable pictures."""
    from torch.utils.tensorboard import SummaryWriter

    folder = board_folder(out, cell)
    with replacing(folder) as temporary:
        writer = SummaryWriter(str(temporary))
        try:
            _curve(writer, cell.curve)
            _trace(writer, cell)
            for name, value in cell.scores.items():
                _scalar(writer, f"end/{name}", value, cell.steps, cell.train_seconds)
            status = f"{cell.status}{': ' + cell.reason if cell.reason else ''}"
            writer.add_text("cell/status", status, cell.steps, 0.0)
            _pictures(writer, out, cell)
        finally:
            writer.close()
        shutil.rmtree(folder, ignore_errors=True)
    return folder


def _curve(writer: "SummaryWriter", curve: list[Checkpoint]) -> None:
    for point in curve:
        for name in (*METRICS, "network_evaluations", "core_seconds"):
            _scalar(writer, f"test/{name}", getattr(point, name), point.step, point.seconds)
        if point.density is None:
            continue
        edges = np.asarray(point.density["edges"])
        centres = 0.5 * (edges[:-1] + edges[1:])
        for name in ("before", "after"):
            counts = POINTS * np.asarray(point.density[name])
            writer.add_histogram_raw(
                f"density/{name}",
                min=float(edges[0]),
                max=float(edges[-1]),
                num=POINTS,
                sum=float(counts @ centres),
                sum_squares=float(counts @ centres**2),
                bucket_limits=edges[1:].tolist(),
                bucket_counts=counts.tolist(),
                global_step=point.step,
                walltime=point.seconds,
            )


def _trace(writer: "SummaryWriter", cell: CellRecord) -> None:
    """Write the trace; the seconds of steps are interpolated linearly between checkpoints, from 0 at the start."""
    steps = cell.trace.get("step", [])
    known = [0.0, *(float(point.step) for point in cell.curve)], [0.0, *(point.seconds for point in cell.curve)]
    for name in TRACED:
        for step, value in zip(steps, cell.trace.get(name, []), strict=False):
            if step is not None:
                seconds = float(np.interp(step, *known))
                _scalar(writer, f"train/{name}", value, int(step), seconds)


def _pictures(writer: "SummaryWriter", out: Path, cell: CellRecord) -> None:
    """Write display colour and opacity of every saved view at every checkpoint that has it; the truth is at step 0."""
    path = records_folder(out) / cell.pictures if cell.pictures else None
    if path is None or not path.is_file():
        return
    seconds = {point.step: point.seconds for point in cell.curve}
    for render in read_renders(path):
        at = seconds.get(render.step, 0.0)
        _picture(writer, f"{render.view}/colour", render.colour, render.step, at)
        _picture(writer, f"{render.view}/opacity", render.opacity[..., None], render.step, at)
    truth = records_folder(out) / truth_pictures(cell.scene)
    for true in read_truth(truth) if truth.is_file() else []:
        _picture(writer, f"{true.view}/truth", true.display, 0, 0.0)


def _picture(writer: "SummaryWriter", tag: str, values: np.ndarray, step: int, seconds: float) -> None:
    """Write `values` [h, w, channels], clipped to 0 … 1, as 8 bits."""
    levels = np.round(np.clip(np.asarray(values, dtype=np.float32), 0.0, 1.0) * 255.0).astype(np.uint8)
    writer.add_image(tag, levels, step, seconds, dataformats="HWC")


def _scalar(writer: "SummaryWriter", tag: str, value: float | None, step: int, seconds: float) -> None:
    if value is not None:
        writer.add_scalar(tag, value, step, walltime=seconds)
