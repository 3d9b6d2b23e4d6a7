"""What a key of the pose alone (Listing 5) would return, at poses that it has seen, if something else changed."""

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from baselines.contract import Precision
from harness.plan.settings import TrainSettings
from harness.playback.cached import CachedMethod
from harness.playback.run_loader import TrainedCell
from harness.playback.store import ViewStore
from harness.records.study import Check, Table, check
from harness.studies.framework import Found
from harness.studies.serving.cache_latency import ROOM, cells_of, same
from harness.studies.serving.serving_context import ServingContext, plain, significant, study
from harness.training.batches import Batches, Camera
from harness.training.checkpoints import tensors_of
from harness.training.learner import Job, Learner, at_step, train
from harness.training.make_learner import learner_for
from harness.training.scoring.evaluate import View, cameras_of
from harness.training.scoring.metrics import mse
from harness.training.trainer import Trainer
from scenes.view_sets.view_set import ViewSet

LONGER = 1.25
"""The factor by which the focal length is longer."""
INSET = 0.01
"""The inset from near and far as a share of their distance."""


def pose_hash(camera_to_world: np.ndarray) -> str:
    """Return `_pose_hash` of Listing 5, which is not printed: a hash of the sixteen numbers, to the last bit."""
    return hashlib.blake2b(np.ascontiguousarray(camera_to_world, dtype=np.float64).tobytes()).hexdigest()


@dataclass(frozen=True)
class Variant:
    """A request that differs from what the cache has seen."""

    changed: str
    learner: Learner
    chunk: int
    asked: Callable[[Camera], Camera] = lambda camera: camera


LEAST_VISIBLE = 0.5 / 255
"""The least visible error of display colour: half a step of 8 bits."""


@dataclass(frozen=True)
class Confusion:
    """What a key of the pose alone would have returned, and what ours did."""

    changed: str
    views: int
    stale: int
    """The views for which the key of the pose alone was in the cache already, with another picture behind it."""
    rmse: float
    """The root mean square between what it would have returned and what was asked for, over these views."""
    missed: int
    """The views for which our key was new."""
    caught: int
    """The stale ones of them: for every stale view our key has to be new."""


@study
def confusions(context: ServingContext) -> Iterator[Found]:
    cells = cells_of(context)
    rows = confused(context, cells[0], variants(context, cells[0])) if cells else []
    for cell in cells[1:]:
        rows += confused(context, cell, in_other_calls(cell))
    if not rows:
        yield "No method of the run can be rendered here."
        return
    yield from compared(rows)


