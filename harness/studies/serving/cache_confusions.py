"""Which pictures a key that holds only the pose (Listing 5) confuses, as something else has changed."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.playback.cached import CachedMethod
from harness.playback.run_loader import TrainedCell
from harness.playback.store import ViewStore
from harness.records.study import Check, Table, check
from harness.studies.framework import Found
from harness.studies.serving.cache_latency import ROOM, cells_of, same
from harness.studies.serving.serving_context import ServingContext, plain, significant, study
from harness.training.batches import Camera
from harness.training.learner import Learner
from harness.training.scoring.metrics import mse

LONGER = 1.25
"""The factor by which the focal length is longer."""
INSET = 0.01
"""The inset from near and far as a share of their distance."""
LEAST_VISIBLE = 0.5 / 255
"""The smallest visible error of display colour: half a step of 8 bits."""


@dataclass(frozen=True)
class Variant:
    changed: str
    learner: Learner
    chunk: int
    request: Callable[[Camera], Camera] = lambda camera: camera


@dataclass(frozen=True)
class Confusion:
    """What a key that holds only the pose would have returned, and whether the harness's key differs."""

    changed: str
    views: int
    stale: int
    """The views of which another picture was stored."""
    rmse: float | None
    """The root mean square difference of the stale pictures; None if they have another size."""
    caught: int
    """The stale views for which the harness's key is new; it has to be new for all of them."""


@study
def confusions(context: ServingContext) -> Iterator[Found]:
    cells = cells_of(context)
    rows = confusions_with(context, cells[0], variants(context, cells[0])) if cells else []
    for cell in cells[1:]:
        rows += confusions_with(context, cell, in_other_chunks(cell))
    if not rows:
        yield "No method of the run can be rendered here."
        return
    yield from findings_of(rows)


def findings_of(rows: Sequence[Confusion]) -> Iterator[Found]:
    stale = [row for row in rows if row.stale]
    visible = {row.changed: row.rmse for row in stale if row.rmse is not None}
    worst = max(visible, key=lambda changed: visible[changed], default=None)
    hidden = [changed for changed, rmse in visible.items() if rmse <= LEAST_VISIBLE]
    off = f", off by up to {significant(visible[worst])} ({worst})" if worst else ""
    unseen = f"; invisible in 8 bits: {', '.join(hidden)}" if hidden else ""
    kinds = f"of {len(rows)} kinds"
    yield f"A key that holds only the pose would return another picture after {len(stale)} {kinds} of change{off}."
    yield Check(
        "kinds of change after which a key that holds only the pose returns another picture",
        float(len(stale)),
        high=0.0,
        why=f"{kinds}{off}{unseen}",
        subject="Listing 5",
        owner="paper",
        status="fail" if stale else "pass",
        repeats=len(rows),
        id="key.pose",
    )
    if stale:
        caught = 100.0 * sum(row.caught for row in rows) / sum(row.stale for row in rows)
        what = "share of the stale views for which the harness's key is new"
        yield check(what, caught, 100.0, unit="%", id="key.ours")
    columns = ["changed at the same pose", "views", "stale by the pose", "off by", "new for the harness's key"]
    lines = [[row.changed, row.views, row.stale, row.rmse if row.stale else None, row.caught] for row in rows]
    yield Table("confusions", 0, "What a key has to distinguish", columns, lines)


def confusions_with(context: ServingContext, cell: TrainedCell, others: Iterable[Variant]) -> list[Confusion]:
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
    """Yield changes of what the picture depends on other than the pose. The tests of `harness.playback.keys` change
    everything else.
    """
    learner, chunk, scene = cell.learner, cell.chunk, cell.scene
    another = next((seed for seed in context.run.run.seeds if seed != context.seed), None)
    if another is not None and (trained := context.trained(scene, learner.method, another)) is not None:
        yield Variant("weights of another seed", trained.learner, trained.chunk)
    for method in context.methods:
        if method != learner.method and (trained := context.trained(scene, method)) is not None:
            yield Variant(f"method {method} instead of {learner.method}", trained.learner, trained.chunk)
    yield Variant(
        f"focal length {LONGER} times as long", learner, chunk,
        lambda camera: replace(camera, focal=LONGER * camera.focal),
    )  # fmt: skip
    yield Variant(
        "half the width", learner, chunk, lambda camera: camera.resized(max(1, camera.width // 2))
    )  # fmt: skip
    inset = INSET * (scene.far - scene.near)
    yield Variant(
        "near and far closer together", learner, chunk,
        lambda camera: replace(camera, near=camera.near + inset, far=camera.far - inset),
    )  # fmt: skip
    yield from in_other_chunks(cell)


def in_other_chunks(cell: TrainedCell) -> Iterator[Variant]:
    if not cell.learner.field.pointwise:
        half = max(1, cell.chunk // 2)
        yield Variant(f"{cell.learner.method} with {half} rays per chunk instead of {cell.chunk}", cell.learner, half)
