"""What a scene needs, made into settings: from its view set, with what the user forces in or out on top."""

from dataclasses import replace
from typing import TYPE_CHECKING

from harness.plan.settings import TrainSettings
from scenes.modelling.needs import Needs, as_rows, forced, left_out, needs_from_rows

if TYPE_CHECKING:
    from scenes.view_sets.view_set import ViewSet

LEFT_OUT_BY = {
    "view_direction": "directions",
    "outside_box": "clipping",
    "empty_space": "grid",
    "behind_opaque": "early_stop",
}
"""Need → the acceleration that leaves it out (`--need NAME` and `--without ACCELERATION` are the same)."""
FORCEABLE = (*LEFT_OUT_BY, "fine_pass", "participating_media", "depth_metric")
"""What there is a choice about: the other parts no method has, or all are compared with."""


def needs_of(views: "ViewSet") -> Needs:
    """Empty for a view set from elsewhere, about whose scene nothing is known."""
    return needs_from_rows(views.rendered.get("needs"))


def with_needs(views: "ViewSet", need: tuple[str, ...], no_need: tuple[str, ...]) -> "ViewSet":
    """The same images, with parts forced in or out; without depth where nothing has one."""
    if need or no_need:
        found = forced(needs_of(views), need, no_need)
        views = replace(views, rendered={**views.rendered, "needs": as_rows(found), "left_out": left_out(found)})
    depth = needs_of(views).get("depth_metric")
    if depth is not None and not depth.needed:
        views = replace(views, val=replace(views.val, depth=None), test=replace(views.test, depth=None))
    return views


def kept(train: TrainSettings, need: tuple[str, ...]) -> TrainSettings:
    """`train` that leaves out none of `need`."""
    off = tuple(acceleration for name, acceleration in LEFT_OUT_BY.items() if name in need)
    fine = train.fine_bins or 2 * train.bins if "fine_pass" in need else train.fine_bins
    return replace(train, accelerations=train.accelerations.without(off), fine_bins=fine)


def for_scene(train: TrainSettings, views: "ViewSet") -> TrainSettings:
    """`train` with what this scene needs kept and what it does not need left out.

    The view direction is not in these settings: whoever makes a learner asks
    `harness.training.lockstep.needs_view_direction`.
    """
    found = needs_of(views)
    sampling = tuple(name for name in ("outside_box", "empty_space", "behind_opaque") if _is(found, name, True))
    train = kept(train, sampling)
    return replace(train, fine_bins=0) if _is(found, "fine_pass", False) else train


def _is(found: Needs, name: str, needed: bool) -> bool:
    return name in found and found[name].needed == needed
