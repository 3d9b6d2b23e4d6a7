"""Error against time while a view is refined: by attention, in raster order, spread over the picture, and plainly.

The maps of attention that are compared are formulas of the picture's size or of its coarse frame.
"""

import typing
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from baselines.numerics.attention.maps import MAPS, MapInputs
from baselines.numerics.attention.priorities import is_equal, region_order
from baselines.numerics.attention.regions import Regions
from harness.playback.progressive import Canvas, Done, coarse, estimated_error, refine
from harness.playback.run_loader import TrainedCell
from harness.records.serving_record import Anytime, Measure, Order, Pair, Reaching
from harness.studies.serving.serving_context import CLOCK, Clock
from harness.training.batches import Camera
from harness.training.evaluate import View

KINDS = {
    "point": "a point of interest in the picture's centre, half the attention a quarter of the width away",
    "mask": "a user's mask: the middle half of the rows and of the columns, a quarter of the picture",
    "gradients": "where the coarse frame changes",
    "error": "where half of the samples make another coarse frame",
    "foveal": "the acuity of an eye that looks at a third of the height and two thirds of the width",
}
"""Map of `baselines.numerics.attention.maps.MAPS` → what is attended to, in words."""
CENTRE = (1 / 2, 1 / 2)
LOOKED_AT = {"foveal": (1 / 3, 2 / 3)}
"""The row and column that are looked at, as shares of height and width; the centre for all others."""


@dataclass(frozen=True)
class Looked:
    """A view of a cell, its regions, and the stride of its coarse frame."""

    cell: TrainedCell
    camera: Camera
    regions: Regions
    stride: int
    bins: int
    """The samples per ray, of the coarse frame as well."""


def attention_of(kind: str, view: Looked, first: View | None = None) -> tuple[np.ndarray, int]:
    """Return the attention, float64 [regions], and the network evaluations that it cost; `first` is the coarse frame,
    which is rendered if it is needed and not given. Raises `ValueError` for an unknown kind.
    """
    if kind not in KINDS:
        raise ValueError(f"unknown map of attention {kind!r}; known: {' '.join(KINDS)}")
    learner, camera, chunk = view.cell.learner, view.camera, view.cell.chunk
    spent = 0

    def frame() -> View:
        nonlocal first, spent
        if first is None:
            first, _, evaluations = coarse(learner, camera, view.stride, chunk, view.bins)
            spent += evaluations
        return first

    def error() -> np.ndarray:
        nonlocal spent
        estimate = estimated_error(learner, camera, frame(), view.stride, chunk, view.bins)
        spent += estimate.network_evaluations
        return estimate.error

    row, column = LOOKED_AT.get(kind, CENTRE)
    sight = MapInputs(
        view.regions,
        row * camera.height,
        column * camera.width,
        0.25 * camera.width,
        camera.focal,
        mask=lambda: middle(camera.height, camera.width),
        image=lambda: frame().colour,
        error=error,
    )
    return MAPS[kind](sight), spent


def middle(height: int, width: int) -> np.ndarray:
    """Return bool [height, width]: pixels whose centre lies in the middle half of the rows and of the columns."""
    rows, columns = (np.arange(height) + 0.5) / height, (np.arange(width) + 0.5) / width
    return (np.abs(rows - 0.5) < 0.25)[:, None] & (np.abs(columns - 0.5) < 0.25)[None, :]


ORDERS: tuple[Order, ...] = typing.get_args(Order)
MEASURES: tuple[Measure, ...] = typing.get_args(Measure)
SHARE_OF_ERROR = 0.1
"""The share of the coarse frame's error at which a picture is called useful."""
QUARTER = 0.25
"""The share of the regions that count as the most attended, or the hardest."""


@dataclass(frozen=True)
class Refined:
    """One view refined once, with the time of each part."""

    first: View
    seconds: list[float]
    """Seconds since the view was requested: of the first frame, and of each part."""
    parts: list[Done]

    def at(self, index: int) -> View:
        """Return the picture after so many parts."""
        height, width = self.first.opacity.shape
        canvas = Canvas(height, width, self.first)
        for part in self.parts[:index]:
            canvas.put(part)
        return canvas.view


@dataclass(frozen=True)
class Measured:
    """One view in one order, refined several times: all give the same picture, their clocks differ."""

    refined: Refined
    seconds: np.ndarray
    """Seconds [repeats, points]."""

    def after(self, limit: float) -> View:
        """Return what is shown after so many seconds, by the median of the repeats; the first frame at least."""
        done = int((np.median(self.seconds, axis=0) <= limit).sum()) - 1
        return self.refined.at(max(done, 0))


def refined(view: Looked, order: Order, kind: str | None, clock: Clock = CLOCK) -> Refined:
    """Render first frame, map and refinement on one clock. Only the order by attention needs a map, and pays for it;
    `plain` begins with the white that a reader sees meanwhile.
    """
    cell, regions, camera = view.cell, view.regions, view.camera
    began = clock()
    attention = np.ones(regions.count)
    if order == "plain":
        first, seconds = Canvas(camera.height, camera.width).view, [0.0]
    else:
        first = coarse(cell.learner, camera, view.stride, cell.chunk).view
        if kind is not None:
            attention, _ = attention_of(kind, view, first)
        seconds = [clock() - began]
    parts = []
    # equal attention, in the order by attention, is plain rendering
    for done in refine(
        cell.learner, camera, regions, attention, cell.chunk, "attention" if order == "plain" else order
    ):
        seconds.append(clock() - began)
        parts.append(done)
    return Refined(first, seconds, parts)


