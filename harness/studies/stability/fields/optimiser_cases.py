"""O1 and O2: what half precision does to weights and optimiser, and what one spike of the gradient costs."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import torch
from torch import Tensor

from baselines.contract import Precision
from baselines.numerics.amplifier import amplify_about_mean, softplus_density
from baselines.numerics.encoding import encode
from baselines.numerics.quadrature import QUADRATURES
from harness.plan.schedule import Budget
from harness.plan.settings import TrainSettings
from harness.records.study import Check, Owner, Series, Table, check
from harness.studies.stability.fields.small_training import (
    CPU,
    STREAM,
    new_trainer,
    not_made_of_parts,
    setup,
    train,
    trained,
)
from harness.studies.stability.stability_context import Finding, StabilityContext
from harness.training.learner import Clipping
from harness.training.lockstep import box_of, needs_view_direction
from harness.training.make_learner import NotAvailable, drjit_backend, learner_for
from harness.training.trainer import Diverged, Trainer


def losses_of_voxels(situation: StabilityContext, at: int, factor: float) -> list[float]:
    """Return the losses of `voxels_drjit`, whose gradient is `factor` times as large at step `at`; 1 is no spike.

    Raises `harness.training.learner.NotAvailable` if Dr.Jit does not work.
    """
    here = setup(situation)
    budget, directions = Budget(here.steps, None), needs_view_direction(here.views)
    drjit_backend(CPU)  # which finds the library that drjit loads
    import drjit as dr

    threads = dr.thread_count()
    try:
        # its trainer takes one thread for the whole process
        learner: Any = learner_for(
            "voxels_drjit", box_of(here.views, CPU), here.settings, budget, STREAM, CPU, directions
        )
        slope = learner._slope

        def spiked(*batch: Any) -> Any:
            found = slope(*batch)
            if learner.step != at or factor == 1.0:
                return found
            larger = {name: values * factor for name, values in found.gradients.items()}
            return replace(found, norm=found.norm * factor, gradients=larger)

        learner._slope = spiked
        losses = []
        for _ in range(here.steps):
            learner.train_on(*here.batches.batch(STREAM, learner.step, here.settings.rays))
            losses.append(learner.last_loss)
        return losses
    finally:
        dr.set_thread_count(threads)


REDUCED: tuple[Precision, ...] = ("bfloat16", "float16")
HALF = {"bfloat16": torch.bfloat16, "float16": torch.float16}
METHOD = "nerf"


# O1


def half_precision(situation: StabilityContext) -> Iterator[Finding]:
    """O1: weights that are kept in half precision, against float32 weights whose matrix multiplications alone are
    reduced.
    """
    rows: list[list[str | float | None]] = []
    for name, dtype in {"float32": torch.float32, **HALF}.items():
        for gradient in (0.0, 1e-5, 1e-4):
            rows.append([name, f"{gradient:g}", *_moved(dtype, gradient)])
    yield Table("adam", 7, "A weight of 1 after 100 steps of Adam at a rate of 5e-4 and one gradient: distance moved",
                ["weights", "gradient", "moved, ε = 1e-8", "moved, ε = 1e-4"], rows)  # fmt: skip
    due = 100 * 5e-4
    for name, dtype in {"float32": torch.float32, **HALF}.items():
        moved = _moved(dtype, 1e-4)[0]
        yield check(
            "relative error of the distance that a weight moves in 100 steps",
            abs(moved / due - 1.0) if isinstance(moved, float) else math.nan,
            high=0.01,
            why=moved if isinstance(moved, str) else "",
            subject=f"weights in {name}",
            owner="ours" if name == "float32" else "usual",
        )
    for name in REDUCED:
        accepted = [part for part, refused in refused_by_parts(HALF[name]).items() if not refused]
        wrong = not_float32(situation, name)
        yield check(
            "weights, moments, gradients and parts that are not kept in float32",
            len(accepted) + len(wrong),
            high=0,
            why=", ".join(accepted + wrong),
            subject=f"products in {name}",
        )
    steps = 4 if situation.quick else 40
    reference = _mean(train(situation, new_trainer(situation, METHOD), steps).losses[-10:])
    for name in REDUCED:
        settings = replace(setup(situation).settings, precision=name)
        losses = train(situation, new_trainer(situation, METHOD, settings), steps).losses
        yield check(
            f"relative difference of the loss of float32 after {steps} steps",
            abs(_mean(losses[-10:]) / reference - 1.0),
            high=0.05,
            subject=f"training in {name}",
        )


def _mean(values: list[float]) -> float:
    return sum(values) / len(values)


def _moved(dtype: torch.dtype, gradient: float) -> tuple[float | str, float | str]:
    """Return how far 100 steps of Adam move a weight of 1 whose gradient never changes, for ε = 1e-8 and 1e-4."""
    found: list[float | str] = []
    for epsilon in (1e-8, 1e-4):
        weight = torch.ones(1, dtype=dtype, requires_grad=True)
        optimiser = torch.optim.Adam([weight], lr=5e-4, eps=epsilon)
        for _ in range(100):
            weight.grad = torch.full((1,), gradient, dtype=dtype)
            optimiser.step()
        moved = 1.0 - float(weight.detach())
        found.append(moved if math.isfinite(moved) else f"the weight is {float(weight.detach())}")
    return found[0], found[1]


def refused_by_parts(dtype: torch.dtype) -> dict[str, bool]:
    """Return whether encoding, amplifier and quadrature refuse to work in a dtype."""
    values = torch.full((2, 3), 0.5, dtype=dtype)
    edges = torch.linspace(0.0, 1.0, 4, dtype=dtype).expand(2, 4)
    one = torch.ones((), dtype=dtype)
    parts = {
        "encoding": lambda: encode(values, 2.0, 4),
        "density": lambda: softplus_density(values, 0.0),
        "amplifier": lambda: amplify_about_mean(values, one, one),
        "quadrature": lambda: QUADRATURES["midpoint"](values, 0.5 * (edges[:, 1:] + edges[:, :-1]), edges),
    }
    refused = {}
    for name, use in parts.items():
        try:
            use()
            refused[name] = False
        except TypeError:
            refused[name] = True
    return refused


def not_float32(situation: StabilityContext, precision: Precision) -> list[str]:
    """Return the weights, gradients and moments of a trainer of that precision, two steps on, that are not float32."""
    trainer = new_trainer(situation, "qnerf", replace(setup(situation).settings, precision=precision))
    seen: dict[str, Tensor] = {}

    def note(*_: object) -> None:
        for name, weight in trainer.fields.named_parameters():
            seen[f"weight {name}"] = weight
            if weight.grad is not None:
                seen[f"gradient {name}"] = weight.grad
            for key, value in trainer.optimiser.state.get(weight, {}).items():
                seen[f"{key} {name}"] = value

    trainer.optimiser.register_step_post_hook(note)
    train(situation, trainer, 2)
    return [name for name, value in seen.items() if value.dtype != torch.float32]


# O2

FACTORS = (1e6, 1e9)
CLIPPING: dict[str, Callable[[TrainSettings], TrainSettings]] = {
    "as here": lambda settings: settings,
    "clipped to a norm of 1 alone": lambda settings: replace(settings, clip_norm=1.0, clip_ratio=math.inf),
    "not clipped": lambda settings: replace(settings, clip_norm=math.inf, clip_ratio=math.inf),
}
"""The changes to the settings of every run."""
SMOOTHED = 20
OTHERS = ("qnerf", "voxels_drjit")
RECOVERY = 200
"""The steps after which a spike must no longer be seen."""
BAR = 0.10


def spike(situation: StabilityContext) -> Iterator[Finding]:
    """O2: one gradient × 1e6 and × 1e9, with the clipping of every run and with less; a gradient that is NaN."""
    at = setup(situation).steps // 4
    base = trained(situation, METHOD).losses
    yield _line("no spike", base)
    for factor in FACTORS:
        for clipping in CLIPPING:
            name, run = f"× {factor:g}, {clipping}", _spiked(situation, METHOD, at, factor, clipping)
            yield _line(name, run.losses)
            yield _recovered(name, "ours" if clipping == "as here" else "usual", run.losses, base, at)
            if clipping == "as here":
                yield _norms(f"{name}: before clipping", [norm for norm, _ in run.norms], at)
            yield _norms(f"{name}: after clipping", [kept for _, kept in run.norms], at)
    yield from _other_methods(situation, at)
    yield _nan_gradient(situation)
    again = train(situation, new_trainer(situation, METHOD)).losses
    yield check(
        "steps whose loss differs in any bit when a cell is trained again",
        sum(one != other for one, other in zip(base, again, strict=True)),
        high=0,
        why="a cell that cannot go on where it was kept is trained again from its start, to the same result",
        subject="trained again",
    )


def _other_methods(situation: StabilityContext, at: int) -> Iterator[Check]:
    """Yield the larger spike alone, with the clipping of every run."""
    for method in OTHERS:
        if method not in situation.methods:
            continue
        name = f"{method}, × {FACTORS[-1]:g}, as here"
        if not_made_of_parts(method):
            yield _voxels(situation, name, at)
            continue
        run = _spiked(situation, method, at, FACTORS[-1], "as here")
        # what clipping makes of a spike is ours, whosever the method
        yield _recovered(name, "ours", run.losses, trained(situation, method).losses, at)


def _voxels(situation: StabilityContext, name: str, at: int) -> Check:
    try:
        base, spiked = (losses_of_voxels(situation, at, factor) for factor in (1.0, FACTORS[-1]))
    except NotAvailable as error:
        return Check("", None, why=str(error), subject=name, status="not_available")
    return _recovered(name, "ours", spiked, base, at)


def _recovered(name: str, theirs: Owner, losses: list[float], base: list[float], at: int) -> Check:
    back = slice(min(at + RECOVERY, len(base)) - SMOOTHED, at + RECOVERY)
    late = _mean(losses[back]) / _mean(base[back]) - 1.0
    frozen = steps_until_back(losses, base, at)
    return check(
        f"loss above that of the run without a spike, {RECOVERY} steps later (mean of {SMOOTHED})",
        max(late, 0.0),
        high=BAR,
        why=f"back within {BAR:.0%} after {frozen} steps" if frozen is not None else "not back in this run",
        subject=name,
        owner=theirs,
    )


class NotedClipping(Clipping):
    """Clipping that records the norm of each gradient before and after it."""

    def __init__(self, norm: float, ratio: float) -> None:
        super().__init__(norm, ratio)
        self.norms: list[tuple[float, float]] = []

    def scale(self, norm: float) -> float:
        kept = super().scale(norm)
        self.norms.append((norm, kept * norm))
        return kept


@dataclass(frozen=True)
class Spiked:
    """A training with one large gradient."""

    losses: list[float]
    norms: list[tuple[float, float]]
    """The norms of the gradient of each step, before and after clipping."""


@cache
def _spiked(situation: StabilityContext, method: str, at: int, factor: float, clipping: str) -> Spiked:
    """Return a training whose gradient is `factor` times as large at step `at`."""
    settings = CLIPPING[clipping](setup(situation).settings)
    trainer = new_trainer(situation, method, settings)
    noted = NotedClipping(settings.clip_norm, settings.clip_ratio)
    trainer.clipping = noted
    for weight in trainer.fields.parameters():
        weight.register_hook(lambda gradient: gradient * factor if trainer.step == at else gradient)
    return Spiked(train(situation, trainer).losses, noted.norms)


def _norms(name: str, norms: list[float], at: int) -> Series:
    """Return a few steps before the spike, and the steps until one of its size would have left a running mean."""
    part = slice(max(0, at - SMOOTHED), at + 2 * SMOOTHED)
    y: list[float | None] = [norm if norm > 0.0 else None for norm in norms[part]]
    return Series("Norm of the gradient around a spike", 11, name, "step", "norm of the gradient",
                  [float(step) for step in range(1, len(norms) + 1)][part], y, log_x=False)  # fmt: skip


def smoothed(losses: list[float]) -> list[float]:
    """Return the mean of each `SMOOTHED` batches, at the place of the last of them; shorter ones at the start."""
    sums = [0.0]
    for loss in losses:
        sums.append(sums[-1] + loss)
    return [(sums[i] - sums[max(0, i - SMOOTHED)]) / min(i, SMOOTHED) for i in range(1, len(sums))]


def steps_until_back(losses: list[float], base: list[float], at: int) -> int | None:
    """Return the steps after `at` from which the smoothed loss stays within `BAR` above the other's; None if it never
    does.
    """
    above = [one > (1.0 + BAR) * other for one, other in zip(smoothed(losses), smoothed(base), strict=True)]
    last = max((step for step in range(at, len(above)) if above[step]), default=at - 1)
    return None if last == len(above) - 1 else last + 1 - at


def _line(name: str, losses: list[float]) -> Series:
    y = smoothed(losses)
    return Series("Training loss after a spike of the gradient", 11, name, "step", f"loss, mean of {SMOOTHED} batches",
                  [float(step) for step in range(1, len(y) + 1)], y, log_x=False)  # fmt: skip


def _nan_gradient(situation: StabilityContext) -> Check:
    """Check that step and tensor are named, and that the weights are those before the step."""
    trainer = new_trainer(situation, METHOD)
    train(situation, trainer, 3)
    before = [weight.detach().clone() for weight in trainer.fields.parameters()]
    trainer.coarse.density_head.weight.register_hook(lambda gradient: gradient * math.nan)
    wanted = "not finite at step 3: gradient of coarse.density_head.weight"
    said = _what_diverged(situation, trainer)
    untouched = all(torch.equal(one, two) for one, two in zip(before, trainer.fields.parameters(), strict=True))
    return check(
        "mistakes of two: step and tensor not named, weights not those before the step",
        float(said != wanted) + float(not untouched),
        high=0,
        why=said or "went on",
        subject="NaN gradient",
    )


def _what_diverged(situation: StabilityContext, trainer: Trainer) -> str | None:
    try:
        train(situation, trainer, 1)
    except Diverged as error:
        return str(error)
    return None
