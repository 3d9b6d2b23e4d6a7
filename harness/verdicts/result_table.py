"""A file of results (CSV, Parquet, JSON, nerfbaselines' own) → one metric by method, scene and seed.

An ambiguous table is refused with a one-line message.
"""

import csv
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from harness.records.json_record import LARGEST_FILE, load_json
from harness.records.metric_table import METRICS, PRIMARY
from scenes.files.errors import InputError

SYNONYMS = {"train_seconds": "seconds", "total_train_time": "seconds"}
"""The names that nerfbaselines and our own summary have for the column `seconds`."""
FORMS = (
    "JSON must be a list of rows {scene, method, psnr, …}, {cells: such rows}, {method, scenes: {scene: {metric: "
    "value}}} or a result file of nerfbaselines"
)


@dataclass(frozen=True)
class Rows:
    """The rows of one file, a list of equal length for each column."""

    source: Path
    columns: dict[str, list[Any]]
    first: int = 1
    """The number of the first row: line 2 of a file with a head."""
    lower: frozenset[str] = field(default_factory=frozenset)
    """The metrics that the file itself declares to be better when lower."""

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), []))

    def where(self, row: int) -> str:
        return f"{self.source}, {'line' if self.first > 1 else 'row'} {row + self.first}"


def read_rows(path: Path) -> list[Rows]:
    """Read the rows of a file, or of all JSON files below a folder; raises `InputError` if there is no table."""
    if path.is_dir():
        files = sorted(path.rglob("*.json"))
        if not files:
            raise InputError(f"{path}: holds no .json file; give a table, or a folder of nerfbaselines' result files")
        return [_from_json(file) for file in files]
    if not path.is_file():
        raise InputError(f"{path}: no such file; give a table as CSV, Parquet or JSON")
    if (size := path.stat().st_size) > LARGEST_FILE:
        raise InputError(f"{path}: has {size} bytes, more than the {LARGEST_FILE} that are read; leave columns out")
    readers: dict[str, Callable[[Path], Rows]] = {".json": _from_json, ".parquet": _from_parquet}
    return [readers.get(path.suffix.lower(), _from_csv)(path)]


def _from_csv(path: Path) -> Rows:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            head = file.readline()
            mark = max(",;\t", key=head.count)
            lines = list(csv.reader([head], delimiter=mark)) + list(csv.reader(file, delimiter=mark))
    except (csv.Error, UnicodeDecodeError) as error:
        raise InputError(f"{path}: is no CSV file in UTF-8 ({error})") from error
    names, *rows = lines or [[]]
    for place, row in enumerate(rows):
        if row and len(row) != len(names):
            raise InputError(f"{path}, line {place + 2}: has {len(row)} fields, the head has {len(names)}")
    while rows and not rows[-1]:
        rows.pop()
    if not all(rows):
        raise InputError(f"{path}, line {rows.index([]) + 2}: is empty; delete it")
    named = _named(path, names)
    columns = [list(values) for values in zip(*rows, strict=True)] or [[] for _ in named]
    return Rows(path, dict(zip(named, columns, strict=True)), 2)


def _from_parquet(path: Path) -> Rows:
    try:
        from pyarrow import ArrowException, parquet
    except ImportError as error:
        raise InputError(
            f"{path}: the package pyarrow is not installed; install the extra parquet of pyproject.toml, or save the "
            "table as CSV"
        ) from error
    try:
        table = parquet.read_table(path)
    except (ArrowException, OSError) as error:
        raise InputError(f"{path}: is no Parquet file ({str(error).splitlines()[0]})") from error
    return Rows(path, dict(zip(_named(path, table.column_names), map(list, table.to_pydict().values()), strict=True)))


