"""Samples distributed evenly, and by attention at as many samples or network evaluations: errors, seconds."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from baselines.numerics.attention.priorities import allocated_bins, in_steps, is_equal
from harness.playback.progressive import evaluations_by_region, render_allocated
from harness.records.study import Table
from harness.studies.framework import Found
from harness.studies.serving.anytime import attended_pixels
from harness.studies.serving.attention_views import (
    KINDS,
    NOTHING,
    AttendedView,
    Looked,
    attended_views,
    attention_of,
    least_bins,
)
from harness.studies.serving.serving_context import CLOCK, Clock, ServingContext, factor, rmse, study

WAYS = {
    "even": "the same for each ray",
    "samples": "by attention, as many samples",
    "evaluations": "by attention, as many evaluations",
}
"""How samples are shared out; those by attention with what it cost to find out."""
WHERE = ("whole", "attended")
Choice = tuple[str, str | None]
"""The way, and the map."""


@dataclass(frozen=True)
class AllocatedRender:
    """One picture with its samples distributed in one way."""

    colour: np.ndarray
    bins: float
    evaluations: int
    own: int
    """The evaluations spent on the distribution itself."""
    seconds: float


@dataclass(frozen=True)
class Sampled:
    """All measurements of one view."""

    of: AttendedView
    reference: np.ndarray
    pictures: dict[Choice, AllocatedRender]
    seconds: dict[Choice, list[float]]


@dataclass(frozen=True)
class Allocation:
    """A picture with its samples shared out in one way."""

    scene: str
    kind: str
    way: str
    picture: AllocatedRender
    seconds: float
    """The median of the repeats, with finding out."""
    errors: dict[str, float]
    """Where → root mean square error of display colour against the same field, finely integrated."""
    truths: dict[str, float]
    """Where → that against the ground truth; empty where its views are not there any more."""

    @property
    def row(self) -> list[str | float | None]:
        one = self.picture
        figures = (one.bins, one.evaluations, one.own, self.seconds)
        against = (errors.get(where) for errors in (self.errors, self.truths) for where in WHERE)
        return [self.scene, self.kind, WAYS[self.way], *map(float, figures), *against]


COMPARED: dict[str, tuple[str, Callable[[Allocation], float]]] = {
    "whole": ("error in the whole picture", lambda one: one.errors["whole"]),
    "attended": ("error in the attended quarter", lambda one: one.errors["attended"]),
    "truth": ("error against the ground truth", lambda one: one.truths.get("whole", 0.0)),
    "evaluations": ("network evaluations", lambda one: one.picture.evaluations),
    "seconds": ("seconds", lambda one: one.seconds),
}
"""Id → what of a picture is compared with the even one's, in words, and where it stands."""


@study
def samples(context: ServingContext) -> Iterator[Found]:
    """Yield errors and costs of samples by attention against those of the even picture with as many a ray."""
    some = [one for one in attended_views(context) if not one.number]
    rows: list[Allocation] = []
    for one in some:
        if context.is_over(f"samples by attention on {one.scene}"):
            break
        rows += allocations(sampled(one, context.sizes.reference_bins, context.sizes.shared))
    if not rows:
        yield NOTHING
        return
    yield from compared(rows)


def compared(rows: Sequence[Allocation]) -> Iterator[Found]:
    """Yield everything that follows from the pictures."""
    even = {(one.scene, one.kind): one for one in rows if one.way == "even"}
    for way in ("evaluations", "samples"):
        pairs = [(one, even[one.scene, one.kind]) for one in rows if one.way == way]
        checks = [
            factor(f"samples.{way}.{id}", f"{what}, {WAYS[way]}", ratios)
            for id, (what, figure) in COMPARED.items()
            if (ratios := [a / b for one, other in pairs if (a := figure(one)) > 0 and (b := figure(other)) > 0])
        ]
        share = np.mean([one.picture.own / one.picture.evaluations for one, _ in pairs])
        words = ", ".join(f"{one.what.removesuffix(f', {WAYS[way]}')} {one.value:.2f} ×" for one in checks)
        yield f"{WAYS[way].capitalize()} ({100 * share:.0f} % to find out), against the same for each ray: {words}."
        yield from checks
    columns = ["scene", "attention", "samples", "a ray", "evaluations", "to find out", "seconds"]
    columns += [f"{where}, against {what}" for what in ("the integral", "the truth") for where in WHERE]
    yield Table("samples", 0, "Every picture with its samples shared out", columns, [one.row for one in rows])


