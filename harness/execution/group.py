"""A group of cells, (scene, seed), from its view set to its records: the work of a worker process."""

import traceback
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import torch

from harness.execution.ground_truth import read_views
from harness.machine.device import keep_freed_memory, use_threads
from harness.machine.provenance import provenance
from harness.plan.group_task import GroupTask
from harness.plan.needed import for_scene
from harness.plan.plugins import origins, require_methods
from harness.records.cells import CellRecord, cell_path, empty_cell, with_files, write_cell
from harness.records.snapshot import drop_ended
from scenes.files.errors import InputError


def run_group(
    task: GroupTask,
    on_progress: Callable[[float], None],
    on_cell: Callable[[CellRecord], None],
    placed: dict[str, object] | None = None,
    on_notice: Callable[[str], None] = lambda text: None,
) -> None:
    """Train, score and write every method of the group; a program error ends in records of status `error`. `placed` is
    what provenance tells of the executor: `own_cores`, `cores`, `node`, … Raises `OSError` if a record cannot be
    written.
    """
    from harness.training.cell_training import content_of
    from harness.training.lockstep import train_group

    try:
        task.out.mkdir(parents=True, exist_ok=True)  # decoded images are written there before the first record
        use_threads(task.threads)
        keep_freed_memory()
        views = read_views(task.view_set, task.views, task.out, decoded=task.decoded)
        if task.content not in (None, content_of(views)):
            raise InputError(
                f"{task.view_set}: changed since the run began; put it back as it was and resume with --resume, or "
                "start again with a fresh --out"
            )
        if task.hull is not None:
            views.adopt_hull(task.hull)
        require_methods(task.methods)
        origin = {**provenance(torch.device(task.device)), **origins(task.methods), **(placed or {})}
        fitted = replace(task, train=for_scene(task.train, views))
        for cell in train_group(fitted, views, origin, on_progress, on_notice=on_notice):
            cell = with_files(task.out, cell)
            write_cell(task.out, cell)
            drop_ended(task.out, cell)
            on_cell(cell)
    except OSError:
        raise
    except Exception as error:
        reason = str(error)
        if not isinstance(error, InputError):
            lines = traceback.format_exception_only(error)
            where = traceback.extract_tb(error.__traceback__)[-1]
            reason = f"{''.join(lines).strip()} ({Path(where.filename).name}:{where.lineno})"
        for cell in failed_cells(task, reason):
            on_cell(cell)


def missing_methods(task: GroupTask) -> tuple[str, ...]:
    """Return the methods of the group without a record."""
    return tuple(name for name in task.methods if not cell_path(task.out, task.scene, name, task.seed).exists())


def failed_cells(task: GroupTask, reason: str) -> list[CellRecord]:
    """Write and return a record of status `error` for each method of the group without a record."""
    cells = [empty_cell(task.scene, method, task.seed, "error", reason) for method in missing_methods(task)]
    for cell in cells:
        write_cell(task.out, cell)
    return cells
