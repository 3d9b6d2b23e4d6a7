"""Samples distributed by attention against the same number distributed evenly: errors, evaluations, seconds."""

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
    RegionView,
    attended_views,
    attention_of,
    least_bins,
)
from harness.studies.serving.serving_context import CLOCK, Clock, ServingContext, factor, rmse, study

WAY = "by attention, the same number of samples"
COMPARED = {
    "whole": "error in the whole picture",
    "attended": "error in the attended quarter",
    "truth": "error against the ground truth",
    "evaluations": "network evaluations",
    "seconds": "seconds",
}
"""Name in `Allocation.figures` of what is compared with the evenly sampled picture → its description."""
COLUMNS = {
    "bins": "samples per ray",
    "evaluations": "evaluations",
    "own": "evaluations for the map",
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
    """A picture of a scene, sampled evenly or by attention, and its errors, also where the map `kind` attends."""

    scene: str
    kind: str
    is_even: bool
    figures: dict[str, float]
    """Name → cost (seconds are medians of the repeats), or root mean square error of display colour: against the same
    field, finely integrated, and against the ground truth if the views still exist."""


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
    cost = f"the map takes {100 * share:.0f} % of the evaluations"
    yield f"{WAY.capitalize()}, against an equal number per ray: {words}; {cost}."
    yield from checks
    table = [
        [row.scene, row.kind, "even" if row.is_even else WAY, *(row.figures.get(name) for name in COLUMNS)]
        for row in rows
    ]
    columns = ["scene", "attention", "samples", *COLUMNS.values()]
    yield Table("samples", 0, "Every picture with its distributed samples", columns, table)


def render_with(view: RegionView, kind: str | None, bins: int, clock: Clock = CLOCK) -> AllocatedRender:
    """Distribute `bins` samples per ray, evenly or by the map `kind`, and render, on one clock."""
    # no more samples than in a chunk of plain rendering
    chunk = max(1, view.cell.chunk * view.bins // max(bins, view.bins))
    began, own, rays = clock(), 0, view.regions.rays
    number = np.full(view.regions.count, bins)
    if kind is not None:
        attention, own = attention_of(kind, view)
        number = in_steps(allocated_bins(attention, rays, bins, least_bins(bins)), rays)
    picture, evaluations = render_allocated(view.cell.learner, view.camera, view.regions, number, chunk)
    seconds = clock() - began
    return AllocatedRender(picture.colour, float((number * rays).sum() / rays.sum()), evaluations + own, own, seconds)


def allocations(attended: AttendedView, reference_bins: int, repeats: int, clock: Clock = CLOCK) -> list[Allocation]:
    """Measure the run's own number of samples, evenly and by every map that attends unequally. Each picture is rendered
    once off the clock, which allocates and chooses kernels, and then in turn with all others, in alternating order.
    """
    view = attended.view
    kinds = [kind for kind in KINDS if not is_equal(attended.maps[kind])]
    choices = [None, *kinds]
    pictures = {kind: render_with(view, kind, view.bins) for kind in choices}
    seconds: dict[str | None, list[float]] = {kind: [] for kind in choices}
    for repeat in range(repeats):
        for kind in choices[:: 1 if repeat % 2 == 0 else -1]:
            seconds[kind].append(render_with(view, kind, view.bins, clock).seconds)
    # so fine that the remaining error of the quadrature is small
    reference = render_with(view, None, reference_bins).colour
    rows = []
    for kind in kinds:
        pixels = attended_pixels(view.regions, attended.maps[kind])
        for choice in (None, kind):
            picture = pictures[choice]
            figures = {"bins": picture.bins, "evaluations": float(picture.evaluations), "own": float(picture.own)}
            figures["seconds"] = float(np.median(seconds[choice]))
            figures["whole"], figures["attended"] = _errors(picture.colour, reference, pixels)
            if attended.truth is not None:
                figures["truth"], figures["attended_truth"] = _errors(picture.colour, attended.truth, pixels)
            rows.append(Allocation(attended.scene, kind, choice is None, figures))
    return rows


def _errors(colour: np.ndarray, wanted: np.ndarray, attended: np.ndarray) -> tuple[float, float]:
    flat, right = colour.reshape(-1, 3), wanted.reshape(-1, 3)
    return rmse(flat, right), rmse(flat[attended], right[attended])
