"""Every run of the report as data, from which the page shows the runs behind a figure."""

from typing import TypeVar

from harness.records.cells import CellRecord
from harness.records.metric_table import METRICS
from harness.verdicts.failures import judgeable
from reports.data.load import Records, in_complete_groups
from reports.data.table import SCORES
from reports.drawing.palette import colours_of
from reports.drawing.traces import rounded
from reports.page.shell import settings_rows
from reports.run.density import is_histogram
from reports.run.saving.replay import conditions, replay

Value = TypeVar("Value")

RUN_SCRIPTS = ("density.js",)
CURVES = ("step", "seconds", "core_seconds", *METRICS, "alpha", "beta")
OF_A_VIEW = ("psnr", "ssim", "flip")
TRACED = 30
"""The maximum number of points of a small line over training."""
DENSITY = ("before", "after", "before_inside", "after_inside", "before_outside", "after_outside")


def runs_data(records: Records) -> dict[str, object]:
    """Return scores and curves in columns, a list per name, so that names are not repeated for every value."""
    differing = settings_that_differ(records.cells)
    compared = {(cell.scene, cell.seed) for cell in in_complete_groups(records.cells, records.run.main_methods)}
    return {
        "scenes": records.scenes,
        "views": {cell.scene: [view.view for view in cell.views] for cell in records.cells if cell.views},
        "methods": records.methods,
        "metrics": [
            {
                "name": metric.name,
                "label": metric.label,
                "unit": metric.unit,
                "digits": metric.digits,
                "up": metric.higher_is_better,
            }
            for metric in METRICS.values()
        ],
        "colours": {method: colour.variable for method, colour in colours_of(records.methods).items()},
        "cells": [
            _cell(records, cell, differing[cell.scene])
            | ({} if (cell.scene, cell.seed) in compared else {"whole": False})
            for cell in records.cells
        ],
        **_targets(records),
    }


def _targets(records: Records) -> dict[str, object]:
    """Return how soon each run reached the target: scene → method → seed → axis of time → time and its meaning."""
    record = records.targets
    if record is None or record.target is None:
        return {}
    reached: dict[str, dict[str, dict[str, dict[str, object]]]] = {}
    for reach in record.reaches:
        by_seed = reached.setdefault(reach.scene, {}).setdefault(reach.method, {})
        by_seed.setdefault(str(reach.seed), {})[reach.axis] = [*rounded([reach.time]), reach.known]
    return {"target": record.target, "reached": reached}


def _cell(records: Records, cell: CellRecord, differing: set[str]) -> dict[str, object]:
    curve = sorted(cell.curve, key=lambda point: point.step)
    columns = {name: [_number(getattr(point, name)) for point in curve] for name in CURVES}
    # the largest share of all layers, as a dead layer cuts off every layer before it
    columns["dead_units"] = [_number(max(point.dead_units.values())) if point.dead_units else None for point in curve]
    return {
        **{name: getattr(cell, name) for name in ("scene", "method", "seed", "status", "steps")},
        "judged": judgeable(cell),
        "reason": cell.reason or "",
        "seconds": _number(cell.train_seconds),
        "core_seconds": _number(cell.train_core_seconds),
        "scores": {name: _number(score) for name in SCORES if (score := cell.scores.get(name)) is not None},
        "warnings": cell.all_warnings,
        "differing": {name: value for name, value in sorted(settings_rows(cell.settings)) if name in differing},
        "views": _known({name: [_number(getattr(view, name)) for view in cell.views] for name in OF_A_VIEW}),
        "trace": _trace(cell),
        "costs": {name: _number(amount) for name, amount in cell.costs.items()},
        "replay": replay(records, cell),
        "beside": conditions(cell),
        "file": f"records/cells/{cell.scene}.{cell.method}.{cell.seed}.json",
        "curve": _known(columns),
    }


def _known(columns: dict[str, list[Value]]) -> dict[str, list[Value]]:
    return {name: values for name, values in columns.items() if any(value is not None for value in values)}


def _trace(cell: CellRecord) -> dict[str, list[float | None]]:
    """Return at most `TRACED` points of each series, including the first and the last."""
    many = len(cell.trace.get("step", []))
    places = sorted({round(at * (many - 1) / (TRACED - 1)) for at in range(TRACED)}) if many > TRACED else range(many)
    return {
        name: [None if series[at] is None else float(f"{series[at]:.3g}") for at in places]
        for name, series in _known(cell.trace).items()
    }


def settings_that_differ(cells: list[CellRecord]) -> dict[str, set[str]]:
    by_scene: dict[str, list[set[tuple[str, str]]]] = {}
    for cell in cells:
        by_scene.setdefault(cell.scene, []).append(set(settings_rows(cell.settings)))
    return {
        scene: {name for name, _ in runs[0].union(*runs) - runs[0].intersection(*runs)}
        for scene, runs in by_scene.items()
    }


def density_data(records: Records) -> list[dict[str, object]]:
    """Return the histograms of density of each run at its checkpoints, `after` only if it differs from `before`."""
    histograms = []
    for cell in records.cells:
        points = sorted(filter(is_histogram, cell.curve), key=lambda point: point.step)
        known = [(point.step, point.density or {}) for point in points]
        alike = [(step, density) for step, density in known if density["edges"] == known[-1][1]["edges"]]
        if alike:
            histograms.append(
                {
                    "scene": cell.scene,
                    "method": cell.method,
                    "seed": cell.seed,
                    "edges": rounded(alike[0][1]["edges"]),
                    "steps": [step for step, _ in alike],
                    "at": [_shares(density) for _, density in alike],
                }
            )
    return histograms


def _shares(density: dict[str, list[int | float]]) -> dict[str, object]:
    bins = len(density["edges"]) - 1
    known: dict[str, object] = {
        side: rounded(density[side]) for side in DENSITY if len(density.get(side) or ()) == bins
    }
    for side in DENSITY[1::2]:
        if known.get(side) == known.get(side.replace("after", "before")):
            known.pop(side, None)
    return known | {name: value for name, value in density.items() if name.startswith("points")}


def _number(value: float | None) -> float | int | None:
    return None if value is None else rounded([value])[0]
