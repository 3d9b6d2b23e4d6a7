"""Files of results (CSV, Parquet, JSON, result files of nerfbaselines) → one metric by method, scene and seed.

An ambiguous table is refused with a one-line message.
"""

import csv
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from harness.records.json_record import LARGEST_FILE, load_json
from harness.records.metric_table import METRICS, POSSIBLE, PRIMARY
from scenes.files.errors import InputError

SYNONYMS = {"train_seconds": "seconds", "train_core_seconds": "core_seconds", "total_train_time": "seconds"}
"""The names of `seconds` and `core_seconds` in nerfbaselines and in the summary of a run."""
GIVEN = Path("the given table")
"""The name of a table in memory in messages."""
FORMS = (
    "JSON must be a list of rows {scene, method, psnr, …}, {cells: such rows}, {method, scenes: {scene: {metric: "
    "value}}} or a result file of nerfbaselines"
)


@dataclass(frozen=True)
class Rows:
    """The rows of one or several files, as columns of equal length."""

    columns: dict[str, list[object]]
    stretches: list[tuple[Path, int, int]]
    """The path of each file, its number of rows, and the number of its first row: line 2 of a file with a header."""
    lower: frozenset[str] = frozenset()
    """The metrics that a file itself declares to be better when lower."""

    def __len__(self) -> int:
        return sum(many for _, many, _ in self.stretches)

    def where(self, row: int) -> str:
        for path, many, first in self.stretches:
            if row < many:
                return f"{path}, {'line' if first > 1 else 'row'} {row + first}"
            row -= many
        raise IndexError(row)


def read_rows(paths: Iterable[Path]) -> Rows:
    """Read the rows of files, and of all JSON files below folders; raises `InputError` for a file without a table."""
    return _join([_from_file(file) for path in paths for file in _files(path)])


