"""Cells trained as planned and in other ways with everything else equal: the runs of every comparison of settings.

Paired cells share scene, method and seed, and so every batch and every initial weight of the same shape. What concerns
only rendering is tried on one set of weights, rendered both ways.
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from statistics import fmean
from typing import Any, Literal, TypeVar

import numpy as np
import torch

from harness.execution.ground_truth import read_views
from harness.machine.provenance import versions
from harness.machine.stopping import in_workers
from harness.machine.stopwatch import Stopwatch
from harness.plan.needed import kept
from harness.plan.run_plan import Plan
from harness.records.json_record import as_promised, digest_of, load_record, write_record
from harness.training.batches import Cameras
from harness.training.lockstep import stream_of, trained_alone
from harness.training.make_learner import NotAvailable
from harness.training.scoring import evaluate
from harness.training.trainer import Diverged, Trainer
from harness.verdicts.statistics import PairedDifference, paired_difference
from scenes.files.errors import InputError
from scenes.modelling.needs import with_needs
from scenes.view_sets.view_set import ViewSet

PLANNED = "as planned"
Key = TypeVar("Key")


@dataclass(frozen=True)
class Arm:
    train: Mapping[str, Any] = field(default_factory=dict)
    """Field of the settings of training → the value that replaces the planned one."""
    own: object = None
    """The method's own settings; None for the planned ones."""
    need: tuple[str, ...] = ()
    no_need: tuple[str, ...] = ()
    rendered_with: tuple[str, ...] = ()
    """The needs that are put back, one at a time, to render the same weights again."""


@dataclass(frozen=True)
class CellTask:
    scene: str
    method: str
    seed: int
    view_set: Path
    scratch: Path
    """A folder on a disk for decoded images."""
    plan: Plan
    arms: Mapping[str, Arm]
    device: str = "cpu"
    scored_on: Literal["val", "test"] = "test"
    kept: Path | None = None
    """The folder where the finished cell is kept, and from which it is read instead of being trained again."""


@dataclass(frozen=True)
class Rerendered:
    """The same weights, rendered again with a part that had been left out."""

    core_seconds: float
    core_seconds_without: float
    """The processor time of rendering the same views without it, the two timed in turn."""
    largest_change: float
    """The largest change of a display colour."""


@dataclass(frozen=True)
class Ended:
    psnr: float | None
    """The mean over the views that are scored; None if training diverged."""
    train_seconds: float = 0.0
    rerendered: dict[str, Rerendered] = field(default_factory=dict)
    core_seconds: float = 0.0
    rendering_core_seconds: float = 0.0
    """The processor time of rendering the scored views."""
    why: str = ""
    steps: int = 0


@dataclass(frozen=True)
class CellArms:
    scene: str
    method: str
    seed: int
    ended: dict[str, Ended]


def trained_cells(tasks: list[CellTask], workers: int) -> Iterator[CellArms]:
    return in_workers([partial(kept_cell, task) for task in tasks], workers)


def kept_cell(task: CellTask) -> CellArms:
    """Return the kept cell, or train it and keep it; a cell that cannot be read is trained again."""
    if task.kept is None:
        return trained_cell(task)
    file = task.kept / f"{task.scene}-{task.method}-{task.seed}-{identity(task)}.json"
    with suppress(OSError, ValueError):
        return as_promised(load_record(file), CellArms)
    cell = trained_cell(task)
    file.parent.mkdir(exist_ok=True)
    write_record(file, cell)
    return cell


def identity(task: CellTask) -> str:
    """Return the digest of all that a cell's results depend on, except its scene and seed."""
    plan = replace(task.plan.without_extras(), scenes=(), methods=(task.method,), seeds=())
    arms = {name: asdict(arm) for name, arm in task.arms.items()}
    given = [plan.settings(), arms, task.view_set.name, task.device, task.scored_on]
    return digest_of([*given, versions()])[:12]


def trained_cell(task: CellTask) -> CellArms:
    views = views_of(task.view_set, task.plan, task.scratch, task.scored_on)
    ended = {name: _ended(task, arm, views) for name, arm in task.arms.items()}
    return CellArms(task.scene, task.method, task.seed, ended)


def views_of(folder: Path, plan: Plan, scratch: Path, scored_on: Literal["val", "test"]) -> ViewSet:
    """Read a view set. Raises `InputError` if it lacks the validation views that are scored."""
    views = read_views(folder, plan.views, scratch, scored_on)
    if scored_on == "val" and not views.val.names:
        raise InputError(f"{folder}: has no validation views (transforms_val.json), which are scored here")
    return views


def means_of(scored: Iterable[tuple[Key, float | None]]) -> dict[Key, float | None]:
    """Map key → the mean of its scores, the best first; None, and last, if a score is missing."""
    scores: dict[Key, list[float | None]] = {}
    for key, score in scored:
        scores.setdefault(key, []).append(score)
    means = {
        key: None if None in some else fmean(score for score in some if score is not None)
        for key, some in scores.items()
    }
    return dict(sorted(means.items(), key=lambda item: -np.inf if item[1] is None else item[1], reverse=True))


def weigh(pairs: Iterable[tuple[float | None, float | None]]) -> PairedDifference | None:
    """Return the first score less the second over the pairs that have both; None without such a pair."""
    differences = [first - second for first, second in pairs if first is not None and second is not None]
    return paired_difference(np.array(differences)) if differences else None


def _ended(task: CellTask, arm: Arm, views: ViewSet) -> Ended:
    plan, device = task.plan, torch.device(task.device)
    views = with_needs(views, arm.need, arm.no_need)
    split = views.val if task.scored_on == "val" else views.test
    cameras, watch, chunk = evaluate.cameras_of(views, split, device), Stopwatch(device), plan.score.chunk
    own = plan.own_settings([task.method]) if arm.own is None else {task.method: arm.own}
    settings = replace(kept(replace(plan.train, **arm.train), arm.need), own=own)
    try:
        stream = stream_of(task.scene, task.seed)
        trainer = trained_alone(task.method, views, stream, settings, plan.budget, device)
        rendered = watch.counting(evaluate.render_split(trainer, cameras, chunk))
        psnr = evaluate.quick_scores(rendered, split)["psnr"]
        again = {}
        if isinstance(trainer, Trainer):
            again = {name: _rerendered(trainer, name, cameras, chunk) for name in arm.rendered_with}
        clock = trainer.clock
        return Ended(psnr, clock.seconds, again, clock.core_seconds, watch.core_seconds, steps=trainer.step)
    except Diverged:
        return Ended(None, why="diverged")
    except NotAvailable as missing:
        return Ended(None, why=f"not available: {missing}")


def _rerendered(trainer: Trainer, name: str, cameras: Cameras, chunk: int) -> Rerendered:
    """Render view by view without and with the part `name`, in turn; the trainer's settings are restored."""
    settings = {"out": trainer.settings, "in": kept(trainer.settings, (name,))}
    watches = {part: Stopwatch(trainer.device) for part in settings}
    largest = 0.0
    for index in range(len(cameras)):
        colours = {}
        for part in ("out", "in") if index % 2 else ("in", "out"):
            trainer.settings = settings[part]
            with watches[part].running():
                colours[part] = evaluate.render_view(trainer, cameras, index, chunk).colour
        largest = max(largest, float(np.abs(colours["out"] - colours["in"]).max()))
    trainer.settings = settings["out"]
    return Rerendered(watches["in"].core_seconds, watches["out"].core_seconds, largest)
