"""O1, O2 and O4: half precision of weights and optimiser, a spike of the gradient, badly conditioned matrices."""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import accumulate
from typing import Any

import torch
from torch import Tensor, nn

from baselines.contract import DTYPES, Precision
from baselines.numerics.amplifier import amplify_about_mean, softplus_density
from baselines.numerics.encoding import encode
from baselines.numerics.optimisers import OPTIMISERS, Optimiser, OptimiserName, optimiser_of
from baselines.numerics.quadrature import QUADRATURES
from harness.plan.profiles import TUNED
from harness.plan.schedule import Budget, learning_rate
from harness.plan.seeds import generator_for
from harness.records.study import Check, Owner, Series, Table, check
from harness.studies.framework import Found, Rows
from harness.studies.stability.fields.small_training import CPU, STREAM, new_trainer, setup, train, trained
from harness.studies.stability.stability_context import StabilityContext, error_of, none_of, not_judged, worst_of
from harness.training.learner import Job, steps
from harness.training.lockstep import box_of, needs_view_direction
from harness.training.make_learner import NotAvailable, drjit_backend, learner_for
from harness.training.trainer import Diverged

HALF: tuple[Precision, ...] = ("bfloat16", "float16")
METHOD = "nerf"


def half_precision(context: StabilityContext) -> Iterator[Found]:
    rows: Rows = [[name, f"{gradient:g}", *(_moved(dtype, gradient, epsilon) for epsilon in (1e-8, 1e-4))]
                  for name, dtype in DTYPES.items() for gradient in (0.0, 1e-5, 1e-4)]  # fmt: skip
    title = "A weight of 1 after 100 steps of Adam at a rate of 5e-4 and one gradient: distance moved"
    yield Table("adam", 7, title, ["weights", "gradient", "moved, ε = 1e-8", "moved, ε = 1e-4"], rows)
    due = 100 * 5e-4
    owners: dict[str, Owner] = {"float32": "ours"}
    for name, dtype in DTYPES.items():
        moved = _moved(dtype, 1e-4)
        error, why = (abs(moved / due - 1.0), "") if isinstance(moved, float) else (math.nan, moved)
        what, owner = "relative error of the distance that a weight moves in 100 steps", owners.get(name, "usual")
        yield check(what, error, high=0.01, why=why, subject=f"weights in {name}", owner=owner)
    for half in HALF:
        reduced = accepted_by_parts(DTYPES[half]) + not_float32(context, half)
        what = "weights, moments, gradients and parts that are not kept in float32"
        yield none_of(what, reduced, f"matrix multiplications in {half}")
    count = 4 if context.quick else 40
    reference = _mean(train(context, new_trainer(context, METHOD), count).losses[-10:])
    for half in HALF:
        settings = replace(setup(context).settings, precision=half)
        losses = train(context, new_trainer(context, METHOD, settings), count).losses
        difference = abs(_mean(losses[-10:]) / reference - 1.0)
        what = f"relative difference of the loss of float32 after {count} steps"
        yield check(what, difference, high=0.05, subject=f"training in {half}")


def _mean(values: list[float]) -> float:
    return sum(values) / len(values)


def _moved(dtype: torch.dtype, gradient: float, epsilon: float = 1e-8) -> float | str:
    weight = torch.ones(1, dtype=dtype, requires_grad=True)
    optimiser = torch.optim.Adam([weight], lr=5e-4, eps=epsilon)
    for _ in range(100):
        weight.grad = torch.full((1,), gradient, dtype=dtype)
        optimiser.step()
    moved = 1.0 - float(weight.detach())
    return moved if math.isfinite(moved) else f"the weight is {float(weight.detach())}"


def accepted_by_parts(dtype: torch.dtype) -> list[str]:
    values = torch.full((2, 3), 0.5, dtype=dtype)
    edges = torch.linspace(0.0, 1.0, 4, dtype=dtype).expand(2, 4)
    unit = torch.ones((), dtype=dtype)
    parts = {
        "encoding": lambda: encode(values, 2.0, 4),
        "density": lambda: softplus_density(values, 0.0),
        "amplifier": lambda: amplify_about_mean(values, unit, unit),
        "quadrature": lambda: QUADRATURES["midpoint"](values, 0.5 * (edges[:, 1:] + edges[:, :-1]), edges),
    }
    return [name for name, use in parts.items() if error_of(TypeError, use) is None]


def not_float32(context: StabilityContext, precision: Precision) -> list[str]:
    trainer = new_trainer(context, "qnerf", replace(setup(context).settings, precision=precision))
    seen: dict[str, Tensor] = {}
    take_step = trainer.optimiser.step

    def noting(rate: float | Tensor) -> None:
        take_step(rate)
        for name, weight in trainer.fields.named_parameters():
            seen[f"weight {name}"] = weight
            if weight.grad is not None:
                seen[f"gradient {name}"] = weight.grad

    trainer.optimiser.step = noting  # type: ignore[method-assign]
    train(context, trainer, 2)
    seen |= {f"state {name}": value for name, value in trainer.optimiser.tensors().items()}
    return [name for name, value in seen.items() if value.is_floating_point() and value.dtype != torch.float32]


