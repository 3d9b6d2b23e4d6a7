"""Rows of results → one metric by method, scene and seed. An ambiguous table is refused with a one-line message."""

import math
import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from harness.records.metric_table import METRICS, PRIMARY, possible_range
from harness.verdicts.tables.files import read_rows
from harness.verdicts.tables.headers import (
    HIGHER,
    INVERTED,
    LOWER,
    WEAK_AVERAGE,
    bare,
    is_aside,
    is_average,
    is_data_set,
    may_be_average,
    metric_of,
)
from harness.verdicts.tables.numbers import LARGEST, decimals, is_column_of_numbers, is_missing, number
from harness.verdicts.tables.rows import Rows
from scenes.files.errors import InputError

PROTOCOL = (
    "width", "resolution", "downscale", "downsample", "factor", "views", "view_set", "split", "colour_space",
    "color_space", "background",
)  # fmt: skip
"""The columns that say how a score was made: scores of a scene that differ in one are not comparable."""
ORIGINS = ("source", *PROTOCOL)
"""The columns that say where a score comes from, shown with each method."""
KEYS = ("scene", "method", "seed", "steps", "seconds", "core_seconds", *ORIGINS)
"""The columns that are not metrics."""
MARGINS = {name: metric.smallest_of_interest for name, metric in METRICS.items()}
"""The smallest effect of interest of each known metric."""
MOST_ORIGINS = 3
"""The maximum number of different values of an origin that are listed for a method."""
MOST_METHODS = 200
MOST_CELLS = 5_000_000
FINE = 0.02
"""The largest rounding, as a share of the usual distance of a scene from the mean, at which values tell a mean."""
LEAST_AVERAGED = 3
"""The minimum number of scenes whose mean another scene can be found to be."""


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
    read_as: str = ""
    """The table in one sentence, as it was understood."""
    origins: list[str] = field(default_factory=list)
    """Where each method's scores come from: its file if there are several, `source` and the protocol."""
    other_metrics: list[str] = field(default_factory=list)


def read_table(
    paths: Sequence[Path], metric: str | None = None, lower: Sequence[str] = (), methods: Sequence[str] = ()
) -> ResultTable:
    """Read a table; `metric` defaults to psnr, else to the first. Raises `InputError` if it cannot be judged."""
    return replace(table_of(read_rows(paths, metric), metric, lower, methods), source=", ".join(map(str, paths)))