def shared_out(view: Looked, way: str, kind: str | None, bins: int, budget: int, least: int) -> tuple[np.ndarray, int]:
    """Return the samples per ray of each region, and the network evaluations that finding them took.

    `even`: `bins` everywhere. `samples`: as many in all, by the map `kind`. `evaluations`: so that all evaluations,
    including those of the map, come to about `budget`; the cost of a sample is estimated from the coarse frame's rays,
    region by region, and that frame is the map's.
    """
    if way == "even" or kind is None:
        return np.full(view.regions.count, bins), 0
    view = replace(view, bins=bins)
    if way == "samples":
        attention, spent = attention_of(kind, view)
        return in_steps(allocated_bins(attention, view.regions.rays, bins, least), view.regions.rays), spent
    cost = evaluations_by_region(view.cell.learner, view.camera, view.regions, view.stride, view.cell.chunk, bins)
    attention, spent = attention_of(kind, view, cost.view)
    spent += cost.network_evaluations
    affordable = bins * (budget - spent) / int(cost.by_region.sum())
    number = allocated_bins(attention, cost.by_region, max(float(least), affordable), least)
    return in_steps(number, cost.by_region), spent


def rendered(
    view: Looked, way: str, kind: str | None, bins: int, budget: int = 0, clock: Clock = CLOCK
) -> AllocatedRender:
    """Distribute and render on one clock; the picture is an array in memory by then. A chunk has no more samples than a
    plain one.
    """
    chunk = max(1, view.cell.chunk * view.bins // max(bins, view.bins))
    began = clock()
    number, spent = shared_out(view, way, kind, bins, budget, least_bins(bins))
    picture, evaluations = render_allocated(view.cell.learner, view.camera, view.regions, number, chunk)
    seconds = clock() - began
    mean = float((number * view.regions.rays).sum() / view.regions.rays.sum())
    return AllocatedRender(picture.colour, mean, evaluations + spent, spent, seconds)


def sampled(one: AttendedView, reference_bins: int, repeats: int, clock: Clock = CLOCK) -> Sampled:
    """Measure the run's own number of samples in every way, by every map that attends unequally, and evenly. Each
    is rendered once off the clock, which allocates and chooses kernels, and then in turn with all
    others, as often as requested, in changing order.
    """
    view, own = one.view, one.view.bins
    kinds = [kind for kind, attention in one.maps.items() if not is_equal(attention)]
    choices: list[Choice] = [("even", None), *((way, kind) for way in list(WAYS)[1:] for kind in kinds)]
    budget = rendered(view, "even", None, own).evaluations
    pictures = {choice: rendered(view, *choice, own, budget) for choice in choices}
    seconds: dict[Choice, list[float]] = {choice: [] for choice in choices}
    for repeat in range(repeats):
        for choice in choices[:: 1 if repeat % 2 == 0 else -1]:
            seconds[choice].append(rendered(view, *choice, own, budget, clock).seconds)
    # so fine that the remaining error of the quadrature is small
    reference = rendered(view, "even", None, reference_bins).colour
    return Sampled(one, reference, pictures, seconds)


def allocations(seen: Sampled) -> list[Allocation]:
    """Return the pictures in every way, for each map that attends unequally."""
    rows = []
    for kind in KINDS:
        if is_equal(seen.of.maps[kind]):
            continue
        attended = attended_pixels(seen.of.view.regions, seen.of.maps[kind])
        for choice, picture in seen.pictures.items():
            if choice[1] in (None, kind):
                truth = _errors(picture.colour, seen.of.truth, attended) if seen.of.truth is not None else {}
                errors = _errors(picture.colour, seen.reference, attended)
                seconds = float(np.median(seen.seconds[choice]))
                rows.append(Allocation(seen.of.scene, kind, choice[0], picture, seconds, errors, truth))
    return rows


def _errors(colour: np.ndarray, wanted: np.ndarray, attended: np.ndarray) -> dict[str, float]:
    flat, right = colour.reshape(-1, 3), wanted.reshape(-1, 3)
    return {"whole": rmse(flat, right), "attended": rmse(flat[attended], right[attended])}
