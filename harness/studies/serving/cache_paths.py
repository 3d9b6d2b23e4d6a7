"""Camera paths looked at through the view cache: where their views come from."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from harness.playback.cached import CHANNELS
from harness.playback.camera_paths import spiral, walk
from harness.playback.run_loader import TrainedCell
from harness.playback.store import ViewStore
from harness.records.study import Check, Table
from harness.studies.framework import Found
from harness.studies.serving.cache_latency import LEVELS, ROOM, cells_of, frozen, level_of_last
from harness.studies.serving.serving_context import CLOCK, Clock, ServingContext, plain, study, timed


class Route(NamedTuple):
    """A path, and the cache through which it is rendered."""

    path: str
    """The path in words."""
    poses: np.ndarray
    """Poses, float64 [views, 4, 4]."""
    memory_bytes: int
    disk_bytes: int = 0
    """The capacity on disk; 0 is a cache without one."""
    others: Sequence[np.ndarray] = ()
    """The poses of similar paths, whose hits in a memory that keeps everything are counted."""


class PathUse(NamedTuple):
    """A path that was followed."""

    sources: Counter[int | None]
    """Level, or None for rendered → views."""
    seconds: float
    seconds_without: float
    """The seconds with every view rendered."""

    @property
    def hit_rate(self) -> float:
        return 1.0 - self.sources[None] / self.sources.total()


def hit_rate(poses: np.ndarray) -> float:
    """Return the share of poses that were seen before."""
    return (len(poses) - len({pose.tobytes() for pose in poses})) / len(poses)


@study
def paths(context: ServingContext) -> Iterator[Found]:
    """Yield the hit rate of each path, and where its views came from."""
    cells = cells_of(context)
    if not cells:
        yield "No method of the run can be rendered here."
        return
    cell = cells[0]
    rows: list[list[str | float | None]] = []
    checks = []
    for number, route in enumerate(routes(context, cell)):
        use = followed(context, cell, route, number)
        if use is None:
            continue
        rates = [100.0 * rate for rate in (use.hit_rate, *map(hit_rate, route.others))]
        counts = [float(use.sources[level]) for level in LEVELS]
        rows.append([route.path, *counts, use.seconds, use.seconds_without])
        checks.append(
            Check(
                f"hits of {route.path}",
                float(np.mean(rates)),
                unit="%",
                why=f"mean over {len(rates)} seeds" if len(rates) > 1 else "",
                owner="machine",
                spread=(min(rates), max(rates)) if len(rates) > 1 else None,
                repeats=len(rates),
                id=f"path.{number}",
            )
        )
    if checks:
        parts = [f"{check.value:.0f} % of {check.what.removeprefix('hits of ')}" for check in checks]
        yield f"From the cache come {'; '.join(parts)}."
    yield from checks
    columns = ["path", *LEVELS.values(), "seconds", "all rendered"]
    yield Table("paths", 0, f"Where the views came from: {cell.learner.method} on {cell.scene.name}", columns, rows)


def routes(context: ServingContext, cell: TrainedCell) -> list[Route]:
    """Return an orbit rendered three times, walks that come back to where they were, an orbit larger than the memory,
    and the spiral of the test views, which never comes back: all that a cache costs.
    """
    count = context.sizes.orbit
    orbit = context.orbit(cell.scene, count)
    radius = float(np.linalg.norm(orbit[0][:3, 3]))
    steps = 2 * count
    first, *others = (walk(steps, context.seed + place, radius) for place in range(context.sizes.walks))
    lens = context.camera(cell, orbit[0])
    little = max(1, count // 3) * lens.width * lens.height * CHANNELS * np.dtype(np.float32).itemsize
    twice = np.concatenate([orbit, orbit])
    words = f"an orbit of {count} views, twice, with room for {max(1, count // 3)} in memory"
    return [
        Route(f"an orbit of {count} views, three times", np.concatenate([twice, orbit]), ROOM),
        Route(f"a walk of {steps} steps", first, ROOM, 0, others),
        Route(f"{words} alone", twice, little),
        Route(f"{words} and the others on disk", twice, little, ROOM),
        Route(f"a spiral of {count} views, none twice", spiral(count, radius), ROOM),
    ]


def followed(
    context: ServingContext, cell: TrainedCell, route: Route, number: int, clock: Clock = CLOCK
) -> PathUse | None:
    """Request every view from the cache and render it without, in turn; None if the time is over before the end."""
    disk = context.scratch / f"path.{number}" if route.disk_bytes else None
    store = ViewStore(route.memory_bytes, disk, route.disk_bytes)
    cached = frozen(cell, store, (1, 2) if route.disk_bytes else (1,))
    cached.key(context.camera(cell, route.poses[0]))  # digests the weights, once
    sources: Counter[int | None] = Counter()
    seconds = {"with": 0.0, "without": 0.0}
    for index, pose in enumerate(route.poses):
        if context.is_over(f"{route.path}, with {cell.learner.method}"):
            return None
        camera, before = context.camera(cell, pose), store.hits
        calls: list[tuple[str, Callable[[], object]]] = [
            ("with", lambda: cached.render(camera)),  # noqa: B023
            ("without", lambda: plain(cell.learner, camera, cell.chunk)),  # noqa: B023
        ]
        for name, call in calls[:: 1 if index % 2 else -1]:
            seconds[name] += timed(call, clock)[1]
        sources[level_of_last(store, before)] += 1
    return PathUse(sources, seconds["with"], seconds["without"])
