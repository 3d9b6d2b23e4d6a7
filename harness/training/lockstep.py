"""All methods of one scene and seed, trained in turn on the same batches, each on its own clock; or one method."""

from collections.abc import Callable, Iterator

import torch

from baselines.contract import Box
from harness.plan.group_task import GroupTask
from harness.plan.needed import for_scene, pixels_across
from harness.plan.schedule import Budget
from harness.plan.settings import TrainSettings
from harness.records.cells import CellRecord, empty_cell
from harness.training.batches import Batches
from harness.training.cell_training import CellTraining, IncompatibleSnapshot
from harness.training.checkpoints import Keeping
from harness.training.learner import Job, Learner, train, turns_of, warm_up
from harness.training.make_learner import NotAvailable, learner_for
from harness.training.saved_renders import keep_truth
from harness.training.scoring import evaluate
from harness.training.shared_state import left_as_it_was
from scenes.files.errors import InputError
from scenes.modelling.needs import part_name
from scenes.view_sets.view_set import ViewSet


def train_group(
    task: GroupTask,
    views: ViewSet,
    provenance: dict[str, object],
    on_progress: Callable[[float], None],
    made_by: Callable[..., Learner] | None = None,
    on_notice: Callable[[str], None] = lambda text: None,
) -> Iterator[CellRecord]:
    """Yield the record of each method as soon as it has ended; methods that fail or diverge do not stop the others.

    `on_progress` gets the trained share of the group; `made_by` replaces `learner_for`. Snapshots of all cells are
    written to the output folder from time to time; resuming a cell from one is reported to `on_notice`.
    """
    device, stream = torch.device(task.device), stream_of(task.scene, task.seed)
    batches = _batches(views, task.train, device)
    box, directed = box_of(views, device), needs_view_direction(views)
    floor = evaluate.floor_psnr(views)
    keep_truth(task.out, task.scene, views, task.score.stored_views)

    def fresh(method: str) -> CellTraining:
        job = Job(method, box, task.train, task.budget, stream, device, directed)
        learner = (made_by or learner_for)(job)
        batch_at = batches.for_learner(learner.whole_views, stream, task.train.rays, turns_of(learner) is not None)
        return CellTraining(learner, batch_at, views, task, provenance, floor)

    runners = []
    for method in task.methods:
        started = _started(method, task, fresh, on_notice)
        if isinstance(started, CellRecord):
            yield started
        else:
            runners.append(started)
    active = list(runners)
    keeping = Keeping(task.keep_every)
    turn = 0
    while active:
        first = turn % len(active)
        for runner in active[first:] + active[:first]:  # the order rotates, so that caches favour no method
            record = runner.advance()
            if record is not None:
                active.remove(runner)
                yield record
            if keeping.is_due:
                with keeping.done():
                    for notice in filter(None, [cell.keep() for cell in active]):
                        on_notice(notice)
        on_progress(sum(min(runner.progress, 1.0) for runner in runners) / len(runners))
        turn += 1


def _batches(views: ViewSet, settings: TrainSettings, device: torch.device) -> Batches:
    cameras = evaluate.cameras_of(views, views.train, device)
    return Batches(cameras, views.train.rgba, settings.covered_share, settings.contrast_weight)


def _started(
    method: str, task: GroupTask, fresh: Callable[[str], CellTraining], on_notice: Callable[[str], None]
) -> CellTraining | CellRecord:
    """Return the cell, resumed from a snapshot if it has one, or its record if it ends before the first step."""
    try:
        with left_as_it_was():
            runner = fresh(method)
    except NotAvailable as missing:
        return empty_cell(task.scene, method, task.seed, "not_available", str(missing))
    except InputError:
        raise
    except (Exception, SystemExit) as error:
        reason = f"{type(error).__name__} before the first step: {error}"
        return empty_cell(task.scene, method, task.seed, "error", reason)
    if (failed := runner.warm_up()) is not None:
        return failed
    try:
        notice = runner.resume()
    except IncompatibleSnapshot as incompatible:
        notice, runner = str(incompatible), fresh(method)
        runner.warm_up()
    if notice:
        on_notice(notice)
    return runner


def box_of(views: ViewSet, device: torch.device) -> Box:
    """Return the box around everything visible, with the hull and the scale of the training views."""
    lower, upper = (torch.as_tensor(corner, dtype=torch.float32, device=device) for corner in views.bounds)
    return Box(lower, upper, torch.from_numpy(views.hull), pixels_across(views))


def stream_of(scene: str, seed: int) -> str:
    """Return the seed of a cell's random numbers: scenes are independent draws, methods of one scene are paired."""
    return f"{scene}/{seed}"


def needs_view_direction(views: ViewSet) -> bool:
    """Return False if the scene's description says that it looks the same from all sides."""
    rows = views.rendered.get("left_out", [])
    return "view_direction" not in [part_name(row["what"], row.get("name", "")) for row in rows]


def trained_alone(
    method: str,
    views: ViewSet,
    stream: str,
    settings: TrainSettings,
    budget: Budget,
    device: torch.device,
) -> Learner:
    """Return a learner trained to the end of its budget on the batches of `stream`, without the parts that the scene
    does not need. Raises `Diverged`, and `NotAvailable` if the method cannot run here.
    """
    settings = for_scene(settings, views)
    directed = needs_view_direction(views)
    learner = learner_for(Job(method, box_of(views, device), settings, budget, stream, device, directed))
    batches = _batches(views, settings, device)
    batch_at = batches.for_learner(learner.whole_views, stream, settings.rays, turns_of(learner) is not None)
    warm_up(learner, batch_at)
    return train(learner, batch_at)
