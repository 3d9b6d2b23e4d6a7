"""What a key that holds only the pose (Listing 5) returns at known poses if something else has changed."""

import hashlib
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
from harness.training.scoring.evaluate import View
from harness.training.scoring.metrics import mse

LONGER = 1.25
"""The factor by which the focal length is longer."""
INSET = 0.01
"""The inset from near and far as a share of their distance."""


def pose_hash(camera_to_world: np.ndarray) -> str:
    """Return `_pose_hash` of Listing 5, which the paper does not print: a hash of all bits of the sixteen numbers."""
    return hashlib.blake2b(np.ascontiguousarray(camera_to_world, dtype=np.float64).tobytes()).hexdigest()


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
    """What a key that holds only the pose would have returned, and what the harness's key returned."""

    changed: str
    views: int
    stale: int
    """The views whose pose was known, with another picture stored for it."""
    rmse: float
    """The root mean square difference between the stored and the requested picture, over the stale views."""
    missed: int
    """The views for which the harness's key was new."""
    caught: int
    """The stale views among them; the harness's key has to be new for all stale views."""


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
    stale, views = [row for row in rows if row.stale], sum(row.views for row in rows)
    worst = max(stale, key=lambda row: row.rmse, default=None)
    hidden = [row.changed for row in stale if row.rmse <= LEAST_VISIBLE]
    off = f", off by up to {significant(worst.rmse)} ({worst.changed})" if worst else ""
    unseen = f"; invisible in 8 bits: {', '.join(hidden)}" if hidden else ""
    yield (
        f"A key that holds only the pose would return another picture after {len(stale)} of {len(rows)} kinds of "
        f"change{off}; the harness's key is new for {sum(row.missed for row in rows)} of {views} views."
    )
    yield Check(
        "kinds of change after which a key that holds only the pose returns another picture",
        float(len(stale)),
        high=0.0,
        why=f"of {len(rows)} kinds{off}{unseen}",
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
    lines = [[row.changed, row.views, row.stale, row.rmse if row.stale else None, row.missed] for row in rows]
    yield Table("confusions", 0, "What a key has to distinguish", columns, lines)


def confusions_with(context: ServingContext, cell: TrainedCell, others: Iterable[Variant]) -> list[Confusion]:
    """Store pictures of `cell` under both keys, then request each of `others` at their poses."""
    cameras = [context.camera(cell, pose) for pose in context.orbit(cell.scene, context.sizes.confused)]
    store = ViewStore(ROOM)
    cached = CachedMethod(cell.learner, store, cell.chunk)
    by_pose: dict[str, View] = {}
    for camera in cameras:
        by_pose[pose_hash(camera.camera_to_world)] = view = plain(cell.learner, camera, cell.chunk)
        cached.keep(camera, view)
    return [_confusion(variant, cameras, by_pose, store) for variant in others]


def _confusion(variant: Variant, cameras: list[Camera], by_pose: dict[str, View], store: ViewStore) -> Confusion:
    cached = CachedMethod(variant.learner, store, variant.chunk)
    stale, missed, caught, squares = 0, 0, 0, []
    for known in cameras:
        camera = variant.request(known)
        expected = plain(variant.learner, camera, variant.chunk)
        returned, is_new = by_pose.get(pose_hash(camera.camera_to_world)), cached.lookup(camera) is None
        missed += is_new
        if returned is not None and not same(returned, expected):
            stale += 1
            caught += is_new
            squares.append(mse(of_size(returned.colour, *expected.opacity.shape), expected.colour))
    # all pictures of a variant have one size, so that the mean of means is the mean over all their pixels
    rmse = float(np.sqrt(np.mean(squares))) if squares else 0.0
    return Confusion(variant.changed, len(cameras), stale, rmse, missed, caught)


def variants(context: ServingContext, cell: TrainedCell) -> Iterator[Variant]:
    """Yield changes of what the picture depends on other than the pose, and last an almost equal pose. The tests of
    `harness.playback.keys` change everything else.
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
    yield Variant("a pose one unit in the last place away", learner, chunk, one_ulp_away)


def in_other_chunks(cell: TrainedCell) -> Iterator[Variant]:
    if not cell.learner.field.pointwise:
        half = max(1, cell.chunk // 2)
        yield Variant(f"{cell.learner.method} with {half} rays per chunk instead of {cell.chunk}", cell.learner, half)


def of_size(picture: np.ndarray, height: int, width: int) -> np.ndarray:
    """Resample [h, w, …] → [height, width, …] by nearest pixels, as a picture of another size would be shown."""
    rows = ((np.arange(height) + 0.5) * picture.shape[0] / height).astype(int)
    columns = ((np.arange(width) + 0.5) * picture.shape[1] / width).astype(int)
    resampled: np.ndarray = picture[rows][:, columns]
    return resampled


def one_ulp_away(camera: Camera) -> Camera:
    """Return the camera with its x position changed by one unit in the last place."""
    pose = camera.camera_to_world.copy()
    pose[0, 3] = np.nextafter(pose[0, 3], np.inf)
    return camera.at(pose)
