"""Columns of results → one metric by method, scene and seed; whatever makes a table ambiguous is refused in a line."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from harness.comparisons import METRICS, PRIMARY
from harness.judge.rows import Rows, read_rows
from scenes.errors import InputError

KEYS = ("scene", "method", "seed", "steps", "seconds")
"""Columns that are no metric."""
LOWER = frozenset(
    ("lpips", "flip", "rmse", "mse", "mae", "delta_e", "depth_rmse", "rmse_linear", "fid", "kid", "dists", "chamfer")
)
"""Metrics that are better when lower, also as parts of a name: `lpips_vgg`."""
HIGHER = frozenset(("psnr", "ssim", "iou", "msssim", "accuracy", "f1"))
MARGINS = {name: metric.smallest_of_interest for name, metric in METRICS.items()} | {"lpips": 0.005}
"""Smallest effect of interest of each metric that has an agreed one."""
MOST_METHODS = 200
MOST_CELLS = 5_000_000
LARGEST = 1e12
"""No score is larger, and the squares of all that are smaller are finite."""


@dataclass(frozen=True)
class Table:
    """One metric of somebody's results."""

    source: str
    metric: str
    higher_is_better: bool
    methods: list[str]
    scenes: list[str]
    seeds: list[str]
    """A single one without a name where the table has no such column."""
    values: np.ndarray
    """[methods, scenes, seeds], NaN where there is none."""
    seconds: list[float | None]
    """Mean training seconds of each method."""
    steps: list[float | None]
    notes: list[str]
    """What a reader must know of how it was read."""


def read_table(paths: Sequence[Path], metric: str | None = None, lower: Sequence[str] = ()) -> Table:
    """`metric` is psnr, else the first one, where it is not given; raises `InputError` for what cannot be judged."""
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
    return Table(
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
    """Columns whose first entry is a number, in their order."""
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
    """Whether higher is better, and what is said where nobody knows."""
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
    """Each name's place among the distinct ones, in the order of their first appearance."""
    places: dict[str, int] = {}
    codes = np.fromiter((places.setdefault(name, len(places)) for name in names), np.int64, len(names))
    return codes, list(places)


def _numbers(parts: list[Rows], name: str) -> np.ndarray:
    """A column as numbers, NaN where it is empty; raises `InputError` at the first entry that is none."""
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
    """`value` as a number of at most `LARGEST`, None where it is none."""
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
