"""Has anything changed? Losses and renders of the first steps, before rounding errors grow.

In double precision rounding stays below 1e-10 on every processor, so that any difference is a change of the program. In
single precision, which runs use, rounding doubles from step to step, so that only the first few steps are compared.
"""

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch
from msgspec import structs

from harness.gate.gate_context import GateContext, complete
from harness.gate.gates import STARTS, TOLERANCES, Gate, Start, gates
from harness.gate.limits import NONE_DIFFERS, Limit, judge
from harness.gate.references import Course, Courses, References
from harness.plan.profiles import PROFILES
from harness.plan.schedule import Budget
from harness.plan.settings import TrainSettings
from harness.records.json_record import flat
from harness.records.study import Check
from harness.studies.drawn_views import disc_views
from harness.training.batches import Batches
from harness.training.learner import Job, at_step, steps
from harness.training.lockstep import box_of
from harness.training.scoring import evaluate
from harness.training.trainer import Trainer
from scenes.view_sets.view_set import ViewSet

STEPS = 24
PIXELS_APART = 37
STREAM = "early"
SETTINGS = "changed.settings"


@dataclass(frozen=True)
class Precision:
    dtype: torch.dtype
    steps: int
    rendered_after: tuple[int, ...]


PRECISIONS = {
    "double": Precision(torch.float64, STEPS, (4, 12, 24)),
    "single": Precision(torch.float32, 5, (1, 3)),
}


def _answer(checks: dict[str, Check]) -> str:
    failed = [name for name, check in checks.items() if check.is_broken]
    return "Has anything changed? " + (f"yes: {', '.join(failed)}" if failed else "no more than the order of sums")


@complete("changed", _answer)
def measure(context: GateContext) -> Iterator[Check]:
    chosen, stored = context.of_kind("changed"), context.references
    if SETTINGS in chosen:
        now = profile_settings()
        changed = sorted(key for key in now.keys() | stored.profiles.keys() if now.get(key) != stored.profiles.get(key))
        why = ", ".join(f"{key} {stored.profiles.get(key)} → {now.get(key)}" for key in changed)
        yield judge(chosen[SETTINGS], [len(changed)], NONE_DIFFERS, why)
    for gate, size, where in _deviations(context) if chosen.keys() - {SETTINGS} else ():
        if gate.name in chosen:
            yield judge(gate, [size], _limit(gate), where)


def broken(context: GateContext) -> list[str]:
    """Return the failing gates of the first steps, whether they are chosen or not."""
    return [gate.name for gate, size, _ in _deviations(context) if judge(gate, [size], _limit(gate)).is_broken]


def _limit(gate: Gate) -> Limit:
    return Limit(None, TOLERANCES[gate.name.split(".")[1]])


def _deviations(context: GateContext) -> Iterator[tuple[Gate, float | None, str]]:
    here, stored = context.first_steps(), context.references.courses
    for gate in gates():
        match gate.name.split("."):
            case ["changed", precision, start]:
                before = stored.get(precision, {}).get(start, Course([math.nan], {}))
                size, where = deviation(here[precision][start], before)
                yield gate, size, "unchanged" if size == 0.0 else where


def renew(context: GateContext) -> References:
    return structs.replace(context.references, profiles=profile_settings(), courses=context.first_steps())


def courses(names: tuple[str, ...] = tuple(STARTS)) -> Courses:
    views = disc_views(32, 12, 1, seed=1)  # made without a renderer, whose rounding would count
    dtype = torch.get_default_dtype()
    results: Courses = {}
    try:
        for precision, kind in PRECISIONS.items():
            torch.set_default_dtype(kind.dtype)
            results[precision] = {name: _first_steps(STARTS[name], views, kind) for name in names}
    finally:
        torch.set_default_dtype(dtype)
    return results


def settings_of_start(start: Start) -> TrainSettings:
    """Return settings with which grid, warm-up, both kinds of clipping and a density take effect in the first steps."""
    usual = PROFILES["reduced"].train
    return replace(
        usual,
        precision="float32",
        rays=128,
        warm_up_steps=8,
        learning_rate=2e-2,
        clip_norm=0.2,
        clip_ratio=1.5,
        bins=usual.bins // 2 if start.fine_bins else usual.bins,
        fine_bins=start.fine_bins,
        grid=replace(usual.grid, cells=16, first_step=9, every=5),
    )


def _first_steps(start: Start, views: ViewSet, kind: Precision) -> Course:
    settings, cpu = settings_of_start(start), torch.device("cpu")
    train, test = (
        replace(cameras, camera_to_world=cameras.camera_to_world.to(kind.dtype))
        for cameras in (evaluate.cameras_of(views, split, cpu) for split in (views.train, views.test))
    )
    box = box_of(views, cpu)
    box = replace(box, lower=box.lower.to(kind.dtype), upper=box.upper.to(kind.dtype))
    learner = Trainer(Job(start.method, box, settings, Budget(STEPS, None), STREAM, cpu))
    for field in (learner.coarse, learner.fine):
        if field is not None:
            field.dtype = kind.dtype
    if start.stirred:
        with torch.no_grad():
            learner.coarse.amplifier.alpha.fill_(1.2)
            learner.coarse.amplifier.beta.fill_(1.3)
            learner.coarse.density_head.weight.mul_(4.0)
    batches = Batches(train, views.train.rgba, settings.covered_share, settings.contrast_weight)
    batch_at = batches.stream(STREAM, settings.rays)
    compared = test.all_rays(0).chosen(torch.arange(0, test.width * test.height, PIXELS_APART))
    losses, renders = [], {}
    for _ in steps(learner, batch_at, at_step(kind.steps)):
        losses.append(float(learner.last_loss or math.nan))
        if learner.step in kind.rendered_after:
            with learner.averaged():
                image = learner.render(compared, 2048)
            renders[str(learner.step)] = torch.cat([image.colour.flatten(), image.depth]).tolist()
    return Course(losses, renders)


def deviation(new: Course, stored: Course) -> tuple[float | None, str]:
    """Return the largest difference, relative of a loss or RMS of a render, and its place; or None and the reason."""
    if len(new.losses) != len(stored.losses) or new.renders.keys() != stored.renders.keys():
        return None, "the stored steps differ from these"
    sizes = [
        (abs(after - before) / abs(before), f"loss of step {step}")
        for step, (after, before) in enumerate(zip(new.losses, stored.losses, strict=True))
    ]
    for name, before in stored.renders.items():
        difference = np.asarray(new.renders[name]) - np.asarray(before)
        sizes.append((float(np.sqrt(np.mean(difference**2))), f"render after step {name}"))
    if not all(math.isfinite(size) for size, _ in sizes):
        return None, "a loss or a render is not finite"
    return max(sizes)


def profile_settings() -> dict[str, object]:
    """Return the settings of budget, training, scores and views of the profiles `reduced` and `full`, one by one."""
    parts = {name: PROFILES[name].settings() for name in ("reduced", "full")}
    asked = {name: {part: of[part] for part in ("budget", "train", "score", "views")} for name, of in parts.items()}
    as_stored: dict[str, object] = json.loads(json.dumps(dict(flat(asked))))
    return as_stored
