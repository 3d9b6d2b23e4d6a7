"""The trainer of `voxels_drjit`, with the same batches, budget, schedule, clock and trace as the trainer of networks.

Importing this module imports Dr.Jit: `harness.training.make_learner` does so when the method is trained.
"""

import math
from typing import Any

import drjit as dr
import torch
from jaxtyping import Float
from torch import Tensor

from baselines.contract import Rays, Rendering
from baselines.methods.explicit import VoxelSettings
from baselines.voxels_drjit import Adam, Backend, VoxelField
from harness.plan.seeds import generator_for
from harness.training.learner import Job
from harness.training.trainer import BudgetedTrainer, Diverged


class VoxelTrainer(BudgetedTrainer):
    own: VoxelSettings

    def __init__(self, job: Job, backend: Backend = "llvm") -> None:
        super().__init__(job)
        dr.set_thread_count(1)  # several threads would sum gradients in an order that changes from run to run
        self._stages = list(self.own.stages())
        self.field = VoxelField(self.box, self._stages.pop(0)[1], self.view_dependent, backend, self.own)
        self._optimiser = Adam(self.field)

    @property
    def fields(self) -> VoxelField:
        return self.field

    def warm_up(self, rays: Rays, colours: Float[Tensor, "rays 3"]) -> None:
        """Compile the kernels off the clock: take a step at every resolution, on fields that are discarded."""
        for _, voxels in self.own.stages():
            field = self.field.refined(voxels)
            _, _, gradients, _ = self._slope(field, rays, colours, generator_for(self.seed, "warm-up"))
            Adam(field).step(field, gradients, 0.0, 1.0)
        dr.sync_thread()

    def train_on(self, rays: Rays, colours: Float[Tensor, "rays 3"]) -> None:
        """Take one step on the clock. Raises `Diverged`; the field is then the one before the step."""
        rays.require_finite()
        with self.clock.running():
            while self._stages and self.progress >= self._stages[0][0]:
                self.field = self.field.refined(self._stages.pop(0)[1])
                self._optimiser = Adam(self.field)
            rate = self.own.rate_factor * self.learning_rate()
            jitter = generator_for(self.seed, self.step, "jitter")
            loss, norm, gradients, points = self._slope(self.field, rays, colours, jitter)
            scale = self.clipping.scale(norm)
            self._optimiser.step(self.field, gradients, rate, scale)
            dr.sync_thread()
        self._count(loss, (norm, norm * scale), points, len(rays))

    def _rendered(self, rays: Rays, generator: torch.Generator | None, first: int, bins: int | None) -> Rendering:
        rays.require_finite()
        return self.field.render(rays, bins or self.own.bins)

    def rendered_by(self) -> dict[str, Any]:
        field = self.field
        return {**self._rendered_by(), "bins": self.own.bins, "degree": field.degree, "shape": list(field.shape)}

    def restore(self, tensors: dict[str, Tensor], step: int) -> None:
        self.field = self.field.filled(tensors)
        self._stages = [stage for stage in self._stages if stage[1] > max(self.field.shape)]
        self.step = step

    def optimiser_tensors(self) -> dict[str, Tensor]:
        return self._optimiser.state_dict()

    def restore_optimiser(self, tensors: dict[str, Tensor]) -> None:
        self._optimiser = Adam(self.field)
        self._optimiser.load_state_dict(tensors)

    def _slope(
        self, field: VoxelField, rays: Rays, colours: Tensor, generator: torch.Generator
    ) -> tuple[float, float, dict[str, Any], int]:
        """Return the mean squared error of display colours, including rays that miss the box; the norm of its gradient;
        the gradient; and the number of evaluated points. Raises `Diverged` naming an array that is not finite.
        """
        samples, inside = field.samples(rays, self.own.bins, generator)
        missed = torch.ones(len(rays), dtype=torch.bool, device=colours.device)
        missed[inside] = False
        background = float(((1.0 - colours[missed]) ** 2).sum())
        smooth = torch.randint(math.prod(field.shape), (self.own.smoothed,), generator=generator)
        error, square, gradients = 0.0, 0.0, dict[str, Any]()
        if samples is not None:
            error, square, gradients = field.loss_and_gradients(
                samples, colours[inside], 1.0 / colours.numel(), smooth.to(colours.device), self.own.smoothing
            )
        loss = error + background / colours.numel()
        if not math.isfinite(loss):
            weight = _first_not_finite(field.values)
            raise Diverged(self.step, f"weight of {weight}" if weight else "loss")
        if not math.isfinite(square):
            raise Diverged(self.step, f"gradient of {_first_not_finite(gradients) or 'all voxels together'}")
        return loss, math.sqrt(square), gradients, len(inside) * self.own.bins


def _first_not_finite(arrays: dict[str, Any]) -> str | None:
    return next((name for name, values in arrays.items() if not dr.all(dr.isfinite(values))), None)
