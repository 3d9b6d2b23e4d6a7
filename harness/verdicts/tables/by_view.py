"""Rows of single views → rows of cells: scores are means over the views, and scenes stay the units of a verdict."""

import statistics
from collections import defaultdict
from dataclasses import replace

from harness.verdicts.tables.numbers import is_column_of_numbers, is_missing, number
from harness.verdicts.tables.rows import Rows
from scenes.files.errors import InputError

VIEW = (
    "view", "image", "frame", "view_name", "image_name", "img", "img_name", "view_id", "image_id", "frame_id",
    "frame_idx", "filename",
)  # fmt: skip
"""The names of a column of views, the preferred one first."""
CELL = ("method", "scene", "seed")


def over_views(rows: Rows) -> Rows:
    """Return the mean of each cell over a column of views; rows without one, or with only one row per cell, are
    returned as they are. Raises `InputError` for a view that is listed twice, that a method of the scene lacks, or that
    has no score.
    """
    name = next((name for name in VIEW if name in rows.columns), None)
    if name is None:
        return rows
    keys = [key for key in CELL if key in rows.columns]
    cells: dict[tuple[str, ...], dict[str, int]] = defaultdict(dict)
    for row, view in enumerate(rows.columns[name]):
        views = cells[tuple(str(rows.columns[key][row]) for key in keys)]
        if str(view) in views:
            raise InputError(f"{rows.where(row)}: repeats {name} {view} of {rows.where(views[str(view)])}; delete one")
        views[str(view)] = row
    if len(cells) == len(rows):
        return rows
    _require_same_views(rows, name, cells)
    firsts = [min(views.values()) for views in cells.values()]
    columns: dict[str, list[object]] = {}
    for column, values in rows.columns.items():
        if column == name:
            continue
        is_score = column not in keys and is_column_of_numbers(values)
        columns[column] = [
            _mean(rows, column, [*views.values()]) if is_score else values[first]
            for first, views in zip(firsts, cells.values(), strict=True)
        ]
    columns["views"] = [len(views) for views in cells.values()]
    places = [rows.places[row] for row in firsts]
    note = "Scores are means over the views of a scene: scenes, and not views, are the units of a verdict."
    return replace(rows, columns=columns, places=places, notes=[*rows.notes, note])


def _require_same_views(rows: Rows, name: str, cells: dict[tuple[str, ...], dict[str, int]]) -> None:
    of_scene: dict[object, dict[str, int]] = {}
    for views in cells.values():
        row = min(views.values())
        scene = rows.columns["scene"][row]
        known = of_scene.setdefault(scene, views)
        if lacking := sorted(known.keys() ^ views.keys()):
            other = rows.where(min(known.values()))
            raise InputError(
                f"{rows.where(row)}: {name} {lacking[0]} of {scene} is in this cell or in that of {other}, not both: "
                "means over different views cannot be compared; keep the common ones"
            )


def _mean(rows: Rows, column: str, some: list[int]) -> float | None:
    values = [None if is_missing(rows.columns[column][row]) else number(rows.columns[column][row]) for row in some]
    known = [value for value in values if value is not None]
    if len(known) < len(values) and known:
        row = some[values.index(None)]
        raise InputError(f"{rows.where(row)}: {column} of this view is missing; leave the view out of all cells")
    return statistics.fmean(known) if known else None