FACTORS = (1e6, 1e9)
CLIPPING: dict[str, dict[str, float]] = {
    "as here": {},
    "clipped to a norm of 1 only": {"clip_norm": 1.0, "clip_ratio": math.inf},
    "not clipped": {"clip_norm": math.inf, "clip_ratio": math.inf},
}
SMOOTHED = 20
RECOVERY = 200
"""The steps after which a spike must no longer have an effect."""
BAR = 0.10


def spike(context: StabilityContext) -> Iterator[Found]:
    at = setup(context).steps // 4
    base = trained(context, METHOD).losses
    yield _line("no spike", base)
    for factor in FACTORS:
        for clipping in CLIPPING:
            name, losses = f"× {factor:g}, {clipping}", spiked(context, METHOD, at, factor, clipping)
            yield _line(name, losses)
            yield _recovered(name, losses, base, at, "ours" if clipping == "as here" else "usual")
    # only the larger spike; clipping belongs to this harness, for every method
    largest = FACTORS[-1]
    if "qnerf" in context.methods:
        losses = spiked(context, "qnerf", at, largest, "as here")
        yield _recovered(f"qnerf, × {largest:g}, as here", losses, trained(context, "qnerf").losses, at)
    if "voxels_drjit" in context.methods:
        name = f"voxels_drjit, × {largest:g}, as here"
        try:
            plain, losses = (losses_of_voxels(context, at, factor) for factor in (1.0, largest))
            yield _recovered(name, losses, plain, at)
        except NotAvailable as error:
            yield not_judged(name, str(error), "not_available")
    yield _nan_gradient(context)
    again = train(context, new_trainer(context, METHOD)).losses
    what = "steps whose loss differs in any bit when a cell is trained again"
    why = "a cell that cannot be resumed from its snapshot is trained again from the start, to the same result"
    count = sum(a != b for a, b in zip(base, again, strict=True))
    yield check(what, count, high=0, why=why, subject="trained again")


def losses_of_voxels(context: StabilityContext, at: int, factor: float) -> list[float]:
    """Return the losses of `voxels_drjit`, its gradient at step `at` times `factor`. Raises `NotAvailable`."""
    here = setup(context)
    box, directions = box_of(here.views, CPU), needs_view_direction(here.views)
    drjit_backend(CPU)  # finds the LLVM library before drjit is imported
    import drjit as dr

    threads = dr.thread_count()
    try:
        # the trainer sets one thread for the whole process
        budget = Budget(here.steps, None)
        learner: Any = learner_for(Job("voxels_drjit", box, here.settings, budget, STREAM, CPU, directions))
        slope = learner._slope

        def spiked(*batch: Any) -> Any:
            loss, norm, gradients, points = slope(*batch)
            if learner.step != at or factor == 1.0:
                return loss, norm, gradients, points
            return loss, norm * factor, {name: values * factor for name, values in gradients.items()}, points

        learner._slope = spiked
        return [at_step.last_loss for at_step in steps(learner, here.batches.stream(STREAM, here.settings.rays))]
    finally:
        dr.set_thread_count(threads)


def _recovered(name: str, losses: list[float], base: list[float], at: int, owner: Owner = "ours") -> Check:
    back = slice(min(at + RECOVERY, len(base)) - SMOOTHED, at + RECOVERY)
    late = _mean(losses[back]) / _mean(base[back]) - 1.0
    frozen = steps_until_back(losses, base, at)
    what = f"loss above that of the run without a spike, {RECOVERY} steps later (mean of {SMOOTHED})"
    why = f"back within {BAR:.0%} after {frozen} steps" if frozen is not None else "not back in this run"
    return check(what, max(late, 0.0), high=BAR, why=why, subject=name, owner=owner)


def spiked(context: StabilityContext, method: str, at: int, factor: float, clipping: str) -> list[float]:
    settings = replace(setup(context).settings, **CLIPPING[clipping])  # type: ignore[arg-type]
    trainer = new_trainer(context, method, settings)
    for weight in trainer.fields.parameters():
        weight.register_hook(lambda gradient: gradient * factor if trainer.step == at else gradient)
    return train(context, trainer).losses


def smoothed(losses: list[float]) -> list[float]:
    """Return the running mean over the last `SMOOTHED` batches; over fewer at the start."""
    sums = [0.0, *accumulate(losses)]
    return [(sums[i] - sums[max(0, i - SMOOTHED)]) / min(i, SMOOTHED) for i in range(1, len(sums))]


