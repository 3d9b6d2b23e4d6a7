"""One method trained alone on one view set: what measures a single difference, beside the comparisons in lockstep."""

from collections.abc import Callable

import torch

from harness import evaluate
from harness.batches import Batches
from harness.learner import Learner
from harness.lockstep import box_of, needs_view_direction
from harness.make_learner import learner_for
from harness.needed import for_scene
from harness.schedule import Budget
from harness.settings import TrainSettings
from scenes.view_set import Split, ViewSet


def trained_alone(
    method: str,
    views: ViewSet,
    stream: str,
    settings: TrainSettings,
    budget: Budget,
    device: torch.device,
    on_step: Callable[[Learner], None] | None = None,
) -> Learner:
    """Trained to the end of its budget on the batches of `stream`; `on_step` is called after each step, off the clock.

    What the scene does not need is left out. Raises `Diverged`, and `NotAvailable` for a method that cannot run here.
    """
    settings = for_scene(settings, views)
    cameras = evaluate.cameras_of(views, views.train, device)
    batches = Batches(cameras, views.train.rgba, settings.ray_attention)
    box, directed = box_of(views, device), needs_view_direction(views)
    trainer = learner_for(method, box, settings, budget, stream, device, directed)
    trainer.warm_up(*batches.batch(stream, 0, settings.rays))
    while trainer.progress < 1.0:
        trainer.train_on(*batches.batch(stream, trainer.step, settings.rays))
        if on_step is not None:
            on_step(trainer)
    return trainer


def psnr_on(trainer: Learner, views: ViewSet, split: Split, chunk: int) -> float | None:
    """Mean PSNR over a split of `views`; raises `Diverged` on a pixel that is not finite."""
    cameras = evaluate.cameras_of(views, split, trainer.device)
    return evaluate.quick_scores(evaluate.render_split(trainer, cameras, chunk), split)["psnr"]
