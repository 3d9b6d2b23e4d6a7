"""OUT/records → one object with everything that a report shows, in the order in which it is shown.

Whatever is wrong with a file is said once, naming the file and the remedy: no traceback reaches a reader.
"""

import math
import types
import typing
from collections.abc import Callable, Iterable
from dataclasses import dataclass, is_dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from harness.chart_record import Series, Table
from harness.records import (
    CellRecord,
    Comparison,
    DamagedRecord,
    RunRecord,
    SceneRecord,
    read_cell,
    read_comparisons,
    read_run,
    records_folder,
)
from harness.targets_record import TARGETS_FILE, TargetsRecord, read_targets

One = TypeVar("One")
REMEDY = "delete it and run again with --resume"


class NoRecords(ValueError):
    """The folder holds nothing that could be reported."""


class NotForPublishing(ValueError):
    """A record whose figures are too rough to be shown to others."""


def refuse_quick(settings: dict[str, Any], path: Path) -> None:
    """Raises `NotForPublishing` for the record of a quick run."""
    if settings.get("quick"):
        raise NotForPublishing(
            f"{path}: a quick run, too rough to publish; measure again without --quick, or leave out --publish"
        )


@dataclass(frozen=True)
class Records:
    """All of a run. Cells are sorted by scene, method and seed as the run lists them."""

    out: Path
    run: RunRecord
    cells: list[CellRecord]
    comparisons: list[Comparison]
    targets: TargetsRecord | None = None
    """When a score was reached; None in runs recorded before that was noted."""

    @property
    def folder(self) -> Path:
        return records_folder(self.out)

    @property
    def scenes(self) -> list[str]:
        """Scenes in the run's order, then those that only cells know."""
        return _in_order([scene.name for scene in self.run.scenes], (cell.scene for cell in self.cells))

    @property
    def methods(self) -> list[str]:
        """Methods in the run's order, then those that only cells know."""
        return _in_order(list(self.run.methods), (cell.method for cell in self.cells))

    @property
    def failed(self) -> list[CellRecord]:
        """Cells that diverged or ended in an error."""
        return [cell for cell in self.cells if cell.status in ("diverged", "error")]

    @property
    def not_available(self) -> dict[str, dict[str, int]]:
        """Method → reason → number of its cells that could not be trained here; that is no failure."""
        found: dict[str, dict[str, int]] = {}
        for cell in self.cells:
            if cell.status == "not_available":
                reasons = found.setdefault(cell.method, {})
                reason = cell.reason or "no reason recorded"
                reasons[reason] = reasons.get(reason, 0) + 1
        return found

    def scene(self, name: str) -> SceneRecord | None:
        return next((scene for scene in self.run.scenes if scene.name == name), None)

    def cells_of(self, scene: str, method: str) -> list[CellRecord]:
        return [cell for cell in self.cells if cell.scene == scene and cell.method == method]

    def comparison(
        self, scene: str, method: str, against: str, metric: str = "psnr", budget: str = "steps"
    ) -> Comparison | None:
        wanted = (scene, method, against, metric, budget)
        for one in self.comparisons:
            if (one.scene, one.method, one.against, one.metric, one.budget) == wanted:
                return one
        return None


def read_records(out: Path) -> Records:
    """Everything under `out`; raises `NoRecords` or `DamagedRecord` with a message for the reader."""
    folder = records_folder(out)
    if not out.is_dir():
        raise NoRecords(f"{out}: no such folder; give the output folder of a run, for instance out/latest")
    if not folder.is_dir():
        raise NoRecords(f"{out}: no records/ in it; give the output folder of a run, for instance out/latest")
    paths = sorted((folder / "cells").glob("*.json"))
    if not paths:
        raise NoRecords(f"{folder}: no finished cell yet; finish the run (python -m harness run --resume)")
    if not (folder / "run.json").is_file():
        raise NoRecords(f"{folder / 'run.json'}: missing; finish the run (python -m harness run --resume)")
    run = _sound(folder / "run.json", RunRecord, lambda: read_run(out))
    cells = [_sound(path, CellRecord, partial(read_cell, path)) for path in paths]
    comparisons = _sound(folder / "comparisons.json", list[Comparison], lambda: read_comparisons(out))
    targets = _sound(folder / TARGETS_FILE, TargetsRecord | None, lambda: read_targets(out))
    unsorted = Records(out, run, cells, comparisons)
    scenes, methods = unsorted.scenes, unsorted.methods
    cells.sort(key=lambda cell: (scenes.index(cell.scene), methods.index(cell.method), cell.seed))
    return Records(out, run, cells, comparisons, targets)