def table_of(
    rows: Rows, metric: str | None = None, lower: Sequence[str] = (), methods: Sequence[str] = ()
) -> ResultTable:
    """Return one metric of `rows`, as `read_table` does for files; only of the named `methods` if there are any."""
    source = rows.source
    metrics = [name for name in rows.columns if name not in KEYS and is_column_of_numbers(rows.columns[name])]
    chosen = _choose(rows, metrics, metric)
    for name in lower:
        if name.lower() not in rows.columns:
            raise InputError(f"--lower {name}: no such column; metrics of the table: {', '.join(metrics)}")
        if name.lower() in HIGHER or (name.lower(), "↑") in rows.arrows:
            raise InputError(f"--lower {name}: is better when higher (by its name or arrow); drop it, or rename it")
    of_rows = [_encode(rows, key) for key in ("method", "scene", "seed")]
    values = _values(rows, chosen, of_rows)
    spent, unread = zip(*(_spent(rows, name) for name in ("seconds", "core_seconds", "steps")), strict=True)
    names, scenes, seeds = (encoded.names for encoded in of_rows)
    averages, of_methods = _averages(scenes, values), _averages(names, values.swapaxes(0, 1), by_value=False)
    kept_scenes = [k for k in range(len(scenes)) if k not in averages and np.isfinite(values[:, k]).any()]
    there = np.isfinite(values[:, kept_scenes]).any(axis=(1, 2))
    if unknown := [name for name in methods if name not in names]:
        raise InputError(f"--methods {unknown[0]}: no such method; methods of the table: {', '.join(names)}")
    asked = [names.index(name) for name in dict.fromkeys(methods)] or [*range(len(names))]
    kept = [k for k in asked if there[k] and k not in of_methods]
    lacking = [names[k] for k in asked if not there[k]]
    lacking += [name for k, name in enumerate(scenes) if not np.isfinite(values[:, k]).any()]
    notes = [f"Left out: {why}." for why in unread if why]
    notes += [f"Without any result, left out: {', '.join(lacking)}."] if lacking else []
    if len(kept) < 2:
        many = f"{len(kept)} method{'s' * (len(kept) != 1)}"
        raise InputError(f"{source}: has {many} with results; a comparison needs two: add those of others")
    has = np.isfinite(values[kept][:, kept_scenes]).any(axis=2).astype(int)
    if len(kept_scenes) > 1 and int(np.triu(has @ has.T, 1).max()) < 2:
        raise InputError(f"{source}: no two methods have two scenes in common: the spread of scenes is not known")
    if len(kept_scenes) < 2:
        many = f"{len(kept_scenes)} scene{'s' * (len(kept_scenes) != 1)}"
        raise InputError(f"{source}: has {many} with results; the spread of scenes is not known below two")
    higher, guess = _direction(rows, chosen, {name.lower() for name in lower})
    seconds, core_seconds, steps = ([_mean(each[of_rows[0].codes == k]) for k in kept] for each in spent)
    notes += _shared_cells(rows, of_rows)
    size = f"{len(kept)} methods × {len(kept_scenes)} scenes"
    size += f" × {len(seeds)} seeds" if len(seeds) > 1 else ""
    notes += [
        f"{scenes[k]} is taken for a scene: its values are no means of the others."
        for k in kept_scenes
        if bare(scenes[k]) in WEAK_AVERAGE
    ]
    if of_data := ", ".join(scenes[k] for k in kept_scenes if is_data_set(scenes[k])):
        notes.append(f"Means of data sets are taken for scenes, but vary less: {of_data}. Give results by scene.")
    means = [*rows.averages, *(scenes[k] for k in averages), *(names[k] for k in of_methods)]
    left_out = f"; left out as means of the others: {', '.join(means)}" if means else ""
    return ResultTable(
        source=str(source),
        metric=chosen,
        higher_is_better=higher,
        methods=[names[k] for k in kept],
        scenes=[scenes[k] for k in kept_scenes],
        seeds=seeds,
        values=values[kept][:, kept_scenes],
        seconds=seconds,
        core_seconds=core_seconds,
        steps=steps,
        notes=[*(note for encoded in of_rows for note in encoded.notes), *rows.notes, *notes, *guess],
        read_as=f"Read as {size}, {chosen} {'↑' if higher else '↓'}{left_out}",
        origins=[_origin(rows, np.flatnonzero(of_rows[0].codes == k).tolist()) for k in kept],
        other_metrics=[name for name in metrics if name != chosen],
    )


def _shared_cells(rows: Rows, of_rows: Sequence["_Encoded"]) -> list[str]:
    """Name the methods whose results on one scene come from several files: they may be two methods."""
    method, scene, _ = of_rows
    files: dict[tuple[int, ...], dict[str, None]] = {}
    for *cell, (file, _, _) in zip(method.codes.tolist(), scene.codes.tolist(), rows.places, strict=True):
        files.setdefault(tuple(cell), {})[str(file)] = None
    several = {method.names[cell[0]]: " and ".join(paths) for cell, paths in files.items() if len(paths) > 1}
    return [f"{name}: the results in {where} are taken as those of one method." for name, where in several.items()]


def _origin(rows: Rows, of_method: list[int]) -> str:
    parts: list[str] = []
    if len({path for path, _, _ in rows.places}) > 1:
        parts += dict.fromkeys(rows.places[row][0].name for row in of_method)
    for name in (column for column in ORIGINS if column in rows.columns):
        values = dict.fromkeys(str(v) for row in of_method if not is_missing(v := rows.columns[name][row]))
        shown = ", ".join(values) if len(values) <= MOST_ORIGINS else f"{len(values)} different"
        parts += [shown if name == "source" else f"{name} {shown}"] if values else []
    return "; ".join(parts)


