"""Gradients against central differences: a method whose gradient has a wrong sign or factor still trains, only worse.

Rectifiers, thresholds and clamps make kinks, at which differences of long steps err more than they seem to; so steps
are short, and that needs double precision. A method whose kernels know single precision alone is held to less.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

import torch
from torch import Tensor

from baselines.contract import Box
from harness.studies.conformance.subject import BOX, Broken, Subject, roughened, some_rays

RAYS = 20
WINDOW = 3
"""The steps in a row whose differences are taken together."""
ROUNDINGS = 16.0
"""The roundings of a colour in one step."""
BARS = 3.0
"""The error bars by which a gradient may be off."""
RESOLVED = 0.05
"""The largest error bar, as a share of the gradient, of a difference that says anything."""


@dataclass(frozen=True)
class Ladder:
    """The steps in a precision, and by how much a gradient may be off."""

    dtype: torch.dtype
    steps: tuple[float, ...]
    """The steps, in lengths of the parameter, from long to short."""
    share: float
    """The share of itself by which a gradient may be off in any case."""


DOUBLE = Ladder(torch.float64, tuple(8.0**-k for k in range(5, 10)), 1e-5)
SINGLE = Ladder(torch.float32, tuple(4.0**-k for k in range(2, 9)), 0.1)


class Difference(NamedTuple):
    """A derivative from differences of several steps."""

    value: float
    bar: float
    """Half of the range of the differences, and rounding."""


def gradients_are_derivatives(subject: Subject) -> None:
    """Along the gradient of each parameter a picture changes as the gradient says, within the error bars of central
    differences over a ladder of steps, in double precision if the method has it.
    """
    with _default(torch.float64):
        try:
            loss, field = _loss_of(subject, torch.float64)
            loss()
        except (RuntimeError, TypeError):  # kernels of single precision
            loss = None
        if loss is not None:
            _compare(loss, field, DOUBLE)
            return
    _compare(*_loss_of(subject, torch.float32), SINGLE)


def _compare(loss: Callable[[], Tensor], field: Any, ladder: Ladder) -> None:
    loss().backward()
    rounding = ROUNDINGS * torch.finfo(ladder.dtype).eps * RAYS**0.5
    resolved = 0
    for name, parameter in field.named_parameters():
        size = 0.0 if parameter.grad is None else float(parameter.grad.norm())
        if size == 0.0:  # which `gradients_reach_everything` judges
            continue
        found = difference(loss, parameter, parameter.grad / size, ladder.steps, rounding)
        if found.bar > RESOLVED * size:
            continue
        resolved += 1
        if abs(size - found.value) > BARS * found.bar + ladder.share * size:
            raise Broken(
                f"along its gradient, {name} has the derivative {found.value:.6g} ± {found.bar:.1g} by differences "
                f"and {size:.6g} by the gradient"
            )
    if not resolved:
        raise Broken("differences resolve the gradient of no parameter")


@torch.no_grad()
def difference(
    loss: Callable[[], Tensor], parameter: Tensor, direction: Tensor, ladder: tuple[float, ...], rounding: float
) -> Difference:
    """Return the derivative of `loss()` as `parameter` moves along the unit `direction`, from the steps whose
    differences agree best; `rounding` is the error of one loss.
    """
    start = parameter.clone()
    length = float(start.norm()) or 1.0

    def slope(step: float) -> float:
        ends = []
        for side in (step, -step):
            parameter.copy_(start + side * direction)
            ends.append(float(loss()))
        parameter.copy_(start)
        return (ends[0] - ends[1]) / (2.0 * step)

    slopes = [slope(step * length) for step in ladder]
    found = []
    for place in range(len(ladder) - WINDOW + 1):
        low, high = min(seen := slopes[place : place + WINDOW]), max(seen)
        bar = 0.5 * (high - low) + rounding / (ladder[place + WINDOW - 1] * length)
        found.append(Difference(0.5 * (low + high), bar))
    return min(found, key=lambda each: each.bar)


def _loss_of(subject: Subject, dtype: torch.dtype) -> tuple[Callable[[], Tensor], Any]:
    """Return a sum over the colours of some rays, with random weights, and the field that it depends on."""
    box = Box(BOX.lower.to(dtype), BOX.upper.to(dtype))
    field = subject.field(box=box).to(dtype)
    if hasattr(field, "dtype"):
        field.dtype = dtype
    # α away from 1/φ, at which Eq. 4 clamps densities of about 0: a kink at the very start
    field, rays = roughened(field, 1.0), some_rays(RAYS).to(dtype)
    weights = torch.randn(RAYS, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(63))

    def loss() -> Tensor:
        return (subject.rendered(field, rays).colour.double() * weights).sum()

    return loss, field


@contextmanager
def _default(dtype: torch.dtype) -> Iterator[None]:
    before = torch.get_default_dtype()
    torch.set_default_dtype(dtype)
    try:
        yield
    finally:
        torch.set_default_dtype(before)
