"""Results as JSON: rows, records of this program, and the files of nerfbaselines, 3D Gaussian Splatting
(`results.json`, `per_view.json`), nerfstudio's `ns-eval` and gsplat (`stats/val_step29999.json`).
"""

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from harness.records.metric_table import METRICS
from harness.verdicts.tables.headers import share_of_scenes
from harness.verdicts.tables.layout import rows_of_columns
from harness.verdicts.tables.places import ResultPlace, scene_folder
from harness.verdicts.tables.rows import Rows
from scenes.files.errors import InputError
from scenes.files.json_object import JsonObject, each_key_once

FORMS = (
    "JSON must be a list of rows {scene, method, psnr, …}, {cells: such rows}, {method, scenes: {scene: {metric: "
    "value}}}, or a file of results of nerfbaselines, 3D Gaussian Splatting, ns-eval or gsplat"
)


class HoldsNoRows(InputError):
    """A JSON file of something else than results."""


def read_json_rows(path: Path, text: str, place: ResultPlace, metric: str | None) -> Rows:
    """Return the rows of a file's text; `place` says what its folders name. Raises `HoldsNoRows`, and `InputError` for
    what is no JSON.
    """
    try:
        is_lines = path.suffix.lower() in (".jsonl", ".ndjson")
        data = msgspec.json.Decoder().decode_lines(text) if is_lines else msgspec.json.decode(text)
        for part in text.split("\n") if is_lines else [text]:
            json.loads(part or "{}", object_pairs_hook=each_key_once)
    except RecursionError as error:
        raise InputError(f"{path}: is nested too deeply") from error
    except ValueError as error:
        raise InputError(f"{path}: is not JSON ({error}); write null for a missing result") from error
    metrics = data.get("metrics") if isinstance(data, dict) else None
    declared = [each for each in metrics if isinstance(each, dict)] if isinstance(metrics, list) else []
    arrows = {(str(each.get("id")), "↓") for each in declared if each.get("ascending") is False}
    rows = _rows(data, path, place)
    if not rows or not all(isinstance(row, dict) for row in rows):
        raise HoldsNoRows(f"{path}: holds no rows; {FORMS}")
    rows = [_with_protocol(row) for row in rows]
    if place.seed is not None:
        rows = [{"seed": place.seed, **row} for row in rows]
    names = list(dict.fromkeys(name for row in rows for name, value in row.items() if _is_plain(value)))
    columns = [[row.get(name) if _is_plain(row.get(name)) else None for row in rows] for name in names]
    read = rows_of_columns(path, names, columns, metric)
    return replace(read, arrows=read.arrows | arrows)


def _is_plain(value: object) -> bool:
    return value is None or isinstance(value, str | int | float)


def _with_protocol(row: JsonObject) -> JsonObject:
    """Return a row of `harness score` with what was scored as columns."""
    made = row.get("made")
    if not isinstance(made, dict) or "width" not in made:
        return row
    views = {"views": len(row["views"])} if isinstance(row.get("views"), list) else {}
    # AlexNet's is called `lpips` in published tables
    of_vgg = {"lpips": None, "lpips_vgg": row.get("lpips")} if made.get("lpips_network") == "vgg" else {}
    return {**row, "width": made["width"], **views, **of_vgg}


def _rows(data: Any, path: Path, place: ResultPlace) -> list[Any]:
    if isinstance(data, list):
        nested = data and all(isinstance(each, dict) and isinstance(each.get("scenes"), dict) for each in data)
        return [row for each in data for row in _of_method(each)] if nested else data
    if not isinstance(data, dict):
        return []
    if isinstance(data.get("metrics"), dict):
        return [_of_scene_file(data, path)]
    if isinstance(data.get("results"), dict) and "method_name" in data:
        return [{**_scores(data["results"]), "scene": data.get("experiment_name"), "method": data["method_name"]}]
    if isinstance(data.get("scenes"), dict):
        return _of_method(data)
    for name in ("methods", "cells", "results", "rows", "data"):
        # a run's summary also has a list of method names
        if isinstance(data.get(name), list) and all(isinstance(each, dict) for each in data[name]):
            return _rows(data[name], path, place)
    if "scene" not in data and _scores(data):
        return [{**_scores(data), "scene": place.scene or scene_folder(path), "method": place.method or "gsplat"}]
    if data and all(isinstance(each, dict) and _scores(each) for each in data.values()):
        return _of_gaussian_splatting(data, path, place)
    return _of_data_frame(data)


