"""Checks of a method in training, on a drawn view set of a disc on white. Each raises `Broken`."""

import json
import math
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import torch

from baselines.contract import NetworkSize
from baselines.methods.explicit import GAUSSIANS, VoxelSettings
from harness.plan.schedule import Budget
from harness.plan.settings import GridSettings, TrainSettings
from harness.records.snapshot import read_unfinished, write_unfinished
from harness.studies.conformance.subject import Broken, Subject
from harness.studies.drawn_views import disc_views
from harness.training.batches import Batches
from harness.training.checkpoints import load_checkpoint, restore_training, save_checkpoint, tensors_of, training_state
from harness.training.learner import Job, Learner, at_step, train, warm_up
from harness.training.lockstep import box_of
from harness.training.make_learner import learner_for
from harness.training.scoring.evaluate import cameras_of
from scenes.view_sets.view_set import ViewSet

CPU = torch.device("cpu")
STREAM = "conformance/0"
STEPS = 60
SHORT = 6
CHUNK = 128
LEAST_GAIN = 0.9
"""The largest share of its initial error on the test view that a method may have after training."""
SETTINGS = TrainSettings(
    network=NetworkSize(depth=6, width=32, colour_layers=2, colour_width=16, position_bands=4, direction_bands=2),
    rays=128,
    bins=16,
    first_bins=12,
    fine_bins=0,
    learning_rate=1e-2,
    last_learning_rate=1e-3,
    warm_up_steps=5,
    grid=GridSettings(cells=12, first_step=20, every=10),
    own={
        "voxels_drjit": VoxelSettings(finest=16, bins=24, smoothed=256),
        # thousands of Gaussians, half opaque at the start, hide each other in pictures of 24 pixels
        "ellipsoids": replace(GAUSSIANS["ellipsoids"][0], first=300, most=500),
    },
)
GRID_IN_USE = SETTINGS.grid.first_step + 2
STOPPED = SETTINGS.grid.first_step // 2
"""The step of the stop: before the grid is in use, and between two refinements of voxels."""


@cache
def drawn() -> tuple[ViewSet, Batches]:
    views = disc_views(24, 8, 1, seed=1)
    return views, Batches(cameras_of(views, views.train, CPU), views.train.rgba)


def fresh(subject: Subject, settings: TrainSettings = SETTINGS) -> Learner:
    views, _ = drawn()
    return learner_for(Job(subject.name, box_of(views, CPU), settings, Budget(STEPS, None), STREAM, CPU, True))


def trained(subject: Subject, steps: int, settings: TrainSettings = SETTINGS, stops: tuple[int, ...] = ()) -> Learner:
    """Train; each of `stops` saves the state and resumes it in another learner. Raises `Diverged`."""
    _, batches = drawn()
    learner = fresh(subject, settings)
    batch_at = batches.for_learner(learner.whole_views, STREAM, settings.rays)
    warm_up(learner, batch_at)
    for stop in stops:
        with tempfile.TemporaryDirectory() as scratch:
            path = Path(scratch) / "cell.safetensors"
            write_unfinished(path, training_state(train(learner, batch_at, at_step(stop))))
            state = read_unfinished(path)
        learner = fresh(subject, settings)
        warm_up(learner, batch_at)
        restore_training(learner, state)
    return train(learner, batch_at, at_step(steps))


def picture(learner: Learner) -> torch.Tensor:
    """Render the test view [pixels, 3]."""
    views, _ = drawn()
    return learner.render(cameras_of(views, views.test, CPU).all_rays(0), CHUNK).colour.detach().cpu()


def error(learner: Learner) -> float:
    views, _ = drawn()
    rgba = np.asarray(views.test.rgba[0], dtype=np.float32)
    truth = torch.from_numpy(rgba[..., :3] * rgba[..., 3:] + 1.0 - rgba[..., 3:]).reshape(-1, 3)
    return float(torch.mean((picture(learner) - truth) ** 2))


def learns(subject: Subject) -> None:
    """A short training lowers the error of a view that was not trained on."""
    before, after = error(fresh(subject)), error(trained(subject, STEPS))
    if not after <= LEAST_GAIN * before:
        raise Broken(f"{STEPS} steps take the mean squared error of a test view from {before:.4g} to {after:.4g}")


def learns_the_same_again(subject: Subject) -> None:
    """The same seed gives bit-identical weights in any state of torch's global generator."""
    states = []
    for seed in (1, 2):
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            states.append(tensors_of(trained(subject, SHORT)))
    _are_equal(states[0], states[1], f"after the same {SHORT} steps")


def _are_equal(first: dict[str, torch.Tensor], second: dict[str, torch.Tensor], when: str) -> None:
    for name, value in first.items():
        if not torch.equal(value, second[name]):
            raise Broken(f"{name} differs {when}")


def comes_back_from_its_checkpoint(subject: Subject) -> None:
    """A restored checkpoint renders a bit-identical picture: the file holds everything that training changed."""
    learner = trained(subject, 2 * GRID_IN_USE)
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "cell.safetensors"
        save_checkpoint(learner, path)
        other = fresh(subject)
        load_checkpoint(other, path, learner.step)
    change = float((picture(learner) - picture(other)).abs().max())
    if change != 0.0:
        raise Broken(f"the restored field renders another picture, by up to {change:.3g}")


def goes_on_in_the_middle(subject: Subject) -> None:
    """A cell that was stopped twice and resumed ends bit-identical to one that was not stopped."""
    last = GRID_IN_USE + SETTINGS.grid.every
    unbroken, resumed = trained(subject, last), trained(subject, last, stops=(STOPPED, GRID_IN_USE))
    _are_equal(tensors_of(resumed), tensors_of(unbroken), "after it was resumed")


def trains_with_two_passes(subject: Subject) -> None:
    """A coarse and a fine field, as in the original, can be trained and have separate weights."""
    learner = trained(subject, 2, replace(SETTINGS, fine_bins=8))
    names = list(tensors_of(learner))
    for kind in ("coarse", "fine"):
        if not any(name.startswith(f"{kind}.") for name in names):
            raise Broken(f"there is no weight of the {kind} field")
    if not bool(torch.isfinite(picture(learner)).all()):
        raise Broken("a picture of two passes is not finite")


def can_be_recorded(subject: Subject) -> None:
    """`rendered_by()` is JSON, the scalars of the amplifier are finite, and `parameter_counts()` are integers."""
    learner = trained(subject, 1)
    try:
        json.dumps(learner.rendered_by(), allow_nan=False)
    except (TypeError, ValueError) as wrong:
        raise Broken(f"rendered_by() is not JSON: {wrong}") from wrong
    for name, value in learner.amplifier_scalars().items():
        if value is not None and not math.isfinite(value):
            raise Broken(f"{name} is {value}")
    counts = learner.field.parameter_counts()
    if not all(type(value) is int for value in counts.values()) or counts.get("total", 0) < 1:
        raise Broken(f"parameter_counts() is {counts}")
