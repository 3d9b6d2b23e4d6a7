"""A method with a trainer of its own: a grid of voxels, with its own rates and its own loss."""

import math
from dataclasses import asdict, dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.functional import grid_sample, softplus

from baselines.contract import Box, Rays, Rendering, uniform_weights
from baselines.marching.sampling_plan import Sampling
from baselines.numerics.optimisers import OptimiserSettings, optimiser_of
from baselines.rendering import render_rays
from harness.plan.seeds import generator_for
from harness.training.learner import Job
from harness.training.trainer import BudgetedTrainer, Diverged


@dataclass(frozen=True)
class VoxelGridSettings:
    """All that changes its results. Records hold every value, and a run with other values reuses no cell."""

    voxels: int = 32
    """The voxels along each side of the scene's box."""
    bins: int = 64
    """The points of a ray."""
    rate: float = 0.1
    peak: float = 25.0
    """The density where a voxel holds 1, per half of the longest side of the box."""
    sparsity: float = 1e-4
    """The weight of the mean opacity in the loss."""


class VoxelGrid(nn.Module):
    """Density and colour between the nodes of a grid, the same from all sides."""

    pointwise = True
    density_limit = math.inf

    def __init__(self, box: Box, own: VoxelGridSettings, seed: int | str) -> None:
        super().__init__()
        self.box, self.unit = box, own.peak / box.half_extent
        self.values = nn.Parameter(uniform_weights((1, 4, *[own.voxels] * 3), 0.1, seed, "values"))

    def encode_directions(self, d: Tensor) -> Tensor:
        return d[:, :0]

    def density(self, x: Tensor) -> Tensor:
        return self._sampled(x)[0]

    def density_before_and_after(self, x: Tensor) -> tuple[Tensor, Tensor]:
        sigma = self.density(x)
        return sigma, sigma

    def density_and_colour(self, x: Tensor, view: Tensor, ray: Tensor) -> tuple[Tensor, Tensor]:
        return self._sampled(x)

    def parameter_counts(self) -> dict[str, int]:
        return {"voxels": self.values.numel(), "total": self.values.numel()}

    def _sampled(self, x: Tensor) -> tuple[Tensor, Tensor]:
        at = 2.0 * self.box.to_unit(x)[None, None, None] - 1.0
        values = grid_sample(self.values, at, align_corners=True, padding_mode="border")[0, :, 0, 0]
        return softplus(values[0] - 4.0) * self.unit, torch.sigmoid(values[1:]).T


class VoxelGridTrainer(BudgetedTrainer):
    """Adam on all voxels, at one rate."""

    own: VoxelGridSettings

    def __init__(self, job: Job) -> None:
        super().__init__(job)
        self.field = VoxelGrid(self.box, self.own, self.seed).to(self.device)
        self.optimiser = optimiser_of(self.field.parameters(), OptimiserSettings("adam", (0.9, 0.99)))

    @property
    def fields(self) -> VoxelGrid:
        return self.field

    def warm_up(self, rays: Rays, colours: Tensor) -> None:
        self._loss(rays, colours, generator_for(self.seed, "warm-up"))[0].backward()
        self.field.zero_grad(set_to_none=True)

    def train_on(self, rays: Rays, colours: Tensor) -> None:
        with self.clock.running():
            loss, evaluations = self._loss(rays, colours, generator_for(self.seed, self.step))
            if not math.isfinite(loss.item()):
                raise Diverged(self.step, "loss")
            loss.backward()
            norm = float(self.field.values.grad.norm())
            if not math.isfinite(norm):
                raise Diverged(self.step, "gradient of the voxels")
            self.optimiser.step(self.own.rate)
            self.field.zero_grad(set_to_none=True)
        self._count(loss.item(), (norm, norm), evaluations, len(rays))

    def _loss(self, rays: Rays, colours: Tensor, generator: torch.Generator) -> tuple[Tensor, int]:
        rendering = self._rendered(rays, generator, 0, None)
        error = (rendering.colour - colours).square().mean()
        return error + self.own.sparsity * rendering.opacity.mean(), rendering.network_evaluations

    def _rendered(self, rays: Rays, generator: torch.Generator | None, first: int, bins: int | None) -> Rendering:
        white = torch.ones(3, device=self.device)
        return render_rays(self.field, None, rays, self.box, Sampling(bins or self.own.bins), None, white, generator)

    def rendered_by(self) -> dict[str, Any]:
        """Return all that a picture depends on besides rays and weights: the key of a cached view."""
        box = [self.box.lower.tolist(), self.box.upper.tolist()]
        return {"method": self.method, "own": asdict(self.own), "box": box, "device": self.device.type}

    def restore(self, tensors: dict[str, Tensor], step: int) -> None:
        self.field.load_state_dict(tensors)
        self.step = step

    def optimiser_tensors(self) -> dict[str, Tensor]:
        return self.optimiser.tensors()

    def restore_optimiser(self, tensors: dict[str, Tensor]) -> None:
        self.optimiser.restore(tensors)
