"""The billboard failure, brought about on purpose: every training image painted in front of its own camera."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from harness import evaluate
from harness.batches import Batches
from harness.cell_training import warnings_of
from harness.ground_truth import read_views
from harness.lockstep import box_of
from harness.schedule import Budget
from harness.settings import TrainSettings, ViewSettings
from harness.trainer import Trainer

FEW_VIEWS = 6
STEPS = 200
FOG = 20.0
"""Added to every raw density at the start: softplus of it is opaque within a bin, so the first bin is all that is
seen, and no gradient reaches what lies behind. A density without a bias, scaled up, starts like that."""


@dataclass(frozen=True)
class Painted:
    """How it ends."""

    train: float
    """PSNR of the training views, dB."""
    test: float
    floor: float
    """Of copies of the nearest training view."""
    depth: float
    """Median over the test views, scene units."""
    near: float
    """Where rays begin."""
    warnings: list[str]


def planted_billboard(folder: Path, views: ViewSettings, train: TrainSettings, scratch: Path, steps: int) -> Painted:
    """`nerf` trained on a few views of the set in `folder`, with fog before every camera at the start.

    Rays run from near to far, as in the original: cut to a box that all cameras share, they would have to share what
    is painted on it as well.
    """
    seen = read_views(folder, replace(views, train=FEW_VIEWS), scratch)
    settings = replace(
        train,
        accelerations=train.accelerations.without(("clipping", "grid", "early_stop")),
        grid=replace(train.grid, cells=0),
    )
    device = torch.device("cpu")
    batches = Batches(evaluate.cameras_of(seen, seen.train, device), seen.train.rgba)
    learner = Trainer("nerf", box_of(seen, device), settings, Budget(steps, None), "billboard", device)
    with torch.no_grad():
        learner.coarse.density_head.bias.add_(FOG)
    while learner.progress < 1.0:
        learner.train_on(*batches.batch("billboard", learner.step, settings.rays))
    images = list(evaluate.render_split(learner, evaluate.cameras_of(seen, seen.test, device), chunk=4096))
    scores = {
        "psnr": evaluate.quick_scores(images, seen.test)["psnr"],
        "psnr_train": evaluate.train_psnr(learner, seen, FEW_VIEWS, chunk=4096),
        "psnr_floor": evaluate.floor_psnr(seen),
    }
    opacity = float(np.mean([image.opacity.mean() for image in images]))
    return Painted(
        train=scores["psnr_train"] or 0.0,
        test=scores["psnr"] or 0.0,
        floor=scores["psnr_floor"] or 0.0,
        depth=float(np.median([image.depth for image in images])),
        near=seen.near,
        warnings=warnings_of(scores, opacity, grid_emptied=False),
    )
