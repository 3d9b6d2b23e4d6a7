"""How long a picture takes by rendering, and by a hit of each level of the view cache."""

import os
from pathlib import Path

import numpy as np

from harness.playback.cached import CachedMethod
from harness.playback.run_loader import TrainedCell
from harness.playback.store import ViewStore
from harness.records.serving_record import Latency, Source, Timed
from harness.studies.serving.serving_context import CLOCK, Clock, ServingContext, latency, plain, timed
from harness.training.batches import Camera
from harness.training.evaluate import View

ROOM = 1 << 30
"""A capacity in bytes that exceeds all that is stored here, so that nothing is evicted."""
POSES = 8


class WrongHit(RuntimeError):
    """A hit that is not of the expected level, or not the picture that was rendered: an error of ours."""


def latencies(situation: ServingContext, cell: TrainedCell, clock: Clock = CLOCK) -> list[Latency]:
    """Time rendering, and hits of every kind, in turn, so that whatever else the machine does affects all alike.

    A hit is what a caller waits for: key of a new camera, lookup, checksum, array. Weights are frozen, so that they are
    hashed once, before; in `level 0 hashed` they are hashed at every request, as is the default. Level 2 is read by a
    store that keeps nothing in memory: from a file in the operating system's memory, as one that was written lately is,
    and, if the system can be told to drop a file's data, from one that is not (`level 2 cold`; names of files stay, and
    the disk may have a memory of its own).
    """
    sizes, method = situation.sizes, cell.learner.method
    poses = situation.orbit(cell.scene, POSES)
    seconds: dict[Timed, list[float]] = {
        name: [] for name in ("render", "level 0", "level 1", "level 2", "level 0 hashed", "level 2 cold")
    }
    folder = situation.scratch / f"latency.{method}"
    plain(cell.learner, situation.camera(cell, poses[0]), cell.chunk)  # allocations and kernel choices
    for round_ in range(sizes.rounds):
        if round_ and situation.is_over(f"latencies of {method}, rounds after {round_} of {sizes.rounds}"):
            break
        pose = poses[round_ % POSES]
        asked = situation.camera(cell, pose)
        view, took = timed(lambda: plain(cell.learner, asked, cell.chunk), clock)  # noqa: B023
        seconds["render"].append(took)

        def hit(name: Timed, cached: CachedMethod, level: Source) -> None:
            # a new camera: nothing may be remembered of it
            seconds[name].append(_hit(cached, situation.camera(cell, pose), view, level, clock))  # noqa: B023

        if round_ < POSES:
            frozen(cell, ViewStore(0, folder, ROOM), (2,)).keep(asked, view)
        for _ in range(sizes.hits):
            cached = frozen(cell, ViewStore(ROOM, None, 0))
            cached.keep(asked, view)
            hit("level 1", cached, "level 1")
            hit("level 0", cached, "level 0")
            hit("level 0 hashed", CachedMethod(cell.learner, cached.store, cell.chunk, levels=(1,)), "level 0")
        for _ in range(sizes.hits):  # after those in memory, which writing and dropping files would slow down
            hit("level 2", _of_disk(cell, folder, asked), "level 2")
            cold = _of_disk(cell, folder, asked)
            if dropped(folder):
                hit("level 2 cold", cold, "level 2")
    if not seconds["level 2 cold"]:
        del seconds["level 2 cold"]
        situation.leave_out("hits on disk were timed with the file in the system's memory alone: it cannot be dropped")
    rendering = seconds["render"]
    return [
        latency(cell.scene.name, method, source, values, None if source == "render" else rendering)
        for source, values in seconds.items()
    ]


def frozen(cell: TrainedCell, store: ViewStore, levels: tuple[int, ...] = (1,)) -> CachedMethod:
    """Return a method that nobody trains, cached at these levels."""
    return CachedMethod(cell.learner, store, cell.chunk, frozen=True, levels=levels)


def bytes_a_view(situation: ServingContext, cell: TrainedCell) -> tuple[int, int]:
    """Return the bytes per view in memory and on disk, means over an orbit."""
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


def dropped(folder: Path) -> bool:
    """Write the data of all files in a folder to disk and ask the operating system to drop it; returns whether it was
    asked.
    """
    if not hasattr(os, "posix_fadvise"):
        return False
    for file in folder.rglob("*"):
        if file.is_file():
            handle = os.open(file, os.O_RDONLY)
            try:
                os.fsync(handle)
                os.posix_fadvise(handle, 0, 0, os.POSIX_FADV_DONTNEED)
            finally:
                os.close(handle)
    return True


def came_from(store: ViewStore, before: dict[int, int]) -> Source:
    """Return where the last view came from: `before` are the hits of the store before it was requested."""
    now = store.statistics.hits
    found: list[Source] = [_LEVELS[level] for level in now if now[level] > before[level]]
    return found[0] if found else "render"


_LEVELS: dict[int, Source] = {0: "level 0", 1: "level 1", 2: "level 2"}


def _of_disk(cell: TrainedCell, folder: Path, camera: Camera) -> CachedMethod:
    """Return the method of a disk cache with nothing in memory and the weights hashed already."""
    cached = frozen(cell, ViewStore(0, folder, ROOM), (2,))
    cached.key(camera)
    return cached


def _hit(cached: CachedMethod, camera: Camera, view: View, level: Source, clock: Clock) -> float:
    """Return the seconds of one hit; raises `WrongHit`. Its source is checked afterwards, because checking reads the
    file.
    """
    before = cached.store.statistics.hits
    found, took = timed(lambda: cached.render(camera), clock)
    if not same(found, view):
        raise WrongHit(f"a hit of {level} is not the picture that was stored")
    if (source := came_from(cached.store, before)) != level:
        raise WrongHit(f"a view came from {source}, where {level} is timed")
    return took


def same(one: View, other: View) -> bool:
    """Whether both are equal to the last bit: −0 is not 0."""
    return all(
        a.shape == b.shape and a.dtype == b.dtype and a.tobytes() == b.tobytes()
        for a, b in ((getattr(one, name), getattr(other, name)) for name in ("colour", "opacity", "depth"))
    )
