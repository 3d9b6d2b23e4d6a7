"""Error against time while a view is refined: by attention, in raster order, by spread pixels, and plainly."""

import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from baselines.numerics.attention.priorities import is_equal, region_order
from baselines.numerics.attention.regions import Regions
from harness.playback.progressive import Canvas, Done, coarse, refine
from harness.records.study import Check, Status, Table
from harness.studies.framework import Found, Rows
from harness.studies.serving.attention_views import (
    KINDS,
    NOTHING,
    AttendedView,
    RegionView,
    attended_views,
    attention_of,
)
from harness.studies.serving.serving_context import CLOCK, Clock, ServingContext, brief, factor, plain, study
from harness.training.scoring.evaluate import View

ORDERS = {
    "attention": "attention",
    "raster": "raster order",
    "spread": "spread pixels",
    "plain": "plain rendering",
}
"""The orders in which a picture is refined after its coarse frame; `plain` has no such frame and the largest chunks."""
MEASURES = {"whole": "the whole picture", "attended": "the most attended quarter"}
SHARE_OF_ERROR = 0.1
"""The share of the coarse frame's error at which a picture is called useful."""
QUARTER = 0.25
"""The share of the regions that count as the most attended."""
MIN_SCENES = 3

Run = tuple[str, str | None]
"""An order, and the map that it needs."""


@dataclass(frozen=True)
class Refined:
    """One view refined in one order. All repeats give the same picture, at other times."""

    first: View
    parts: list[Done]
    seconds: np.ndarray
    """Seconds [repeats, points] from the request to the first frame, and to each part."""


@dataclass(frozen=True)
class RefinedView:
    of: AttendedView
    finished: View
    runs: dict[Run, Refined]


class Curve(NamedTuple):
    """Errors over time of one scene, map and order: means over the views, point by point."""

    seconds: np.ndarray
    """Seconds [repeats, points]."""
    errors: dict[str, list[float]]
    """Measure → root mean square error."""


class Reaching(NamedTuple):
    """When an error falls below a limit for good: the median, minimum and maximum over the repeats."""

    seconds: float
    least: float
    most: float


Times = dict[str, Reaching | None]
"""Order → its time; None if the error stays above the limit."""


@dataclass(frozen=True)
class Case:
    scene: str
    kind: str
    curves: dict[str, Curve]

    def times(self, measure: str) -> Times:
        limit = SHARE_OF_ERROR * self.curves["raster"].errors[measure][0]
        return {order: reaching(curve, measure, limit) for order, curve in self.curves.items()}


@study
def anytime(context: ServingContext) -> Iterator[Found]:
    cases = cases_of(list(_refined_views(context)))
    yield from findings_of(cases) if cases else (NOTHING,)


def findings_of(cases: Sequence[Case]) -> Iterator[Found]:
    times = [case.times("whole") for case in cases]
    checks = []
    for order, words in ORDERS.items():
        milliseconds = [1e3 * at.seconds for by_order in times if (at := by_order[order]) is not None]
        if len(milliseconds) == len(cases):
            what = f"until {100 * SHARE_OF_ERROR:.0f} % of the error remains, {words}"
            spread = min(milliseconds), max(milliseconds)
            middle, count = statistics.median(milliseconds), len(cases)
            checks.append(
                Check(what, middle, unit="ms", owner="machine", spread=spread, repeats=count, id=f"whole.{order}")
            )
    medians = ", ".join(f"{check.what.partition(', ')[2]} {brief(1e-3 * (check.value or 0.0))}" for check in checks)
    won = sum(first_of(by_order) == "attention" for by_order in times)
    yield (
        f"Until {100 * SHARE_OF_ERROR:.0f} % of the coarse frame's error remains in the whole picture: {medians} "
        f"(medians); attention is first in {won} of {len(cases)} cases of scene and map."
    )
    yield from checks
    yield from (_earlier_check(cases, measure) for measure in MEASURES)
    sooner = [
        raster.seconds / mine.seconds
        for at in (case.times("attended") for case in cases)
        if (raster := at["raster"]) and (mine := at["attention"])
    ]
    if sooner:
        yield factor("sooner.attended", "time of raster order against attention, in the most attended quarter", sooner)
    yield _table(cases)


def _refined_views(context: ServingContext) -> Iterator[RefinedView]:
    sizes = context.sizes
    for attended in attended_views(context):
        view, name = attended.view, f"{attended.scene}, view {attended.number + 1} of {sizes.views}"
        context.show.line(f"  {view.cell.learner.method} on {name}")
        runs: list[Run] = []
        for kind, attention in attended.maps.items():
            if is_equal(attention):
                context.leave_out(f"{name}, {kind}", "it attends equally to all regions, which is plain rendering")
            else:
                runs.append(("attention", kind))
        runs += [(order, None) for order in ORDERS if order != "attention"]
        finished = plain(view.cell.learner, view.camera, view.cell.chunk)
        yield RefinedView(attended, finished, measure(view, runs, sizes.repeats))


def measure(view: RegionView, runs: Sequence[Run], repeats: int, clock: Clock = CLOCK) -> dict[Run, Refined]:
    """Measure all runs in turn, in alternating order, so that a busy machine affects all alike."""
    again: dict[Run, list[Refined]] = {run: [] for run in runs}
    for repeat in range(repeats):
        for run in runs[:: 1 if repeat % 2 == 0 else -1]:
            again[run].append(refine_in(view, *run, clock))
    return {
        run: replace(repeated[0], seconds=np.concatenate([each.seconds for each in repeated]))
        for run, repeated in again.items()
    }


