"""Studies that train: each training is an ordinary run in a shared folder, resumed, repaired or trained again."""

import json
from abc import abstractmethod
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import msgspec

from harness.execution import run as execution
from harness.machine.provenance import provenance
from harness.plan.run_plan import Plan
from harness.records.cells import CellRecord, SceneRecord, cell_path, read_cells, read_cells_of, read_run
from harness.records.study import Studies
from harness.run_folder.earlier_run import earlier_run
from harness.run_folder.integrity import DAMAGED, plan_of_cells, quarantine, repair
from harness.studies.framework import TRAININGS_FOLDER, Shelf, Study, StudyContext


@dataclass(frozen=True)
class StudyRun:
    plan: Plan
    scenes: list[SceneRecord]
    cells: list[CellRecord]


@dataclass(frozen=True)
class TrainedContext(StudyContext):
    command: ClassVar[str]
    """The command that a record of a training names."""
    as_planned: bool
    """Whether this processor has the bfloat16 matrix multiplications of the profile."""

    @abstractmethod
    def plan(self, name: str) -> Plan:
        """Return the plan of the training of that name."""

    def trained(self, name: str) -> StudyRun:
        """Return the training of that name, an ordinary run in `studies/<name>`, after training what it lacks.

        Existing cells are kept, except those that failed without a chance (`lacks_cells`). A run of another plan is
        moved to OUT/damaged.
        """
        plan, folder = self.plan(name), folder_of(self.out, name)
        if is_of_another_plan(folder, plan):
            self.show.line(f"{folder}: of another plan, moved to {self.out / DAMAGED}: trained again")
            quarantine(self.out, folder.relative_to(self.out).as_posix())
        if lacks_cells(folder, plan):
            folder.mkdir(parents=True, exist_ok=True)
            execution.run(plan, folder, self.view_sets, self.machine, self.command, self.show)
        return StudyRun(plan, read_run(folder).scenes, list(read_cells(folder)))

    def repaired(self, name: str) -> bool:
        """Repair the folder of a training; return whether the training has to be resumed. A folder that is missing or
        of another plan is not touched: recorded figures were taken while it was valid.
        """
        plan, folder = self.plan(name), folder_of(self.out, name)
        if not folder.exists() or is_of_another_plan(folder, plan):
            return False
        repair(folder, plan, lambda line: self.show.line(f"{name}: {line}"))
        return lacks_cells(folder, plan)

    def trainings(self, *studies: Study) -> list[str]:
        return list(dict.fromkeys(name for study in studies for name in study.trainings))

    def valid(self, record: Studies, shelf: Shelf, asked: list[str]) -> Studies:
        """Return the record without the studies whose figures a resumed training would change. Only trainings of the
        studies `asked` are resumed, but other studies may share them.
        """
        trainings = sorted(self.trainings(*(shelf.studies[name] for name in asked)))
        resumed = {name for name in trainings if self.repaired(name)}
        kept = []
        for study in record.studies:
            if lost := sorted(resumed & set(self.trainings(shelf.studies[study.info.id]))):
                self.show.line(f"{study.info.id}: its figures are dropped, as {', '.join(lost)} has to be resumed")
            else:
                kept.append(study)
        return msgspec.structs.replace(record, studies=kept)

    def scale(self, study: Study) -> str:
        """Describe the trainings of a study in one line, with the commits of its cells if they differ from this one.

        Cells of another commit, or of a modified tree, are used all the same: the plan decides what is compatible.
        """
        plans = {name: self.plan(name) for name in self.trainings(study)}
        lines = [
            f"{', '.join(plan.scenes)}; {len(plan.seeds)} seed{'s' * (len(plan.seeds) > 1)}; {plan.budget.in_words}; "
            f"{plan.views.train} training views of {plan.views.resolution} px"
            for plan in plans.values()
        ]
        scale, here = " | ".join(dict.fromkeys(lines)), provenance(self.device)["commit"]
        commits = Counter(
            cell.provenance.get("commit", "unknown")
            for name, plan in plans.items()
            for cell in read_cells_of(folder_of(self.out, name), plan.cells())
        )
        if not any(commit != here or commit == "unknown" or commit.endswith("-dirty") for commit in commits):
            return scale
        counts = ", ".join(f"{count} cells at commit {commit}" for commit, count in commits.items())
        return f"{scale}. Not all was trained at commit {here}, at which it was judged: {counts}"


def folder_of(out: Path, training: str) -> Path:
    return out / TRAININGS_FOLDER / training


def lacks_cells(folder: Path, plan: Plan) -> bool:
    """Return whether a cell is missing, failed with an error, or was not available, or the run is not finished."""
    run = earlier_run(folder)
    if run is None or not run.finished or not all(cell_path(folder, *key).exists() for key in plan.cells()):
        return True
    return any(cell.status in ("error", "not_available") for cell in read_cells(folder))


def is_of_another_plan(folder: Path, plan: Plan) -> bool:
    """Return whether the training is of another plan, by its record, or by its cells if the record is damaged."""
    if (run := earlier_run(folder)) is None:
        return bool(plan_of_cells(folder, plan))
    return bool(run.settings != json.loads(json.dumps(plan.settings())))
