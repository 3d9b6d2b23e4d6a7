"""What every study gets to work with."""

import json
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from harness.chart_record import Series, Table
from harness.evidence.trainings import TRAININGS, plan_of
from harness.evidence_record import Check, Effect
from harness.json_record import DamagedRecord
from harness.plan import Machine, Plan
from harness.progress import Progress
from harness.records import CellRecord, RunRecord, SceneRecord, cell_path, read_cells, read_run
from harness.soundness import DAMAGED, aside, mend, plan_of_cells

Finding = str | Check | Effect | Series | Table
"""A string is a sentence that answers the study's question; the first is its answer."""
TRAININGS_FOLDER = "studies"
"""Under OUT."""
Measure = Callable[["Situation"], Iterator[Finding]]


@dataclass(frozen=True)
class Trained:
    """What a training left behind."""

    folder: Path
    plan: Plan
    scenes: list[SceneRecord]
    cells: list[CellRecord]


@dataclass(frozen=True)
class Situation:
    """One run of the studies."""

    out: Path
    view_sets: Path
    scratch: Path
    """A folder on a disk, gone after the run."""
    machine: Machine
    precision_as_planned: bool
    """Whether this processor has the profile's bfloat16 products."""
    quick: bool
    """Sizes at which no figure means anything, to try the studies themselves."""
    show: Progress

    def plan(self, name: str) -> Plan:
        """Of the training of that name."""
        return plan_of(TRAININGS[name], self.precision_as_planned, self.quick)

    def trained(self, name: str) -> Trained:
        """The training of that name: an ordinary run in `studies/<name>`. Cells that are there are not trained again,
        but for those that had no chance (`lacks_cells`); what is there of another plan is moved to OUT/damaged.

        Studies may ask for the same one, one after another.
        """
        from harness.runner import run

        plan, folder = self.plan(name), folder_of(self.out, name)
        if _is_of_another_plan(folder, plan):
            self.show.line(f"{folder}: of another plan, moved to {self.out / DAMAGED}: trained again")
            aside(self.out, folder.relative_to(self.out).as_posix())
        if lacks_cells(folder, plan):
            folder.mkdir(parents=True, exist_ok=True)
            run(plan, folder, self.view_sets, self.machine, "nox -s evidence", self.show)
        return Trained(folder, plan, read_run(folder).scenes, list(read_cells(folder)))

    def mended(self, name: str) -> bool:
        """Leaves nothing in the folder of a training that is not as it was written; whether it has to be gone on with.

        One that is not there or is of another plan is left as it is: its figures were taken when it was.
        """
        plan, folder = self.plan(name), folder_of(self.out, name)
        if not folder.exists() or _is_of_another_plan(folder, plan):
            return False
        mend(folder, plan, lambda line: self.show.line(f"{name}: {line}"))
        return lacks_cells(folder, plan)

    def scale(self, *names: str) -> str:
        """Of trainings, in one line, and where the code may have changed since they were done."""
        lines = []
        for name in names:
            plan = self.plan(name)
            lines.append(
                f"{', '.join(plan.scenes)}; {len(plan.seeds)} seeds; {plan.budget.steps} steps; {plan.views.train} "
                f"training views of {plan.views.resolution} px"
            )
        return ". ".join([" | ".join(dict.fromkeys(lines)), *self._trained_elsewhen(names)])

    def _trained_elsewhen(self, names: tuple[str, ...]) -> Iterator[str]:
        """Trainings with cells of another commit than the present one, or of a tree with changes, which no commit
        names. They are used all the same: the plan is what tells whether a cell fits.
        """
        import torch

        from harness.provenance import provenance

        here = provenance(torch.device(self.machine.device))["commit"]
        told = []
        for name in names:
            made = Counter(
                cell.provenance.get("commit", "unknown")
                for cell in read_cells(folder_of(self.out, name))
                if (cell.scene, cell.method, cell.seed) in set(self.plan(name).cells())
            )
            if any(commit != here or not _names_the_code(commit) for commit in made):
                said = ", ".join(f"{count} cells at commit {commit}" for commit, count in made.items())
                told.append(f"{name}: {said}")
        if told:
            yield f"Not all was trained at commit {here}, at which it was judged ({'; '.join(told)})"


def folder_of(out: Path, training: str) -> Path:
    """Where the run of a training lies."""
    return out / TRAININGS_FOLDER / training


def lacks_cells(folder: Path, plan: Plan) -> bool:
    """Whether only running it again makes a training whole: it is not finished, something is missing, or cells failed
    without having had their chance."""
    run = _run_of(folder)
    if run is None or not run.finished or not all(cell_path(folder, *one).exists() for one in plan.cells()):
        return True
    return any(cell.status in ("error", "not_available") for cell in read_cells(folder))


def _is_of_another_plan(folder: Path, plan: Plan) -> bool:
    """By its record, or by its cells where that is lost."""
    run = _run_of(folder)
    if run is None:
        return bool(plan_of_cells(folder, plan))
    return run.settings != json.loads(json.dumps(plan.settings()))


def _names_the_code(commit: str) -> bool:
    return commit != "unknown" and not commit.endswith("-dirty")


def _run_of(folder: Path) -> RunRecord | None:
    with suppress(DamagedRecord):
        return read_run(folder)
    return None
