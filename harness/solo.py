"""One method trained alone on one view set: what measures a single difference, beside the comparisons in lockstep."""

from collections.abc import Callable

import torch

from harness import evaluate
from harness.batches import Batches
from harness.lockstep import box_of, needs_view_direction
from harness.schedule import Budget
from harness.settings import TrainSettings
from harness.trainer import Trainer
from scenes.view_set import ViewSet


def trained_alone(
    method: str,
    views: ViewSet,
    stream: str,
    settings: TrainSettings,
    budget: Budget,
    device: torch.device,
    on_step: Callable[[Trainer], None] | None = None,
) -> Trainer:
    """Trained to the end of its budget on the batches of `stream`; `on_step` is called after each step, off the clock.

    Raises `Diverged`.
    """
    batches = Batches(evaluate.cameras_of(views, views.train, device), views.train.rgba)
    trainer = Trainer(method, box_of(views, device), settings, budget, stream, device, needs_view_direction(views))
    trainer.warm_up(*batches.batch(stream, 0, settings.rays))
    while trainer.progress < 1.0:
        trainer.train_on(*batches.batch(stream, trainer.step, settings.rays))
        if on_step is not None:
            on_step(trainer)
    return trainer


def test_psnr(trainer: Trainer, views: ViewSet, chunk: int) -> float | None:
    """Mean PSNR over the test views; raises `Diverged` on a pixel that is not finite."""
    cameras = evaluate.cameras_of(views, views.test, trainer.device)
    return evaluate.quick_scores(evaluate.render_split(trainer, cameras, chunk), views.test)["psnr"]
