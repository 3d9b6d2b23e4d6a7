"""Camera paths through the view cache: where each view came from, and what that saved."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from harness.camera_paths import walk
from harness.finished import TrainedCell
from harness.serving.cache_latency import ROOM, frozen
from harness.serving.situation import Situation, plain
from harness.serving.timing import CLOCK, Clock, timed
from harness.serving_record import PathUse
from harness.view_cache.store import ViewStore

LEVELS = ("render", "level 0", "level 1", "level 2")

KEEP = 0.25
"""Chance that a walk goes on the same way as before."""


@dataclass(frozen=True)
class Route:
    """A path, and the cache that it is looked at through."""

    path: str
    """In words."""
    poses: np.ndarray
    """float64 [views, 4, 4]"""
    memory_bytes: int
    disk_bytes: int
    """0: without a disk."""


def routes(situation: Situation, cell: TrainedCell, view_bytes: int) -> list[Route]:
    """An orbit looked at three times, a walk that comes back to where it was, and an orbit larger than the memory."""
    count = situation.sizes.orbit
    orbit = situation.orbit(cell.scene, count)
    radius = float(np.linalg.norm(orbit[0][:3, 3]))
    steps = 2 * count
    little = max(1, count // 3) * view_bytes
    twice = np.concatenate([orbit, orbit])
    words = f"an orbit of {count} views, twice, with room for {max(1, count // 3)} in memory"
    return [
        Route(f"an orbit of {count} views, three times", np.concatenate([twice, orbit]), ROOM, 0),
        Route(f"a walk of {steps} steps back and forth", walk(steps, situation.seed, radius, keep=KEEP), ROOM, 0),
        Route(f"{words} alone", twice, little, 0),
        Route(f"{words} and the others on disk", twice, little, ROOM),
    ]


def followed(situation: Situation, cell: TrainedCell, route: Route, number: int, clock: Clock = CLOCK) -> PathUse:
    """Every view is asked of the cache and rendered without it, in turn, so that a busy machine hurts both alike."""
    disk = situation.scratch / f"path.{number}" if route.disk_bytes else None
    store = ViewStore(route.memory_bytes, disk, route.disk_bytes)
    cached = frozen(cell, store, (1, 2) if route.disk_bytes else (1,))
    cached.key(situation.camera(cell, route.poses[0]))  # digests the weights, once
    hits = Counter(dict.fromkeys(LEVELS, 0))
    seconds = {"with": 0.0, "without": 0.0}
    for index, pose in enumerate(route.poses):
        camera = situation.camera(cell, pose)
        level = store.where(cached.key(camera))
        hits["render" if level is None else f"level {level}"] += 1
        calls: list[tuple[str, Callable[[], object]]] = [
            ("with", lambda: cached.render(camera)),  # noqa: B023
            ("without", lambda: plain(cell.learner, camera, cell.chunk)),  # noqa: B023
        ]
        for name, call in calls[:: 1 if index % 2 else -1]:
            seconds[name] += timed(call, clock)[1]
    return PathUse(
        scene=cell.scene.name,
        method=cell.learner.method,
        path=route.path,
        views=len(route.poses),
        hits=dict(hits),
        memory_bytes=route.memory_bytes,
        disk_bytes=route.disk_bytes,
        seconds=seconds["with"],
        seconds_without=seconds["without"],
    )
