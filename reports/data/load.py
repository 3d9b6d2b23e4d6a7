"""OUT/records → one object with everything that a report shows, in the order in which it is shown.

Any fault of a file is reported once, naming the file and the remedy: no traceback reaches a reader.
"""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TypeVar

from msgspec import structs

from harness.records.cells import (
    Budget,
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
from harness.records.json_record import REMEDY
from harness.records.targets import TARGETS_FILE, TargetsRecord, read_targets
from harness.verdicts.claim_files import claims_of, usual_roles
from harness.verdicts.comparisons import compare
from harness.verdicts.headline_family import headline_budgets
from scenes.files.errors import DamagedRecord, shown

Value = TypeVar("Value")


class NoRecords(ValueError):
    """The folder holds no records to report."""


class NotForPublishing(ValueError):
    """A record whose figures are too rough to be shown to others."""


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
    """The cells of methods that were planned on some scenes only: tables over all scenes exclude them."""
    extra_comparisons: list[Comparison] = field(default_factory=list)
    guest_cells: list[CellRecord] = field(default_factory=list)
    """The cells of methods of other families, which are not compared."""

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
    def pictured(self) -> list[str]:
        """Return the methods of which pictures are shown: those that are compared, then the guests."""
        return [*self.methods, *self.run.guests]

    @property
    def pictured_cells(self) -> list[CellRecord]:
        return [*self.cells, *self.guest_cells]

    @property
    def every_cell(self) -> list[CellRecord]:
        return [*self.cells, *self.extra_cells, *self.guest_cells]

    @property
    def baseline(self) -> str:
        return self.run.roles.among(self.methods).baseline

    @property
    def control(self) -> str | None:
        """Return the method that explains a difference from the baseline, if one was run."""
        cast = self.run.roles.among(self.methods)
        return next((name for name in cast.controls if name != cast.baseline), None)

    @property
    def rivals(self) -> list[str]:
        return [self.baseline, *([self.control] if self.control else [])]

    @property
    def contenders(self) -> list[str]:
        """Return the tested methods; the headline is about the first."""
        return self.run.roles.among(self.methods).contenders(self.methods)

    @property
    def budgets(self) -> tuple[Budget, ...]:
        """Return the budgets of the headline: equal steps, and equal core seconds if they were counted."""
        return headline_budgets([row.budget for row in self.comparisons])

    @property
    def failed(self) -> list[CellRecord]:
        return [cell for cell in self.every_cell if cell.status in ("diverged", "error")]

    @property
    def not_available(self) -> dict[str, Counter[str]]:
        """Map method → reason → number of its cells that could not be trained here; that is not a failure."""
        reasons: dict[str, Counter[str]] = {}
        for cell in self.cells:
            if cell.status == "not_available":
                reasons.setdefault(cell.method, Counter())[cell.reason or "no reason recorded"] += 1
        return reasons

    def scene(self, name: str) -> SceneRecord | None:
        return next((scene for scene in self.run.scenes if scene.name == name), None)

    def cells_of(self, scene: str, method: str) -> list[CellRecord]:
        return [cell for cell in self.every_cell if cell.scene == scene and cell.method == method]

    def comparison(
        self, scene: str, method: str, against: str, metric: str = "psnr", budget: str = "steps"
    ) -> Comparison | None:
        key = (scene, method, against, metric, budget)
        for row in (*self.comparisons, *self.extra_comparisons):
            if (row.scene, row.method, row.against, row.metric, row.budget) == key:
                return row
        return None


def read_records(out: Path, partly: bool = False) -> Records:
    """Read everything under `out`; raises `NoRecords` or `DamagedRecord` with a message for the reader. With `partly` a
    damaged file is excluded and noted, unless nothing can be shown without it.
    """
    folder, finish = records_folder(out), "finish the run (python -m harness run --resume)"
    if not folder.is_dir():
        lacks = "no records/ in it" if out.is_dir() else "no such folder"
        raise NoRecords(f"{out}: {lacks}; give the output folder of a run, for instance out/latest")
    paths = cell_files(out)
    if not paths:
        raise NoRecords(f"{folder}: no finished cell yet; {finish}")
    if not (folder / "run.json").is_file():
        raise NoRecords(f"{folder / 'run.json'}: missing; {finish}")
    run = read_run(out)
    if run.claims is None:
        run = structs.replace(run, claims=claims_of(run.methods, ()), roles=usual_roles())
    left_out: list[str] | None = [] if partly else None
    cells = [cell for path in paths if (cell := if_valid(partial(read_cell, path), None, left_out)) is not None]
    if all(cell.method in run.guests for cell in cells):
        raise NoRecords(f"{folder}: no finished cell of a method is valid; {finish}")
    comparisons: list[Comparison] = if_valid(partial(read_comparisons, out, cells), [], left_out)
    extra = {name for name in run.methods if name not in run.main_methods}
    known = _in_order(run.main_methods, (cell.method for cell in cells if cell.method not in extra))
    targets = if_valid(partial(_targets, out, known, cells), None, left_out)
    if len(cells) < len(paths):  # the recorded ones include cells that are not shown
        compared = [name for name in run.methods if name not in run.guests]
        comparisons, targets = compare(in_complete_groups(cells, run.main_methods), compared, run.roles), None
    scenes = _in_order([scene.name for scene in run.scenes], (cell.scene for cell in cells))
    methods = [*known, *run.methods]
    cells.sort(key=lambda cell: (scenes.index(cell.scene), methods.index(cell.method), cell.seed))
    return Records(
        out,
        run,
        [cell for cell in cells if cell.method not in extra],
        [row for row in comparisons if row.method not in extra],
        targets,
        left_out or [],
        [cell for cell in cells if cell.method in extra - set(run.guests)],
        [row for row in comparisons if row.method in extra],
        [cell for cell in cells if cell.method in run.guests],
    )


def in_complete_groups(cells: list[CellRecord], methods: list[str]) -> list[CellRecord]:
    """Return the cells of scenes and seeds that have every method: only these are compared."""
    ended = Counter((cell.scene, cell.seed) for cell in cells if cell.method in methods)
    return [cell for cell in cells if ended[cell.scene, cell.seed] == len(methods)]


def _targets(out: Path, methods: list[str], cells: list[CellRecord]) -> TargetsRecord | None:
    record = read_targets(out, cells)
    for curve in record.curves if record else []:
        if curve.method not in methods:
            why = f"a curve is of {shown(curve.method)}, which is not a method of the run; {REMEDY}"
            raise DamagedRecord(f"{records_folder(out) / TARGETS_FILE}: {why}")
    return record


def _in_order(first: list[str], then: Iterable[str]) -> list[str]:
    return list(dict.fromkeys([*first, *sorted(set(then) - set(first))]))


def if_valid(read: Callable[[], Value], without: Value, left_out: list[str] | None) -> Value:
    """Return what `read` returns; for a `DamagedRecord` `without`, and a line in `left_out` unless that is None."""
    try:
        return read()
    except DamagedRecord as problem:
        if left_out is None:
            raise
        left_out.append(str(problem))
        return without
