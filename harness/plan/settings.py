"""Settings of training, sampling and scoring: small frozen groups, equal for all methods except what is their own."""

import math
from dataclasses import dataclass, field
from typing import Any

from baselines.contract import EVERY_ACCELERATION, Accelerations, NetworkSize, Precision
from baselines.numerics.optimisers import OptimiserSettings
from harness.plan.schedule import Decay
from scenes.view_sets.source import Region


@dataclass(frozen=True)
class GridSettings:
    """The occupancy grid that excludes empty space."""

    cells: int = 32
    """The number of cells along each axis; 0 switches the grid off."""
    first_step: int = 150
    """The first step with a grid. Everything is evaluated before: early pruning deletes what has not
    been learnt yet.
    """
    every: int = 25
    share: float = 0.25
    """The share of the cells measured at each refresh; the first one measures all."""
    opacity_threshold: float = 0.02
    """The least share of the densest cell's loss that a ray must lose in a cell for it to be occupied."""
    exploration: float = 0.01
    """The share of the unoccupied points that training evaluates all the same."""
    per_pixel: float | None = None
    """The cells per pixel of the box's longest side as a view shows it, in place of `cells` once a view set is known
    (`harness.plan.needed.at_scale`).
    """


@dataclass(frozen=True)
class TrainSettings:
    """The training settings, by default those of §7.1 of the paper: Adam, 5e-4, 1024 rays; the original NeRF's
    sampling.
    """

    network: NetworkSize = field(default_factory=NetworkSize)
    rays: int = 1024
    bins: int = 64
    bins_per_pixel: float | None = None
    """The bins per pixel of the box's longest side, in place of `bins` once a view set is known."""
    first_bins: int = 64
    """The bins per ray before the step from which the occupancy grid is in use."""
    rendered_bins: int | None = None
    """The bins per ray of pictures; None: those of training. Where the grid leaves out most of them, and none has a
    gradient, more cost little.
    """
    fine_bins: int = 128
    covered_share: float = 0.0
    """The share of a batch's rays that go through covered pixels; the others go anywhere. The loss then weighs the
    object more than its background, the same for all methods.
    """
    optimiser: OptimiserSettings = field(default_factory=OptimiserSettings)
    learning_rate: float = 5e-4
    last_learning_rate: float = 5e-5
    decay: Decay = "exponential"
    """The fall of the learning rate between the two. A linear one stays high for longer."""
    warm_up_steps: int = 0
    average: float = 0.0
    """The power of the running mean of the weights that is shown and kept in their place
    (`baselines.numerics.weight_average`); 0: the weights themselves.
    """
    clip_norm: float = 1.0
    clip_ratio: float = 4.0
    """The multiple of the usual norm of previous gradients to which a gradient is also clipped: a norm of 1 that
    `clip_norm` passes may be a hundred times the usual, and Adam remembers its square for a thousand steps.
    """
    precision: Precision = "float32"
    own: dict[str, Any] = field(default_factory=dict)
    """Method → the settings that are its own (`baselines.catalog.Method.settings`), in place of the catalogue's."""
    grid: GridSettings = field(default_factory=GridSettings)
    accelerations: Accelerations = EVERY_ACCELERATION


@dataclass(frozen=True)
class ScoreSettings:
    """The times and the size of scoring the test set."""

    checkpoints: int = 8
    earliest: float = 0.02
    """The share of the budget at the first checkpoint."""
    chunk: int = 4096
    """The number of rays rendered at a time; part of the result if a method's density depends on the chunk."""
    train_views: int = 4
    """The number of training views scored at the end, so that train and test stand together."""
    stored_views: int = 2
    """The number of test views kept as pictures for the report."""


NEEDED, NEEDED_DB, NEEDED_SLOPE_DB = (95, 400), 45.0, 12.0
"""The samples per pixel that the classics need for such a ceiling, least and most, and what ten times as many gain."""


@dataclass(frozen=True)
class ViewSettings:
    """The ground truth to render, and the parts that are taken to be needed of it."""

    resolution: int = 800
    train: int = 100
    val: int = 100
    test: int = 200
    spp_train: int = 256
    """The samples per pixel of training and validation views; the most, if there is a ceiling."""
    spp_test: int = 256
    ceiling_train_db: float | None = None
    """The PSNR that the noise of these views may allow, in place of a number of samples
    (`scenes.rendering.samples`).
    """
    ceiling_test_db: float | None = None
    need: tuple[str, ...] = ()
    """The parts that are kept whatever the scene says (`harness.plan.needed.FORCEABLE`)."""
    no_need: tuple[str, ...] = ()
    """The parts that are left out whatever the scene says."""
    region: Region | None = None
    """The region of the visible geometry, as the user gives it for images that are not ours."""

    def samples(self) -> tuple[float, float]:
        """Return the samples per pixel of all views together: of the classic scene that needs fewest, and most."""
        views, ceilings = (self.train + self.val, self.test), (self.ceiling_train_db, self.ceiling_test_db)
        low = high = 0.0
        for count, most, db in zip(views, (self.spp_train, self.spp_test), ceilings, strict=True):
            share = math.inf if db is None else 10 ** ((db - NEEDED_DB) / NEEDED_SLOPE_DB)
            least, many = (min(most, needed * share) for needed in NEEDED)
            low, high = low + count * least, high + count * many
        return low, high
