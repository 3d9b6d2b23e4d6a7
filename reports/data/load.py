"""OUT/records → one object with everything that a report shows, in the order in which it is shown.

Any fault of a file is reported once, naming the file and the remedy: no traceback reaches a reader.
"""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from harness.records.cells import (
    CellRecord,
    Comparison,
    RunRecord,
    SceneRecord,
    cell_files,
    read_cell,
    read_comparisons,
    read_run,
    records_folder,
)
from harness.records.json_record import REMEDY, DamagedRecord, shown
from harness.records.study import Series, Table
from harness.records.targets import TARGETS_FILE, TargetsRecord, read_targets
from harness.verdicts.comparisons import compare

One = TypeVar("One")


class NoRecords(ValueError):
    """The folder holds no records to report."""


class NotForPublishing(ValueError):
    """A record whose figures are too rough to be shown to others."""


def refuse_quick(settings: dict[str, Any], path: Path) -> None:
    """Raise `NotForPublishing` for the record of a quick run."""
    if settings.get("quick"):
        raise NotForPublishing(
            f"{path}: a quick run, too rough to publish; measure again without --quick, or leave out --publish"
        )


@dataclass(frozen=True)
class Records:
    """The records of a run. Cells are sorted by scene, method and seed as the run lists them."""

    out: Path
    run: RunRecord
    cells: list[CellRecord]
    comparisons: list[Comparison]
    targets: TargetsRecord | None = None
    """The times at which a score was reached; None in runs recorded before that was noted."""
    left_out: list[str] = field(default_factory=list)
    """The damaged files that `--partial` excludes, one line each with the reason."""
    extra_cells: list[CellRecord] = field(default_factory=list)
    """The cells of methods that were planned on single scenes: they explain a result and are in no
    table of all scenes.
    """
    extra_comparisons: list[Comparison] = field(default_factory=list)
    """The comparisons of those methods."""

    @property
    def folder(self) -> Path:
        return records_folder(self.out)

    @property
    def scenes(self) -> list[str]:
        """Return scenes in the run's order, then those that only cells know."""
        return _in_order([scene.name for scene in self.run.scenes], (cell.scene for cell in self.cells))

    @property
    def methods(self) -> list[str]:
        """Return methods of every scene in the run's order, then those that only cells know."""
        return _in_order(self.run.main_methods, (cell.method for cell in self.cells))

    @property
    def failed(self) -> list[CellRecord]:
        """Return cells that diverged or ended in an error."""
        return [cell for cell in (*self.cells, *self.extra_cells) if cell.status in ("diverged", "error")]

    @property
    def not_available(self) -> dict[str, dict[str, int]]:
        """Map method → reason → number of its cells that could not be trained here; that is no failure."""
        found: dict[str, dict[str, int]] = {}
        for cell in self.cells:
            if cell.status == "not_available":
                reasons, reason = found.setdefault(cell.method, {}), cell.reason or "no reason recorded"
                reasons[reason] = reasons.get(reason, 0) + 1
        return found

    def scene(self, name: str) -> SceneRecord | None:
        return next((scene for scene in self.run.scenes if scene.name == name), None)

    def cells_of(self, scene: str, method: str) -> list[CellRecord]:
        every = (*self.cells, *self.extra_cells)
        return [cell for cell in every if cell.scene == scene and cell.method == method]

    def comparison(
        self, scene: str, method: str, against: str, metric: str = "psnr", budget: str = "steps"
    ) -> Comparison | None:
        wanted = (scene, method, against, metric, budget)
        for one in (*self.comparisons, *self.extra_comparisons):
            if (one.scene, one.method, one.against, one.metric, one.budget) == wanted:
                return one
        return None


