"""`voxels_drjit` in training: the same batches, budget, schedule, clock and trace as a network's trainer has.

Importing this module imports Dr.Jit: `harness.training.learner` does so when the method is trained.
"""

import math
from dataclasses import dataclass
from typing import Any

import drjit as dr
import torch
from jaxtyping import Float
from torch import Tensor

from baselines.contract import Box, Rays, Rendering
from baselines.occupancy import OccupancyGrid
from baselines.voxels_drjit import Adam, Backend, VoxelField
from harness.machine.stopwatch import Stopwatch
from harness.plan.schedule import Budget, learning_rate
from harness.plan.seeds import generator_for
from harness.plan.settings import TrainSettings
from harness.training.learner import Clipping
from harness.training.trainer import TRACE_EVERY, TRACED, Diverged, require_bins


class VoxelTrainer:
    """A trainer of the voxel field on one scene with one seed, a batch at a time."""

    def __init__(
        self,
        method: str,
        box: Box,
        settings: TrainSettings,
        budget: Budget,
        seed: int | str,
        device: torch.device,
        view_dependent: bool,
        backend: Backend,
    ) -> None:
        # several threads would add up gradients in an order that changes from run to run
        dr.set_thread_count(1)
        self.method = method
        self.box = box
        self.settings = settings
        self.budget = budget
        self.seed = seed
        self.device = device
        self.grid: OccupancyGrid | None = None
        self.clock = Stopwatch(device)
        self.step = 0
        self.network_evaluations = 0
        self.last_loss = math.nan
        self.trace: dict[str, list[float | None]] = {name: [] for name in TRACED}
        view_dependent = view_dependent or not settings.accelerations.directions
        self._stages = list(settings.voxels.stages())
        self.field = VoxelField(box, self._stages.pop(0)[1], view_dependent, backend)
        self._optimiser = Adam(self.field)
        self.clipping = Clipping(settings.clip_norm, settings.clip_ratio)

    @property
    def fields(self) -> VoxelField:
        return self.field

    @property
    def progress(self) -> float:
        return self.budget.progress(self.step, self.clock.seconds)

    def warm_up(self, rays: Rays, colours: Float[Tensor, "rays 3"]) -> None:
        """Take a step at every fineness on fields that are thrown away: kernels are compiled here,
        outside the clock.
        """
        for _, voxels in self.settings.voxels.stages():
            field = self.field.refined(voxels)
            found = self._slope(field, rays, colours, generator_for(self.seed, "warm-up"))
            Adam(field).step(field, found.gradients, 0.0, 1.0)
        dr.sync_thread()

    def train_on(self, rays: Rays, colours: Float[Tensor, "rays 3"]) -> None:
        """Take one step on one batch, on the clock. Raises `Diverged`; the field is then the one before the step."""
        settings = self.settings
        rays.require_finite()
        with self.clock.running():
            while self._stages and self.progress >= self._stages[0][0]:
                self.field = self.field.refined(self._stages.pop(0)[1])
                self._optimiser = Adam(self.field)
            rate = settings.voxels.rate_factor * learning_rate(
                self.progress,
                self.step,
                settings.learning_rate,
                settings.last_learning_rate,
                settings.warm_up_steps,
            )
            found = self._slope(self.field, rays, colours, generator_for(self.seed, self.step, "jitter"))
            scale = self.clipping.scale(found.norm)
            self._optimiser.step(self.field, found.gradients, rate, scale)
            dr.sync_thread()
        self.step += 1
        self.last_loss = found.loss
        self.network_evaluations += found.points
        if self.step % TRACE_EVERY == 0 or self.step == 1:
            noted = {
                "step": float(self.step), "loss": found.loss, "gradient_norm": found.norm,
                "clipped_norm": found.norm * scale, "samples_per_ray": found.points / len(rays),
                **self.amplifier_scalars(),
            }  # fmt: skip
            for name, series in self.trace.items():
                series.append(noted[name])

    def render(self, rays: Rays, chunk: int, bins: int | None = None) -> Rendering:
        """Render all of `rays`, `chunk` at a time, at the midpoints of the bins; with `bins` of them per ray if that is
        given.

        Raises `ValueError` for less than one bin, and `Diverged` on a pixel not finite.
        """
        if bins is None:
            bins = self.settings.voxels.bins
        require_bins(bins)
        rays.require_finite()
        parts = [
            self.field.render(rays.part(start, start + chunk), bins) for start in range(0, max(len(rays), 1), chunk)
        ]
        for name in ("colour", "opacity", "depth"):
            if not all(bool(torch.isfinite(getattr(part, name)).all()) for part in parts):
                raise Diverged(self.step, f"rendered {name}")
        return Rendering(
            colour=torch.cat([part.colour for part in parts]),
            opacity=torch.cat([part.opacity for part in parts]),
            depth=torch.cat([part.depth for part in parts]),
            network_evaluations=sum(part.network_evaluations for part in parts),
        )

    def rendered_by(self) -> dict[str, Any]:
        return {
            "method": self.method,
            "bins": self.settings.voxels.bins,
            "degree": self.field.degree,
            "shape": list(self.field.shape),
            "box": [self.box.lower.tolist(), self.box.upper.tolist()],
            "background": [1.0, 1.0, 1.0],  # `VoxelField.render` knows no other
            "device": self.device.type,
        }

    def restore(self, tensors: dict[str, Tensor], step: int) -> None:
        self.field = self.field.filled(tensors)
        self._stages = [stage for stage in self._stages if stage[1] > max(self.field.shape)]
        self.step = step

    def optimiser_tensors(self) -> dict[str, Tensor]:
        return self._optimiser.state_dict()

    def restore_optimiser(self, tensors: dict[str, Tensor]) -> None:
        self._optimiser = Adam(self.field)
        self._optimiser.load_state_dict(tensors)

    def amplifier_scalars(self) -> dict[str, float | None]:
        return {"alpha": None, "beta": None}

    def _slope(self, field: VoxelField, rays: Rays, colours: Tensor, generator: torch.Generator) -> "_Slope":
        """Compute the gradient; raises `Diverged`, naming what is not finite."""
        voxels = self.settings.voxels
        samples, inside = field.samples(rays, voxels.bins, generator)
        missed = torch.ones(len(rays), dtype=torch.bool, device=colours.device)
        missed[inside] = False
        background = float(((1.0 - colours[missed]) ** 2).sum())
        smooth = torch.randint(math.prod(field.shape), (voxels.smoothed,), generator=generator)
        error, square, gradients = 0.0, 0.0, dict[str, Any]()
        if samples is not None:
            error, square, gradients = field.loss_and_gradients(
                samples, colours[inside], 1.0 / colours.numel(), smooth.to(colours.device), voxels.smoothing
            )
        loss = error + background / colours.numel()
        if not math.isfinite(loss):
            weight = _first_not_finite(field.values)
            raise Diverged(self.step, f"weight of {weight}" if weight else "loss")
        if not math.isfinite(square):
            raise Diverged(self.step, f"gradient of {_first_not_finite(gradients) or 'all voxels together'}")
        return _Slope(loss, math.sqrt(square), gradients, len(inside) * voxels.bins)


@dataclass(frozen=True)
class _Slope:
    """The gradient of one batch and its measurements."""

    loss: float
    """The mean squared error of display colours, including rays that miss the box."""
    norm: float
    """The norm of the gradient, before it is clipped."""
    gradients: dict[str, Any]
    points: int
    """The number of evaluated points."""


def _first_not_finite(arrays: dict[str, Any]) -> str | None:
    return next((name for name, values in arrays.items() if not dr.all(dr.isfinite(values))), None)
