"""Scenes of the catalogue, rendered and trained once for all cases that look at them."""

import json
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.chart_record import Table
from harness.json_record import DamagedRecord
from harness.pictures_record import last_of, read_renders
from harness.records import CellRecord, RunRecord, cell_path, read_cells, read_run, records_folder
from harness.soundness import mend
from harness.stability.situation import Situation, whose
from harness.stability_record import Outcome, Status


@dataclass(frozen=True)
class Trained:
    """What a run of the ordinary benchmark left behind."""

    out: Path
    view_sets: Path
    run: RunRecord
    cells: dict[tuple[str, str], list[CellRecord]]
    """(scene, method) → its cells, one a seed."""

    @property
    def methods(self) -> list[str]:
        return list(self.run.methods)

    def of(self, scene: str) -> Iterator[CellRecord]:
        """The cells of a scene, method by method in the order of the run."""
        return (cell for method in self.methods for cell in self.cells.get((scene, method), []))

    def folder(self, scene: str) -> Path:
        """Its view set."""
        return self.view_sets / next(one.view_set for one in self.run.scenes if one.name == scene)


def trained(situation: Situation, profile: str, scenes: Iterable[str], folder: Path) -> Trained:
    """`folder` with every cell of these scenes: those that it lacks are trained.

    What an earlier case trained there stays in its record: the scenes of both are planned, and finished cells are
    kept. Where nothing is missing, nothing is run, so that cases can ask one after another.
    """
    before = _run_of(folder)
    there = [scene.name for scene in before.scenes] if before else []
    wanted = {*scenes, *there}
    everything = situation.plan(profile)
    plan = situation.plan(profile, [name for name in everything.scenes if name in wanted])
    if folder.exists():
        mend(folder, plan, lambda line: situation.show.line(f"  {folder.name}: {line}"))
    whole = all(cell_path(folder, *one).exists() for one in plan.cells())
    if not (whole and before and before.finished and before.settings == json.loads(json.dumps(plan.settings()))):
        folder.mkdir(parents=True, exist_ok=True)
        situation.trained(plan, folder)
    return read_trained(folder, situation.view_sets)


def read_trained(folder: Path, view_sets: Path) -> Trained:
    cells: dict[tuple[str, str], list[CellRecord]] = {}
    for cell in read_cells(folder):
        cells.setdefault((cell.scene, cell.method), []).append(cell)
    return Trained(folder, view_sets, read_run(folder), cells)


def _run_of(folder: Path) -> RunRecord | None:
    with suppress(DamagedRecord):
        return read_run(folder)
    return None


def unscored(case: str, cell: CellRecord, what: str) -> Outcome | None:
    """What is said of a cell without scores: not available where the method is not, else failed; None of a whole one.

    A cell that diverged or failed is a failure of whoever its method belongs to.
    """
    if cell.status == "done":
        return None
    status: Status = "not_available" if cell.status == "not_available" else "fail"
    return Outcome(
        case, cell.method, whose(cell.method), status, what=what, why=f"{cell.scene}: {cell.status}, {cell.reason}"
    )


@dataclass(frozen=True)
class Shown:
    """A test view as the record keeps it, in float16: what every method leaves behind, whatever it is made of."""

    view: str
    render: np.ndarray
    """[h, w, 3], display colour over white."""
    opacity: np.ndarray
    """[h, w]."""


def shown(found: Trained, cell: CellRecord) -> list[Shown]:
    if cell.pictures is None:
        return []
    return [
        Shown(one.view, np.clip(one.colour.astype(np.float64), 0.0, 1.0), one.opacity.astype(np.float64).clip(0.0, 1.0))
        for one in last_of(read_renders(records_folder(found.out) / cell.pictures))
    ]


NOTHING_THERE = ("empty",)
"""Scenes of which to show nothing is right."""
LARGEST_TRACE = 0.05
"""Mean distance from white of a picture that shows nothing."""


def learnt_nothing(found: Trained, cell: CellRecord) -> bool:
    """Whether a whole cell shows nothing at all of a scene in which there is something: empty collapse.

    That a training collapses within a few hundred steps hangs on its random numbers, and says nothing of how well a
    formula is computed: it is recorded, and never taken for a result. What has no opacity and is dark all the same
    adds up its colours wrongly, and is judged.
    """
    collapsed = any(warning.startswith("empty collapse") for warning in cell.warnings)
    if cell.status != "done" or not collapsed or cell.scene in NOTHING_THERE:
        return False
    return all((1.0 - one.render).mean() <= LARGEST_TRACE for one in shown(found, cell))


SCORES = ("psnr", "psnr_train", "psnr_floor", "psnr_ceiling")


def scores_table(case: str, title: str, trained: Trained, scenes: Iterable[str], item: int) -> Table:
    """Scene × method: training and test views always side by side."""
    rows: list[list[str | float | None]] = [
        [
            scene,
            cell.method,
            *(cell.scores.get(name) for name in SCORES),
            cell.status if cell.reason is None else f"{cell.status}: {cell.reason}",
            "; ".join(["learnt nothing"] * learnt_nothing(trained, cell) + cell.warnings),
        ]
        for scene in scenes
        for cell in trained.of(scene)
    ]
    columns = ["scene", "method", "test dB", "training dB", "floor dB", "ceiling dB", "status", "what to know"]
    return Table(f"{case.lower()}-scores", item, title, columns, rows)
