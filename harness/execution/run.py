"""Plan → view sets → cells → records: the main path, from top to bottom."""

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import torch
from msgspec import structs

from baselines.catalog import GIVEN
from baselines.methods.explicit import GivenSettings
from harness.execution.executors import device_here, run_groups
from harness.execution.ground_truth import view_set_folders
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
    read_cell,
    read_cells_of,
    write_comparisons,
    write_run,
)
from harness.records.snapshot import ENDED, drop_folder
from harness.records.targets import write_targets
from harness.run_folder.earlier_run import earlier_run, notices_of, with_measured
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
) -> int:
    """Execute the plan, without finished cells, into the locked folder `out` (`harness.run_folder.output_folder`).
    `verify` then trains with and without the parts that each scene does not need. Returns exit code 0, or 3 if a cell
    diverged or failed or an omission costs more than its bound. Raises `InputError` before training for wrong input.
    """
    earlier = earlier_run(out)
    phases = Phases(earlier.phases if earlier else {})
    use_threads(machine.threads)
    keys = sorted(plan.cells())
    # images of the user are decoded once, for all groups
    with scratch_folder(out) if plan.view_set else nullcontext() as decoded:
        with phases.timed("render"):
            folders = view_set_folders(plan, view_sets, show)
            tasks = [replace(task, decoded=decoded) for task in plan.tasks(folders, machine, out)]
            tasks, record = _read_view_sets(plan, tasks, command, show)
        origin = provenance(torch.device(device_here(machine))) | {"executor": machine.executor}
        origin |= record.provenance | notices_of(earlier)
        record = structs.replace(record, provenance=origin, scenes=with_measured(record.scenes, earlier))
        _write(out, keys, record, phases)
        try:
            with phases.timed("train"):
                _train(tasks, keys, record, machine, show)
                _score_guests(plan, tasks, record, machine, show)
        except KeyboardInterrupt:
            _write(out, keys, record, phases)
            raise KeyboardInterrupt(_kept(out, keys)) from None
    cells = _compare(out, keys, record)
    _write(out, keys, record, phases, finished=True)
    if verify:
        with phases.timed("verify"):
            record = structs.replace(record, scenes=verify(cells, record.scenes, folders))
        _write(out, keys, record, phases, finished=True)
    # a method that cannot run on this machine is not a failure; its cells name what is missing
    guests = list(read_cells_of(out, plan.guest_cells()))
    ended = sum(cell.status in ("done", "not_available") for cell in (*cells, *guests))
    return 0 if ended == len(keys) + len(guests) and not any(scene.costs_more for scene in record.scenes) else 3


def _read_view_sets(
    plan: Plan, tasks: list[GroupTask], command: str, show: Progress
) -> tuple[list[GroupTask], RunRecord]:
    """Return the tasks with the view sets' digests, and the run's record. Raises `InputError` for a faulty set."""
    keys = plan.cells()
    read = {task.scene: scene_record(task, keys) for task in tasks[: len(plan.scenes)]}
    scenes = [each.record for each in read.values()]
    for scene in scenes if plan.view_set else ():
        box = " ".join(f"{x:.3g}" for corner in scene.bounds for x in corner)
        show.line(f"view set {scene.name}: box {box}; its silhouettes leave {scene.hull_share:.0%} of it; {scene.seen}")
    cautions = [f"{scene.name}: {caution}" for scene in scenes for caution in scene.cautions]
    for caution in cautions:
        show.line(f"view set {caution}")
    notes = {scene: each.notes for scene, each in read.items()} if plan.view_set else {}
    record = planned_record(plan, command, notes)
    claims = [measured_at_printed_size(file) for file in plan.claims]
    not_tested = [*record.not_tested, *cautions]
    record = structs.replace(record, scenes=scenes, claims=claims, not_tested=not_tested)
    return [_with_scene(plan, task, read[task.scene]) for task in tasks], record


def _with_scene(plan: Plan, task: GroupTask, read: SceneRead) -> GroupTask:
    """Return the task with the digest of its view set, and the Gaussians of the scene that are given."""
    task = replace(task, content=read.content)
    if not plan.given:
        return task
    given = GivenSettings(*plan.given[plan.scenes.index(task.scene)], read.focal)
    return replace(task, train=replace(task.train, own={**task.train.own, GIVEN: given}))


def _write(out: Path, keys: list[Key], record: RunRecord, phases: Phases, finished: bool = False) -> None:
    cells = list(read_cells_of(out, keys))
    not_tested = [*record.not_tested, *mixed_hardware(cells), *mixed_sources(cells)]
    write_run(out, structs.replace(record, phases=phases.seconds(), finished=finished, not_tested=not_tested))


def _train(tasks: list[GroupTask], keys: list[Key], record: RunRecord, machine: Machine, show: Progress) -> None:
    """Train the missing cells of the tasks; add the executor's notices to the record's provenance."""
    out, origin = tasks[0].out, record.provenance
    cells = _ended_cells(out, keys)
    missing = [replace(task, methods=methods) for task in tasks if (methods := missing_methods(task))]
    elsewhere = stale_cells(cells, origin, out)
    if elsewhere and (missing or mixed_sources(cells)):
        show.line(elsewhere)
    show.start_training(len(keys), sum(len(task.methods) for task in missing))
    for event in _events(missing, machine, origin["commit"], show):
        if event.notice is not None and event.notice not in (notices := origin.setdefault("notices", [])):
            notices.append(event.notice)
        if event.share is not None:
            show.trained(event.task, event.share)
            if event.share == 1.0:
                _compare(out, keys, record)
    drop_folder(out)


def _score_guests(plan: Plan, tasks: list[GroupTask], record: RunRecord, machine: Machine, show: Progress) -> None:
    """Score the missing guests: Gaussians as they are given, and a method that is trained for scale, on each scene for
    the baseline's core seconds if these are known.
    """
    out, baseline = tasks[0].out, record.roles.baseline
    _ended_cells(out, plan.guest_cells())
    due = []
    for task in (task for task in tasks if task.seed == plan.seeds[0]):
        path = cell_path(out, task.scene, baseline, task.seed)
        if plan.given:
            due.append(replace(task, methods=(GIVEN,), budget=Budget(0, None)))
        if plan.guest and path.exists() and (seconds := read_cell(path).train_core_seconds):
            due.append(replace(task, methods=(plan.guest,), budget=Budget(None, None, seconds)))
    for guest in plan.guests:  # one after the other, as both are groups of the same scenes and seed
        missing = [task for task in due if task.methods == (guest,) and missing_methods(task)]
        if not missing:
            continue
        if guest != GIVEN:
            show.line(f"training {guest} for scale, on each scene for the core seconds of {baseline}")
        for _ in _events(missing, machine, record.provenance["commit"], show):
            pass
        drop_folder(out)


def _ended_cells(out: Path, keys: list[Key]) -> list[CellRecord]:
    """Return the cells that have ended; the records of others are removed, so that they are tried again."""
    ended = []
    for cell in read_cells_of(out, keys):
        if cell.status in ENDED:
            ended.append(cell)
        else:
            cell_path(out, cell.scene, cell.method, cell.seed).unlink()
    return ended


def _events(tasks: list[GroupTask], machine: Machine, commit: str, show: Progress) -> Iterator[Event]:
    for event in run_groups(machine, tasks, commit, run_locally):
        if event.notice is not None:
            show.line(event.notice)
        if event.cell is not None:
            show.cell(event.cell)
        yield event


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