def refine_in(view: RegionView, order: str, kind: str | None, clock: Clock = CLOCK) -> Refined:
    """Only the order by attention computes a map; `plain` begins with a white frame. All parts share one clock."""
    cell, regions, camera = view.cell, view.regions, view.camera
    began = clock()
    attention = np.ones(regions.count)
    if order == "plain":  # it is the order by attention with equal attention
        first, seconds, order = Canvas(camera.height, camera.width).view, [0.0], "attention"
    else:
        first = coarse(cell.learner, camera, view.stride, cell.chunk).view
        if kind is not None:
            attention = attention_of(kind, view, first)
        seconds = [clock() - began]
    parts = []
    for done in refine(cell.learner, camera, regions, attention, cell.chunk, order):  # type: ignore[arg-type]
        seconds.append(clock() - began)
        parts.append(done)
    return Refined(first, parts, np.array([seconds]))


def attended_pixels(regions: Regions, attention: np.ndarray) -> np.ndarray:
    """Return bool [pixels]: those of the most attended quarter of the regions."""
    count = max(1, round(QUARTER * regions.count))
    attended = np.zeros(regions.height * regions.width, dtype=bool)
    for region in region_order(attention)[:count]:
        attended[regions.pixels(int(region))] = True
    return attended


def errors_along(run: Refined, finished: View, where: np.ndarray) -> Iterator[list[float]]:
    """Yield the root mean square error everywhere and in `where`, of the first frame and after each part."""
    target = finished.colour.reshape(-1, 3).astype(np.float64)
    squares = ((run.first.colour.reshape(-1, 3) - target) ** 2).mean(axis=-1)
    for part in (None, *run.parts):
        if part is not None:
            squares[part.pixels] = ((part.colour - target[part.pixels]) ** 2).mean(axis=-1)
        yield [float(np.sqrt(chosen.mean())) for chosen in (squares, squares[where])]


def cases_of(views: Sequence[RefinedView]) -> list[Case]:
    cases = []
    for scene in dict.fromkeys(view.of.scene for view in views):
        for kind in KINDS:
            attended = [view for view in views if view.of.scene == scene and ("attention", kind) in view.runs]
            if attended:
                cases.append(Case(scene, kind, {order: curve_of(attended, kind, order) for order in ORDERS}))
    return cases


def curve_of(views: Sequence[RefinedView], kind: str, order: str) -> Curve:
    """Return means over the views, point by point."""
    runs = [view.runs[order, kind if order == "attention" else None] for view in views]
    errors = [
        list(errors_along(run, view.finished, attended_pixels(view.of.view.regions, view.of.maps[kind])))
        for view, run in zip(views, runs, strict=True)
    ]
    means = np.mean(errors, axis=0).T.tolist()
    return Curve(np.mean([run.seconds for run in runs], axis=0), dict(zip(MEASURES, means, strict=True)))


def reaching(curve: Curve, measure: str, limit: float) -> Reaching | None:
    above = [index for index, value in enumerate(curve.errors[measure]) if value > limit]
    index = above[-1] + 1 if above else 0
    if index == curve.seconds.shape[1]:
        return None
    seconds = curve.seconds[:, index]
    return Reaching(float(np.median(seconds)), float(seconds.min()), float(seconds.max()))


def earlier(times: Times, order: str, other: str) -> bool:
    """Return whether `order` is at the limit before `other`: its slowest repeat before the fastest of `other`."""
    mine, theirs = times[order], times[other]
    return mine is not None and (theirs is None or mine.most < theirs.least)


def first_of(times: Times) -> str | None:
    """Return the order that is at the limit before all others; None if the repeats leave it open."""
    return next((mine for mine in times if all(earlier(times, mine, other) for other in times if other != mine)), None)


def _earlier_check(cases: Sequence[Case], measure: str) -> Check:
    """Return in how many cases attention is earlier than raster order. For the attended quarter this is the paper's
    claim: with enough scenes it holds if attention is earlier in every case, and fails if it is later in every case.
    """
    times = [(case.scene, case.times(measure)) for case in cases]
    scenes = {case.scene for case in cases}
    behind_on = {scene for scene, at in times if not earlier(at, "attention", "raster")}
    ahead = sum(earlier(at, "attention", "raster") for _, at in times)
    behind = sum(earlier(at, "raster", "attention") for _, at in times)
    undecided = len(cases) - ahead - behind
    status: Status = "measured"
    words = f"of {len(cases)} cases, later in {behind}" + (f", undecided in {undecided}" if undecided else "")
    if measure == "attended":
        status = "inconclusive"
        if len(scenes) >= MIN_SCENES and len(cases) in (ahead, behind):
            status = "pass" if ahead else "fail"
        words += f", earlier in all of them on {len(scenes - behind_on)} of {len(scenes)} scenes"
        words += "; the map that orders regions defines which are attended: earlier by construction, but for its cost"
    return Check(
        f"cases in which attention is earlier than raster order, in {MEASURES[measure]}",
        float(ahead),
        why=words,
        subject="Eq. 7",
        owner="paper",
        status=status,
        repeats=len(cases),
        id=f"earlier.{measure}",
    )


def _table(cases: Sequence[Case]) -> Table:
    rows: Rows = []
    for case in cases:
        for measure, words in MEASURES.items():
            times = case.times(measure)
            best = first_of(times)
            shown = [f"{brief(at.seconds)}{' ▲' * (order == best)}" if at else "never" for order, at in times.items()]
            rows.append([case.scene, case.kind, words, *shown])
    title = f"Until {100 * SHARE_OF_ERROR:.0f} % of the coarse frame's error remains (▲ the first in every repeat)"
    return Table("times", 0, title, ["scene", "attention", "in", *ORDERS.values()], rows)
