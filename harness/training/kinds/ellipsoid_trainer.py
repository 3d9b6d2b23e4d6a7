"""The trainer of `ellipsoids`: the Gaussians of `splats`, traced and differentiated by Mitsuba on rays of all views.

Importing this module imports Mitsuba: `harness.training.make_learner` does so when the method is trained.
"""

import math

import drjit as dr
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import normalize

from baselines.contract import Rays, Rendering
from baselines.numerics.compositing import hit_distance
from baselines.splats.gaussians import parts_of
from baselines.splats.traced import Traced
from harness.training.kinds.splat_trainer import GaussianTrainer
from harness.training.learner import Job
from harness.training.trainer import Diverged


class EllipsoidTrainer(GaussianTrainer):
    """A trainer of Gaussians that Mitsuba traces."""

    def __init__(self, job: Job) -> None:
        super().__init__(job)
        self.field.traced = True
        dr.set_thread_count(1)  # several threads would sum gradients in an order that changes from run to run
        self._scene: Traced | None = None

    def _slope(self, rays: Rays, colours: Tensor) -> tuple[float, Tensor, int]:
        rays.require_finite()
        values = self.field.values.detach().requires_grad_()
        numbers = self._numbers(values)
        traced, where = self._traced(numbers), self._normalised(rays)
        colour, _, _, met = traced.trace(*where)
        error = colour - colours
        if not math.isfinite(loss := float(error.square().mean())):
            raise Diverged(self.step, "loss")
        gradients = traced.gradient(*where, colour, 2.0 * error / error.numel())
        torch.autograd.backward(numbers, gradients)
        assert values.grad is not None
        return loss, values.grad, met

    def _rendered(self, rays: Rays, generator: torch.Generator | None, first: int, bins: int | None) -> Rendering:
        rays.require_finite()
        traced = self._traced(self._numbers(self.field.values))
        colour, through, distance, met = traced.trace(*self._normalised(rays))
        depth = hit_distance(distance * self.box.half_extent, 1.0 - through, rays.far)
        return Rendering(colour.clamp(0.0, 1.0), 1.0 - through, depth, met)

    def _numbers(self, values: Float[Tensor, "gaussians columns"]) -> tuple[Tensor, ...]:
        """Return the numbers in the order of `baselines.splats.traced.NAMES`."""
        position, log_scale, rotation, logit, base, high = parts_of(values)
        quaternion = normalize(rotation, dim=-1)[:, [1, 2, 3, 0]]
        data = torch.cat([position, self.field.scales(log_scale), quaternion], dim=1)
        return data, torch.sigmoid(logit), torch.cat([base, high], dim=1)

    def _traced(self, numbers: tuple[Tensor, ...]) -> Traced:
        """Return the scene with these numbers, rebuilt if the count of Gaussians changed."""
        if self._scene is None or self._scene.count != len(numbers[0]):
            self._scene = Traced(numbers)
        else:
            self._scene.move(numbers)
        return self._scene

    def _normalised(self, rays: Rays) -> tuple[Tensor, Tensor]:
        return self.box.normalised(rays.origins), rays.directions
