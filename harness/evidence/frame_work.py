"""One frame of a radiance field by any rule and sampler: its error, its evaluations and its seconds."""

import math
import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import torch
from jaxtyping import Float, Int
from torch import Tensor

from baselines.contract import Box, RadianceField, Rays
from baselines.numerics.quadrature import QUADRATURES
from baselines.occupancy import OccupancyGrid
from baselines.rendering import Sampling, render_rays
from harness.seeds import generator_for
from harness.stability.quadrature_orders import fitted_order

MEASURES = ("colour", "opacity")


class EmptyOutside:
    """A field without density outside of its box, whose integral a ray has the same of, cut to the box or not."""

    def __init__(self, inner: RadianceField, box: Box) -> None:
        self.inner = inner
        self.box = box

    @property
    def pointwise(self) -> bool:
        return self.inner.pointwise

    def encode_directions(self, d: Float[Tensor, "rays 3"]) -> Float[Tensor, "rays features"]:
        return self.inner.encode_directions(d)

    def density(self, x: Float[Tensor, "points 3"]) -> Float[Tensor, " points"]:
        return self._inside(x, self.inner.density(x))

    def density_before_and_after(
        self, x: Float[Tensor, "points 3"]
    ) -> tuple[Float[Tensor, " points"], Float[Tensor, " points"]]:
        before, after = self.inner.density_before_and_after(x)
        return self._inside(x, before), self._inside(x, after)

    def density_and_colour(
        self, x: Float[Tensor, "points 3"], view: Float[Tensor, "rays features"], ray: Int[Tensor, " points"]
    ) -> tuple[Float[Tensor, " points"], Float[Tensor, "points 3"]]:
        sigma, colour = self.inner.density_and_colour(x, view, ray)
        return self._inside(x, sigma), colour

    def _inside(self, x: Tensor, sigma: Tensor) -> Tensor:
        # points on a face are the first and last ones of a ray that is cut to the box, and rounding moves them
        margin = 1e-5 * (self.box.upper - self.box.lower).max()
        within = ((x >= self.box.lower - margin) & (x <= self.box.upper + margin)).all(dim=-1)
        return torch.where(within, sigma, 0.0)


@dataclass(frozen=True)
class Sampler:
    """Where a ray's points lie."""

    name: str
    clipped: bool = True
    grid: bool = False
    early_stop: bool = False
    random: bool = False
    two_passes: bool = False
    """A quarter of the points spread evenly, half as many fenceposts as there are points drawn where those saw
    something, and a second pass over both: as many evaluations as one pass over all."""


SAMPLERS = (
    Sampler("near to far", clipped=False),
    Sampler("box"),
    Sampler("box, grid", grid=True),
    Sampler("box, grid, early stop", grid=True, early_stop=True),
    Sampler("box, random", random=True),
    Sampler("box, coarse and fine", two_passes=True),
)


@dataclass(frozen=True)
class Frame:
    """What is rendered; `near_to_far` is in its rays."""

    field: RadianceField
    rays: Rays
    box: Box
    grid: OccupancyGrid | None
    background: Float[Tensor, " 3"]
    chunk: int

    @torch.no_grad()
    def rendered(self, rule: str, sampler: Sampler, samples: int) -> tuple[Tensor, Tensor, int]:
        """Display colour [rays, 3], opacity [rays], network evaluations; about `samples` points a ray."""
        bins = max(1, samples // QUADRATURES[rule].stride)
        sampling = Sampling(
            bins=max(1, bins // 4) if sampler.two_passes else bins,
            fine_bins=max(1, bins // 2) if sampler.two_passes else 0,
            quadrature=rule,
            clip_to_box=sampler.clipped,
            early_stop=sampler.early_stop,
        )
        fine = self.field if sampler.two_passes else None
        grid = self.grid if sampler.grid else None
        generator = generator_for("frame", samples) if sampler.random else None
        parts = [
            render_rays(
                self.field, fine, self.rays.part(start, start + self.chunk), self.box, sampling, grid,
                self.background, generator,
            )
            for start in range(0, len(self.rays), self.chunk)
        ]  # fmt: skip
        colour, opacity = (torch.cat([getattr(one, name) for one in parts]) for name in MEASURES)
        return colour, opacity, sum(one.network_evaluations for one in parts)


@dataclass
class Line:
    """One rule and sampler over growing numbers of samples."""

    rule: str
    sampler: str
    samples: list[int] = field(default_factory=list)
    error: dict[str, list[float]] = field(default_factory=lambda: {name: [] for name in MEASURES})
    evaluations: list[int] = field(default_factory=list)
    """Of the whole frame."""
    seconds: list[float] = field(default_factory=list)
    """Medians."""

    def cost_of(self, target: float, costs: Sequence[float], measure: str = "colour") -> float | None:
        """The least of `costs` at which the error is no more than `target`."""
        reached = [cost for cost, error in zip(costs, self.error[measure], strict=True) if error <= target]
        return min(reached, default=None)

    def least(self, measure: str) -> float:
        """Raises `ValueError` where an error is not finite, which a minimum would hide or be."""
        return min(_finite(error, self.rule, self.sampler) for error in self.error[measure])

    def order(self, measure: str, floor: float) -> float | None:
        """Fitted over the finer half of what stands clear of the reference's own error."""
        clear = [(n, e) for n, e in zip(self.samples, self.error[measure], strict=True) if e > 3.0 * floor]
        finer = clear[len(clear) // 2 :] if len(clear) >= 6 else clear[-3:]
        return fitted_order([e for _, e in finer], tuple(n for n, _ in finer))


def rms(difference: Tensor) -> float:
    return float(difference.double().square().mean().sqrt())


def _finite(error: float, rule: str, sampler: str) -> float:
    if not math.isfinite(error):
        raise ValueError(f"{rule} ({sampler}): an error is not finite: {error}")
    return error


def measured_lines(
    frame: Frame,
    rules: Iterable[str],
    samplers: Iterable[Sampler],
    samples: Sequence[int],
    reference: dict[str, Tensor],
    rounds: int,
    synchronise: Callable[[], object] = lambda: None,
    clock: Callable[[], float] = time.perf_counter,
) -> list[Line]:
    """Every rule with every sampler at each of `samples`, timed in turns: all of them once, then all once more, …

    `reference` has `MEASURES`. Raises `ValueError` where an error is not finite.
    """
    todo = [(rule, sampler, count) for rule in rules for sampler in samplers for count in samples]
    for rule, sampler in {(rule, sampler): None for rule, sampler, _ in todo}:
        frame.rendered(rule, sampler, min(samples))  # allocations, off the clock
    lines: dict[tuple[str, str], Line] = {}
    taken: dict[tuple[str, str, int], list[float]] = {}
    for number in range(rounds):
        for rule, sampler, count in todo:
            synchronise()
            began = clock()
            colour, opacity, evaluations = frame.rendered(rule, sampler, count)
            synchronise()
            taken.setdefault((rule, sampler.name, count), []).append(clock() - began)
            if number == 0:
                line = lines.setdefault((rule, sampler.name), Line(rule, sampler.name))
                line.samples.append(count)
                line.evaluations.append(evaluations)
                line.error["colour"].append(_finite(rms(colour - reference["colour"]), rule, sampler.name))
                line.error["opacity"].append(_finite(rms(opacity - reference["opacity"]), rule, sampler.name))
    for line in lines.values():
        line.seconds += [statistics.median(taken[line.rule, line.sampler, count]) for count in line.samples]
    return list(lines.values())
