"""How long a picture takes by rendering, and by a hit of each level of the view cache."""

from pathlib import Path

import numpy as np

from harness.evaluate import View
from harness.finished import TrainedCell
from harness.serving.situation import Situation, plain
from harness.serving.timing import CLOCK, Clock, latency, timed
from harness.serving_record import Latency, Source
from harness.view_cache.cached import CachedMethod
from harness.view_cache.store import ViewStore

ROOM = 1 << 30
"""Bytes: more than is ever stored here, so that nothing falls out."""
POSES = 8


class WrongHit(RuntimeError):
    """A hit that is not of the level that was meant, or not the picture that was rendered: an error of ours."""


def latencies(situation: Situation, cell: TrainedCell, clock: Clock = CLOCK) -> list[Latency]:
    """Rendering, and hits in level 0, 1 and 2, in turn, so that whatever else the machine does hurts all alike.

    A hit is what a caller waits for: key, looking up, checksum, array. Its weights are frozen, so that they are
    digested once, before. Level 2 is read from disk at every call, by a store that keeps nothing in memory; the
    operating system holds the file in its own memory, as it would of a view that was written lately.
    """
    sizes, method = situation.sizes, cell.learner.method
    poses = situation.orbit(cell.scene, POSES)
    seconds: dict[Source, list[float]] = {"render": [], "level 0": [], "level 1": [], "level 2": []}
    folder = situation.scratch / f"latency.{method}"
    plain(cell.learner, situation.camera(cell, poses[0]), cell.chunk)  # allocations and kernel choices
    for round_ in range(sizes.rounds):
        pose = poses[round_ % POSES]
        camera = situation.camera(cell, pose)
        view, took = timed(lambda: plain(cell.learner, camera, cell.chunk), clock)  # noqa: B023
        seconds["render"].append(took)
        for _ in range(sizes.hits):
            store = ViewStore(ROOM, None, 0)
            cached = frozen(cell, store)
            cached.keep(camera, view)
            seconds["level 1"].append(_hit(cached, store, situation, cell, pose, view, 1, clock))
            seconds["level 0"].append(_hit(cached, store, situation, cell, pose, view, 0, clock))
            seconds["level 2"].append(_disk_hit(situation, cell, pose, view, folder, clock))
    rendering = seconds["render"]
    return [
        latency(cell.scene.name, method, source, values, None if source == "render" else rendering)
        for source, values in seconds.items()
    ]


def frozen(cell: TrainedCell, store: ViewStore, levels: tuple[int, ...] = (1,)) -> CachedMethod:
    """A method that nobody trains, cached at these levels."""
    return CachedMethod(cell.learner, store, cell.chunk, frozen=True, levels=levels)


def bytes_a_view(situation: Situation, cell: TrainedCell) -> tuple[int, int]:
    """In memory and on disk, means over an orbit."""
    poses = situation.orbit(cell.scene, POSES)
    folder = situation.scratch / f"bytes.{cell.learner.method}"
    store = ViewStore(ROOM, folder, ROOM)
    cached = frozen(cell, store, (1, 2))
    sizes = []
    for pose in poses:
        camera = situation.camera(cell, pose)
        cached.render(camera)
        value = store.get(cached.key(camera))
        if value is None:
            raise WrongHit("a view that was just stored is not there")
        sizes.append(value.nbytes)
    files = [file.stat().st_size for file in folder.rglob("*") if file.is_file()]
    return round(float(np.mean(sizes))), round(sum(files) / len(poses))


def _disk_hit(
    situation: Situation, cell: TrainedCell, pose: np.ndarray, view: View, folder: Path, clock: Clock
) -> float:
    store = ViewStore(0, folder, ROOM)
    cached = frozen(cell, store, (2,))
    camera = situation.camera(cell, pose)
    if store.where(cached.key(camera)) is None:
        cached.keep(camera, view)
    return _hit(cached, store, situation, cell, pose, view, 2, clock)


def _hit(
    cached: CachedMethod,
    store: ViewStore,
    situation: Situation,
    cell: TrainedCell,
    pose: np.ndarray,
    view: View,
    level: int,
    clock: Clock,
) -> float:
    """Seconds of one; raises `WrongHit`."""
    camera = situation.camera(cell, pose)  # a new one: nothing may be remembered of it
    found_at = store.where(cached.key(camera))
    if found_at != level:
        raise WrongHit(f"a view is at level {found_at}, where one of level {level} is timed")
    found, took = timed(lambda: cached.render(camera), clock)
    if not same(found, view):
        raise WrongHit(f"a hit of level {level} is not the picture that was stored")
    return took


def same(one: View, other: View) -> bool:
    """To the last bit."""
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in ("colour", "opacity", "depth"))
