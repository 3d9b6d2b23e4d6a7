"""The view cache (§8.1, Listing 5) on a finished run: latency, bytes, camera paths, and what a lesser key confuses."""

import typing
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from harness.playback.camera_paths import spiral, walk
from harness.playback.run_loader import TrainedCell
from harness.playback.store import ViewStore
from harness.records.serving_record import CacheRecord, PathUse, Source
from harness.studies.serving.cache_confusions import confusions, in_other_calls, variants
from harness.studies.serving.cache_latency import ROOM, bytes_a_view, came_from, frozen, latencies
from harness.studies.serving.serving_context import CLOCK, Clock, ServingContext, plain, timed
from harness.training.evaluate import View


@dataclass(frozen=True)
class Route:
    """A path, and the cache through which it is rendered."""

    path: str
    """The path in words."""
    poses: np.ndarray
    """Poses, float64 [views, 4, 4]."""
    memory_bytes: int
    disk_bytes: int
    """The capacity on disk; 0 is a cache without one."""
    others: Sequence[np.ndarray] = ()
    """The poses of similar paths, of which the hits alone are counted."""


def routes(situation: ServingContext, cell: TrainedCell, view_bytes: int) -> list[Route]:
    """Return an orbit rendered three times, walks that come back to where they were, an orbit larger than the memory,
    and the spiral of the test views, which never comes back: all that a cache costs.
    """
    count = situation.sizes.orbit
    orbit = situation.orbit(cell.scene, count)
    radius = float(np.linalg.norm(orbit[0][:3, 3]))
    steps = 2 * count
    first, *others = (walk(steps, situation.seed + place, radius) for place in range(situation.sizes.walks))
    little = max(1, count // 3) * view_bytes
    twice = np.concatenate([orbit, orbit])
    words = f"an orbit of {count} views, twice, with room for {max(1, count // 3)} in memory"
    return [
        Route(f"an orbit of {count} views, three times", np.concatenate([twice, orbit]), ROOM, 0),
        Route(f"a walk of {steps} steps", first, ROOM, 0, others),
        Route(f"{words} alone", twice, little, 0),
        Route(f"{words} and the others on disk", twice, little, ROOM),
        Route(f"a spiral of {count} views, none twice", spiral(count, radius), ROOM, 0),
    ]


def followed(
    situation: ServingContext, cell: TrainedCell, route: Route, number: int, clock: Clock = CLOCK
) -> PathUse | None:
    """Request every view from the cache and render it without, in turn, so that a busy machine affects both alike.
    Returns None if the time is over before the end.
    """
    disk = situation.scratch / f"path.{number}" if route.disk_bytes else None
    store = ViewStore(route.memory_bytes, disk, route.disk_bytes)
    cached = frozen(cell, store, (1, 2) if route.disk_bytes else (1,))
    cached.key(situation.camera(cell, route.poses[0]))  # digests the weights, once
    hits = Counter(dict.fromkeys(typing.get_args(Source), 0))
    seconds = {"with": 0.0, "without": 0.0}
    for index, pose in enumerate(route.poses):
        if situation.is_over(f"{route.path}, with {cell.learner.method}"):
            return None
        camera, before = situation.camera(cell, pose), store.statistics.hits
        calls: list[tuple[str, Callable[[], object]]] = [
            ("with", lambda: cached.render(camera)),  # noqa: B023
            ("without", lambda: plain(cell.learner, camera, cell.chunk)),  # noqa: B023
        ]
        for name, call in calls[:: 1 if index % 2 else -1]:
            seconds[name] += timed(call, clock)[1]
        hits[came_from(store, before)] += 1
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
        other_hit_rates=[hit_rate(situation, cell, poses, route.memory_bytes) for poses in route.others],
    )


def hit_rate(situation: ServingContext, cell: TrainedCell, poses: np.ndarray, memory_bytes: int) -> float:
    """Return the hit rate of a path through a cache in memory. It does not depend on what a picture shows: a miss
    stores a black one.
    """
    cached = frozen(cell, ViewStore(memory_bytes, None, 0))
    camera = situation.camera(cell, poses[0])
    shape = (camera.height, camera.width)
    picture = View(*(np.zeros(one, np.float32) for one in ((*shape, 3), shape, shape)))
    found = 0
    for pose in poses:
        camera = situation.camera(cell, pose)
        if cached.lookup(camera) is None:
            cached.keep(camera, picture)
        else:
            found += 1
    return found / len(poses)


SCENE = "lego"
METHODS = ("nerf", "qnerf")
"""The methods preferred if the run has them."""


def measured(situation: ServingContext) -> CacheRecord | None:
    """Measure the cache; None if no method of the run can be rendered here."""
    cells = cells_of(situation)
    if not cells:
        return None
    found = []
    for cell in cells:
        if situation.is_over(f"latencies of {cell.learner.method}"):
            break
        situation.show.line(f"  latencies of {cell.learner.method} on {cell.scene.name}")
        found += latencies(situation, cell)
    first = cells[0]
    memory, disk = bytes_a_view(situation, first)
    paths = []
    for number, route in enumerate(routes(situation, first, memory)):
        situation.show.line(f"  {route.path}")
        if (path := followed(situation, first, route, number)) is not None:
            paths.append(path)
    if len(cells) > 1:
        situation.leave_out(f"camera paths were followed with {first.learner.method} alone: hits are any method's")
    situation.show.line("  what a key of the pose alone would return")
    mixed = confusions(situation, first, variants(situation, first))
    for cell in cells[1:]:
        mixed += confusions(situation, cell, in_other_calls(cell))
    camera = situation.camera(first, situation.orbit(first.scene, 1)[0])
    return CacheRecord(camera.width, camera.height, found, paths, mixed, memory, disk)


def cells_of(situation: ServingContext) -> list[TrainedCell]:
    """Return the cells of one scene: two methods if there is a scene that has them, ours first."""
    names = {scene.name: scene for scene in situation.scenes}
    preferred = ([names.pop(SCENE)] if SCENE in names else []) + list(names.values())
    methods = [name for name in METHODS if name in situation.methods]
    methods += [name for name in situation.methods if name not in methods]
    best: list[TrainedCell] = []
    for scene in preferred:
        cells: list[TrainedCell] = []
        for method in methods:
            if len(cells) < len(METHODS) and (cell := situation.trained(scene, method)) is not None:
                cells.append(cell)
        if len(cells) > len(best):
            best = cells
        if len(best) == min(len(METHODS), len(methods)):
            break
    return best