def read_records(out: Path, partly: bool = False) -> Records:
    """Read everything under `out`; raises `NoRecords` or `DamagedRecord` with a message for the reader. With `partly` a
    damaged file is excluded and noted, unless nothing can be shown without it.
    """
    folder = records_folder(out)
    if not out.is_dir():
        raise NoRecords(f"{out}: no such folder; give the output folder of a run, for instance out/latest")
    if not folder.is_dir():
        raise NoRecords(f"{out}: no records/ in it; give the output folder of a run, for instance out/latest")
    paths = cell_files(out)
    if not paths:
        raise NoRecords(f"{folder}: no finished cell yet; finish the run (python -m harness run --resume)")
    if not (folder / "run.json").is_file():
        raise NoRecords(f"{folder / 'run.json'}: missing; finish the run (python -m harness run --resume)")
    run = read_run(out)
    left_out: list[str] | None = [] if partly else None
    cells = [cell for path in paths if (cell := if_sound(partial(read_cell, path), None, left_out)) is not None]
    if not cells:
        raise NoRecords(f"{folder}: no finished cell is sound; finish the run (python -m harness run --resume)")
    comparisons: list[Comparison] = if_sound(partial(read_comparisons, out), [], left_out)
    extra = {name for name in run.methods if name not in run.main_methods}
    known = Records(out, run, [cell for cell in cells if cell.method not in extra], comparisons).methods
    targets = if_sound(partial(_targets, out, known), None, left_out)
    if len(cells) < len(paths):  # both are of cells that are not shown
        comparisons, targets = compare(of_whole_groups(cells, run.main_methods), list(run.methods)), None
    unsorted = Records(out, run, cells, comparisons)
    scenes, methods = unsorted.scenes, [*known, *run.methods]
    cells.sort(key=lambda cell: (scenes.index(cell.scene), methods.index(cell.method), cell.seed))
    return Records(
        out,
        run,
        [cell for cell in cells if cell.method not in extra],
        [one for one in comparisons if one.method not in extra],
        targets,
        left_out or [],
        [cell for cell in cells if cell.method in extra],
        [one for one in comparisons if one.method in extra],
    )


def find_record(path: Path, read: Callable[[Path], One], wrong: Callable[[One], str | None], remedy: str) -> One | None:
    """Return a record that lies beside a run, None if there is none; raises `DamagedRecord`.

    `wrong` finds the first thing that no run writes, though every type is right.
    """
    if not path.is_file():
        return None
    record = read(path)
    if (problem := wrong(record)) is not None:
        raise DamagedRecord(f"{path}: {problem}; {remedy}")
    return record


def of_whole_groups(cells: list[CellRecord], methods: list[str]) -> list[CellRecord]:
    """Return the cells of scenes and seeds that have every method: no others are compared."""
    ended = Counter((cell.scene, cell.seed) for cell in cells if cell.method in methods)
    return [cell for cell in cells if ended[cell.scene, cell.seed] == len(methods)]


def _targets(out: Path, methods: list[str]) -> TargetsRecord | None:
    """Raises `DamagedRecord` also where a curve is of none of the methods."""
    found = read_targets(out)
    stray = next((one.method for one in found.curves if one.method not in methods), None) if found else None
    if stray is not None:
        path = records_folder(out) / TARGETS_FILE
        raise DamagedRecord(f"{path}: a curve is of {shown(stray)}, which is no method of the run; {REMEDY}")
    return found


def _in_order(first: list[str], then: Iterable[str]) -> list[str]:
    return list(dict.fromkeys([*first, *sorted(set(then) - set(first))]))


def uneven(series: Iterable[Series], tables: Iterable[Table]) -> str | None:
    """Return the first list of a line or a table that is longer or shorter than its partner."""
    for one in series:
        for name in ("y", "low", "high"):
            values = getattr(one, name)
            if values is not None and len(values) != len(one.x):
                return f"series {one.name!r} has {len(one.x)} x but {len(values)} {name}"
    for table in tables:
        for row in table.rows:
            if len(row) != len(table.columns):
                return f"table {table.id!r} has {len(table.columns)} columns but a row of {len(row)}"
    return None


def if_sound(read: Callable[[], One], without: One, left_out: list[str] | None) -> One:
    """Return the result of `read`. If it raises `DamagedRecord`: `without`, and a line in `left_out`; raises it if that
    is None.
    """
    try:
        return read()
    except DamagedRecord as problem:
        if left_out is None:
            raise
        left_out.append(str(problem))
        return without