def _values(rows: Rows, chosen: str, of_rows: Sequence["_Encoded"]) -> np.ndarray:
    """Return the scores [methods, scenes, seeds], NaN for a missing one."""
    source = rows.source
    shape = tuple(len(encoded.names) for encoded in of_rows)
    if shape[0] > MOST_METHODS:
        raise InputError(f"{source}: {shape[0]} methods are more than the {MOST_METHODS} that are compared in pairs")
    if math.prod(shape) > MOST_CELLS:
        size = " × ".join(map(str, shape))
        raise InputError(
            f"{source}: {size} methods, scenes and seeds are more than {MOST_CELLS} cells; average views before"
        )
    flat = np.asarray(np.ravel_multi_index([encoded.codes for encoded in of_rows], shape))
    _refuse_duplicates(flat, rows)
    _refuse_other_protocols(rows, of_rows[1])
    scores = _numbers(rows, chosen)
    low, high = possible_range(chosen)
    if (wrong := np.flatnonzero((scores < low) | (scores > high))).size:
        raise InputError(
            f"{rows.where(int(wrong[0]))}: {chosen} is {scores[wrong[0]]:g}, but lies between {low:g} and {high:g} for "
            "any two images; correct it, or give the column another name"
        )
    values = np.full(shape, np.nan)
    values.ravel()[flat] = scores
    return values


def _averages(scenes: list[str], values: np.ndarray, by_value: bool = True) -> list[int]:
    """Return the scenes that are means of the others: by name, or, at either end of the table, by all their values if
    `by_value`; for methods, `values` is turned.
    """
    # a scene may have its data set before it
    named = [k for k, name in enumerate(scenes) if any(map(is_average, name.split("/") if by_value else [name]))]
    weak = [k for k, name in enumerate(scenes) if may_be_average(name) and k not in named]
    others = [k for k in range(len(scenes)) if k not in named]
    if len(others) <= LEAST_AVERAGED or len(values) < 2:
        return named
    cells = scene_means(values)
    tolerance = 1.01 * 10.0 ** -decimals(cells[np.isfinite(cells)].tolist())
    for place in dict.fromkeys([*weak, *((others[0], others[-1]) if by_value else ())]):
        rest = [k for k in others if k != place]
        complete = np.isfinite(cells[:, [place, *rest]]).all(axis=1)
        if complete.sum() < 2:
            continue
        means = cells[complete][:, rest].mean(axis=1)
        # of coarsely printed numbers, a scene may agree with the mean by chance
        usual = float(np.median(np.abs(cells[complete][:, rest] - means[:, None])))
        is_fine = tolerance <= FINE * usual or place in weak
        if is_fine and (np.abs(cells[complete, place] - means) <= tolerance).all():
            return sorted([*named, place])
    return named


def _choose(rows: Rows, metrics: list[str], metric: str | None) -> str:
    every = rows.columns.keys() - set(KEYS)
    if metric is not None and metric.lower() not in every:
        raise InputError(f"--metric {metric}: no such column; metrics of the table: {', '.join(metrics) or 'none'}")
    if metric is not None:
        return metric.lower()
    if PRIMARY in every:
        return PRIMARY
    metrics = [name for name in metrics if name and not is_aside(name)]
    if not metrics:
        source = rows.source
        raise InputError(f"{source}: has no column of numbers other than {', '.join(KEYS)}: nothing to judge")
    # a name that holds it, if not that of training views
    return next((name for name in metrics if PRIMARY in name and "train" not in name), metrics[0])


def _direction(rows: Rows, metric: str, lower: set[str]) -> tuple[bool, list[str]]:
    """Return whether higher is better, and a note if that is a guess; raises `InputError` for arrows of both kinds."""
    arrows = {arrow for name, arrow in rows.arrows if name == metric}
    if len(arrows) > 1:
        raise InputError(f"{rows.source}: marks {metric} as ↑ and as ↓; correct one of the arrows")
    if metric in lower or arrows:
        return arrows == {"↑"}, []
    turned = INVERTED.match(metric)
    rest = metric[turned.end() :] if turned else metric
    parts = set(re.split(r"[\s_-]+", rest))
    if rest in LOWER or parts & LOWER:
        return bool(turned), []
    if parts & HIGHER:
        return not turned, []
    return True, [f"{metric} is taken to be better when higher; give --lower {shlex.quote(metric)} if it is not."]


@dataclass(frozen=True)
class _Encoded:
    """A column of names as numbers."""

    codes: np.ndarray
    """The index of each row's name among the distinct names."""
    names: list[str]
    """In the order of their first appearance."""
    notes: list[str]


