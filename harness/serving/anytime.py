"""Error against time while a view is refined: by attention, in raster order, and spread over the picture."""

import typing
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from harness.attention.priorities import is_equal, region_order
from harness.attention.progressive import Canvas, Done, coarse, refine
from harness.attention.regions import Regions
from harness.evaluate import View
from harness.serving.attention_maps import Looked, attention_of
from harness.serving.timing import CLOCK, Clock
from harness.serving_record import Anytime, Order, Reaching

ORDERS: tuple[Order, ...] = typing.get_args(Order)
SHARES_OF_ERROR = (0.5, 0.1)
ATTENDED_SHARE = 0.25
"""Of the regions: the most attended."""


@dataclass(frozen=True)
class Refined:
    """One view refined once: what was done when."""

    first: View
    seconds: list[float]
    """Since the view was asked for: of the coarse frame, and of each part."""
    parts: list[Done]

    def at(self, index: int) -> View:
        """The picture after so many parts."""
        height, width = self.first.opacity.shape
        canvas = Canvas(height, width, self.first)
        for part in self.parts[:index]:
            canvas.put(part)
        return canvas.view


@dataclass(frozen=True)
class Measured:
    """One view in one order, refined several times: all give the same picture, their clocks differ."""

    refined: Refined
    seconds: list[float]
    """Medians over the repeats."""

    def after(self, limit: float) -> View:
        """What is there when so many seconds are over; the coarse frame at least."""
        done = sum(second <= limit for second in self.seconds) - 1
        return self.refined.at(max(done, 0))


def refined(view: Looked, order: Order, kind: str | None, clock: Clock = CLOCK) -> Refined:
    """Coarse frame, map and refinement on one clock. Only the order by attention needs a map, and pays for it."""
    cell, regions = view.cell, view.regions
    began = clock()
    first, _ = coarse(cell.learner, view.camera, view.stride, cell.chunk)
    attention = np.ones(regions.count) if kind is None else attention_of(kind, view, first)
    seconds, parts = [clock() - began], []
    for done in refine(cell.learner, view.camera, regions, attention, cell.chunk, order):
        seconds.append(clock() - began)
        parts.append(done)
    return Refined(first, seconds, parts)


Run = tuple[Order, str | None]
"""An order, and the map that it needs."""


def runs_of(maps: dict[str, np.ndarray]) -> list[Run]:
    """Each order once; attention for every map that attends to something more than to something else."""
    attended: list[Run] = [("attention", kind) for kind, attention in maps.items() if not is_equal(attention)]
    return [*attended, ("raster", None), ("spread", None)]


def measured(view: Looked, runs: Sequence[Run], repeats: int, clock: Clock = CLOCK) -> dict[Run, Measured]:
    """All runs in turn, as often as asked, in changing order: a busy machine hurts all alike."""
    found: dict[Run, list[Refined]] = {run: [] for run in runs}
    for repeat in range(repeats):
        for run in runs[:: 1 if repeat % 2 == 0 else -1]:
            found[run].append(refined(view, run[0], run[1], clock))
    return {
        run: Measured(again[0], np.median([one.seconds for one in again], axis=0).tolist())
        for run, again in found.items()
    }


def attended_pixels(regions: Regions, attention: np.ndarray) -> np.ndarray:
    """bool [pixels]: those of the quarter of the regions that is attended most."""
    count = max(1, round(ATTENDED_SHARE * regions.count))
    found = np.zeros(regions.height * regions.width, dtype=bool)
    for region in region_order(attention)[:count]:
        found[regions.pixels(int(region))] = True
    return found


def errors_along(one: Refined, finished: View, attended: np.ndarray) -> Iterator[tuple[float, float]]:
    """Root mean square error in the attended pixels and everywhere, of the coarse frame and after each part."""
    wanted = finished.colour.reshape(-1, 3).astype(np.float64)
    squares = ((one.first.colour.reshape(-1, 3) - wanted) ** 2).mean(axis=-1)
    yield _roots(squares, attended)
    for part in one.parts:
        squares[part.pixels] = ((part.colour - wanted[part.pixels]) ** 2).mean(axis=-1)
        yield _roots(squares, attended)


def _roots(squares: np.ndarray, attended: np.ndarray) -> tuple[float, float]:
    found = float(np.sqrt(squares[attended].mean())), float(np.sqrt(squares.mean()))
    if not np.isfinite(found).all():
        raise ValueError("an error of a picture that is being refined is not finite")
    return found


@dataclass(frozen=True)
class Seen:
    """Everything measured of one view."""

    view: Looked
    finished: View
    maps: dict[str, np.ndarray]
    runs: dict[Run, Measured]


def curve(seen: Sequence[Seen], kind: str, order: Order) -> Anytime | None:
    """Means over the views, point by point; None where no view is attended unequally by this map."""
    run: Run = (order, kind if order == "attention" else None)
    some = [one for one in seen if ("attention", kind) in one.runs]
    if not some:
        return None
    errors = [
        list(errors_along(one.runs[run].refined, one.finished, attended_pixels(one.view.regions, one.maps[kind])))
        for one in some
    ]
    attended, whole = np.mean(errors, axis=0).T
    parts = some[0].runs[run].refined.parts
    cell = some[0].view.cell
    return Anytime(
        scene=cell.scene.name,
        method=cell.learner.method,
        attention=kind,
        order=order,
        views=len(some),
        seconds=np.mean([one.runs[run].seconds for one in some], axis=0).tolist(),
        share=[0.0, *(part.share for part in parts)],
        rmse_attended=attended.tolist(),
        rmse_whole=whole.tolist(),
    )


def reaching(one: Anytime, share_of_error: float) -> Reaching:
    """When the attended error is first at most a share of the coarse frame's, and stays so."""
    limit = share_of_error * one.rmse_attended[0]
    above = [index for index, error in enumerate(one.rmse_attended) if error > limit]
    index = above[-1] + 1 if above else 0
    there = index < len(one.seconds)
    return Reaching(
        scene=one.scene,
        method=one.method,
        attention=one.attention,
        order=one.order,
        share_of_error=share_of_error,
        seconds=one.seconds[index] if there else None,
        share_of_time=one.seconds[index] / one.seconds[-1] if there else None,
    )
