"""Every run of the report as one piece of data, with which the page shows the runs behind a figure."""

from typing import Any

from harness.records.cells import CellRecord
from harness.records.metric_table import ALONG_TRAINING, METRICS
from reports.data.load import Records, of_whole_groups
from reports.data.table import SCORES
from reports.drawing.palette import colours_of
from reports.drawing.traces import rounded
from reports.page.shell import flat
from reports.run.density import is_histogram

RUN_SCRIPTS = ("density.js",)
"""The further scripts that the page of a run needs."""
CURVES = ("step", "seconds", "core_seconds", *ALONG_TRAINING, "alpha", "beta")
"""The values of a checkpoint."""
DENSITY = ("before", "after", "before_inside", "after_inside", "before_outside", "after_outside")


def runs_data(records: Records) -> dict[str, Any]:
    """Return scores and curves in columns, one list per name, so that no name is repeated a thousand times."""
    differing = settings_that_differ(records.cells)
    compared = {(cell.scene, cell.seed) for cell in of_whole_groups(records.cells, records.run.main_methods)}
    return {
        "scenes": records.scenes,
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
            _cell(cell, differing[cell.scene]) | ({} if (cell.scene, cell.seed) in compared else {"whole": False})
            for cell in records.cells
        ],
        **_targets(records),
    }


def _targets(records: Records) -> dict[str, Any]:
    """Return how soon each run reached the target: scene → method → seed → axis of time → time and what is known of
    it.
    """
    record = records.targets
    if record is None or record.target is None:
        return {}
    reached: dict[str, Any] = {}
    for reach in record.reaches:
        by_seed = reached.setdefault(reach.scene, {}).setdefault(reach.method, {})
        by_seed.setdefault(str(reach.seed), {})[reach.axis] = [*rounded([reach.time]), reach.known]
    return {"target": record.target, "reached": reached}


def _cell(cell: CellRecord, differing: set[str]) -> dict[str, Any]:
    curve = sorted(cell.curve, key=lambda point: point.step)
    columns = {name: [_number(getattr(point, name)) for point in curve] for name in CURVES}
    return {
        **{name: getattr(cell, name) for name in ("scene", "method", "seed", "status", "steps")},
        "reason": cell.reason or "",
        "seconds": _number(cell.train_seconds),
        "core_seconds": _number(cell.train_core_seconds),
        "scores": {name: _number(score) for name in SCORES if (score := cell.scores.get(name)) is not None},
        "warnings": cell.warnings,
        "differing": {name: value for name, value in sorted(flat(cell.settings)) if name in differing},
        "file": f"records/cells/{cell.scene}.{cell.method}.{cell.seed}.json",
        "curve": {name: values for name, values in columns.items() if any(value is not None for value in values)},
    }


def settings_that_differ(cells: list[CellRecord]) -> dict[str, set[str]]:
    """Map scene → names of the settings that differ among its runs."""
    by_scene: dict[str, list[set[tuple[str, str]]]] = {}
    for cell in cells:
        by_scene.setdefault(cell.scene, []).append(set(flat(cell.settings)))
    return {
        scene: {name for name, _ in runs[0].union(*runs) - runs[0].intersection(*runs)}
        for scene, runs in by_scene.items()
    }


def density_data(records: Records) -> list[dict[str, Any]]:
    """Return histograms of density of each run at its checkpoints, `after` where it is not the same as `before`."""
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


def _shares(density: dict[str, Any]) -> dict[str, Any]:
    bins = len(density["edges"]) - 1
    known = {side: rounded(density[side]) for side in DENSITY if len(density.get(side) or ()) == bins}
    for side in DENSITY[1::2]:
        if known.get(side) == known.get(side.replace("after", "before")):
            known.pop(side, None)
    return known | {name: value for name, value in density.items() if name.startswith("points")}


def _number(value: float | None) -> float | int | None:
    return None if value is None else rounded([value])[0]
