"""Has anything changed? Losses and renders of the first steps, in which rounding has not grown yet.

In double precision rounding stays below 1e-12 for all of them: what differs there differs in meaning. In single
precision, which is what runs use, it doubles from step to step, so that only the first few are compared.
"""

import json
import math
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch

from baselines import fused_network
from baselines.contract import Box
from harness.gate.gates import FACTORS, Gate
from harness.gate.limits import Limit
from harness.gate.outcome import GateContext, Sample
from harness.gate.process import classes_here, forced, in_child
from harness.gate.references import Course, Courses, References
from harness.plan.profiles import PROFILES
from harness.plan.schedule import Budget
from harness.plan.settings import TrainSettings
from harness.studies.drawn_views import write_disc
from harness.training import evaluate
from harness.training.batches import Batches
from harness.training.learner import at_step, steps
from harness.training.lockstep import box_of
from harness.training.trainer import Trainer
from scenes.view_sets.view_set import ViewSet, read_view_set

STEPS = 24
PIXELS_APART = 37
"""The stride of the pixels of a test view that are compared."""
STREAM = "early"


@dataclass(frozen=True)
class Precision:
    """The precision in which the first steps are calculated."""

    dtype: torch.dtype
    steps: int
    """The number of steps that are compared."""
    rendered_after: tuple[int, ...]


PRECISIONS = {
    "double": Precision(torch.float64, STEPS, (4, 12, 24)),
    "single": Precision(torch.float32, 5, (1, 3)),
}


@dataclass(frozen=True)
class Start:
    """A training whose first steps are recorded."""

    method: str
    fine_bins: int = 0
    stirred: bool = False
    """Whether the amplifier is moved away from the values at which it does nothing, and raw densities are of several
    units.
    """


STARTS = {
    "nerf": Start("nerf"),
    "nerf_matched": Start("nerf_matched"),
    "nerf_fine": Start("nerf", fine_bins=16),
    "qnerf": Start("qnerf"),
    "qnerf_stirred": Start("qnerf", stirred=True),
    "qnerf_listing4": Start("qnerf_listing4"),
    "qnerf_repaired": Start("qnerf_repaired"),
}


@dataclass(frozen=True)
class Reordering:
    """Another order of the same sums."""

    threads: int = 1
    block_bytes: int = fused_network.BLOCK_BYTES
    fused: bool = True


REORDERINGS = {
    "two threads": Reordering(threads=2),
    "small blocks": Reordering(block_bytes=1 << 18),
    "single operations": Reordering(fused=False),
}
"""The last one applies to single precision alone: single operations round to it."""


def settings_of(start: Start, fused: bool = True) -> TrainSettings:
    """Return the default profile's settings, with a grid, a warm-up and a clipping that act within the first steps."""
    usual = PROFILES["reduced"].train
    return replace(
        usual,
        precision="float32",
        rays=128,
        warm_up_steps=8,
        clip_norm=0.1,
        clip_ratio=1.5,
        bins=usual.bins // 2 if start.fine_bins else usual.bins,
        fine_bins=start.fine_bins,
        grid=replace(usual.grid, cells=16, first_step=9, every=5),
        accelerations=usual.accelerations if fused else usual.accelerations.without(("fused",)),
    )


def courses(names: tuple[str, ...] = tuple(STARTS), order: Reordering = Reordering()) -> Courses:
    """Return all that is recorded, in this process."""
    torch.set_num_threads(order.threads)
    usual = fused_network.BLOCK_BYTES
    fused_network.BLOCK_BYTES = order.block_bytes
    try:
        with drawn() as views:
            return {
                precision: {
                    name: course(STARTS[name], views, precision, settings_of(STARTS[name], order.fused))
                    for name in names
                }
                for precision in PRECISIONS
                if order.fused or precision == "single"
            }
    finally:
        fused_network.BLOCK_BYTES = usual
        torch.set_num_threads(1)


@contextmanager
def drawn() -> Iterator[ViewSet]:
    """Provide views of a ball that need no renderer, so that no renderer's rounding is in them."""
    with tempfile.TemporaryDirectory() as folder:
        write_disc(Path(folder) / "views", 32, 12, 1, seed=1)
        yield read_view_set(Path(folder) / "views", scratch=Path(folder))


def course(start: Start, views: ViewSet, precision: str, settings: TrainSettings) -> Course:
    """Return the first steps of one training."""
    kind = PRECISIONS[precision]
    usual = torch.get_default_dtype()
    torch.set_default_dtype(kind.dtype)
    try:
        return _course(start, views, kind, settings)
    finally:
        torch.set_default_dtype(usual)