Run = tuple[Order, str | None]
"""An order, and the map that it needs."""


def runs_of(maps: dict[str, np.ndarray]) -> list[Run]:
    """Return each order once; attention for every map that attends to something more than to something else."""
    attended: list[Run] = [("attention", kind) for kind, attention in maps.items() if not is_equal(attention)]
    return [*attended, *((order, None) for order in ORDERS if order != "attention")]


def measured(view: Looked, runs: Sequence[Run], repeats: int, clock: Clock = CLOCK) -> dict[Run, Measured]:
    """Measure all runs in turn, as often as requested, in changing order: a busy machine affects all alike."""
    found: dict[Run, list[Refined]] = {run: [] for run in runs}
    for repeat in range(repeats):
        for run in runs[:: 1 if repeat % 2 == 0 else -1]:
            found[run].append(refined(view, run[0], run[1], clock))
    return {run: Measured(again[0], np.array([one.seconds for one in again])) for run, again in found.items()}


def attended_pixels(regions: Regions, attention: np.ndarray) -> np.ndarray:
    """Return bool [pixels]: those of the quarter of the regions that is attended most."""
    count = max(1, round(QUARTER * regions.count))
    found = np.zeros(regions.height * regions.width, dtype=bool)
    for region in region_order(attention)[:count]:
        found[regions.pixels(int(region))] = True
    return found


def hardest_pixels(regions: Regions, first: View, finished: View) -> np.ndarray:
    """Return bool [pixels]: those of the quarter of the regions in which the coarse frame is most wrong."""
    squares = ((first.colour.astype(np.float64) - finished.colour) ** 2).mean(axis=-1)
    return attended_pixels(regions, regions.mean(squares))


def errors_along(one: Refined, finished: View, *where: np.ndarray) -> Iterator[list[float]]:
    """Yield the root mean square error everywhere and in each of `where`, of the first frame and after each part."""
    wanted = finished.colour.reshape(-1, 3).astype(np.float64)
    squares = ((one.first.colour.reshape(-1, 3) - wanted) ** 2).mean(axis=-1)
    yield _roots(squares, where)
    for part in one.parts:
        squares[part.pixels] = ((part.colour - wanted[part.pixels]) ** 2).mean(axis=-1)
        yield _roots(squares, where)


def _roots(squares: np.ndarray, where: Sequence[np.ndarray]) -> list[float]:
    found = [float(np.sqrt(some.mean())) for some in (squares, *(squares[chosen] for chosen in where))]
    if not np.isfinite(found).all():
        raise ValueError("an error of a picture that is being refined is not finite")
    return found


@dataclass(frozen=True)
class Seen:
    """All measurements of one view."""

    view: Looked
    finished: View
    coarse: View
    maps: dict[str, np.ndarray]
    runs: dict[Run, Measured]


@dataclass(frozen=True)
class TimedCurve:
    """A curve as recorded, and the seconds that its own are the medians of."""

    anytime: Anytime
    seconds: np.ndarray
    """Seconds [repeats, points], means over the views."""


def curve(seen: Sequence[Seen], kind: str, order: Order) -> TimedCurve | None:
    """Return means over the views, point by point; None if no view is attended unequally by this map."""
    run: Run = (order, kind if order == "attention" else None)
    some = [one for one in seen if ("attention", kind) in one.runs]
    if not some:
        return None
    errors = []
    for one in some:
        regions = one.view.regions
        hardest = hardest_pixels(regions, one.coarse, one.finished)
        attended = attended_pixels(regions, one.maps[kind])
        errors.append(list(errors_along(one.runs[run].refined, one.finished, hardest, attended)))
    whole, hard, near = np.mean(errors, axis=0).T
    seconds = np.mean([one.runs[run].seconds for one in some], axis=0)
    cell = some[0].view.cell
    found = Anytime(
        scene=cell.scene.name,
        method=cell.learner.method,
        attention=kind,
        order=order,
        views=len(some),
        seconds=np.median(seconds, axis=0).tolist(),
        share=[0.0, *(part.share for part in some[0].runs[run].refined.parts)],
        total_spread=_spread(seconds[:, -1]),
        rmse_whole=whole.tolist(),
        rmse_hardest=hard.tolist(),
        rmse_attended=near.tolist(),
    )
    return TimedCurve(found, seconds)


def reaching(one: TimedCurve, measure: Measure, error: float, share: float = SHARE_OF_ERROR) -> Reaching:
    """Return when the measured error is first at most `share` of `error`, the coarse frame's, and stays so."""
    curve = one.anytime
    limit = share * error
    above = [index for index, value in enumerate(curve.rmse(measure)) if value > limit]
    index = above[-1] + 1 if above else 0
    there = index < len(curve.seconds)
    return Reaching(
        scene=curve.scene,
        method=curve.method,
        attention=curve.attention,
        order=curve.order,
        measure=measure,
        share_of_error=share,
        error=limit,
        seconds=curve.seconds[index] if there else None,
        spread=_spread(one.seconds[:, index]) if there else None,
    )


def reachings(curves: Sequence[TimedCurve]) -> list[Reaching]:
    """Return when each measured error is small enough, for the curves of one scene and map, which begin with the same
    coarse frame, if with any.
    """
    begun = next(one.anytime for one in curves if one.anytime.order != "plain")
    return [reaching(one, measure, begun.rmse(measure)[0]) for one in curves for measure in MEASURES]


def _spread(seconds: np.ndarray) -> Pair:
    return float(seconds.min()), float(seconds.max())