def steps_until_back(losses: list[float], base: list[float], at: int) -> int | None:
    """Return the number of steps after `at` until the smoothed loss stays within `BAR`; None if it never does."""
    above = [loss > (1.0 + BAR) * plain for loss, plain in zip(smoothed(losses), smoothed(base), strict=True)]
    last = max((step for step in range(at, len(above)) if above[step]), default=at - 1)
    return None if last == len(above) - 1 else last + 1 - at


def _line(name: str, losses: list[float]) -> Series:
    panel, label = "Training loss after a spike of the gradient", f"loss, mean of {SMOOTHED} batches"
    x = [float(step) for step in range(1, len(losses) + 1)]
    return Series(panel, 11, name, "step", label, x, smoothed(losses), log_x=False)


def _nan_gradient(context: StabilityContext) -> Check:
    trainer = new_trainer(context, METHOD)
    train(context, trainer, 3)
    before = [weight.detach().clone() for weight in trainer.fields.parameters()]
    trainer.coarse.density_head.weight.register_hook(lambda gradient: gradient * math.nan)
    message = str(error_of(Diverged, train, context, trainer, 1) or "")
    misnamed = message != "not finite at step 3: gradient of coarse.density_head.weight"
    untouched = all(torch.equal(a, b) for a, b in zip(before, trainer.fields.parameters(), strict=True))
    what = "mistakes of two: step and tensor not named, weights not those before the step"
    count = float(misnamed) + float(not untouched)
    return check(what, count, high=0, why=message or "training continued", subject="NaN gradient")


SIDE, CONDITIONED_STEPS = 32, 400
LEAST = 1e-10
"""The share of the first loss below which float32 cannot resolve it."""
CONDITIONS = (1e1, 1e3, 1e6)
"""The ratio of largest to smallest curvature along either side of the matrix."""


def conditioned(context: StabilityContext) -> Iterator[Found]:
    """Minimise ½ ⟨W − W*, A (W − W*) B⟩ by every optimiser, where A and B are symmetric with random axes."""
    count = 60 if context.quick else CONDITIONED_STEPS
    rows: Rows = []
    for condition in CONDITIONS:
        first, _ = descended("adam", condition, 0, torch.float64)
        for name in OPTIMISERS:
            (single, optimiser), (double, _) = (
                descended(name, condition, count, dtype) for dtype in (torch.float32, torch.float64)
            )
            rows.append([f"{condition:g}", name, single, double])
            subject = f"{name}, condition {condition:g}"
            what = f"relative difference of the loss of float64 after {count} steps"
            # in float32 a weight close to its target is wrong in its last digit
            yield check(what, abs(single - double) / max(double, LEAST * first), high=0.25, subject=subject)
            if bases := [value for key, value in optimiser.tensors().items() if key.endswith("_basis")]:
                what = "largest entry of QᵀQ − 1 of a basis"
                yield check(what, worst_of(map(off_orthogonal, bases)), high=1e-5, subject=f"{subject}, bases")
    title = f"The loss after {count} steps at the rates of short runs"
    yield Table("conditioned", 8, title, ["condition of a side", "optimiser", "float32", "float64"], rows)


def descended(name: OptimiserName, condition: float, count: int, dtype: torch.dtype) -> tuple[float, Optimiser]:
    """Return the loss after `count` steps from 0, computed in float64, and the optimiser."""
    curvature = torch.logspace(0.0, -math.log10(condition), SIDE, dtype=torch.float64)
    left, right, target = (_rotation(number) for number in range(3))
    a, b = ((axes * curvature) @ axes.mT for axes in (left, right))
    weight, bias = nn.Parameter(torch.zeros(SIDE, SIDE, dtype=dtype)), nn.Parameter(torch.zeros(1, dtype=dtype))
    bias.grad = torch.zeros_like(bias)
    settings = TUNED[name]
    optimiser = optimiser_of([weight, bias], settings["optimiser"])
    for step in range(count):
        weight.grad = (a @ (weight.detach().double() - target) @ b).to(dtype)
        first, last = settings["learning_rate"], settings["last_learning_rate"]
        optimiser.step(learning_rate(step / count, step, first, last, 0, settings["decay"]))
    off = weight.detach().double() - target
    return 0.5 * float((off * (a @ off @ b)).sum()), optimiser


def off_orthogonal(bases: Tensor) -> float:
    """Return the largest entry of QᵀQ − 1 over stacked bases [weights, side, side]."""
    return float((bases.mT @ bases - torch.eye(bases.shape[-1], dtype=bases.dtype)).abs().max())


def _rotation(number: int) -> Tensor:
    values = torch.randn(SIDE, SIDE, dtype=torch.float64, generator=generator_for("rotation", number))
    rotation: Tensor = torch.linalg.qr(values).Q
    return rotation
