"""Settings from the needs of a scene's view set, including parts that the user forces in or out."""

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from harness.plan.settings import TrainSettings
from scenes.modelling.needs import PARTS, Need, Needs, needs_of
from scenes.view_sets.source import covered_pixels

if TYPE_CHECKING:
    from scenes.view_sets.view_set import ViewSet

LEFT_OUT_BY = {
    "view_direction": "directions",
    "outside_box": "clipping",
    "empty_space": "grid",
    "outside_hull": "hull",
    "behind_matter": "hidden",
    "behind_opaque": "early_stop",
}
"""Part → the acceleration that leaves it out: `--need PART` and `--without ACCELERATION` are the same."""
FORCEABLE = (*LEFT_OUT_BY, "background_rays", "fine_pass", "participating_media", "depth_metric")
"""The parts that a user can force; no method has the others, or every comparison needs them."""
SAMPLED = ("outside_box", "empty_space", "outside_hull", "behind_matter", "background_rays", "behind_opaque")
"""The parts that the training settings decide."""


def kept(train: TrainSettings, need: tuple[str, ...]) -> TrainSettings:
    """Return `train` without any acceleration that leaves out a part of `need`."""
    off = tuple(acceleration for name, acceleration in LEFT_OUT_BY.items() if name in need)
    fine = train.fine_bins or 2 * train.bins if "fine_pass" in need else train.fine_bins
    covered = 0.0 if "background_rays" in need else train.covered_share
    return replace(train, accelerations=train.accelerations.without(off), fine_bins=fine, covered_share=covered)


def needs_here(train: TrainSettings, views: "ViewSet") -> Needs:
    """Return the needs of the view set, and those that follow from its silhouettes when training with `train`; the
    latter are the same for all methods, and known for all images with alpha.
    """
    known = needs_of(views)
    derived: dict[str, tuple[bool, str]] = {}
    if train.covered_share:
        seen = len(covered_pixels(views.train.rgba)) / math.prod(views.train.rgba.shape[:3])
        derived["background_rays"] = (
            seen >= train.covered_share,
            f"the object, or its edge, fills {100 * seen:.0f} % of a view",
        )
    if train.grid.cells and train.accelerations.grid:
        if train.accelerations.hull:
            share = float(views.hull.mean())
            derived["outside_hull"] = (share == 1.0, f"the silhouettes leave {100 * share:.0f} % of the box")
        if train.accelerations.hidden:
            behind = known.get("behind_opaque")
            reason = "a ray ends where the grid measured opaque matter" if behind is None else behind.reason
            derived["behind_matter"] = (behind is not None and behind.needed, reason)
    known = {name: Need(name, *facts) for name, facts in derived.items()} | known
    return {name: known[name] for name in PARTS if name in known}


def for_scene(train: TrainSettings, views: "ViewSet") -> TrainSettings:
    """Return `train` with all parts that this scene needs, and without those that it does not need. The view direction
    is not among them: `harness.training.lockstep.needs_view_direction` decides it for a learner.
    """
    needs = needs_of(views)
    sampling = tuple(name for name in SAMPLED if _is(needs, name, True))
    train = at_scale(kept(train, sampling), views)
    return replace(train, fine_bins=0) if _is(needs, "fine_pass", False) else train


LEAST_CELLS, MOST_CELLS = 16, 128
LEAST_BINS, MOST_BINS = 24, 256


def pixels_across(views: "ViewSet") -> float:
    """Return the length in pixels of the box's longest side, at its centre in a mean training view."""
    centre, longest = views.bounds.mean(axis=0), float((views.bounds[1] - views.bounds[0]).max())
    distance = float(np.linalg.norm(views.train.camera_to_world[:, :3, 3] - centre, axis=-1).mean())
    return longest * views.focal / distance


def at_scale(train: TrainSettings, views: "ViewSet") -> TrainSettings:
    """Return `train` with the numbers of cells and bins that are given per pixel computed for these views."""
    pixels = pixels_across(views)
    if train.grid.per_pixel is not None and train.grid.cells:
        cells = min(max(round(train.grid.per_pixel * pixels), LEAST_CELLS), MOST_CELLS)
        train = replace(train, grid=replace(train.grid, cells=cells))
    if train.bins_per_pixel is None:
        return train
    return replace(train, bins=min(max(round(train.bins_per_pixel * pixels), LEAST_BINS), MOST_BINS))


def _is(needs: Needs, name: str, needed: bool) -> bool:
    return name in needs and needs[name].needed == needed
