"""Gradients against central differences: a method whose gradient has a wrong sign or factor still trains, only worse.

At the kinks of rectifiers, thresholds and clamps, differences over long steps have larger errors than their spread
shows. Steps are therefore short, which needs double precision; a method without it has a wider tolerance.
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
"""The number of consecutive steps whose differences are combined."""
ROUNDINGS = 16.0
"""The number of rounding errors in a colour."""
BARS = 3.0
"""The largest error of a gradient, in error bars."""
RESOLVED = 0.05
"""The largest error bar of a difference that is used, as a share of the gradient."""


@dataclass(frozen=True)
class Ladder:
    dtype: torch.dtype
    steps: tuple[float, ...]
    """The steps relative to the norm of the parameter, from long to short."""
    share: float
    """The relative tolerance of a gradient, in addition to the error bars."""


DOUBLE = Ladder(torch.float64, tuple(8.0**-k for k in range(7, 11)), 1e-5)
SINGLE = Ladder(torch.float32, tuple(4.0**-k for k in range(2, 9)), 0.1)


class Difference(NamedTuple):
    value: float
    bar: float
    """Half of the range of the differences, plus the rounding error."""


def gradients_are_derivatives(subject: Subject) -> None:
    """The derivative along the gradient of each parameter agrees with central differences within their error bars, in
    double precision if the method has it.
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
        if size == 0.0:  # `gradients_reach_everything` checks this
            continue
        value, bar = difference(loss, parameter, parameter.grad / size, ladder.steps, rounding)
        if bar > RESOLVED * size:
            continue
        resolved += 1
        if abs(size - value) > BARS * bar + ladder.share * size:
            raise Broken(
                f"along its gradient, {name} has the derivative {value:.6g} ± {bar:.1g} by differences "
                f"and {size:.6g} by the gradient"
            )
    if not resolved:
        raise Broken("differences resolve the gradient of no parameter")


@torch.no_grad()
def difference(
    loss: Callable[[], Tensor], parameter: Tensor, direction: Tensor, ladder: tuple[float, ...], rounding: float
) -> Difference:
    """Return the derivative of `loss()` along a unit `direction`, from the steps whose differences agree best."""
    start = parameter.clone()
    length = float(start.norm()) or 1.0

    def loss_at(offset: float) -> float:
        parameter.copy_(start + offset * direction)
        return float(loss())

    slopes = [(loss_at(h) - loss_at(-h)) / (2.0 * h) for h in (step * length for step in ladder)]
    parameter.copy_(start)
    estimates = []
    for place in range(len(ladder) - WINDOW + 1):
        together = slopes[place : place + WINDOW]
        low, high = min(together), max(together)
        bar = 0.5 * (high - low) + rounding / (ladder[place + WINDOW - 1] * length)
        estimates.append(Difference(0.5 * (low + high), bar))
    return min(estimates, key=lambda estimate: estimate.bar)


def _loss_of(subject: Subject, dtype: torch.dtype) -> tuple[Callable[[], Tensor], Any]:
    """Return a randomly weighted sum of the colours of some rays, and the field that it depends on."""
    box = Box(BOX.lower.to(dtype), BOX.upper.to(dtype))
    field = subject.field(box=box).to(dtype)
    if hasattr(field, "dtype"):
        field.dtype = dtype
    # α is not 1/φ as at the start, where Eq. 4 has a kink at densities of about 0
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
