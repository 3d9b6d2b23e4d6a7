"""The trainer of `splats`, which draws Gaussians one view at a time, and its base, which `ellipsoids` shares."""

import math
from abc import abstractmethod
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from baselines.contract import Rays, Rendering
from baselines.methods.explicit import GaussianSettings
from baselines.splats import adam
from baselines.splats.gaussians import Gaussians, Pencil, on_plane
from baselines.splats.population import first_values, relocated
from baselines.splats.rasteriser import COLUMNS
from harness.plan.seeds import generator_for
from harness.training.kinds.ssim_loss import row_length, ssim_loss
from harness.training.learner import Job
from harness.training.trainer import BudgetedTrainer, Diverged

KEPT_RAYS = 2_000_000
"""The maximum number of rays of training views that are kept sorted into cells, 40 bytes each."""


class GaussianTrainer(BudgetedTrainer):
    """A trainer of Gaussians, drawn or traced."""

    own: GaussianSettings

    def __init__(self, job: Job) -> None:
        super().__init__(job)
        # a box of no view set is looked at about as closely as rays are sampled
        pixel = 2.0 / (self.box.pixels_across or self.settings.bins)
        degree = self.own.degree if self.view_dependent else 0
        # the first Gaussians lie on the surface of the silhouettes' hull
        box = self.box if self.settings.accelerations.hull else replace(self.box, hull=None)
        self.field = Gaussians(box, degree, torch.zeros(0, 0), pixel, self.own.widened)
        self.field.values = first_values(
            box, self.own.first, self.field.columns, self.own.first_opacity, generator_for(self.seed, "first")
        )
        self.mean = torch.zeros_like(self.field.values)
        self.square = torch.zeros_like(self.field.values)
        self.seen = torch.zeros(len(self.field.values), 1)
        rates = [rate for name, size in COLUMNS.items() for rate in [getattr(self.own, name)] * size]
        self.rates = self.own.faster * torch.tensor(rates + [self.own.harmonics] * (self.field.columns - len(rates)))

    @property
    def fields(self) -> Gaussians:
        return self.field

    def warm_up(self, rays: Rays, colours: Float[Tensor, "rays 3"]) -> None:
        """Compile the kernels, off the clock."""
        _, gradient, _ = self._slope(rays, colours)
        state = self.mean, self.square, self.seen, self.field.values
        self.mean, self.square, self.seen = (part.clone() for part in state[:3])
        self._adam(gradient, 0.0)
        self.mean, self.square, self.seen, self.field.values = state

    def train_on(self, rays: Rays, colours: Float[Tensor, "rays 3"]) -> None:
        """Take one step, on the clock. Raises `Diverged`; the Gaussians are then those before the step."""
        with self.clock.running():
            loss, gradient, drawn = self._slope(rays, colours)
            norm = float(gradient.norm())
            if not math.isfinite(norm):
                raise Diverged(self.step, "gradient of the Gaussians")
            rate, before = self.own.last_rate ** min(self.progress, 1.0), self.field.values
            if not self._adam(gradient, rate):
                self.field.values = before
                raise Diverged(self.step, "weights of the Gaussians")
            if (self.step + 1) % self.own.moved_every == 0 and self.progress < self.own.moved_until:
                self._move(generator_for(self.seed, self.step, "population"))
        self._count(loss, (norm, norm), drawn, len(rays))

    @abstractmethod
    def _slope(self, rays: Rays, colours: Tensor) -> tuple[float, Tensor, int]:
        """Return the loss, its gradient, and how often a ray met a Gaussian. Raises `Diverged`."""

    def _adam(self, gradient: Tensor, rate: float) -> bool:
        """Take a step of Adam; return whether the Gaussians are finite."""
        before, after = self.field.values, torch.empty_like(self.field.values)
        moments = adam.Moments(self.mean.numpy(), self.square.numpy(), self.seen.numpy())
        rates, betas = (rate * self.rates).numpy(), np.array(self.own.betas, dtype=np.float32)
        epsilon = np.float32(self.own.epsilon)
        finite = adam.step(before.numpy(), gradient.numpy(), moments, rates, betas, epsilon, after.numpy())
        self.field.values = after
        return bool(finite)

    def _move(self, generator: torch.Generator) -> None:
        values, own = self.field.values, self.own
        more = max(min(own.most - len(values), int(own.growth * len(values))), 0)
        values, changed = relocated(values, more, own.dead, generator)
        for name in ("mean", "square", "seen"):
            state = getattr(self, name)
            state = torch.cat([state, state.new_zeros(len(values) - len(state), state.shape[1])])
            state[changed] = 0.0
            setattr(self, name, state)
        self.field.values = values

    def rendered_by(self) -> dict[str, Any]:
        return {**self._rendered_by(), "degree": self.field.degree, "pixel": self.field.pixel}

    def restore(self, tensors: dict[str, Tensor], step: int) -> None:
        values = tensors["gaussians"]
        if values.ndim != 2 or values.shape[1] != self.field.columns:
            raise ValueError(f"Gaussians of shape {tuple(values.shape)}, not of {self.field.columns} columns")
        self.field.values, self.field.pixel = values, float(tensors["pixel"])
        self.step = step

    def optimiser_tensors(self) -> dict[str, Tensor]:
        return {"mean": self.mean, "square": self.square, "seen": self.seen}

    def restore_optimiser(self, tensors: dict[str, Tensor]) -> None:
        self.mean, self.square, self.seen = (tensors[name] for name in ("mean", "square", "seen"))


class DrawingTrainer(BudgetedTrainer):
    """A trainer of Gaussians that draws all rays at once, as each chunk would be sorted and projected separately."""

    field: Gaussians

    @property
    def fields(self) -> Gaussians:
        return self.field

    def _rendered(self, rays: Rays, generator: torch.Generator | None, first: int, bins: int | None) -> Rendering:
        rays.require_finite()
        return self.field.render(rays)

    def render(self, rays: Rays, chunk: int, bins: int | None = None) -> Rendering:
        return super().render(rays, max(len(rays), 1), bins)


class SplatTrainer(DrawingTrainer, GaussianTrainer):
    """A trainer of Gaussians that draws all pixels of a view at a time."""

    whole_views = True

    def __init__(self, job: Job) -> None:
        super().__init__(job)
        self._pencils: dict[bytes, Pencil] = {}

    def _pencil(self, rays: Rays) -> Pencil:
        """Return the sorted rays of a view; they are kept, as sorting them again takes a tenth of a step."""
        key = rays.origins[0].numpy().tobytes() + rays.directions[[0, -1]].numpy().tobytes()
        if (pencil := self._pencils.get(key)) is None:
            pencil = Pencil.of(rays.origins[0], rays.directions, rays.near)
            if (len(self._pencils) + 1) * len(rays) <= KEPT_RAYS:
                self._pencils[key] = pencil
        return pencil

    def _slope(self, rays: Rays, colours: Tensor) -> tuple[float, Tensor, int]:
        values = self.field.values.detach().requires_grad_()
        pencil = self._pencil(rays)
        out, through, drawn = self.field.draw(pencil, values)
        picture = out[:, :3] + through[:, None]
        error = torch.mean((picture - colours) ** 2)
        if self.own.ssim_weight:
            rows = (-1, row_length(on_plane(rays.directions, pencil.axes)), 3)
            error = error + self.own.ssim_weight * ssim_loss(picture.view(rows), colours.view(rows))
        (gradient,) = torch.autograd.grad(error, values)
        if not math.isfinite(loss := error.item()):
            raise Diverged(self.step, "loss")
        return loss, gradient, drawn
