"""What every study gets to work with."""

import json
import shutil
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from harness.chart_record import Series, Table
from harness.evidence.trainings import TRAININGS, plan_of
from harness.evidence_record import Check, Effect
from harness.plan import Machine, Plan
from harness.progress import Progress
from harness.records import CellRecord, DamagedRecord, RunRecord, SceneRecord, read_cells, read_run

Finding = str | Check | Effect | Series | Table
"""A string is a sentence that answers the study's question; the first is its answer."""
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
        """The training of that name: an ordinary run in `studies/<name>`. Cells that are there are not trained again.

        Studies may ask for the same one, one after another.
        """
        from harness.runner import run

        plan, folder = self.plan(name), self.out / "studies" / name
        before = _run_of(folder)
        if before is not None and before.settings != json.loads(json.dumps(plan.settings())):
            shutil.rmtree(folder)
            before = None
        if before is None or not before.finished:
            folder.mkdir(parents=True, exist_ok=True)
            run(plan, folder, self.view_sets, self.machine, "nox -s evidence", self.show)
        return Trained(folder, plan, read_run(folder).scenes, list(read_cells(folder)))

    def scale(self, *names: str) -> str:
        """Of trainings, in one line."""
        lines = []
        for name in names:
            plan = self.plan(name)
            lines.append(
                f"{', '.join(plan.scenes)}; {len(plan.seeds)} seeds; {plan.budget.steps} steps; {plan.views.train} "
                f"training views of {plan.views.resolution} px"
            )
        return " | ".join(dict.fromkeys(lines))


def _run_of(folder: Path) -> RunRecord | None:
    with suppress(DamagedRecord):
        return read_run(folder)
    return None