def _named(path: Path, names: Iterable[Any]) -> list[str]:
    """Return column names in lower case, by one name each; raises `InputError` if two are the same."""
    known = [str(name).strip().lower() for name in names]
    known = [SYNONYMS.get(name, name) if SYNONYMS.get(name) not in known else name for name in known]
    twice = next((name for name in known if known.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"{path}: two columns are called {twice!r}; rename one")
    return known


def _from_json(path: Path) -> Rows:
    try:
        data = load_json(path)
    except (OSError, ValueError) as error:
        why = f"is no JSON ({error})" if isinstance(error, msgspec.DecodeError) else str(error)
        raise InputError(f"{path}: {why}; where there is no result, write null") from error
    lower: frozenset[str] = frozenset()
    if isinstance(data, dict) and "metrics" in data and isinstance(data["metrics"], list):
        lower = frozenset(
            str(one.get("id")) for one in data["metrics"] if isinstance(one, dict) and one.get("ascending") is False
        )
    rows = _json_rows(data, path)
    if not rows or not all(isinstance(row, dict) for row in rows):
        raise InputError(f"{path}: holds no rows; {FORMS}")
    names = list(dict.fromkeys(name for row in rows for name, value in row.items() if _is_plain(value)))
    columns = [[row.get(name) if _is_plain(row.get(name)) else None for row in rows] for name in names]
    return Rows(path, dict(zip(_named(path, names), columns, strict=True)), lower=lower)


def _is_plain(value: Any) -> bool:
    return value is None or isinstance(value, str | int | float)


def _json_rows(data: Any, path: Path) -> list[Any]:
    """Return the rows of each known form; none of any other."""
    if isinstance(data, list):
        nested = data and all(isinstance(one, dict) and isinstance(one.get("scenes"), dict) for one in data)
        return [row for one in data for row in _of_method(one)] if nested else data
    if not isinstance(data, dict):
        return []
    if isinstance(data.get("metrics"), dict):
        return [_of_scene_file(data, path)]
    if isinstance(data.get("scenes"), dict):
        return _of_method(data)
    for name in ("methods", "cells"):
        # our own summary lists the names of its methods beside its cells
        if isinstance(data.get(name), list) and all(isinstance(one, dict) for one in data[name]):
            return _json_rows(data[name], path)
    return []


def _of_method(one: dict[str, Any]) -> list[dict[str, Any]]:
    name = one.get("id", one.get("method", one.get("name")))
    scenes = one["scenes"].items()
    return [{**scores, "scene": scene, "method": name} for scene, scores in scenes if isinstance(scores, dict)]


def _of_scene_file(data: dict[str, Any], path: Path) -> dict[str, Any]:
    """Return the row of a result file of one method on one scene; older ones name their method by the folder alone."""
    info: dict[str, Any] = next((data[name] for name in ("nb_info", "info") if isinstance(data.get(name), dict)), {})
    places = [data.get("render_dataset_metadata"), info.get("dataset_metadata")]
    scenes = [place.get("scene") for place in places if isinstance(place, dict)]
    scene = next(filter(None, [*scenes, info.get("dataset_scene")]), path.stem)
    method = info.get("method") or path.parent.parent.name
    seconds = {"seconds": info["total_train_time"]} if "total_train_time" in info else {}
    return {**data["metrics"], **seconds, "scene": scene, "method": method}


KEYS = ("scene", "method", "seed", "steps", "seconds")
"""The columns that are no metric."""
LOWER = {name for name, metric in METRICS.items() if not metric.higher_is_better}
LOWER |= {"lpips", "rmse", "mse", "mae", "fid", "kid", "dists", "chamfer"}
"""The metrics that are better when lower, also as parts of a name: `lpips_vgg`."""
HIGHER = {"psnr", "ssim", "iou", "msssim", "accuracy", "f1"}
MARGINS = {name: metric.smallest_of_interest for name, metric in METRICS.items()} | {"lpips": 0.005}
"""The smallest effect of interest of each metric that has an agreed one."""
MOST_METHODS = 200
MOST_CELLS = 5_000_000
LARGEST = 1e12
"""The limit of scores: no score is larger, and the squares of all that are smaller are finite."""


@dataclass(frozen=True)
class ResultTable:
    """One metric of a user's results."""

    source: str
    metric: str
    higher_is_better: bool
    methods: list[str]
    scenes: list[str]
    seeds: list[str]
    """The seeds; a single one without a name if the table has no such column."""
    values: np.ndarray
    """The scores, [methods, scenes, seeds], NaN where there is none."""
    seconds: list[float | None]
    """The mean training seconds of each method."""
    steps: list[float | None]
    notes: list[str]
    """The notes for a reader on how it was read."""


def read_table(paths: Sequence[Path], metric: str | None = None, lower: Sequence[str] = ()) -> ResultTable:
    """Read a table; `metric` is psnr, else the first one, if it is not given. Raises `InputError` if it cannot be
    judged.
    """
    parts = [rows for path in paths for rows in read_rows(path)]
    for rows in parts:
        lacking = [name for name in ("scene", "method") if name not in rows.columns]
        if lacking:
            known = ", ".join(rows.columns) or "none"
            raise InputError(f"{rows.source}: has no column {' and no column '.join(lacking)} (columns: {known})")
        if not len(rows):
            raise InputError(f"{rows.source}: has a head and no rows")
    metrics = _metrics(parts)
    chosen = _chosen(metrics, metric, parts)
    names = {key: _names(parts, key) for key in ("method", "scene", "seed")}
    codes, known = zip(*(_coded(names[key]) for key in ("method", "scene", "seed")), strict=True)
    shape = tuple(len(one) for one in known)
    _check_shape(parts, shape)
    flat = np.asarray(np.ravel_multi_index(codes, shape))
    _refuse_duplicates(flat, parts, seeded="seed" in parts[0].columns)
    numbers = {name: _numbers(parts, name) for name in (chosen, "seconds", "steps")}
    values = np.full(shape, np.nan)
    values.ravel()[flat] = numbers[chosen]
    there = np.isfinite(values)
    methods, scenes = there.any(axis=(1, 2)), there.any(axis=(0, 2))
    _check_size(parts, int(methods.sum()), int(scenes.sum()))
    notes = [f"{name}: no result at all, left out." for name, has in zip(known[0], methods, strict=True) if not has]
    if others := [name for name in metrics if name != chosen]:
        notes.append(f"Other metrics in the table, not judged here (--metric): {', '.join(others)}.")
    higher, note = _direction(chosen, {one.lower() for one in lower}.union(*(rows.lower for rows in parts)))
    per_method = [
        [_mean(numbers[name][codes[0] == place]) for place in np.flatnonzero(methods)] for name in ("seconds", "steps")
    ]
    return ResultTable(
        source=", ".join(map(str, paths)),
        metric=chosen,
        higher_is_better=higher,
        methods=[known[0][place] for place in np.flatnonzero(methods)],
        scenes=[known[1][place] for place in np.flatnonzero(scenes)],
        seeds=known[2],
        values=values[methods][:, scenes],
        seconds=per_method[0],
        steps=per_method[1],
        notes=notes + note,
    )


def _metrics(parts: list[Rows]) -> list[str]:
    """Return columns whose first entry is a number, in their order."""
    found = []
    for name in dict.fromkeys(chain.from_iterable(rows.columns for rows in parts)):
        if name not in KEYS:
            values = (value for rows in parts for value in rows.columns.get(name, ()) if value not in (None, ""))
            first = next(values, None)
            if first is not None and _number(first) is not None:
                found.append(name)
    return found


def _chosen(metrics: list[str], asked: str | None, parts: list[Rows]) -> str:
    every = set(chain.from_iterable(rows.columns for rows in parts)) - set(KEYS)
    if asked is not None and asked.lower() not in every:
        raise InputError(f"--metric {asked}: no such column; metrics of the table: {', '.join(metrics) or 'none'}")
    if asked is not None:
        return asked.lower()
    if PRIMARY in every:
        return PRIMARY
    if not metrics:
        raise InputError(f"{parts[0].source}: has no column of numbers beside {', '.join(KEYS)}: nothing to judge")
    return metrics[0]


def _direction(metric: str, lower: set[str]) -> tuple[bool, list[str]]:
    """Return whether higher is better, and a note if nobody knows."""
    words = set(metric.replace("-", "_").split("_"))
    if metric in lower or metric in LOWER or words & LOWER:
        return False, []
    if words & HIGHER:
        return True, []
    return True, [f"{metric} is taken to be better when higher; give --lower {metric} where it is not."]


def _names(parts: list[Rows], key: str) -> list[str]:
    names: list[str] = []
    for rows in parts:
        column = rows.columns.get(key)
        if column is None:
            names += [""] * len(rows)
            continue
        found = [value if isinstance(value, str) else "" if value is None else str(value) for value in column]
        if key != "seed" and (empty := next((i for i, name in enumerate(found) if not name.strip()), None)) is not None:
            raise InputError(f"{rows.where(empty)}: has no {key}")
        names += found
    return names


def _coded(names: list[str]) -> tuple[np.ndarray, list[str]]:
    """Return each name's place among the distinct ones, in the order of their first appearance."""
    places: dict[str, int] = {}
    codes = np.fromiter((places.setdefault(name, len(places)) for name in names), np.int64, len(names))
    return codes, list(places)


def _numbers(parts: list[Rows], name: str) -> np.ndarray:
    """Return a column as numbers, NaN where it is empty; raises `InputError` at the first entry that is none."""
    return np.concatenate([_column(rows, name) for rows in parts])


def _column(rows: Rows, name: str) -> np.ndarray:
    values = rows.columns.get(name)
    if values is None:
        return np.full(len(rows), np.nan)
    empty = np.fromiter((value is None or value == "" for value in values), bool, len(values))
    try:
        found = np.array(["0" if none else value for value, none in zip(values, empty, strict=True)], dtype=np.float64)
        wrong = ~(np.abs(found) <= LARGEST)
        wrong |= np.fromiter((isinstance(value, bool) for value in values), bool, len(values))
    except (ValueError, TypeError, OverflowError):
        wrong = np.array([not none and _number(value) is None for value, none in zip(values, empty, strict=True)])
    if wrong.any():
        first = int(np.argmax(wrong))
        raise InputError(
            f"{rows.where(first)}: {name} is {values[first]!r}, no finite number within ±{LARGEST:g}; leave the field "
            "empty where there is no result"
        )
    return np.where(empty, np.nan, found)


def _number(value: Any) -> float | None:
    """Return `value` as a number of at most `LARGEST`, None if it is none."""
    if isinstance(value, bool):
        return None
    try:
        found = float(value)
    except (TypeError, ValueError, OverflowError):
        return None
    return found if abs(found) <= LARGEST else None


def _mean(values: np.ndarray) -> float | None:
    there = values[np.isfinite(values)]
    return float(there.mean()) if there.size else None


def _refuse_duplicates(flat: np.ndarray, parts: list[Rows], seeded: bool) -> None:
    order = np.argsort(flat, kind="stable")
    same = np.flatnonzero(np.diff(flat[order]) == 0)
    if same.size:
        second = int(order[same + 1].min())
        first = int(np.argmax(flat == flat[second]))
        what = "scene, method and seed" if seeded else "scene and method"
        remedy = "delete one" if seeded else "give repetitions a column seed, or delete one"
        raise InputError(f"{_where(parts, second)}: repeats {what} of {_where(parts, first)}; {remedy}")


def _where(parts: list[Rows], row: int) -> str:
    for rows in parts:
        if row < len(rows):
            return rows.where(row)
        row -= len(rows)
    raise IndexError(row)


def _check_shape(parts: list[Rows], shape: tuple[int, ...]) -> None:
    source = parts[0].source
    if shape[0] > MOST_METHODS:
        raise InputError(f"{source}: {shape[0]} methods are more than the {MOST_METHODS} that are compared in pairs")
    if math.prod(shape) > MOST_CELLS:
        raise InputError(
            f"{source}: {' × '.join(map(str, shape))} methods, scenes and seeds are more than {MOST_CELLS} cells; "
            "average views before"
        )


def _check_size(parts: list[Rows], methods: int, scenes: int) -> None:
    source = parts[0].source
    if methods < 2:
        raise InputError(f"{source}: has {methods} method{'s' * (methods != 1)} with results; a comparison needs two")
    if scenes < 2:
        raise InputError(f"{source}: has {scenes} scene with results; how much scenes differ is not known below two")