def _of_data_frame(data: JsonObject) -> list[JsonObject]:
    """Return the rows of the forms that pandas writes, and of {method: {scene: {metric: value}}}, also turned."""
    columns, values, index = (data.get(name) for name in ("columns", "data", "index"))
    if isinstance(columns, list) and isinstance(values, list) and isinstance(index, list):
        return [
            dict(zip(["", *map(str, columns)], [name, *row], strict=False))
            for name, row in zip(index, values, strict=False)
            if isinstance(row, list) and len(row) == len(columns) and len(index) == len(values)
        ]
    lists = list(data.values())
    if lists and all(isinstance(each, list) and len(each) == len(lists[0]) for each in lists):
        return [dict(zip(data, row, strict=True)) for row in zip(*lists, strict=True)]
    if not data or not all(isinstance(each, dict) and each for each in data.values()):
        return []
    if all(name.lower() in METRICS for name in data):  # {metric: {method: {scene: value}}}
        rows = {metric: _of_data_frame(each) for metric, each in data.items()}
        return [{**row, "metric": metric} for metric, some in rows.items() for row in some]
    inner = [value for each in data.values() for value in each.values()]
    if all(isinstance(value, dict) for value in inner):
        turned = share_of_scenes(data) > 0.5
        return [
            {**scores, "scene": outer if turned else name, "method": name if turned else outer}
            for outer, each in data.items()
            for name, scores in each.items()
        ]
    if not all(_is_plain(value) for value in inner):
        return []
    by_column = "method" in data or "scene" in data
    if by_column:  # {column: {row: value}}
        return [{column: values.get(row) for column, values in data.items()} for row in next(iter(data.values()))]
    return [{"": name, **values} for name, values in data.items()]


def _scores(data: Mapping[str, Any]) -> dict[str, float]:
    """Return the known metrics of an object, in lower case; scores by view are averaged."""
    scores = {name.lower(): value for name, value in data.items() if name.lower() in METRICS}
    means = {
        name: sum(value.values()) / len(value) if isinstance(value, dict) and value else value
        for name, value in scores.items()
        if not isinstance(value, dict) or all(isinstance(each, int | float) for each in value.values())
    }
    return {name: value for name, value in means.items() if isinstance(value, int | float)}


def _of_gaussian_splatting(data: JsonObject, path: Path, place: ResultPlace) -> list[JsonObject]:
    """Return a row for each number of steps: `ours_7000`, `ours_30000`; or for each scene of a file of a method."""
    if not all(re.search(r"_\d+$", name) for name in data):
        return [{**_scores(scores), "scene": scene, "method": path.stem} for scene, scores in data.items()]
    several = len(data) > 1 or not place.method
    return [
        {
            **_scores(scores),
            "scene": place.scene or scene_folder(path),
            "steps": float(name.rpartition("_")[2]),
            "method": " ".join(filter(None, (place.method, name if several else ""))),
        }
        for name, scores in data.items()
    ]


def _of_method(row: JsonObject) -> list[JsonObject]:
    name = row.get("id", row.get("method", row.get("name")))
    scenes = row["scenes"].items()
    return [{**scores, "scene": scene, "method": name} for scene, scores in scenes if isinstance(scores, dict)]


def _of_scene_file(data: JsonObject, path: Path) -> JsonObject:
    """Return the row of a result file of one method on one scene; older files name the method only by the folder."""
    info: JsonObject = next((data[name] for name in ("nb_info", "info") if isinstance(data.get(name), dict)), {})
    places = [data.get("render_dataset_metadata"), info.get("dataset_metadata")]
    scenes = [place.get("scene") for place in places if isinstance(place, dict)]
    scene = next(filter(None, [*scenes, info.get("dataset_scene")]), path.stem)
    method = info.get("method") or path.parent.parent.name
    seconds = {"seconds": info["total_train_time"]} if "total_train_time" in info else {}
    return {**data["metrics"], **seconds, "scene": scene, "method": method}