def _course(start: Start, views: ViewSet, kind: Precision, settings: TrainSettings) -> Course:
    cpu = torch.device("cpu")
    train, test = (
        replace(cameras, camera_to_world=cameras.camera_to_world.to(kind.dtype))
        for cameras in (evaluate.cameras_of(views, split, cpu) for split in (views.train, views.test))
    )
    box = box_of(views, cpu)
    box = Box(box.lower.to(kind.dtype), box.upper.to(kind.dtype))
    learner = Trainer(start.method, box, settings, Budget(STEPS, None), STREAM, cpu)
    for field in (learner.coarse, learner.fine):
        if field is not None:
            field.dtype = kind.dtype
    if start.stirred:
        _stir(learner)
    batch_at = Batches(train, views.train.rgba).stream(STREAM, settings.rays)
    looked_at = test.all_rays(0).chosen(torch.arange(0, test.width * test.height, PIXELS_APART))
    losses, renders = [], {}
    for _ in steps(learner, batch_at, at_step(kind.steps)):
        losses.append(float(learner.last_loss or math.nan))
        if learner.step in kind.rendered_after:
            seen = learner.render(looked_at, 2048)
            renders[str(learner.step)] = torch.cat([seen.colour.flatten(), seen.depth]).tolist()
    return Course(losses, renders)


@torch.no_grad()
def _stir(learner: Trainer) -> None:
    amplifier = learner.coarse.amplifier
    amplifier.alpha.fill_(1.2)
    amplifier.beta.fill_(1.3)
    learner.coarse.density_head.weight.mul_(4.0)


def deviation(new: Course, stored: Course) -> tuple[float | None, str]:
    """Return the largest relative difference of a loss or RMS difference of a render, and where; None if they are not
    of the same steps, or one is not finite.
    """
    if len(new.losses) != len(stored.losses) or new.renders.keys() != stored.renders.keys():
        return None, "the stored steps are others"
    found = [
        (abs(ours - theirs) / abs(theirs), f"loss of step {step}")
        for step, (ours, theirs) in enumerate(zip(new.losses, stored.losses, strict=True))
    ]
    for step, theirs in stored.renders.items():
        off = np.asarray(new.renders[step]) - np.asarray(theirs)
        found.append((float(np.sqrt(np.mean(off**2))), f"render after step {step}"))
    if not all(math.isfinite(size) for size, _ in found):
        return None, "a loss or a render is not finite"
    return max(found)


def largest(new: Mapping[str, Course], stored: Mapping[str, Course]) -> float:
    """Return the largest deviation of any start. Raises `ValueError` if one cannot be compared."""
    sizes = [deviation(new[name], stored[name])[0] for name in new]
    if None in sizes:
        raise ValueError("a training of the first steps gave a number that is not finite")
    return max(size for size in sizes if size is not None)


def profile_settings() -> dict[str, Any]:
    """Return what the profiles of the paper's two scales train, score and look at, setting by setting."""
    found: dict[str, Any] = {}

    def walk(name: str, value: Any) -> None:
        if isinstance(value, dict):
            for key, inner in value.items():
                walk(f"{name}.{key}", inner)
        else:
            found[name] = value

    for profile in ("reduced", "full"):
        settings = PROFILES[profile].settings()
        for part in ("budget", "train", "score", "views"):
            walk(f"{profile}.{part}", settings[part])
    return cast("dict[str, Any]", json.loads(json.dumps(found)))


def measure(situation: GateContext, gates: tuple[Gate, ...]) -> dict[str, Sample]:
    """Compute the first steps again and compare them with the stored ones."""
    stored, found = situation.references, {}
    names = {gate.name for gate in gates}
    if "changed.settings" in names:
        now = profile_settings()
        others = [key for key in now.keys() | stored.profiles.keys() if now.get(key) != stored.profiles.get(key)]
        why = ", ".join(f"{key} {stored.profiles.get(key)} → {now.get(key)}" for key in sorted(others))
        found["changed.settings"] = Sample([float(len(others))], why)
    starts = tuple(dict.fromkeys(name.split(".")[2] for name in names if name != "changed.settings"))
    if starts:
        for precision, seen in in_child(courses, starts).items():
            limit = Limit(None, tolerance(precision, stored))
            for start, course in seen.items():
                size, where = deviation(course, stored.courses[precision][start])
                note = "unchanged" if size == 0.0 else where
                found[f"changed.{precision}.{start}"] = Sample([size], where, limit=limit, note=note)
    return {name: sample for name, sample in found.items() if name in names}


def tolerance(precision: str, stored: References) -> float:
    """Return the deviation measured for reordered sums times the factor of `FACTORS`."""
    return FACTORS[precision] * max(stored.reordered[precision].values()) * stored.wider("changed")


def renew(situation: GateContext) -> References:
    """Return the references with new first steps, and with the deviations that other orders of the same sums cause."""
    name = situation.references.name
    usual = in_child(courses)
    reordered: dict[str, dict[str, float]] = {precision: {} for precision in PRECISIONS}

    def compare(order: str, found: Courses) -> None:
        for precision, seen in found.items():
            reordered[precision][order] = float(f"{largest(seen, usual[precision]):.3g}")

    for order, settings in REORDERINGS.items():
        compare(order, in_child(courses, tuple(STARTS), settings))
        situation.show.line(f"changed: sums in another order, {order}")
    for other in {"avx2", "avx512"} & set(classes_here()) - {name}:
        with forced(other):
            compare(f"class {other}", in_child(courses))
    return replace(situation.references, profiles=profile_settings(), courses=usual, reordered=reordered)