def compared(rows: Sequence[Confusion]) -> Iterator[Found]:
    stale, views = [row for row in rows if row.stale], sum(row.views for row in rows)
    worst = max(stale, key=lambda row: row.rmse, default=None)
    hidden = [row.changed for row in stale if row.rmse <= LEAST_VISIBLE]
    off = f", off by up to {significant(worst.rmse)} ({worst.changed})" if worst else ""
    unseen = f"; invisible in 8 bits: {', '.join(hidden)}" if hidden else ""
    yield (
        f"A key of the pose alone would return another picture after {len(stale)} of {len(rows)} kinds of change{off}; "
        f"ours is new for {sum(row.missed for row in rows)} of {views} views."
    )
    yield Check(
        "kinds of change after which a key of the pose alone returns another picture",
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
        yield check("share of the stale views for which our key is new", caught, 100.0, unit="%", id="key.ours")
    columns = ["changed at the same pose", "views", "stale by the pose alone", "off by", "new for our key"]
    lines = [[row.changed, row.views, row.stale, row.rmse if row.stale else None, row.missed] for row in rows]
    yield Table("confusions", 0, "What a key has to tell apart", columns, lines)


def confused(context: ServingContext, cell: TrainedCell, others: Iterable[Variant]) -> list[Confusion]:
    """Store pictures of `cell` under both keys, then request every one of `others` at their poses."""
    cameras = [context.camera(cell, pose) for pose in context.orbit(cell.scene, context.sizes.confused)]
    store = ViewStore(ROOM)
    cached = CachedMethod(cell.learner, store, cell.chunk)
    by_pose: dict[str, View] = {}
    for camera in cameras:
        by_pose[pose_hash(camera.camera_to_world)] = view = plain(cell.learner, camera, cell.chunk)
        cached.keep(camera, view)
    rows: list[Confusion] = []
    for variant in others:
        if context.is_over(f"{variant.changed}, and what comes after it"):
            break
        rows.append(_confusion(variant, cameras, by_pose, store))
    return rows


def _confusion(variant: Variant, cameras: list[Camera], by_pose: dict[str, View], store: ViewStore) -> Confusion:
    cached = CachedMethod(variant.learner, store, variant.chunk)
    stale, missed, caught, squares = 0, 0, 0, []
    for seen in cameras:
        camera = variant.asked(seen)
        wanted = plain(variant.learner, camera, variant.chunk)
        returned, is_new = by_pose.get(pose_hash(camera.camera_to_world)), cached.lookup(camera) is None
        missed += is_new
        if returned is not None and not same(returned, wanted):
            stale += 1
            caught += is_new
            squares.append(mse(of_size(returned.colour, *wanted.opacity.shape), wanted.colour))
    # all pictures of a variant are of one size, so that the mean of means is that of all their pixels
    rmse = float(np.sqrt(np.mean(squares))) if squares else 0.0
    return Confusion(variant.changed, len(cameras), stale, rmse, missed, caught)


def variants(context: ServingContext, cell: TrainedCell) -> Iterator[Variant]:
    """Yield whatever the picture depends on and its pose does not say, and last a pose that is nearly the same."""
    learner, chunk, scene = cell.learner, cell.chunk, cell.scene
    if isinstance(learner, Trainer):
        if (views := context.views(scene)) is None:
            context.leave_out(f"more training on {scene.name}", "there are no views to train on")
        else:
            yield Variant(
                f"{context.sizes.extra_steps} more steps of training", _further(context, learner, views), chunk
            )
        more = replace(learner.settings, bins=2 * learner.settings.bins)
        yield Variant(f"{more.bins} samples a ray instead of {learner.settings.bins}", copied(learner, more), chunk)
        other = "left" if learner.quadrature != "left" else "midpoint"
        ruled = copied(learner)
        ruled.quadrature = other
        yield Variant(f"quadrature {other} instead of {learner.quadrature}", ruled, chunk)
        precise = learner.settings.precision
        lesser: Precision = "float32" if precise != "float32" else "bfloat16"
        other_products = copied(learner, replace(learner.settings, precision=lesser))
        yield Variant(f"{lesser} products instead of {precise}", other_products, chunk)
        black = copied(learner)
        black.background = torch.zeros_like(learner.background)
        yield Variant("a black background instead of white", black, chunk)
    else:
        context.leave_out("more training, samples, quadrature, precision, background", f"not of {learner.method}")
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
    yield from in_other_calls(cell)
    yield Variant("a pose one unit in the last place away", learner, chunk, one_ulp_away)


def in_other_calls(cell: TrainedCell) -> Iterator[Variant]:
    """Yield other divisions of rays into chunks, if the picture depends on them."""
    if not cell.learner.field.pointwise:
        half = max(1, cell.chunk // 2)
        yield Variant(f"{cell.learner.method} with {half} rays a call instead of {cell.chunk}", cell.learner, half)


def of_size(picture: np.ndarray, height: int, width: int) -> np.ndarray:
    """Resample [h, w, …] → [height, width, …] by the nearest pixels, as a picture of another size would be shown."""
    rows = ((np.arange(height) + 0.5) * picture.shape[0] / height).astype(int)
    columns = ((np.arange(width) + 0.5) * picture.shape[1] / width).astype(int)
    resampled: np.ndarray = picture[rows][:, columns]
    return resampled


def one_ulp_away(camera: Camera) -> Camera:
    """Return the camera with the x of its place changed by the smallest amount that float64 can hold."""
    pose = camera.camera_to_world.copy()
    pose[0, 3] = np.nextafter(pose[0, 3], np.inf)
    return camera.at(pose)


def _further(context: ServingContext, learner: Trainer, views: ViewSet) -> Trainer:
    settings = learner.settings
    # a refresh would count as empty what it has not measured: a checkpoint has the grid's mask and no densities
    further = copied(learner, replace(settings, grid=replace(settings.grid, every=1 << 60)))
    batches = Batches(cameras_of(views, views.train, learner.device), views.train.rgba)
    train(further, batches.stream("serving", settings.rays), at_step(further.step + context.sizes.extra_steps))
    return further


def copied(learner: Trainer, settings: TrainSettings | None = None) -> Trainer:
    """Return an independent copy of the method in the same state."""
    job = Job(learner.method, learner.box, settings or learner.settings, learner.budget, learner.seed, learner.device)
    made = learner_for(replace(job, view_dependent=learner.view_dependent))
    assert isinstance(made, Trainer)
    made.restore({name: value.clone() for name, value in tensors_of(learner).items()}, learner.step)
    return made
