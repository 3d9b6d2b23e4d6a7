"""summary.json: every number of the page for those who script against it (schema in the project's design notes)."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from harness.json_record import finite_or_none, write_json
from harness.records import CellRecord
from harness.serving_record import CacheRecord, ServingRecord
from reports.beside import ALONE, Beside
from reports.claims import claims
from reports.estimands import found_failures
from reports.headline import headline
from reports.load import Records
from reports.table import METRICS
from reports.untested import not_tested

SCHEMA = 1


def summary(records: Records, beside: Beside = ALONE) -> dict[str, Any]:
    """Plain data, JSON-ready: what is not a finite number is None and the cell's status says why.

    `cache` and `attention` are None where they were not measured.
    """
    run, found = records.run, claims(records, beside)
    return {
        "schema": SCHEMA,
        "profile": run.profile,
        "finished": run.finished,
        "damaged": records.left_out,
        "headline": headline(records).title,
        "command": run.command,
        "seeds": run.seeds,
        "methods": run.methods,
        "scenes": [
            {
                "scene": scene.name,
                "width": scene.width,
                "height": scene.height,
                "views": scene.views,
                "psnr_ceiling": scene.psnr_ceiling,
                "psnr_floor": scene.psnr_floor,
            }
            for scene in run.scenes
        ],
        "cells": [_cell(cell) for cell in (*records.cells, *records.extra_cells)],
        "comparisons": [asdict(one) for one in (*records.comparisons, *records.extra_comparisons)],
        "failures": asdict(found_failures(records)),
        "claims": [_claim(one.__dict__) for one in found],
        "cache": _cache(beside.serving.cache) if beside.serving and beside.serving.cache else None,
        "attention": _attention(beside.serving) if beside.serving else None,
        "left_out": [{"scene": scene.name, **asdict(one)} for scene in run.scenes for one in scene.left_out],
        "deviations": run.deviations,
        "not_tested": not_tested(run.not_tested, found),
        "phases": run.phases,
        "settings": run.settings,
        "provenance": run.provenance,
    }


def _cell(cell: CellRecord) -> dict[str, Any]:
    names = [metric.name for metric in METRICS]
    scores = [*names, "psnr_train", "psnr_ceiling", *(name for name in cell.scores if name not in names)]
    return {
        "scene": cell.scene,
        "method": cell.method,
        "seed": cell.seed,
        "status": cell.status,
        "reason": cell.reason,
        "steps": cell.steps,
        "train_seconds": cell.train_seconds,
        **{name: finite_or_none(cell.scores.get(name)) for name in dict.fromkeys(scores)},
        "curve": {
            "steps": [point.step for point in cell.curve],
            "seconds": [point.seconds for point in cell.curve],
            "network_evaluations": [point.network_evaluations for point in cell.curve],
            "psnr": [finite_or_none(point.psnr) for point in cell.curve],
            "rmse_linear": [finite_or_none(point.rmse_linear) for point in cell.curve],
        },
        "parameters": cell.parameters,
        "properties": cell.properties,
        "warnings": cell.warnings,
    }


def _cache(record: CacheRecord) -> dict[str, Any]:
    paths = [{**asdict(one), "hit_rate": one.hit_rate} for one in record.paths]
    return {**asdict(record), "paths": paths}


def _attention(record: ServingRecord) -> dict[str, Any] | None:
    """With the viewer's first frame, which refines by attention."""
    if record.attention is None:
        return None
    first = asdict(record.first_frame) if record.first_frame else None
    curves = [
        {
            name: [_short(one) for one in value] if isinstance(value, list) else value
            for name, value in asdict(one).items()
        }
        for one in record.attention.curves
    ]
    return {**asdict(record.attention), "curves": curves, "first_frame": first}


def _short(value: float) -> float:
    """Five digits are more than such a figure has, and half as long."""
    return float(f"{value:.5g}")


def _claim(claim: dict[str, Any]) -> dict[str, Any]:
    judged = ("id", "source", "printed", "measured", "interval", "scale", "verdict")
    explained = ("statement", "kind", "unit", "how", "note")
    return {name: claim[name] for name in (*judged, *explained)}


def write_summary(records: Records, path: Path, beside: Beside = ALONE) -> None:
    """Whole or not at all; NaN and Infinity are refused."""
    write_json(path, summary(records, beside))
