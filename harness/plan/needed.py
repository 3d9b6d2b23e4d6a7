"""Settings from a scene's needs: those of its view set, overruled by what the user forces in or out."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from harness.plan.settings import TrainSettings
from scenes.modelling.needs import Needs, needs_of

if TYPE_CHECKING:
    from scenes.view_sets.view_set import ViewSet

LEFT_OUT_BY = {
    "view_direction": "directions",
    "outside_box": "clipping",
    "empty_space": "grid",
    "behind_opaque": "early_stop",
}
"""Map need → the acceleration that leaves it out (`--need NAME` and `--without ACCELERATION` are the same)."""
FORCEABLE = (*LEFT_OUT_BY, "fine_pass", "participating_media", "depth_metric")
"""The parts with a choice: no method has the other parts, or all are compared with them."""


def kept(train: TrainSettings, need: tuple[str, ...]) -> TrainSettings:
    """Return `train` without any acceleration that leaves out a part of `need`."""
    off = tuple(acceleration for name, acceleration in LEFT_OUT_BY.items() if name in need)
    fine = train.fine_bins or 2 * train.bins if "fine_pass" in need else train.fine_bins
    return replace(train, accelerations=train.accelerations.without(off), fine_bins=fine)


def for_scene(train: TrainSettings, views: "ViewSet") -> TrainSettings:
    """Return `train` with all parts that this scene needs, and without those that it does not need.

    The view direction is not in these settings: whoever makes a learner asks
    `harness.training.lockstep.needs_view_direction`.
    """
    needs = needs_of(views)
    sampling = tuple(name for name in ("outside_box", "empty_space", "behind_opaque") if _is(needs, name, True))
    train = at_scale(kept(train, sampling), views)
    return replace(train, fine_bins=0) if _is(needs, "fine_pass", False) else train


LEAST_CELLS, MOST_CELLS = 16, 128
LEAST_BINS, MOST_BINS = 24, 256


def at_scale(train: TrainSettings, views: "ViewSet") -> TrainSettings:
    """Return `train` with the cells and bins that are given per pixel counted for the box of these views."""
    centre, longest = views.bounds.mean(axis=0), float((views.bounds[1] - views.bounds[0]).max())
    distance = float(np.linalg.norm(views.train.camera_to_world[:, :3, 3] - centre, axis=-1).mean())
    pixels = longest * views.focal / distance
    if train.grid.per_pixel is not None and train.grid.cells:
        cells = min(max(round(train.grid.per_pixel * pixels), LEAST_CELLS), MOST_CELLS)
        train = replace(train, grid=replace(train.grid, cells=cells))
    if train.bins_per_pixel is not None:
        bins = min(max(round(train.bins_per_pixel * pixels), LEAST_BINS), MOST_BINS)
        train = replace(train, bins=bins)
    return train


def _is(needs: Needs, name: str, needed: bool) -> bool:
    return name in needs and needs[name].needed == needed
