"""How long a picture takes by rendering and by a hit of the view cache, and what a key of the pose alone confuses."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.playback.cached import CachedMethod, picture_of
from harness.playback.run_loader import TrainedCell
from harness.playback.store import ViewStore
from harness.records.study import Check, Table, check
from harness.studies.framework import Found, Rows
from harness.studies.serving.serving_context import CLOCK, Clock, ServingContext, brief, plain, significant, study
from harness.training.batches import Camera
from harness.training.learner import Learner
from harness.training.scoring.evaluate import View
from harness.training.scoring.metrics import mse

ROOM = 1 << 30
"""A capacity in bytes that is never reached here, so that nothing is evicted."""
POSES = 8
SCENES, METHODS = ("lego",), ("nerf", "qnerf")
"""What is preferred if the run has it."""
HITS = {"memory.0": ("from memory", 1000.0), "disk.warm": ("from disk, file in the system's memory", 50.0)}
"""Kind of hit → its description, and the minimum ratio of rendering to a hit that this harness calls “instantly”."""
LONGER = 1.25
"""The factor by which the focal length is longer."""
INSET = 0.01
"""The inset from near and far as a share of their distance."""


class WrongHit(RuntimeError):
    """A hit in another level than expected, or with another picture than was stored: an error of this harness."""


@study
def latency(context: ServingContext) -> Iterator[Found]:
    cells = cells_of(context)
    if not cells:
        yield "No method of the run can be rendered here."
        return
    timed = [(cell, latencies(context, cell)) for cell in cells]
    checks = [hit_check(cell, name, seconds[name], seconds["render"]) for cell, seconds in timed for name in HITS]
    parts = []
    for name, (where, target) in HITS.items():
        ratios = [hit.value or 0.0 for hit in checks if hit.id.startswith(f"hit.{name}.")]
        ends = " to ".join(dict.fromkeys(significant(end) for end in (min(ratios), max(ratios))))
        parts.append(f"{ends} times as long as a hit {where} (target {target:g})")
    yield f"Rendering a view {context.width} px wide takes {' and '.join(parts)}."
    yield from checks
    confused = confusions(context, cells[0], variants(context, cells[0]))
    for cell in cells[1:]:
        confused += confusions(context, cell, in_other_chunks(cell))
    yield from findings_of(confused)


def cells_of(context: ServingContext) -> list[TrainedCell]:
    """Return the cells of one scene: two methods if some scene has them, those of `METHODS` first."""
    scenes, methods = context.in_order(SCENES, METHODS)
    best: list[TrainedCell] = []
    for scene in scenes:
        cells = [cell for method in methods if (cell := context.trained(scene, method)) is not None]
        best = max(best, cells[: len(METHODS)], key=len)
        if len(best) == min(len(METHODS), len(methods)):
            break
    return best


def latencies(context: ServingContext, cell: TrainedCell, clock: Clock = CLOCK) -> dict[str, list[float]]:
    """Return the seconds of rendering (`render`) and of hits of each kind, in turn, so that a busy machine affects all
    alike. The disk is read by a store that keeps nothing in memory, from a file that was just written.
    """
    poses, folder = context.orbit(cell.scene, POSES), context.scratch / f"latency.{cell.learner.method}"
    seconds: dict[str, list[float]] = {name: [] for name in ("render", *HITS)}
    plain(cell.learner, context.camera(cell, poses[0]), cell.chunk)  # allocations and kernel choices
    for round_ in range(context.sizes.rounds):
        pose = poses[round_ % POSES]
        camera = context.camera(cell, pose)
        began = clock()
        view = plain(cell.learner, camera, cell.chunk)
        seconds["render"].append(clock() - began)
        for name in HITS:
            place = name.partition(".")[0]
            for _ in range(context.sizes.hits):
                store = ViewStore(ROOM) if place == "memory" else ViewStore(0, folder, ROOM)
                cached = CachedMethod(cell.learner, store, cell.chunk)
                cached.keep(camera, view)
                again = context.camera(cell, pose)  # a new camera: the cache may remember nothing of it
                began = clock()
                hit = cached.lookup(again)
                seconds[name].append(clock() - began)
                if hit is None or hit[1] != place:
                    raise WrongHit(f"a view did not come from {place}, as it should")
                if not same(hit[0], view):
                    raise WrongHit(f"a hit from {place} is not the picture that was stored")
    return seconds


def same(view: View, other: View) -> bool:
    """Return whether both are bit-identical: −0 is not 0."""
    a, b = picture_of(view), picture_of(other)
    return a.shape == b.shape and a.tobytes() == b.tobytes()


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


@dataclass(frozen=True)
class Variant:
    changed: str
    learner: Learner
    chunk: int
    request: Callable[[Camera], Camera] = lambda camera: camera


@dataclass(frozen=True)
class Confusion:
    changed: str
    views: int
    stale: int
    """The views of which a key of the pose alone would return another picture."""
    rmse: float | None
    """The root mean square difference of the stale pictures; None if they have another size."""
    caught: int
    """The stale views for which the harness's key is new; it has to be new for all of them."""


