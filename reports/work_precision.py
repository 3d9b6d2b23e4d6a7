"""Error against what it cost, log–log: training seconds, and network evaluations."""

from reports.convergence import Axis, curve_panels
from reports.figure import Panel, Trace, with_common_limits
from reports.load import Records
from reports.palette import INK
from reports.table import cells_frame, curves_frame

FURTHEST = 10
"""A floor this many times below the smallest error would only squeeze the curves."""


def error_against(records: Records, axis: Axis) -> list[Panel]:
    """Linear RMSE in each scene, with the noise of the ground truth as a floor where it is known."""
    floors = noise_floors(records)
    panels = [
        _with_floor(panel, floors.get(panel.title))
        for panel in curve_panels(records, curves_frame(records), axis, "rmse_linear")
    ]
    return with_common_limits(panels, "x")


def noise_floors(records: Records) -> dict[str, float]:
    """Scene → linear RMSE that the ground truth's own noise causes.

    The ceiling is known in display colour. It is carried over to linear light by the ratio of the two errors
    that the finished cells of the scene show: an estimate, exact only if noise and error lie in the same tones.
    """
    frame = cells_frame(records)
    done = frame[frame["status"] == "done"].dropna(subset=["psnr", "rmse_linear", "psnr_ceiling"])
    ratio = done["rmse_linear"] / 10 ** (-done["psnr"] / 20)
    floors = (ratio * 10 ** (-done["psnr_ceiling"] / 20)).groupby(done["scene"]).median()
    return {str(scene): float(value) for scene, value in floors.items()}


def _with_floor(panel: Panel, level: float | None) -> Panel:
    xs = [x for trace in panel.traces for x in trace.x]
    ys = [y for trace in panel.traces for y in trace.y]
    if level is None or level <= 0 or not xs or level < min(ys) / FURTHEST:
        return panel
    line = Trace("noise of the ground truth", INK.light, "floor", (min(xs), max(xs)), (level, level))
    return Panel(**{**panel.__dict__, "traces": (*panel.traces, line)})
