"""How long a picture takes by rendering, and by a hit in each level of the view cache."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from harness.playback.cached import CachedMethod, picture_of
from harness.playback.run_loader import TrainedCell
from harness.playback.store import ViewStore
from harness.records.study import Check
from harness.studies.framework import Found
from harness.studies.serving.serving_context import (
    CLOCK,
    Clock,
    ServingContext,
    brief,
    plain,
    significant,
    study,
    timed,
)
from harness.training.batches import Camera
from harness.training.scoring.evaluate import View

ROOM = 1 << 30
"""A capacity in bytes that is never reached here, so that nothing is evicted."""
POSES = 8
SCENE = "lego"
METHODS = ("nerf", "qnerf")
"""The methods that are preferred if the run has them."""
HITS = {
    "memory.0": ("from memory, requested again", 1000.0),
    "memory.1": ("from memory, requested for the first time", 1000.0),
    "disk.warm": ("from disk, file in the system's memory", 50.0),
    "disk.cold": ("from disk, file not in the system's memory", 50.0),
}
"""Kind of hit → its description, and the minimum ratio of rendering to a hit that this harness calls “instantly”."""


class WrongHit(RuntimeError):
    """A hit in another level than expected, or with another picture than was stored: an error of this harness."""


@study
def latency(context: ServingContext) -> Iterator[Found]:
    checks: list[Check] = []
    for cell in cells_of(context):
        seconds = latencies(context, cell)
        rendering = seconds.pop("render")
        checks += [hit_check(cell, name, calls, rendering) for name, calls in seconds.items()]
    if not checks:
        yield "No hit was timed."
        return
    parts = []
    for place, where in (("memory.0", "in memory"), ("disk.warm", "on disk")):
        ratios = [check.value or 0.0 for check in checks if check.id.startswith(f"hit.{place}.")]
        ends = " to ".join(dict.fromkeys(significant(end) for end in (min(ratios), max(ratios))))
        parts.append(f"{ends} times as long as a hit {where} (target {HITS[place][1]:g})")
    yield f"Rendering a view {context.width} px wide takes {' and '.join(parts)}."
    yield from checks


def hit_check(cell: TrainedCell, name: str, seconds: Sequence[float], rendering: Sequence[float]) -> Check:
    """Return how many times as long rendering takes as a hit. Its spread is the lower quartile of rendering over the
    upper quartile of hits, and vice versa; the target is met or missed if it lies outside this spread.
    """
    (words, target), method = HITS[name], cell.learner.method
    least, lower, median, upper, most = np.quantile(seconds, (0.05, 0.25, 0.5, 0.75, 0.95)).tolist()
    lower_rendering, rendered, upper_rendering = np.quantile(rendering, (0.25, 0.5, 0.75)).tolist()
    low, high = lower_rendering / upper, upper_rendering / lower
    why = f"{brief(median)} ({brief(least)} to {brief(most)}) against {brief(rendered)} on {cell.scene.name}"
    return Check(
        f"rendering against a hit {words}",
        rendered / median,
        low=target,
        unit="×",
        why=why,
        subject=method,
        owner="machine",
        status="pass" if low >= target else "fail" if high < target else "inconclusive",
        spread=(low, high),
        repeats=len(seconds),
        id=f"hit.{name}.{method}",
    )


def cells_of(context: ServingContext) -> list[TrainedCell]:
    """Return the cells of one scene: two methods if some scene has them, those of `METHODS` first."""
    scenes, methods = context.in_order((SCENE,), METHODS)
    best: list[TrainedCell] = []
    for scene in scenes:
        cells: list[TrainedCell] = []
        for method in methods:
            if len(cells) < len(METHODS) and (cell := context.trained(scene, method)) is not None:
                cells.append(cell)
        best = max(best, cells, key=len)
        if len(best) == min(len(METHODS), len(methods)):
            break
    return best


def latencies(context: ServingContext, cell: TrainedCell, clock: Clock = CLOCK) -> dict[str, list[float]]:
    """Return the seconds of rendering (`render`) and of hits of every kind, in turn, so that a busy machine affects all
    alike.

    The disk is read by a store that keeps nothing in memory: from a file in the operating system's memory, such as one
    just written, and from one that is not, if the system can drop a file's data.
    """
    sizes, method = context.sizes, cell.learner.method
    poses = context.orbit(cell.scene, POSES)
    seconds: dict[str, list[float]] = {name: [] for name in ("render", *HITS)}
    folder = context.scratch / f"latency.{method}"
    plain(cell.learner, context.camera(cell, poses[0]), cell.chunk)  # allocations and kernel choices
    for round_ in range(sizes.rounds):
        pose = poses[round_ % POSES]
        stored_camera = context.camera(cell, pose)
        view, took = timed(lambda: plain(cell.learner, stored_camera, cell.chunk), clock)  # noqa: B023
        seconds["render"].append(took)

        def hit(name: str, cached: CachedMethod) -> None:
            # a new camera: the cache may remember nothing of it
            place = name.partition(".")[0]
            seconds[name].append(_hit(cached, context.camera(cell, pose), view, place, clock))  # noqa: B023

        if round_ < POSES:
            CachedMethod(cell.learner, ViewStore(0, folder, ROOM), cell.chunk).keep(stored_camera, view)
        for _ in range(sizes.hits):
            cached = CachedMethod(cell.learner, ViewStore(ROOM), cell.chunk)
            cached.keep(stored_camera, view)
            hit("memory.1", cached)
            hit("memory.0", cached)
        for _ in range(sizes.hits):  # after the hits in memory, which writing and dropping files would slow down
            hit("disk.warm", _of_disk(cell, folder, stored_camera))
            cold = _of_disk(cell, folder, stored_camera)
            if dropped(folder):
                hit("disk.cold", cold)
    if not seconds["disk.cold"]:
        del seconds["disk.cold"]
        context.leave_out("hits from disk with the file not in the system's memory", "the system cannot drop its data")
    return seconds


def dropped(folder: Path) -> bool:
    """Ask the system to write the data of a folder's files to disk and drop it; returns whether it can be asked."""
    if not hasattr(os, "posix_fadvise"):
        return False
    for file in folder.iterdir():
        with file.open("rb") as opened:
            os.fsync(opened)
            os.posix_fadvise(opened.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
    return True


def _of_disk(cell: TrainedCell, folder: Path, camera: Camera) -> CachedMethod:
    cached = CachedMethod(cell.learner, ViewStore(0, folder, ROOM), cell.chunk)
    cached.key(camera)
    return cached


def _hit(cached: CachedMethod, camera: Camera, view: View, place: str, clock: Clock) -> float:
    """Return the seconds of one hit, checked off the clock; raises `WrongHit`."""
    hit, took = timed(lambda: cached.lookup(camera), clock)
    if hit is None or hit[1] != place:
        raise WrongHit(f"a view did not come from {place}, as it should")
    if not same(hit[0], view):
        raise WrongHit(f"a hit from {place} is not the picture that was stored")
    return took


def same(view: View, other: View) -> bool:
    """Return whether both are bit-identical: −0 is not 0."""
    a, b = picture_of(view), picture_of(other)
    return a.shape == b.shape and a.tobytes() == b.tobytes()
