"""What a key of the pose alone (Listing 5) would return, at poses that it has seen, if something else changed."""

import hashlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from baselines.contract import Precision
from harness.playback.cached import CachedMethod
from harness.playback.run_loader import TrainedCell
from harness.playback.store import ViewStore
from harness.records.serving_record import Confusion
from harness.studies.serving.cache_latency import ROOM, frozen, same
from harness.studies.serving.serving_context import ServingContext, plain
from harness.training.batches import Batches, Camera
from harness.training.checkpoints import tensors_of
from harness.training.evaluate import View, cameras_of
from harness.training.learner import Learner, at_step, train
from harness.training.make_learner import learner_for
from harness.training.metrics import mse
from harness.training.trainer import Trainer

LONGER = 1.25
"""The factor by which the focal length is longer."""
INSET = 0.01
"""The inset from near and far as a share of their distance."""


def pose_hash(camera_to_world: np.ndarray) -> str:
    """Return `_pose_hash` of Listing 5, which the paper does not print: a hash of the sixteen numbers, to the last
    bit.
    """
    return hashlib.blake2b(np.ascontiguousarray(camera_to_world, dtype=np.float64).tobytes()).hexdigest()


@dataclass(frozen=True)
class Variant:
    """A request that differs from what the cache has seen."""

    changed: str
    learner: Learner
    chunk: int
    asked: Callable[[Camera], Camera] = lambda camera: camera


def confusions(situation: ServingContext, cell: TrainedCell, others: Iterable[Variant]) -> list[Confusion]:
    """Store pictures of `cell` under both keys, then request every one of `others` at their poses."""
    cameras = [situation.camera(cell, pose) for pose in situation.orbit(cell.scene, situation.sizes.confused)]
    store = ViewStore(ROOM, None, 0)
    cached = frozen(cell, store)
    by_pose: dict[str, View] = {}
    for camera in cameras:
        by_pose[pose_hash(camera.camera_to_world)] = view = plain(cell.learner, camera, cell.chunk)
        cached.keep(camera, view)
    found: list[Confusion] = []
    for one in others:
        if situation.is_over(f"what a key of the pose alone would return for {one.changed}, and what comes after it"):
            break
        found.append(_confusion(one, cameras, by_pose, store))
    return found


def _confusion(one: Variant, cameras: list[Camera], by_pose: dict[str, View], store: ViewStore) -> Confusion:
    cached = CachedMethod(one.learner, store, one.chunk)
    stale, missed, squares = 0, 0, []
    for seen in cameras:
        camera = one.asked(seen)
        wanted = plain(one.learner, camera, one.chunk)
        returned = by_pose.get(pose_hash(camera.camera_to_world))
        if returned is not None and not same(returned, wanted):
            stale += 1
            squares.append(mse(of_size(returned.colour, *wanted.opacity.shape), wanted.colour))
        missed += cached.lookup(camera) is None
    # all pictures of a variant are of one size, so that the mean of means is that of all their pixels
    return Confusion(one.changed, len(cameras), stale, float(np.sqrt(np.mean(squares))) if squares else 0.0, missed)


def variants(situation: ServingContext, cell: TrainedCell) -> Iterator[Variant]:
    """Yield everything that the picture depends on and its pose does not say, and last a pose that is nearly the
    same.
    """
    learner, chunk, scene = cell.learner, cell.chunk, cell.scene
    if isinstance(learner, Trainer):
        yield from _retrained(situation, cell, learner)
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
        situation.leave_out(
            f"more training, samples, quadrature, precision and background are not confused with {learner.method}'s own"
        )
    another = next((one for one in situation.run.run.seeds if one != situation.seed), None)
    if another is not None and (trained := situation.trained(scene, learner.method, another)) is not None:
        yield Variant("weights of another seed", trained.learner, trained.chunk)
    for method in situation.methods:
        if method != learner.method and (trained := situation.trained(scene, method)) is not None:
            yield Variant(f"method {method} instead of {learner.method}", trained.learner, trained.chunk)
    yield Variant(
        f"focal length {LONGER} times as long", learner, chunk,
        lambda camera: replace(camera, focal=LONGER * camera.focal),
    )  # fmt: skip
    yield Variant(
        "half the width", learner, chunk, lambda camera: camera.resized(max(1, camera.width // 2))
    )  # fmt: skip
    yield Variant("near and far closer together", learner, chunk, narrower)
    yield from in_other_calls(cell)
    yield Variant("a pose one unit in the last place away", learner, chunk, one_ulp_away)


def in_other_calls(cell: TrainedCell) -> Iterator[Variant]:
    """Yield other divisions of rays into chunks, if the picture depends on them."""
    if not cell.learner.field.pointwise:
        half = max(1, cell.chunk // 2)
        yield Variant(f"{cell.learner.method} with {half} rays a call instead of {cell.chunk}", cell.learner, half)


def narrower(camera: Camera) -> Camera:
    """Return the camera with near and far moved inwards by a share of their distance: other samples, of the same
    geometry.
    """
    inset = INSET * (camera.far - camera.near)
    return replace(camera, near=camera.near + inset, far=camera.far - inset)


def of_size(picture: np.ndarray, height: int, width: int) -> np.ndarray:
    """Resample [h, w, …] → [height, width, …] by the nearest pixels: what would be shown of a picture of another
    size.
    """
    rows = ((np.arange(height) + 0.5) * picture.shape[0] / height).astype(int)
    columns = ((np.arange(width) + 0.5) * picture.shape[1] / width).astype(int)
    return picture[rows][:, columns]


def one_ulp_away(camera: Camera) -> Camera:
    """Return the camera with the x of its place changed by the smallest amount that float64 can hold."""
    pose = camera.camera_to_world.copy()
    pose[0, 3] = np.nextafter(pose[0, 3], np.inf)
    return camera.at(pose)


def _retrained(situation: ServingContext, cell: TrainedCell, learner: Trainer) -> Iterator[Variant]:
    views = situation.views(cell.scene)
    if views is None:
        situation.leave_out(f"more training of {cell.scene.name} was not confused: there are no views to train on")
        return
    settings = learner.settings
    # a refresh would count as empty what it has not measured: a checkpoint has the grid's mask and no densities
    kept = replace(settings, grid=replace(settings.grid, every=NEVER))
    further = copied(learner, kept)
    batches = Batches(cameras_of(views, views.train, learner.device), views.train.rgba)
    steps = situation.sizes.extra_steps
    train(further, batches.stream("serving", settings.rays), at_step(further.step + steps))
    yield Variant(f"{steps} more steps of training", further, cell.chunk)


NEVER = 1 << 60
"""A number of steps that is never reached."""


def copied(learner: Trainer, settings: Any = None) -> Trainer:
    """Return an independent copy of the method in the same state."""
    made = learner_for(
        learner.method,
        learner.box,
        settings or learner.settings,
        learner.budget,
        learner.seed,
        learner.device,
        learner.view_dependent,
    )
    assert isinstance(made, Trainer)
    made.restore({name: value.clone() for name, value in tensors_of(learner).items()}, learner.step)
    return made