def _encode(rows: Rows, key: str) -> _Encoded:
    """Encode a column of names; names that differ only in capitals or blanks, and the seeds 0 and 0.0, are equal."""
    column = rows.columns.get(key) or [None] * len(rows)
    spellings: dict[str, dict[str, None]] = {}
    codes, places = [], dict[str, int]()
    for row, value in enumerate(column):
        name = "" if value is None else str(value)
        if key != "seed" and not name.strip():
            raise InputError(f"{rows.where(row)}: has no {key}")
        as_number = number(value) if key == "seed" else None
        same = " ".join(name.split()).casefold()
        if as_number is not None:
            same = f"{as_number:.0f}" if as_number.is_integer() else repr(as_number)
        spellings.setdefault(same, {})[name] = None
        codes.append(places.setdefault(same, len(places)))
    notes = [
        f"Taken as one {key}: {', '.join(map(repr, several))}."
        for several in spellings.values()
        if len(several) > 1 and key != "seed"
    ]
    names = [same if key == "seed" else " ".join(next(iter(several)).split()) for same, several in spellings.items()]
    return _Encoded(np.array(codes, dtype=np.int64), names, notes)


def _refuse_other_protocols(rows: Rows, of_scenes: _Encoded) -> None:
    """Raise `InputError` if scores of one scene come from pictures of different sizes, views, or colours."""
    for name in (column for column in PROTOCOL if column in rows.columns):
        first: dict[int, int] = {}
        for row, value in enumerate(rows.columns[name]):
            if is_missing(value):
                continue
            other = first.setdefault(int(of_scenes.codes[row]), row)
            if str(value) != str(rows.columns[name][other]):
                raise InputError(
                    f"{rows.where(row)}: {name} of {of_scenes.names[of_scenes.codes[row]]} is {value}, and "
                    f"{rows.columns[name][other]} in {rows.where(other)}: such scores cannot be compared; score all "
                    f"pictures with one {name}"
                )


def _numbers(rows: Rows, name: str) -> np.ndarray:
    """Return a column as numbers, NaN for an empty field; raises `InputError` at the first other entry."""
    column = rows.columns.get(name) or [None] * len(rows)
    numbers = [math.nan if is_missing(value) else number(value) for value in column]
    if None in numbers:
        first = numbers.index(None)
        raise InputError(
            f"{rows.where(first)}: {name} is {column[first]!r}, not a finite number within ±{LARGEST:g}; leave the "
            "field empty for a missing result"
        )
    return np.array(numbers, dtype=np.float64)


def _spent(rows: Rows, name: str) -> tuple[np.ndarray, str]:
    """Return a column that is shown beside the verdict as numbers; all NaN, and why, if it has other entries."""
    try:
        return _numbers(rows, name), ""
    except InputError as error:
        return np.full(len(rows), np.nan), str(error)


def scene_means(values: np.ndarray) -> np.ndarray:
    """Return the means [methods, scenes] over the known seeds of [methods, scenes, seeds]; NaN without a seed."""
    there = np.isfinite(values)
    counts = there.sum(axis=2)
    return np.where(counts > 0, np.where(there, values, 0.0).sum(axis=2) / np.maximum(counts, 1), np.nan)


def _mean(values: np.ndarray) -> float | None:
    there = values[np.isfinite(values)]
    return float(there.mean()) if there.size else None


def _is_score(rows: Rows, name: str) -> bool:
    """Return whether a column holds scores, rather than what tells rows apart: names, or whole numbers."""
    values = [number(value) for value in rows.columns[name]]
    return bool(metric_of(name)) or (
        None not in values and not all(float(value).is_integer() for value in values if value)
    )


def _refuse_duplicates(flat: np.ndarray, rows: Rows) -> None:
    order = np.argsort(flat, kind="stable")
    same = np.flatnonzero(np.diff(flat[order]) == 0)
    if same.size:
        second = int(order[same + 1].min())
        first = int(np.argmax(flat == flat[second]))
        seeded = "seed" in rows.columns
        what = "scene, method and seed" if seeded else "scene and method"
        remedy = "delete one" if seeded else "give repetitions a column seed, or delete one"
        texts = {name: [str(values[row]) for row in (first, second)] for name, values in rows.columns.items()}
        differing = [name for name, (one, other) in texts.items() if one != other and not _is_score(rows, name)]
        if rows.places[first][0] != rows.places[second][0]:
            remedy = "keep one of the files, or put each run into a folder seed_1, seed_2, …"
        elif differing:
            one, other = texts[differing[0]]
            remedy = f"they differ in {differing[0]} ({one}, {other}): keep the rows of one, or call that column seed"
        raise InputError(f"{rows.where(second)}: repeats {what} of {rows.where(first)}; {remedy}")