def find_record(
    path: Path, kind: type[One], read: Callable[[Path], One], wrong: Callable[[One], str | None], remedy: str
) -> One | None:
    """A record that lies beside a run, None where there is none; raises `DamagedRecord`.

    `wrong` finds the first thing that no run writes, though every type is right.
    """
    if not path.is_file():
        return None
    record = read(path)
    problem = first_mismatch(record, kind) or wrong(record)
    if problem is not None:
        raise DamagedRecord(f"{path}: {problem}; {remedy}")
    return record


def _in_order(first: list[str], then: Iterable[str]) -> list[str]:
    return list(dict.fromkeys([*first, *sorted(set(then) - set(first))]))


def _sound(path: Path, hint: Any, read: Callable[[], Any]) -> Any:
    """What `read` returns, if it is what its type says; otherwise a message that names the file."""
    try:
        value = read()
    except DamagedRecord:
        raise
    except (TypeError, KeyError, AttributeError, ValueError, IndexError, OSError) as error:
        raise DamagedRecord(f"{path}: {error}; {REMEDY}") from error
    wrong = first_mismatch(value, hint)
    if wrong is not None:
        raise DamagedRecord(f"{path}: {wrong}; {REMEDY}")
    return value


def first_mismatch(value: Any, hint: Any, where: str = "") -> str | None:
    """The first place where `value` is not what `hint` promises, or a number is not finite; None where all is well."""
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    here = where or "the record"
    if hint is Any:
        return _first_not_finite(value, here)
    if is_dataclass(hint):
        if not isinstance(value, typing.cast(type, hint)):
            return f"{here} is not a {getattr(hint, '__name__', hint)}"
        hints = typing.get_type_hints(hint)
        found = (first_mismatch(getattr(value, name), of, f"{where}.{name}".strip(".")) for name, of in hints.items())
        return next((wrong for wrong in found if wrong), None)
    if origin in (types.UnionType, typing.Union):
        wrong = [first_mismatch(value, part, where) for part in parts if part is not type(None)]
        return None if (value is None and type(None) in parts) or None in wrong else wrong[0]
    if origin is typing.Literal:
        return None if value in parts else f"{here} is {value!r}, not one of {', '.join(map(str, parts))}"
    if origin is list:
        return _first_in(value, list, lambda: [(f"{where}[{i}]", one, parts[0]) for i, one in enumerate(value)], here)
    if origin is dict:
        return _first_in(value, dict, lambda: [(f"{where}.{key}", one, parts[1]) for key, one in value.items()], here)
    if origin is tuple:
        if not isinstance(value, tuple) or len(value) != len(parts):
            return f"{here} is not a pair of numbers"
        return _first_in(
            value, tuple, lambda: [(where, one, part) for one, part in zip(value, parts, strict=True)], here
        )
    return _scalar_mismatch(value, hint, here)


def _first_in(value: Any, kind: type, items: Callable[[], list[tuple[str, Any, Any]]], here: str) -> str | None:
    if not isinstance(value, kind):
        return f"{here} is {type(value).__name__}, not {kind.__name__}"
    found = (first_mismatch(one, hint, where.strip(".")) for where, one, hint in items())
    return next((wrong for wrong in found if wrong), None)


def uneven(series: Iterable[Series], tables: Iterable[Table]) -> str | None:
    """The first list of a line or a table that is longer or shorter than its partner."""
    found = [*map(_uneven_series, series), *map(_uneven_table, tables)]
    return next(filter(None, found), None)


def _uneven_series(one: Series) -> str | None:
    for name in ("y", "low", "high"):
        values = getattr(one, name)
        if values is not None and len(values) != len(one.x):
            return f"series {one.name!r} has {len(one.x)} x but {len(values)} {name}"
    return None


def _uneven_table(one: Table) -> str | None:
    wrong = next((row for row in one.rows if len(row) != len(one.columns)), None)
    return None if wrong is None else f"table {one.id!r} has {len(one.columns)} columns but a row of {len(wrong)}"


def _scalar_mismatch(value: Any, hint: type, here: str) -> str | None:
    accepted: tuple[type, ...] = (int, float) if hint is float else (hint,)
    if not isinstance(value, accepted) or (isinstance(value, bool) and hint is not bool):
        return f"{here} is {value!r}, not {hint.__name__}"
    return _first_not_finite(value, here)


def _first_not_finite(value: Any, here: str) -> str | None:
    if isinstance(value, float) and not math.isfinite(value):
        return f"{here} is {value}, which no record may hold"
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return next((wrong for one in inner if (wrong := _first_not_finite(one, here))), None)
