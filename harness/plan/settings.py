"""Settings of training, sampling and scoring, the same for all methods except `TrainSettings.own`."""

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
    """The first step with a grid. Everything is evaluated before, as early pruning deletes unlearnt parts."""
    every: int = 25
    share: float = 0.25
    """The share of the cells measured at each refresh; the first refresh measures all."""
    opacity_threshold: float = 0.02
    """A cell is occupied if a ray loses at least this share of what it loses in the densest cell."""
    exploration: float = 0.01
    """The share of the unoccupied points that training evaluates nevertheless."""
    per_pixel: float | None = None
    """The cells per pixel of the box's longest side, which replace `cells` (`harness.plan.needed.at_scale`)."""


@dataclass(frozen=True)
class TrainSettings:
    """The training settings, by default those of §7.1 (Adam, 5e-4, 1024 rays) with the original NeRF's sampling."""

    network: NetworkSize = field(default_factory=NetworkSize)
    rays: int = 1024
    bins: int = 64
    bins_per_pixel: float | None = None
    """The bins per pixel of the box's longest side, in place of `bins` once a view set is known."""
    first_bins: int = 64
    """The bins per ray before the occupancy grid is in use."""
    rendered_bins: int | None = None
    """The bins per ray of pictures; None: those of training. More cost little, as the grid leaves most of them out."""
    fine_bins: int = 128
    covered_share: float = 0.0
    """The share of rays through covered pixels, so that the object weighs more in the loss; the rest are uniform."""
    contrast_weight: float = 0.0
    """The weight of a covered pixel's contrast in its chance to be drawn (`Batches`): errors are largest at edges."""
    optimiser: OptimiserSettings = field(default_factory=OptimiserSettings)
    learning_rate: float = 5e-4
    last_learning_rate: float = 5e-5
    decay: Decay = "exponential"
    """The fall of the learning rate between the two; a linear one stays high for longer."""
    warm_up_steps: int = 0
    average: float = 0.0
    """The power of the running mean of the weights, which is rendered and saved in their place; 0: no mean."""
    clip_norm: float = 1.0
    clip_ratio: float = 4.0
    """A gradient is also clipped to this multiple of the usual norm of previous gradients: a norm of 1, which
    `clip_norm` passes, may be a hundred times the usual, and Adam remembers its square for a thousand steps.
    """
    precision: Precision = "float32"
    own: dict[str, Any] = field(default_factory=dict)
    """Method → its own settings (`baselines.catalog.Method.settings`), in place of the catalogue's."""
    grid: GridSettings = field(default_factory=GridSettings)
    accelerations: Accelerations = EVERY_ACCELERATION


@dataclass(frozen=True)
class ScoreSettings:
    """When the test set is scored, and how."""

    checkpoints: int = 8
    earliest: float = 0.02
    """The share of the budget at the first checkpoint."""
    curve_views: int | None = None
    """The number of test views, evenly spread, of which the curves are means; None: all. Scores are of all views."""
    chunk: int = 4096
    """The number of rays rendered at a time; part of the result if a method's density depends on the chunk."""
    train_views: int = 4
    """The number of training views scored at the end, for comparison with the test views."""
    stored_views: int = 2
    """The number of test views kept as pictures for the report."""

    def on_curve(self, test: int) -> int:
        """Return the number of views, of `test` views, of which the curves are means."""
        return test if self.curve_views is None else min(self.curve_views, test)

    def rendered(self, test: int) -> int:
        """Return how many of `test` views a cell renders, at its checkpoints and at its end."""
        return (self.checkpoints - 1) * self.on_curve(test) + test


NEEDED, NEEDED_DB, NEEDED_SLOPE_DB = (95, 400), 45.0, 12.0
"""The extremes of the samples per pixel that a classic scene needs for 45 dB, and the gain of ten times as many."""


@dataclass(frozen=True)
class ViewSettings:
    """The ground truth to render, and the parts that are forced in or out."""

    resolution: int = 800
    train: int = 100
    val: int = 100
    test: int = 200
    spp_train: int = 256
    """The samples per pixel of training and validation views; the maximum, if there is a ceiling."""
    spp_test: int = 256
    ceiling_train_db: float | None = None
    """The PSNR that the noise of these views must allow, which decides the samples (`scenes.rendering.samples`)."""
    ceiling_test_db: float | None = None
    need: tuple[str, ...] = ()
    """The parts that are kept even if a scene does not need them (`harness.plan.needed.FORCEABLE`)."""
    no_need: tuple[str, ...] = ()
    """The parts that are left out even if a scene needs them."""
    region: Region | None = None
    """The region of the visible geometry, if the user gives it for a view set."""

    def samples(self) -> tuple[float, float]:
        """Return the minimum and maximum, over the classic scenes, of the samples per pixel of all views together."""
        views, ceilings = (self.train + self.val, self.test), (self.ceiling_train_db, self.ceiling_test_db)
        low = high = 0.0
        for count, most, db in zip(views, (self.spp_train, self.spp_test), ceilings, strict=True):
            share = math.inf if db is None else 10 ** ((db - NEEDED_DB) / NEEDED_SLOPE_DB)
            least, many = (min(most, needed * share) for needed in NEEDED)
            low, high = low + count * least, high + count * many
        return low, high
