"""Samples distributed by attention against as many distributed evenly: errors, network evaluations, seconds."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from baselines.numerics.attention.priorities import allocated_bins, in_steps, is_equal
from harness.playback.progressive import render_allocated
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

WAY = "by attention, as many samples"
COMPARED = {
    "whole": "error in the whole picture",
    "attended": "error in the attended quarter",
    "truth": "error against the ground truth",
    "evaluations": "network evaluations",
    "seconds": "seconds",
}
"""What of a picture is compared with the even one's, by its name in `Allocation.figures`, in words."""
COLUMNS = {
    "bins": "samples a ray",
    "evaluations": "evaluations",
    "own": "to find out",
    "seconds": "seconds",
    "whole": "whole, against the integral",
    "attended": "attended, against the integral",
    "truth": "whole, against the truth",
    "attended_truth": "attended, against the truth",
}


class AllocatedRender(NamedTuple):
    """One picture with its samples distributed evenly, or by a map of attention."""

    colour: np.ndarray
    bins: float
    evaluations: int
    own: int
    seconds: float


class Allocation(NamedTuple):
    """A picture of a scene, evenly sampled or by attention, measured where the map `kind` attends."""

    scene: str
    kind: str
    is_even: bool
    figures: dict[str, float]
    """Name → cost, the median of the repeats for seconds, or root mean square error of display colour against the same
    field, finely integrated, and against the ground truth, if its views are still there."""


@study
def samples(context: ServingContext) -> Iterator[Found]:
    rows: list[Allocation] = []
    for attended in attended_views(context):
        if attended.number:
            continue
        if context.is_over(f"samples by attention on {attended.scene}"):
            break
        rows += allocations(attended, context.sizes.reference_bins, context.sizes.shared)
    if not rows:
        yield NOTHING
        return
    even = {(row.scene, row.kind): row.figures for row in rows if row.is_even}
    pairs = [(row.figures, even[row.scene, row.kind]) for row in rows if not row.is_even]
    checks = [
        factor(f"samples.samples.{name}", f"{what}, {WAY}", ratios)
        for name, what in COMPARED.items()
        if (ratios := [a[name] / b[name] for a, b in pairs if a.get(name, 0.0) > 0.0 and b[name] > 0.0])
    ]
    share = np.mean([figures["own"] / figures["evaluations"] for figures, _ in pairs])
    words = ", ".join(f"{check.what.removesuffix(f', {WAY}')} {check.value:.2f} ×" for check in checks)
    yield f"{WAY.capitalize()} ({100 * share:.0f} % to find out), against the same for each ray: {words}."
    yield from checks
    table = [
        [row.scene, row.kind, "even" if row.is_even else WAY, *(row.figures.get(name) for name in COLUMNS)]
        for row in rows
    ]
    columns = ["scene", "attention", "samples", *COLUMNS.values()]
    yield Table("samples", 0, "Every picture with its samples shared out", columns, table)


def rendered(view: Looked, kind: str | None, bins: int, clock: Clock = CLOCK) -> AllocatedRender:
    """Distribute `bins` samples per ray, evenly or by the map `kind`, and render, on one clock; the picture is an array
    in memory by then. A chunk has no more samples than a plain one.
    """
    chunk = max(1, view.cell.chunk * view.bins // max(bins, view.bins))
    began, own, rays = clock(), 0, view.regions.rays
    number = np.full(view.regions.count, bins)
    if kind is not None:
        attention, own = attention_of(kind, view)
        number = in_steps(allocated_bins(attention, rays, bins, least_bins(bins)), rays)
    picture, evaluations = render_allocated(view.cell.learner, view.camera, view.regions, number, chunk)
    seconds = clock() - began
    return AllocatedRender(picture.colour, float((number * rays).sum() / rays.sum()), evaluations + own, own, seconds)


def allocations(seen: AttendedView, reference_bins: int, repeats: int, clock: Clock = CLOCK) -> list[Allocation]:
    """Measure the run's own number of samples, evenly and by every map that attends unequally. Each picture is rendered
    once off the clock, which allocates and chooses kernels, and then in turn with all others, as often as requested, in
    changing order.
    """
    view = seen.view
    kinds = [kind for kind in KINDS if not is_equal(seen.maps[kind])]
    choices = [None, *kinds]
    pictures = {kind: rendered(view, kind, view.bins) for kind in choices}
    seconds: dict[str | None, list[float]] = {kind: [] for kind in choices}
    for repeat in range(repeats):
        for kind in choices[:: 1 if repeat % 2 == 0 else -1]:
            seconds[kind].append(rendered(view, kind, view.bins, clock).seconds)
    # so fine that the remaining error of the quadrature is small
    reference = rendered(view, None, reference_bins).colour
    rows = []
    for kind in kinds:
        attended = attended_pixels(view.regions, seen.maps[kind])
        for choice in (None, kind):
            picture = pictures[choice]
            figures = {"bins": picture.bins, "evaluations": float(picture.evaluations), "own": float(picture.own)}
            figures["seconds"] = float(np.median(seconds[choice]))
            figures["whole"], figures["attended"] = _errors(picture.colour, reference, attended)
            if seen.truth is not None:
                figures["truth"], figures["attended_truth"] = _errors(picture.colour, seen.truth, attended)
            rows.append(Allocation(seen.scene, kind, choice is None, figures))
    return rows


def _errors(colour: np.ndarray, wanted: np.ndarray, attended: np.ndarray) -> tuple[float, float]:
    flat, right = colour.reshape(-1, 3), wanted.reshape(-1, 3)
    return rmse(flat, right), rmse(flat[attended], right[attended])