def confusions(context: ServingContext, cell: TrainedCell, others: Iterable[Variant]) -> list[Confusion]:
    """Compare the pictures and keys of `cell` with those of `others` at the same poses."""
    cameras = [context.camera(cell, pose) for pose in context.orbit(cell.scene, context.sizes.confused)]
    stored = [plain(cell.learner, camera, cell.chunk) for camera in cameras]
    known = CachedMethod(cell.learner, ViewStore(ROOM), cell.chunk)
    rows = []
    for variant in others:
        new = CachedMethod(variant.learner, ViewStore(ROOM), variant.chunk)
        stale, caught, squares = 0, 0, []
        for camera, view in zip(cameras, stored, strict=True):
            request = variant.request(camera)
            asked = plain(variant.learner, request, variant.chunk)
            if not same(view, asked):
                stale += 1
                caught += new.key(request) != known.key(camera)
                if asked.colour.shape == view.colour.shape:
                    squares.append(mse(asked.colour, view.colour))
        rmse = float(np.sqrt(np.mean(squares))) if squares else None if stale else 0.0
        rows.append(Confusion(variant.changed, len(cameras), stale, rmse, caught))
    return rows


def variants(context: ServingContext, cell: TrainedCell) -> Iterator[Variant]:
    """Yield changes of what a picture depends on except the pose; tests of `harness.playback.keys` change the rest."""
    learner, chunk, scene = cell.learner, cell.chunk, cell.scene
    another = next((seed for seed in context.run.run.seeds if seed != context.seed), None)
    if another is not None and (trained := context.trained(scene, learner.method, another)) is not None:
        yield Variant("weights of another seed", trained.learner, trained.chunk)
    for method in context.methods:
        if method != learner.method and (trained := context.trained(scene, method)) is not None:
            yield Variant(f"method {method} instead of {learner.method}", trained.learner, trained.chunk)
    inset = INSET * (scene.far - scene.near)
    requests: dict[str, Callable[[Camera], Camera]] = {
        f"focal length {LONGER} times as long": lambda camera: replace(camera, focal=LONGER * camera.focal),
        "half the width": lambda camera: camera.resized(max(1, camera.width // 2)),
        "near and far closer together": lambda camera: replace(
            camera, near=camera.near + inset, far=camera.far - inset
        ),
    }
    yield from (Variant(changed, learner, chunk, request) for changed, request in requests.items())
    yield from in_other_chunks(cell)


def in_other_chunks(cell: TrainedCell) -> Iterator[Variant]:
    if not cell.learner.field.pointwise:
        half = max(1, cell.chunk // 2)
        yield Variant(f"{cell.learner.method} with {half} rays per chunk instead of {cell.chunk}", cell.learner, half)


def findings_of(rows: Sequence[Confusion]) -> Iterator[Found]:
    stale = [row for row in rows if row.stale]
    worst = max(stale, key=lambda row: row.rmse or 0.0, default=None)
    off = f", off by up to {significant(worst.rmse)} ({worst.changed})" if worst and worst.rmse else ""
    kinds = f"of {len(rows)} kinds"
    yield f"A key that holds only the pose would return another picture after {len(stale)} {kinds} of change{off}."
    what = "kinds of change after which a key that holds only the pose returns another picture"
    repeats = len(rows)
    yield check(what, len(stale), high=0.0, why=f"{kinds}{off}", subject="Listing 5", owner="paper", repeats=repeats,
                id="key.pose")  # fmt: skip
    if stale:
        caught = 100.0 * sum(row.caught for row in rows) / sum(row.stale for row in rows)
        yield check(
            "share of the stale views for which the harness's key is new", caught, 100.0, unit="%", id="key.ours"
        )
    columns = ["changed at the same pose", "views", "stale by the pose", "off by", "new for the harness's key"]
    lines: Rows = [[row.changed, row.views, row.stale, row.rmse if row.stale else None, row.caught] for row in rows]
    yield Table("confusions", 0, "What a key has to distinguish", columns, lines)