def rows_given(rows: Sequence[Mapping[str, object]]) -> Rows:
    """Return rows in memory, where None is a missing value, with the errors of `read_rows`."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    return _join([_rows(GIVEN, names, [[row.get(name) for row in rows] for name in names])])


def _join(parts: list[Rows]) -> Rows:
    for part in parts:
        source = part.stretches[0][0]
        if lacking := [name for name in ("scene", "method") if name not in part.columns]:
            known = ", ".join(part.columns) or "none"
            raise InputError(f"{source}: has no column {' and no column '.join(lacking)} (columns: {known})")
        if not len(part):
            raise InputError(f"{source}: has a header and no rows")
    names = dict.fromkeys(name for part in parts for name in part.columns)
    columns = {
        name: [value for part in parts for value in part.columns.get(name) or [None] * len(part)] for name in names
    }
    return Rows(columns, [part.stretches[0] for part in parts], frozenset().union(*(part.lower for part in parts)))


def _files(path: Path) -> list[Path]:
    if path.is_dir():
        files = sorted(path.rglob("*.json"))
        if not files:
            raise InputError(f"{path}: holds no .json file; give a table, or a folder of nerfbaselines' result files")
        return files
    if not path.is_file():
        raise InputError(f"{path}: no such file; give a table as CSV, Parquet or JSON")
    if (size := path.stat().st_size) > LARGEST_FILE:
        raise InputError(f"{path}: has {size} bytes, more than the {LARGEST_FILE} that are read; leave columns out")
    return [path]


def _from_file(path: Path) -> Rows:
    readers: dict[str, Callable[[Path], Rows]] = {".json": _from_json, ".parquet": _from_parquet}
    return readers.get(path.suffix.lower(), _from_csv)(path)


def _rows(
    path: Path,
    names: Iterable[object],
    columns: list[list[object]],
    first: int = 1,
    lower: frozenset[str] = frozenset(),
) -> Rows:
    """Return rows with lower-case column names, synonyms replaced; raises `InputError` if two names are equal."""
    known = [str(name).strip().lower() for name in names]
    known = [SYNONYMS.get(name, name) if SYNONYMS.get(name) not in known else name for name in known]
    twice = next((name for name in known if known.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"{path}: two columns are called {twice!r}; rename one")
    many = len(columns[0]) if columns else 0
    return Rows(dict(zip(known, columns, strict=True)), [(path, many, first)], lower)


def _from_csv(path: Path) -> Rows:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            head = file.readline()
            mark = max(",;\t", key=head.count)
            lines = list(csv.reader([head], delimiter=mark)) + list(csv.reader(file, delimiter=mark))
    except (csv.Error, UnicodeDecodeError) as error:
        raise InputError(f"{path}: is not a CSV file in UTF-8 ({error})") from error
    names, *rows = lines or [[]]
    for place, row in enumerate(rows):
        if row and len(row) != len(names):
            raise InputError(f"{path}, line {place + 2}: has {len(row)} fields, the header has {len(names)}")
    while rows and not rows[-1]:
        rows.pop()
    if not all(rows):
        raise InputError(f"{path}, line {rows.index([]) + 2}: is empty; delete it")
    return _rows(path, names, [list(values) for values in zip(*rows, strict=True)] or [[] for _ in names], 2)


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
        raise InputError(f"{path}: is not a Parquet file ({str(error).splitlines()[0]})") from error
    return _rows(path, table.column_names, [list(values) for values in table.to_pydict().values()])


def _from_json(path: Path) -> Rows:
    try:
        data = load_json(path)
    except (OSError, ValueError) as error:
        why = f"is not JSON ({error})" if isinstance(error, msgspec.DecodeError) else str(error)
        raise InputError(f"{path}: {why}; write null for a missing result") from error
    metrics = data.get("metrics") if isinstance(data, dict) else None
    declared = [each for each in metrics if isinstance(each, dict)] if isinstance(metrics, list) else []
    lower = frozenset(str(each.get("id")) for each in declared if each.get("ascending") is False)
    rows = _json_rows(data, path)
    if not rows or not all(isinstance(row, dict) for row in rows):
        raise InputError(f"{path}: holds no rows; {FORMS}")
    names = list(dict.fromkeys(name for row in rows for name, value in row.items() if _is_plain(value)))
    columns = [[row.get(name) if _is_plain(row.get(name)) else None for row in rows] for name in names]
    return _rows(path, names, columns, lower=lower)


def _is_plain(value: object) -> bool:
    return value is None or isinstance(value, str | int | float)


def _json_rows(data: Any, path: Path) -> list[Any]:
    if isinstance(data, list):
        nested = data and all(isinstance(each, dict) and isinstance(each.get("scenes"), dict) for each in data)
        return [row for each in data for row in _of_method(each)] if nested else data
    if not isinstance(data, dict):
        return []
    if isinstance(data.get("metrics"), dict):
        return [_of_scene_file(data, path)]
    if isinstance(data.get("scenes"), dict):
        return _of_method(data)
    for name in ("methods", "cells"):
        # a run's summary has a list of method names besides its cells
        if isinstance(data.get(name), list) and all(isinstance(each, dict) for each in data[name]):
            return _json_rows(data[name], path)
    return []


def _of_method(row: dict[str, Any]) -> list[dict[str, Any]]:
    name = row.get("id", row.get("method", row.get("name")))
    scenes = row["scenes"].items()
    return [{**scores, "scene": scene, "method": name} for scene, scores in scenes if isinstance(scores, dict)]


def _of_scene_file(data: dict[str, Any], path: Path) -> dict[str, Any]:
    """Return the row of a result file of one method on one scene; older files name the method only by the folder."""
    info: dict[str, Any] = next((data[name] for name in ("nb_info", "info") if isinstance(data.get(name), dict)), {})
    places = [data.get("render_dataset_metadata"), info.get("dataset_metadata")]
    scenes = [place.get("scene") for place in places if isinstance(place, dict)]
    scene = next(filter(None, [*scenes, info.get("dataset_scene")]), path.stem)
    method = info.get("method") or path.parent.parent.name
    seconds = {"seconds": info["total_train_time"]} if "total_train_time" in info else {}
    return {**data["metrics"], **seconds, "scene": scene, "method": method}


KEYS = ("scene", "method", "seed", "steps", "seconds", "core_seconds")
"""The columns that are not metrics."""
LOWER = {name for name, metric in METRICS.items() if not metric.higher_is_better}
LOWER |= {"rmse", "mse", "mae", "fid", "kid", "dists", "chamfer"}
"""The metrics that are better when lower, also as part of a name, as in `lpips_vgg`."""
HIGHER = {"psnr", "ssim", "iou", "msssim", "accuracy", "f1"}
MARGINS = {name: metric.smallest_of_interest for name, metric in METRICS.items()}
"""The smallest effect of interest of each known metric."""
MOST_METHODS = 200
MOST_CELLS = 5_000_000
LARGEST = 1e12
"""The limit of scores, whose squares are finite."""


@dataclass(frozen=True)
class ResultTable:
    source: str
    metric: str
    higher_is_better: bool
    methods: list[str]
    scenes: list[str]
    seeds: list[str]
    """The seeds; a single empty name if the table has no such column."""
    values: np.ndarray
    """The scores [methods, scenes, seeds], NaN for a missing one."""
    seconds: list[float | None]
    """The mean training seconds of each method."""
    core_seconds: list[float | None]
    steps: list[float | None]
    notes: list[str]


def read_table(paths: Sequence[Path], metric: str | None = None, lower: Sequence[str] = ()) -> ResultTable:
    """Read a table; `metric` defaults to psnr, else to the first. Raises `InputError` if it cannot be judged."""
    return replace(table_of(read_rows(paths), metric, lower), source=", ".join(map(str, paths)))


def table_of(rows: Rows, metric: str | None = None, lower: Sequence[str] = ()) -> ResultTable:
    """Return one metric of `rows`, as `read_table` does for files."""
    source = rows.stretches[0][0]
    metrics = [name for name in rows.columns if name not in KEYS and _holds_numbers(rows.columns[name])]
    chosen = _choose(rows, metrics, metric)
    codes, known = zip(*(_encode(rows, key) for key in ("method", "scene", "seed")), strict=True)
    shape = tuple(map(len, known))
    if shape[0] > MOST_METHODS:
        raise InputError(f"{source}: {shape[0]} methods are more than the {MOST_METHODS} that are compared in pairs")
    if math.prod(shape) > MOST_CELLS:
        size = " × ".join(map(str, shape))
        raise InputError(
            f"{source}: {size} methods, scenes and seeds are more than {MOST_CELLS} cells; average views before"
        )
    flat = np.asarray(np.ravel_multi_index(codes, shape))
    _refuse_duplicates(flat, rows)
    if unknown := [name for name in lower if name.lower() not in rows.columns]:
        raise InputError(f"--lower {unknown[0]}: no such column; metrics of the table: {', '.join(metrics)}")
    scores, *spent = (_numbers(rows, name) for name in (chosen, "seconds", "core_seconds", "steps"))
    _refuse_impossible(rows, chosen, scores)
    values = np.full(shape, np.nan)
    values.ravel()[flat] = scores
    there = np.isfinite(values)
    has_method, has_scene = there.any(axis=(1, 2)), there.any(axis=(0, 2))
    methods, scenes = np.flatnonzero(has_method), np.flatnonzero(has_scene)
    if len(methods) < 2:
        many = f"{len(methods)} method{'s' * (len(methods) != 1)}"
        raise InputError(f"{source}: has {many} with results; a comparison needs two")
    if len(scenes) < 2:
        raise InputError(f"{source}: has {len(scenes)} scene with results; the spread of scenes is not known below two")
    seconds, core_seconds, steps = ([_mean(each[codes[0] == place]) for place in methods] for each in spent)
    notes = [f"{name}: has no result, left out." for name, has in zip(known[0], has_method, strict=True) if not has]
    if others := [name for name in metrics if name != chosen]:
        notes.append(f"Other metrics in the table, not judged here (--metric): {', '.join(others)}.")
    higher, note = _direction(chosen, {name.lower() for name in lower} | rows.lower)
    return ResultTable(
        source=str(source),
        metric=chosen,
        higher_is_better=higher,
        methods=[known[0][place] for place in methods],
        scenes=[known[1][place] for place in scenes],
        seeds=known[2],
        values=values[has_method][:, has_scene],
        seconds=seconds,
        core_seconds=core_seconds,
        steps=steps,
        notes=notes + note,
    )


def _holds_numbers(values: list[object]) -> bool:
    first = next((value for value in values if value not in (None, "")), None)
    return first is not None and _number(first) is not None


def _choose(rows: Rows, metrics: list[str], metric: str | None) -> str:
    every = rows.columns.keys() - set(KEYS)
    if metric is not None and metric.lower() not in every:
        raise InputError(f"--metric {metric}: no such column; metrics of the table: {', '.join(metrics) or 'none'}")
    if metric is not None:
        return metric.lower()
    if PRIMARY in every:
        return PRIMARY
    if not metrics:
        source = rows.stretches[0][0]
        raise InputError(f"{source}: has no column of numbers other than {', '.join(KEYS)}: nothing to judge")
    return metrics[0]


def _direction(metric: str, lower: set[str]) -> tuple[bool, list[str]]:
    """Return whether higher is better, and a note if that is a guess."""
    parts = set(metric.replace("-", "_").split("_"))
    if metric in lower or metric in LOWER or parts & LOWER:
        return False, []
    if parts & HIGHER:
        return True, []
    return True, [f"{metric} is taken to be better when higher; give --lower {metric} if it is not."]


def _encode(rows: Rows, key: str) -> tuple[np.ndarray, list[str]]:
    """Return for each row the index of its name among the distinct names, in the order of their first appearance."""
    column = rows.columns.get(key) or [None] * len(rows)
    places: dict[str, int] = {}
    codes = []
    for row, value in enumerate(column):
        name = "" if value is None else str(value)
        if key != "seed" and not name.strip():
            raise InputError(f"{rows.where(row)}: has no {key}")
        codes.append(places.setdefault(name, len(places)))
    return np.array(codes, dtype=np.int64), list(places)


def _numbers(rows: Rows, name: str) -> np.ndarray:
    """Return a column as numbers, NaN for an empty field; raises `InputError` at the first other entry."""
    column = rows.columns.get(name) or [None] * len(rows)
    numbers = [math.nan if value is None or value == "" else _number(value) for value in column]
    if None in numbers:
        first = numbers.index(None)
        raise InputError(
            f"{rows.where(first)}: {name} is {column[first]!r}, not a finite number within ±{LARGEST:g}; leave the "
            "field empty for a missing result"
        )
    return np.array(numbers, dtype=np.float64)


def _refuse_impossible(rows: Rows, name: str, scores: np.ndarray) -> None:
    low, high = POSSIBLE.get(name, (-math.inf, math.inf))
    wrong = np.flatnonzero((scores < low) | (scores > high))
    if wrong.size:
        first = int(wrong[0])
        raise InputError(
            f"{rows.where(first)}: {name} is {scores[first]:g}, but lies between {low:g} and {high:g} for any two "
            "images; correct it, or give the column another name"
        )


def _number(value: Any) -> float | None:
    if isinstance(value, bool):
        return None
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        return None
    return number if abs(number) <= LARGEST else None


def _mean(values: np.ndarray) -> float | None:
    there = values[np.isfinite(values)]
    return float(there.mean()) if there.size else None


def _refuse_duplicates(flat: np.ndarray, rows: Rows) -> None:
    order = np.argsort(flat, kind="stable")
    same = np.flatnonzero(np.diff(flat[order]) == 0)
    if same.size:
        second = int(order[same + 1].min())
        first = int(np.argmax(flat == flat[second]))
        seeded = "seed" in rows.columns
        what = "scene, method and seed" if seeded else "scene and method"
        remedy = "delete one" if seeded else "give repetitions a column seed, or delete one"
        raise InputError(f"{rows.where(second)}: repeats {what} of {rows.where(first)}; {remedy}")
