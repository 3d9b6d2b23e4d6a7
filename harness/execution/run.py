"""Plan → view sets → cells → records: the main path, from top to bottom."""

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from msgspec import structs

from baselines.catalog import GIVEN
from baselines.methods.explicit import GivenSettings
from harness.execution.executors import device_here, run_groups
from harness.execution.ground_truth import Arriving, view_set_folders
from harness.execution.group import missing_methods
from harness.execution.group_loop import Event
from harness.execution.local_executor import run_locally
from harness.execution.progress import Progress
from harness.execution.run_record import SceneRead, measured_at_printed_size, scene_record
from harness.machine.device import use_threads
from harness.machine.mixed_cells import mixed_hardware, mixed_sources, stale_cells
from harness.machine.provenance import provenance
from harness.plan.group_task import GroupTask
from harness.plan.planned_record import planned_record
from harness.plan.run_plan import Machine, Plan
from harness.plan.schedule import Budget
from harness.records.cells import (
    CellRecord,
    RunRecord,
    SceneRecord,
    cell_path,
    digests_of,
    read_cells_of,
    write_comparisons,
    write_run,
)
from harness.records.snapshot import ENDED, drop_folder
from harness.records.targets import write_targets
from harness.run_folder.earlier_run import earlier_run, with_measured
from harness.run_folder.folder_lock import scratch_folder
from harness.run_folder.phases import Phases
from harness.verdicts.comparisons import Key, compare
from harness.verdicts.survival import targets

Verify = Callable[[list[CellRecord], list[SceneRecord], dict[str, Path]], list[SceneRecord]]
"""A function of cells, scene records and scene → view set that adds the measured costs of omissions to the records."""


def run(
    plan: Plan,
    out: Path,
    view_sets: Path,
    machine: Machine,
    command: str,
    show: Progress,
    verify: Verify | None = None,
    on_group: Callable[[], None] = lambda: None,
) -> int:
    """Execute the plan, without finished cells, into the locked folder `out` (`harness.run_folder.output_folder`).
    `verify` then trains with and without the parts that each scene does not need; `on_group` is called whenever a group
    has ended and its comparisons are written. Returns exit code 0, or 3 if a cell diverged or failed or an omission
    costs more than its bound. Raises `InputError` before training for wrong input.
    """
    use_threads(machine.threads)
    # images of the user are decoded once, for all groups
    with scratch_folder(out) if plan.view_set else nullcontext() as decoded:
        this = _Run(plan, out, machine, command, decoded, show, on_group)
        arriving = None
        if plan.view_set or plan.scene_file or machine.executor != "local":
            # before any training: a user's mistake is named at once, and a cluster gets all groups together
            with this.phases.timed("render"):
                for scene, folder in view_set_folders(plan, view_sets, show).items():
                    this.add(scene, folder)
                for scene in plan.scenes:
                    this.caution(scene)
        else:
            arriving = Arriving(plan, view_sets, machine, this.arrived)
        this.write()
        try:
            with this.phases.timed("train"):
                this.train(arriving)
                this.score_given()
        except KeyboardInterrupt:
            this.write()
            raise KeyboardInterrupt(_kept(out, this.keys)) from None
    cells = _compare(out, this.keys, this.record)
    this.write(finished=True)
    if verify:
        with this.phases.timed("verify"):
            verified = verify(cells, this.record.scenes, this.folders)
            this.record = structs.replace(this.record, scenes=verified)
        this.write(finished=True)
    # a method that cannot run on this machine is not a failure; its cells name what is missing
    guests = list(read_cells_of(out, plan.guest_cells()))
    ended = sum(cell.status in ("done", "not_available") for cell in (*cells, *guests))
    complete = ended == len(this.keys) + len(guests)
    return 0 if complete and not any(scene.costs_more for scene in this.record.scenes) else 3


