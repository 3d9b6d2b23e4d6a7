"""As many samples a picture, shared out equally or by attention: error, evaluations and seconds of both."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.attention.priorities import allocated_bins, is_equal
from harness.attention.progressive import Done, coarse, render_allocated
from harness.evaluate import View
from harness.serving.anytime import attended_pixels
from harness.serving.attention_maps import Looked, attention_of
from harness.serving.situation import rmse
from harness.serving.timing import CLOCK, Clock, timed
from harness.serving_record import Allocation

LEAST_SHARE = 0.25
"""Of the mean: what every ray gets, whatever is attended."""


def least_bins(bins: int) -> int:
    return max(1, int(LEAST_SHARE * bins))


@dataclass(frozen=True)
class Shared:
    """One picture with its samples shared out in one way."""

    colour: np.ndarray
    bins: float
    evaluations: int
    seconds: float


def rendered(view: Looked, bins: int, kind: str | None, clock: Clock = CLOCK) -> Shared:
    """`bins` a ray in the mean: everywhere (`kind` None), or by attention, with the coarse frame and the map in the
    seconds, as nobody who attends to something can do without; evaluations are the picture's own.
    """
    cell, regions = view.cell, view.regions
    counted: list[int] = []

    def note(part: Done) -> None:
        counted.append(part.network_evaluations)

    def whole() -> tuple[View, np.ndarray]:
        number = np.full(regions.count, bins)
        if kind is not None:
            first, _ = coarse(cell.learner, view.camera, view.stride, cell.chunk)
            number = allocated_bins(attention_of(kind, view, first), regions.rays, bins, least_bins(bins))
        return render_allocated(cell.learner, view.camera, regions, number, cell.chunk, note), number

    (picture, number), seconds = timed(whole, clock)
    mean = float((number * regions.rays).sum() / regions.rays.sum())
    return Shared(picture.colour, mean, sum(counted), seconds)


def reference(view: Looked, bins: int) -> np.ndarray:
    """The same field integrated so finely that what is left of the quadrature's error is small, [h, w, 3]."""
    number = np.full(view.regions.count, bins)
    return render_allocated(view.cell.learner, view.camera, view.regions, number, view.cell.chunk).colour


@dataclass(frozen=True)
class Sampled:
    """Everything measured of one view."""

    view: Looked
    maps: dict[str, np.ndarray]
    reference: np.ndarray
    truth: np.ndarray | None
    pictures: dict[tuple[int, str | None], Shared]


def sampled(
    view: Looked,
    maps: dict[str, np.ndarray],
    bins: Sequence[int],
    beyond: int,
    reference_bins: int,
    truth: np.ndarray | None,
    clock: Clock = CLOCK,
) -> Sampled:
    """Every number of `bins` by every map that attends unequally, and equally; and `beyond` equally alone."""
    kinds = [None, *(kind for kind, attention in maps.items() if not is_equal(attention))]
    rendered(view, min(bins), None, clock)  # allocations and kernel choices
    pictures = {(number, kind): rendered(view, number, kind, clock) for number in bins for kind in kinds}
    pictures[beyond, None] = rendered(view, beyond, None, clock)
    return Sampled(view, maps, reference(view, reference_bins), truth, pictures)


def allocations(seen: Sequence[Sampled], kind: str, bins: int) -> list[Allocation]:
    """Equally and, where it was rendered, by attention: means over the views that this map attends unequally."""
    some = [one for one in seen if not is_equal(one.maps[kind])]
    ways = (False, True) if some and (bins, kind) in some[0].pictures else (False,)
    return [_allocation(some, kind, bins, by_attention) for by_attention in ways] if some else []


def _allocation(some: Sequence[Sampled], kind: str, bins: int, by_attention: bool) -> Allocation:
    pictures = [one.pictures[bins, kind if by_attention else None] for one in some]
    rows, truths = [], []
    for one, picture in zip(some, pictures, strict=True):
        attended = attended_pixels(one.view.regions, one.maps[kind])
        rows.append(_errors(picture.colour, one.reference, attended))
        if one.truth is not None:
            truths.append(_errors(picture.colour, one.truth, attended))
    rmse_attended, rmse_whole = np.mean(rows, axis=0).tolist()
    # a mean over fewer views would stand beside one over all
    truth = np.mean(truths, axis=0).tolist() if len(truths) == len(some) else (None, None)
    cell = some[0].view.cell
    return Allocation(
        scene=cell.scene.name,
        method=cell.learner.method,
        attention=kind,
        by_attention=by_attention,
        views=len(some),
        bins=float(np.mean([one.bins for one in pictures])),
        evaluations=float(np.mean([one.evaluations for one in pictures])),
        seconds=float(np.mean([one.seconds for one in pictures])),
        rmse_attended=rmse_attended,
        rmse_whole=rmse_whole,
        truth_attended=truth[0],
        truth_whole=truth[1],
    )


def _errors(colour: np.ndarray, wanted: np.ndarray, attended: np.ndarray) -> tuple[float, float]:
    flat, right = colour.reshape(-1, 3), wanted.reshape(-1, 3)
    return rmse(flat[attended], right[attended]), rmse(flat, right)
