"""Every run of the report as one piece of data, with which the page shows the runs behind a figure."""

from collections.abc import Iterable
from typing import Any

from harness.records.cells import CellRecord, Checkpoint
from harness.records.metric_table import ALONG_TRAINING, METRICS
from reports.data.load import Records, of_whole_groups
from reports.drawing.palette import colours_of
from reports.drawing.traces import rounded
from reports.page.shell import flat

RUN_SCRIPTS = ("density.js",)
"""The further scripts that the page of a run needs."""
SCORES = ("psnr_train", "psnr_ceiling", "psnr_floor")
CURVES = ("step", "seconds", *ALONG_TRAINING, "alpha", "beta")
"""The values of a checkpoint."""
DENSITY = ("before", "after", "before_inside", "after_inside", "before_outside", "after_outside")


def runs_data(records: Records) -> dict[str, Any]:
    """Return scores and curves in columns, one list per name, so that no name is repeated a thousand times."""
    differing = settings_that_differ(records.cells)
    compared = {(cell.scene, cell.seed) for cell in of_whole_groups(records.cells, list(records.run.methods))}
    return {
        "scenes": records.scenes,
        "methods": records.methods,
        "metrics": [
            {"name": one.name, "label": one.label, "unit": one.unit, "digits": one.digits, "up": one.higher_is_better}
            for one in METRICS.values()
        ],
        "colours": {method: colour.variable for method, colour in colours_of(records.methods).items()},
        "cells": [
            _cell(cell, differing) | ({} if (cell.scene, cell.seed) in compared else {"whole": False})
            for cell in records.cells
        ],
        **_targets(records),
    }


def _targets(records: Records) -> dict[str, Any]:
    """Return how soon each run reached the target: scene → method → seed → steps or seconds → time and what is known of
    it.
    """
    record = records.targets
    if record is None or record.target is None:
        return {}
    reached: dict[str, Any] = {}
    for one in record.reaches:
        by_seed = reached.setdefault(one.scene, {}).setdefault(one.method, {})
        by_seed.setdefault(str(one.seed), {})[one.axis] = [rounded([one.time])[0], one.known]
    return {"target": record.target, "reached": reached}


def _cell(cell: CellRecord, differing: dict[str, set[str]]) -> dict[str, Any]:
    settings = dict(flat(cell.settings))
    names = [*METRICS, *SCORES]
    found: dict[str, Any] = {
        "scene": cell.scene,
        "method": cell.method,
        "seed": cell.seed,
        "status": cell.status,
        "reason": cell.reason or "",
        "steps": cell.steps,
        "seconds": rounded([cell.train_seconds])[0],
        "scores": {name: _number(cell.scores.get(name)) for name in names if cell.scores.get(name) is not None},
        "warnings": cell.warnings,
        "differing": {name: settings[name] for name in sorted(differing[cell.scene]) if name in settings},
        "file": f"records/cells/{cell.scene}.{cell.method}.{cell.seed}.json",
    }
    curve = sorted(cell.curve, key=lambda point: point.step)
    columns = {name: [_number(getattr(point, name)) for point in curve] for name in CURVES}
    found["curve"] = {name: values for name, values in columns.items() if any(one is not None for one in values)}
    return found


def settings_that_differ(cells: Iterable[CellRecord]) -> dict[str, set[str]]:
    """Map scene → names of the settings that differ among its runs."""
    by_scene: dict[str, list[dict[str, str]]] = {}
    for cell in cells:
        by_scene.setdefault(cell.scene, []).append(dict(flat(cell.settings)))
    return {
        scene: {name for one in all_settings for name in one if len({each.get(name) for each in all_settings}) > 1}
        for scene, all_settings in by_scene.items()
    }


def density_data(records: Records) -> list[dict[str, Any]]:
    """Return histograms of density of each run at its checkpoints; `after` is left out if it is the
    same as `before`.
    """
    found = []
    for cell in records.cells:
        points = [point for point in sorted(cell.curve, key=lambda point: point.step) if _is_histogram(point)]
        edges = points[-1].density["edges"] if points and points[-1].density else []
        alike = [point for point in points if point.density and point.density["edges"] == edges]
        if alike:
            found.append(
                {
                    "scene": cell.scene,
                    "method": cell.method,
                    "seed": cell.seed,
                    "edges": rounded(edges),
                    "steps": [point.step for point in alike],
                    "at": [_shares(point.density or {}) for point in alike],
                }
            )
    return found


def _shares(density: dict[str, Any]) -> dict[str, Any]:
    bins = len(density["edges"]) - 1
    known = {side: rounded(density[side]) for side in DENSITY if len(density.get(side) or ()) == bins}
    for side in DENSITY[1::2]:
        if known.get(side) == known.get(side.replace("after", "before")):
            known.pop(side, None)
    return known | {name: value for name, value in density.items() if name.startswith("points")}


def _is_histogram(point: Checkpoint) -> bool:
    density = point.density or {}
    bins = len(density.get("edges", ())) - 1
    return bins > 0 and all(len(density.get(side, ())) == bins for side in ("before", "after"))


def _number(value: float | None) -> float | int | None:
    return None if value is None else rounded([value])[0]
