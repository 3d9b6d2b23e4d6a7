"""Samples distributed evenly, and by attention at as many samples or network evaluations: errors, seconds."""

import typing
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from baselines.numerics.attention.priorities import allocated_bins, in_steps, is_equal
from harness.playback.progressive import Done, evaluations_by_region, render_allocated
from harness.records.serving_record import Allocation, Way
from harness.studies.serving.anytime import Looked, attended_pixels, attention_of
from harness.studies.serving.serving_context import CLOCK, Clock, rmse

WAYS: tuple[Way, ...] = typing.get_args(Way)
LEAST_SHARE = 0.25
"""The share of the mean that every ray gets, whatever is attended."""


def least_bins(bins: int) -> int:
    return max(1, int(LEAST_SHARE * bins))


def shared_out(view: Looked, way: Way, kind: str | None, bins: int, budget: int, least: int) -> tuple[np.ndarray, int]:
    """Return the samples per ray of each region, and the network evaluations that finding them took.

    `even`: `bins` everywhere. `samples`: as many in all, by the map `kind`. `evaluations`: so that all evaluations,
    including those of the map, come to about `budget`; the cost of a sample is estimated from the coarse frame's rays,
    region by region, and that frame is the map's.
    """
    if way == "even" or kind is None:
        return np.full(view.regions.count, bins), 0
    looked = replace(view, bins=bins)
    if way == "samples":
        attention, spent = attention_of(kind, looked)
        return in_steps(allocated_bins(attention, view.regions.rays, bins, least), view.regions.rays), spent
    cost = evaluations_by_region(view.cell.learner, view.camera, view.regions, view.stride, view.cell.chunk, bins)
    attention, spent = attention_of(kind, looked, cost.view)
    spent += cost.network_evaluations
    affordable = bins * (budget - spent) / int(cost.by_region.sum())
    number = allocated_bins(attention, cost.by_region, max(float(least), affordable), least)
    return in_steps(number, cost.by_region), spent


@dataclass(frozen=True)
class AllocatedRender:
    """One picture with its samples distributed in one way."""

    colour: np.ndarray
    bins: float
    evaluations: int
    own: int
    """The evaluations spent on the distribution itself."""
    seconds: float


def rendered(
    view: Looked, way: Way, kind: str | None, bins: int, budget: int = 0, clock: Clock = CLOCK
) -> AllocatedRender:
    """Distribute and render on one clock; the picture is an array in memory by then."""
    counted: list[int] = []

    def note(part: Done) -> None:
        counted.append(part.network_evaluations)

    began = clock()
    number, spent = shared_out(view, way, kind, bins, budget, least_bins(bins))
    picture = render_allocated(view.cell.learner, view.camera, view.regions, number, calls_for(view, bins), note)
    seconds = clock() - began
    mean = float((number * view.regions.rays).sum() / view.regions.rays.sum())
    return AllocatedRender(picture.colour, mean, sum(counted) + spent, spent, seconds)


def calls_for(view: Looked, bins: int) -> int:
    """Return the rays per chunk that have no more samples than a plain one; a pointwise method gives the same
    picture.
    """
    return max(1, view.cell.chunk * view.bins // max(bins, view.bins))


def reference(view: Looked, bins: int) -> np.ndarray:
    """Return the same field integrated so finely that the remaining quadrature error is small, [h, w, 3]."""
    return rendered(view, "even", None, bins).colour


@dataclass(frozen=True)
class Shared:
    """A picture, and its seconds in each repeat."""

    picture: AllocatedRender
    seconds: list[float]


Choice = tuple[Way, str | None, int]
"""The way, the map and the samples per ray that it is compared with."""


@dataclass(frozen=True)
class Sampled:
    """All measurements of one view."""

    view: Looked
    maps: dict[str, np.ndarray]
    reference: np.ndarray
    truth: np.ndarray | None
    pictures: dict[Choice, Shared]


def sampled(
    view: Looked,
    maps: dict[str, np.ndarray],
    reference_bins: int,
    repeats: int,
    truth: np.ndarray | None,
    clock: Clock = CLOCK,
) -> Sampled:
    """Measure the run's own number of samples in every way, by every map that attends unequally, and `evens` evenly.
    Each is rendered once off the clock, which allocates and chooses kernels, and then in turn with all others, as often
    as requested, in changing order.
    """
    kinds = [kind for kind, attention in maps.items() if not is_equal(attention)]
    first: dict[Choice, AllocatedRender] = {}
    for number in evens(view.bins):
        first["even", None, number] = rendered(view, "even", None, number)
    budget = first["even", None, view.bins].evaluations
    for way in WAYS[1:]:
        for name in kinds:
            first[way, name, view.bins] = rendered(view, way, name, view.bins, budget)
    seconds: dict[Choice, list[float]] = {choice: [] for choice in first}
    for repeat in range(repeats):
        for choice in list(first)[:: 1 if repeat % 2 == 0 else -1]:
            way, kind, number = choice
            seconds[choice].append(rendered(view, way, kind, number, budget, clock).seconds)
    pictures = {choice: Shared(picture, seconds[choice]) for choice, picture in first.items()}
    return Sampled(view, maps, reference(view, reference_bins), truth, pictures)


def evens(own: int) -> list[int]:
    """Return the samples per ray that are rendered evenly: half of the run's own, these, and twice as many."""
    return sorted({max(1, own // 2), own, 2 * own})


def allocations(seen: Sequence[Sampled], kind: str) -> list[Allocation]:
    """Return the allocations in every way: means over the views that this map attends unequally."""
    some = [one for one in seen if not is_equal(one.maps[kind])]
    if not some:
        return []
    own = some[0].view.bins
    choices: list[tuple[Way, int]] = [("even", number) for number in evens(own)]
    choices += [(way, own) for way in WAYS[1:]]
    return [_allocation(some, way, kind, number) for way, number in choices]


def _allocation(some: Sequence[Sampled], way: Way, kind: str, bins: int) -> Allocation:
    shared = [one.pictures[way, None if way == "even" else kind, bins] for one in some]
    pictures = [one.picture for one in shared]
    rows, truths = [], []
    for one, picture in zip(some, pictures, strict=True):
        attended = attended_pixels(one.view.regions, one.maps[kind])
        rows.append(_errors(picture.colour, one.reference, attended))
        if one.truth is not None:
            truths.append(_errors(picture.colour, one.truth, attended))
    rmse_attended, rmse_whole = np.mean(rows, axis=0).tolist()
    # a mean over fewer views would stand beside one over all
    truth = np.mean(truths, axis=0).tolist() if len(truths) == len(some) else (None, None)
    seconds = np.mean([one.seconds for one in shared], axis=0)
    cell = some[0].view.cell
    return Allocation(
        scene=cell.scene.name,
        method=cell.learner.method,
        attention=kind,
        way=way,
        against=bins,
        views=len(some),
        bins=float(np.mean([one.bins for one in pictures])),
        evaluations=float(np.mean([one.evaluations for one in pictures])),
        own=float(np.mean([one.own for one in pictures])),
        seconds=float(np.median(seconds)),
        seconds_spread=(float(seconds.min()), float(seconds.max())),
        rmse_attended=rmse_attended,
        rmse_whole=rmse_whole,
        truth_attended=truth[0],
        truth_whole=truth[1],
    )


def _errors(colour: np.ndarray, wanted: np.ndarray, attended: np.ndarray) -> tuple[float, float]:
    flat, right = colour.reshape(-1, 3), wanted.reshape(-1, 3)
    return rmse(flat[attended], right[attended]), rmse(flat, right)