@dataclass
class _Run:
    """A run's tasks and record, which grow with the view sets that are ready."""

    plan: Plan
    out: Path
    machine: Machine
    command: str
    decoded: Path | None
    show: Progress
    on_group: Callable[[], None]

    def __post_init__(self) -> None:
        self.keys = sorted(self.plan.cells())
        self.earlier = earlier_run(self.out)
        self.phases = Phases(self.earlier.phases if self.earlier else {})
        self.tasks: list[GroupTask] = []
        self.folders: dict[str, Path] = {}
        self._read: dict[str, SceneRead] = {}
        self._origin = provenance(torch.device(device_here(self.machine))) | {"executor": self.machine.executor}
        if self.earlier is not None and self.earlier.provenance.get("notices"):
            self._origin["notices"] = [*self.earlier.provenance["notices"]]
        self._claims = [measured_at_printed_size(file) for file in self.plan.claims]
        self.record = self._planned()

    def _planned(self) -> RunRecord:
        """Return the record with the scenes that are ready; others are as an earlier part of the run recorded them, so
        that a resumed run that is killed at once has lost nothing.
        """
        read = [self._read[scene] for scene in self.plan.scenes if scene in self._read]
        scenes = {scene.name: scene for scene in self.earlier.scenes} if self.earlier else {}
        scenes |= {each.record.name: each.record for each in read}
        notes = {each.record.name: each.notes for each in read} if self.plan.view_set else {}
        record = planned_record(self.plan, self.command, notes)
        cautions = [f"{each.record.name}: {caution}" for each in read for caution in each.record.cautions]
        return structs.replace(
            record,
            scenes=with_measured([scenes[name] for name in self.plan.scenes if name in scenes], self.earlier),
            claims=self._claims,
            not_tested=[*record.not_tested, *cautions],
            provenance=self._origin | record.provenance,
        )

    def add(self, scene: str, folder: Path) -> list[GroupTask]:
        """Read the view set of a scene; return its groups. Raises `InputError` for a faulty set."""
        tasks = self.plan.tasks({scene: folder}, self.machine, self.out)
        tasks = [replace(task, decoded=self.decoded) for task in tasks]
        read = scene_record(tasks[0], self.plan.cells())
        tasks = [replace(task, content=read.content, hull=read.hull) for task in tasks]
        if self.plan.given:
            given = GivenSettings(*self.plan.given[self.plan.scenes.index(scene)], read.focal)
            tasks = [replace(task, train=replace(task.train, own={**task.train.own, GIVEN: given})) for task in tasks]
        self.folders[scene], self._read[scene] = folder, read
        self.tasks += tasks
        self.record = self._planned()
        return tasks

    def arrived(self, scene: str, folder: Path) -> list[GroupTask]:
        tasks = self.add(scene, folder)
        self.caution(scene)
        self.write()
        return tasks

    def caution(self, name: str) -> None:
        """Say what the user should know of a view set before it is trained on."""
        scene = self._read[name].record
        if self.plan.view_set:
            box = " ".join(f"{x:.3g}" for corner in scene.bounds for x in corner)
            left = f"its silhouettes leave {scene.hull_share:.0%} of it; {scene.seen}"
            self.show.line(f"view set {name}: box {box}; {left}")
        for caution in scene.cautions:
            self.show.line(f"view set {name}: {caution}")

    def write(self, finished: bool = False) -> None:
        cells = list(read_cells_of(self.out, self.keys))
        not_tested = [*self.record.not_tested, *mixed_hardware(cells), *mixed_sources(cells)]
        phases = self.phases.seconds()
        write_run(self.out, structs.replace(self.record, phases=phases, finished=finished, not_tested=not_tested))

    def train(self, arriving: Arriving | None) -> None:
        """Train the missing cells."""
        cells = _ended_cells(self.out, self.keys)
        missing = len(self.keys) - len(cells)
        elsewhere = stale_cells(cells, self._origin, self.out)
        if elsewhere and (missing or mixed_sources(cells)):
            self.show.line(elsewhere)
        self.show.start_training(len(self.keys), missing)
        due = [replace(task, methods=methods) for task in self.tasks if (methods := missing_methods(task))]
        for event in self._events(due, arriving):
            if event.share is not None and event.task is not None:
                self.show.trained(event.task, event.share)
                if event.share == 1.0:
                    _compare(self.out, self.keys, self.record)
                    self.on_group()
        drop_folder(self.out)

    def score_given(self) -> None:
        _ended_cells(self.out, self.plan.guest_cells())
        due = [task for task in self.tasks if self.plan.given and task.seed == self.plan.seeds[0]]
        given = [replace(task, methods=(GIVEN,), budget=Budget(0, None)) for task in due]
        if missing := [task for task in given if missing_methods(task)]:
            for _ in self._events(missing):
                pass
            drop_folder(self.out)

    def _events(self, tasks: list[GroupTask], arriving: Arriving | None = None) -> Iterator[Event]:
        for event in run_groups(self.machine, tasks, self._origin["commit"], run_locally, arriving):
            if event.notice is not None:
                self.show.line(event.notice)
                self._note(event.notice)
            if event.rendered is not None:
                self.show.rendered(event.rendered, len(self.plan.scenes))
            if event.cell is not None:
                self.show.cell(event.cell)
            if event.task is not None and event.share == 1.0:
                self.show.group(event.task)
            yield event

    def _note(self, notice: str) -> None:
        """Write a notice of the executor into the record at once, as the run may be killed."""
        notices = self._origin.setdefault("notices", [])
        if notice not in notices:
            notices.append(notice)
            self.record.provenance["notices"] = notices
            self.write()


def _ended_cells(out: Path, keys: list[Key]) -> list[CellRecord]:
    """Return the cells that have ended; the records of others are removed, so that they are tried again."""
    ended = []
    for cell in read_cells_of(out, keys):
        if cell.status in ENDED:
            ended.append(cell)
        else:
            cell_path(out, cell.scene, cell.method, cell.seed).unlink()
    return ended


def _compare(out: Path, keys: list[Key], record: RunRecord) -> list[CellRecord]:
    """Write comparisons and targets of the complete groups, so that a stopped run has some too; return all cells."""
    cells = list(read_cells_of(out, keys))
    missing = Counter((scene, seed) for scene, _, seed in keys)
    missing.subtract((cell.scene, cell.seed) for cell in cells)
    complete = [cell for cell in cells if not missing[cell.scene, cell.seed]]
    if complete:
        digests = digests_of(complete)
        write_comparisons(out, compare(complete, list(record.methods), record.roles), digests)
        main = record.main_methods
        reached = targets([cell for cell in complete if cell.method in main], main, record.roles, record.claims or ())
        write_targets(out, structs.replace(reached, digests=digests))
    return cells


def _kept(out: Path, keys: list[Key]) -> str:
    kept = sum(cell_path(out, *key).exists() for key in keys)
    report = f"`python -m reports {out} --partial` reports them; " if kept else ""
    return f"{kept} of {len(keys)} cells are kept; {report}resume with --resume --out {out}"
