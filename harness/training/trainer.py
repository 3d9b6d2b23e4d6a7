"""The training of one method: its field, optimiser, occupancy grid and clock. It prints and writes nothing."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, replace
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from baselines.composition import LOSSES, Parts
from baselines.contract import Counts, FieldSpec, Precision, Rays, Rendering, first_not_finite
from baselines.field import field_of, training_step
from baselines.marching.sampling_plan import Sampling
from baselines.numerics.checks import BadDensity, require_density
from baselines.numerics.optimisers import Optimiser, optimiser_of
from baselines.numerics.sampling import Draws
from baselines.numerics.weight_average import WeightAverage
from baselines.occupancy import OccupancyGrid
from baselines.rendering import render_rays
from harness.machine.stopwatch import Stopwatch
from harness.plan.plugins import method_named
from harness.plan.schedule import learning_rate
from harness.plan.seeds import generator_for
from harness.training.checkpoints import OCCUPIED
from harness.training.learner import Clipping, Job, TakesTurns

LOSS_SCALE: dict[Precision, float] = {"float32": 1.0, "bfloat16": 1.0, "float16": 1024.0}
"""The factor of the loss in the backward pass, a power of two, so that nothing is rounded. Below 6e-8 a float16 is 0,
and the gradient of one sample of 512 rays is about 1e-6; bfloat16 has the range of float32.
"""
TRACED = ("step", "loss", "gradient_norm", "clipped_norm", "alpha", "beta", "samples_per_ray", "learning_rate")
LAYER = "gradient_norm "
"""The prefix of the norms of single layers in a trace, before clipping."""
TRACE_EVERY = 20
ROW = (
    "loss", "gradient_norm", "clipped_norm", "weight_norm", "evaluations", "invalid", "needed", "alpha", "beta"
)  # fmt: skip
"""The first numbers that a step leaves on the device."""
MEAN = "mean."
"""The prefix of the running means of the weights among the tensors of the optimiser."""


class StepLoss(NamedTuple):
    """The loss of a batch, the number of evaluated points, and the counts of a rendering with fixed shapes."""

    loss: Float[Tensor, ""]
    evaluations: int
    counts: Counts | None


class Diverged(ArithmeticError):
    """A value is NaN or infinite; the message names the step and the tensor."""

    def __init__(self, step: int, tensor: str) -> None:
        super().__init__(f"not finite at step {step}: {tensor}")
        self.tensor = tensor


class BudgetedTrainer(ABC):
    """One method on one scene with one seed: its budget, clock, counters and trace."""

    whole_views: ClassVar[bool] = False

    def __init__(self, job: Job) -> None:
        self.method, self.box, self.settings, self.own = job.method, job.box, job.settings, job.own
        self.budget, self.seed, self.device = job.budget, job.seed, job.device
        # colour gets no direction in a scene that looks the same from all sides, unless that is switched off
        self.view_dependent = job.view_dependent or not self.settings.accelerations.directions
        self.grid: OccupancyGrid | None = None
        self.clock = Stopwatch(self.device)
        self.step = 0
        self.network_evaluations = 0
        self.clipping = Clipping(self.settings.clip_norm, self.settings.clip_ratio, self.device)
        self.last_loss: float | None = None
        """The loss of the last batch, before its step."""
        self.trace: dict[str, list[float | None]] = {name: [] for name in TRACED}
        self.turns: TakesTurns | None = None
        """What takes many steps at a time, on a device that should not wait for the host (`harness.training.turns`)."""

    @property
    def progress(self) -> float:
        return self.budget.progress(self.step, self.clock.seconds, self.clock.core_seconds)

    def learning_rate(self, step: int | None = None) -> float:
        """Return the learning rate of a step, by default the next, as far as the clock has come."""
        settings, step = self.settings, self.step if step is None else step
        first, last = settings.learning_rate, settings.last_learning_rate
        progress = self.budget.progress(step, self.clock.seconds, self.clock.core_seconds)
        return learning_rate(progress, step, first, last, settings.warm_up_steps, settings.decay)

    @property
    def _is_traced(self) -> bool:
        return (self.step + 1) % TRACE_EVERY == 0 or self.step == 0

    def _count(
        self, loss: float, norms: tuple[float, float], evaluations: int, rays: int, rate: float | None = None,
        more: Mapping[str, float | None] | None = None,
    ) -> None:  # fmt: skip
        """End a step; `norms` of the gradient are before and after clipping, `more` is traced as well."""
        traced = self._is_traced
        self.step += 1
        self.last_loss = loss
        self.network_evaluations += evaluations
        if traced:
            values = (float(self.step), loss, *norms, None, None, evaluations / rays, rate)
            for name, value in (dict(zip(TRACED, values, strict=True)) | dict(more or {})).items():
                self.trace.setdefault(name, []).append(value)

    def amplifier_scalars(self) -> dict[str, float | None]:
        """Return α and β of the amplifier, None if the method has none."""
        return {"alpha": None, "beta": None}

    def averaged(self) -> AbstractContextManager[None]:
        """Enclose code that sees the running mean of the weights in place of them, if the method has one."""
        return nullcontext()

    def _rendered_by(self) -> dict[str, Any]:
        """Return the part of `Learner.rendered_by` that all trainers share."""
        return {
            "method": self.method,
            "box": [self.box.lower.tolist(), self.box.upper.tolist()],
            "background": [1.0, 1.0, 1.0],
            "device": self.device.type,
        }

    @torch.no_grad()
    def render(self, rays: Rays, chunk: int, bins: int | None = None) -> Rendering:
        """Render all of `rays`, `chunk` at a time, with `bins` per ray (and a second pass in proportion) if that is
        given. Only a single chunk keeps its samples. Raises `ValueError` for less than one bin, and `Diverged`.
        """
        if bins is not None and bins < 1:
            raise ValueError(f"{bins} bins per ray: must be at least 1")
        starts = range(0, max(len(rays), 1), chunk)
        chunks = (self._rendered(rays.part(start, start + chunk), None, start, bins) for start in starts)
        parts = [part if len(starts) == 1 else replace(part, samples=None) for part in chunks]
        whole = Rendering(
            colour=torch.cat([part.colour for part in parts]),
            opacity=torch.cat([part.opacity for part in parts]),
            depth=torch.cat([part.depth for part in parts]),
            network_evaluations=sum(part.network_evaluations for part in parts),
            samples=parts[0].samples,
        )
        for name in ("colour", "opacity", "depth"):
            if (ray := first_not_finite(getattr(whole, name))) is not None:
                raise Diverged(self.step, f"rendered {name} of ray {ray}")
        return whole

    @abstractmethod
    def _rendered(self, rays: Rays, generator: torch.Generator | None, first: int, bins: int | None) -> Rendering:
        """Render one chunk; `first` is the number of its first ray, for errors that name a ray."""


class Trainer(BudgetedTrainer):
    """The trainer of a method that is a field of torch, with an optimiser and an occupancy grid."""

    def __init__(self, job: Job) -> None:
        super().__init__(job)
        self._graded: list[str] = []
        """The names of the weights that have a gradient."""
        parts = self.own if isinstance(self.own, Parts) else Parts()
        self.settings = settings = replace(self.settings, **parts.settings)
        self.error = LOSSES[parts.loss]
        method = method_named(self.method)
        self.background = torch.ones(3, device=self.device)

        def field(name: str) -> Any:
            seed = f"{self.seed}/{name}"
            spec = FieldSpec(settings.network, self.box, settings.precision, seed, self.view_dependent, self.own)
            return field_of(method, spec).to(self.device)

        self.coarse = field("coarse")
        self.fine = field("fine") if settings.fine_bins else None
        self.fields = nn.ModuleDict({"coarse": self.coarse} | ({"fine": self.fine} if self.fine else {}))
        self._weights = dict(self.fields.named_parameters())
        """The weights by name, listed once: to collect them took 6 % of a step of a small network."""
        # Listing 4 takes its background from the last point before `far`: it must see every point of the complete ray
        self.quadrature = parts.quadrature
        self.whole_rays = self.quadrature == "listing4"
        if settings.accelerations.grid and settings.grid.cells > 0 and not self.whole_rays:
            box = self.box if settings.accelerations.hull else replace(self.box, hull=None)
            self.grid = OccupancyGrid(settings.grid.cells, box, settings.grid.opacity_threshold)

    @cached_property
    def optimiser(self) -> Optimiser:
        """Return the optimiser, created in the warm-up: it imports torch's compiler, for seconds off the clock."""
        return optimiser_of(self._weights.values(), self.settings.optimiser)

    @cached_property
    def average(self) -> WeightAverage | None:
        """Return the running mean of the weights, begun at the first step."""
        power = self.settings.average
        return WeightAverage(self._weights.values(), power) if power else None

    def averaged(self) -> AbstractContextManager[None]:
        average = self.__dict__.get("average")  # absent before the first step, and after a checkpoint is loaded
        return average.shown() if average else nullcontext()

    @property
    def field(self) -> Any:
        """Return the field whose rendering is shown (`baselines.field.field_of`)."""
        return self.fine or self.coarse

    def warm_up(self, rays: Rays, colours: Float[Tensor, "rays 3"]) -> None:
        """Run a forward and a backward pass that change nothing: imports, allocations, kernel choices."""
        _ = self.optimiser
        if self.turns is None:
            self.loss(rays, colours, generator_for(self.seed, "warm-up"))[0].backward()
            self.fields.zero_grad(set_to_none=True)

    def train_on(self, rays: Rays, colours: Float[Tensor, "rays 3"]) -> None:
        """Take one step, on the clock; the last step of the budget ends with the mean of the weights. Raises
        `Diverged`; the weights are then those before the step, unless the error names a weight.
        """
        with self.clock.running():
            self.refresh_grid()
            rate = self.learning_rate()
            row = self.looked_at_step(rays, colours, generator_for(self.seed, self.step, "jitter"), rate)
        self.end_step(row, rate, len(rays))

    def looked_at_step(self, rays: Rays, colours: Tensor, draws: Draws, rate: float | Tensor) -> list[float]:
        """Take a step of which the host looks at every number. Raises `Diverged` as `train_on`."""
        row: list[float] = self.take_step(rays, colours, draws, rate, self._checked_loss, self._look).tolist()
        if not math.isfinite(row[ROW.index("weight_norm")]) and not _all_finite(self._weights.values()):
            raise Diverged(self.step, self._first_not_finite("weight"))
        if self.average:
            self.average.observe()
        return row

    def take_step(
        self,
        rays: Rays,
        colours: Tensor,
        draws: Draws,
        rate: float | Tensor,
        loss_of: Callable[[Rays, Tensor, Draws], StepLoss],
        look: Callable[[Tensor], None] = lambda norm: None,
    ) -> Float[Tensor, " numbers"]:
        """Change the weights by a batch. Return the numbers of `ROW` on the device, then the norm of the gradient of
        each weight before clipping; `look` gets the norm of all before the weights change.
        """
        with training_step([self.coarse, self.fine] if self.fine else [self.coarse]):
            loss, evaluations, counts = loss_of(rays, colours, draws)
            scale = LOSS_SCALE[self.settings.precision]
            (loss * scale).backward()
            gradients = [weight.grad for weight in self._weights.values() if weight.grad is not None]
            if scale != 1.0:
                torch._foreach_div_(gradients, scale)
            norms, norm = _norms(gradients)
            look(norm)  # before the gradients are scaled by it, which would make them all NaN
            kept = self.clipping.factor(norm).to(norm.dtype)
            torch._foreach_mul_(gradients, kept)
            self.optimiser.step(rate)
        self._graded = [name for name, weight in self._weights.items() if weight.grad is not None]
        for weight in self._weights.values():
            weight.grad = None
        amplifier = getattr(self.field, "amplifier", None)
        numbers = {
            "loss": loss,
            "gradient_norm": norm,
            "clipped_norm": norm * kept,
            "weight_norm": _norms([weight.detach() for weight in self._weights.values()])[1],
            "evaluations": float(evaluations),
            "invalid": 0.0 if counts is None else counts.invalid,
            "needed": 0.0 if counts is None else counts.needed,
            **{name: getattr(amplifier, name, math.nan) for name in ("alpha", "beta")},
        }
        listed = [value if isinstance(value, Tensor) else torch.full_like(norm, value) for value in numbers.values()]
        return torch.cat([torch.stack([value.detach().double() for value in listed]), norms.double()])

    def end_step(self, row: list[float], rate: float, rays: int) -> None:
        """Count a step from the numbers that `take_step` returned."""
        numbers, norms = dict(zip(ROW, row, strict=False)), row[len(ROW) :]
        more: dict[str, float | None] = {}
        if self._is_traced:
            more = {name: None if math.isnan(numbers[name]) else numbers[name] for name in ("alpha", "beta")}
            more |= _by_layer(zip(self._graded, norms, strict=True))
        clipping = numbers["gradient_norm"], numbers["clipped_norm"]
        self._count(numbers["loss"], clipping, int(numbers["evaluations"]), rays, rate, more)
        if self.average and self.progress >= 1.0:
            self.average.adopt()

    def amplifier_scalars(self) -> dict[str, float | None]:
        amplifier = getattr(self.field, "amplifier", None)
        return {
            name: getattr(amplifier, name).item() if hasattr(amplifier, name) else None for name in ("alpha", "beta")
        }

    def rendered_by(self) -> dict[str, Any]:
        return {
            **self._rendered_by(),
            "own": asdict(self.own) if self.own is not None else None,
            "sampling": asdict(self.sampling()),
            "network": asdict(self.settings.network),
            "precision": self.settings.precision,
            "accelerations": asdict(self.settings.accelerations),
            "view_dependent": self.view_dependent,
            "background": self.background.tolist(),
        }

    def restore(self, tensors: dict[str, Tensor], step: int) -> None:
        weights = dict(tensors)
        occupied = weights.pop(OCCUPIED, None)
        self.fields.load_state_dict(weights)
        if (occupied is None) != (self.grid is None):
            raise ValueError("an occupancy grid is only in the settings or only in the checkpoint")
        if self.grid is not None and occupied is not None:
            if occupied.shape != self.grid.occupied.shape or occupied.dtype != torch.bool:
                raise ValueError(f"an occupancy grid of {occupied.dtype} {tuple(occupied.shape)}")
            self.grid.occupied.copy_(occupied)
        self.step = step

    def optimiser_tensors(self) -> dict[str, Tensor]:
        means = self.average.tensors() if self.average else {}
        return {**self.optimiser.tensors(), **{MEAN + name: value for name, value in means.items()}}

    def restore_optimiser(self, tensors: dict[str, Tensor]) -> None:
        means = {name.removeprefix(MEAN): value for name, value in tensors.items() if name.startswith(MEAN)}
        if self.average:
            self.average.restore(means)
        self.optimiser.restore({name: value for name, value in tensors.items() if not name.startswith(MEAN)})

    def sampling(self, training: bool = False) -> Sampling:
        grid = self.settings.grid
        # also without the grid, so that switching it off changes nothing but the omission
        settled = grid.cells == 0 or self.whole_rays or self.step > grid.first_step
        bins = self.settings.bins if settled else self.settings.first_bins
        return Sampling(
            bins=bins if training else max(bins, self.settings.rendered_bins or bins),
            fine_bins=self.settings.fine_bins,
            quadrature=self.quadrature,
            clip_to_box=self.settings.accelerations.clipping and not self.whole_rays,
            early_stop=self.settings.accelerations.early_stop and self.quadrature == "midpoint",
            hidden=self.settings.accelerations.hidden and self.quadrature == "midpoint",
            exploration=self.settings.grid.exploration,
            # without a grid nearly all points are evaluated, and aligned multiplications are faster
            fixed=self.turns is not None and (training or self.grid is None),
            capacity=self.turns.capacity if self.turns is not None and training else 1.0,
        )

    def _rendered(
        self, rays: Rays, draws: Draws | None, first: int = 0, bins: int | None = None, looks: bool = True
    ) -> Rendering:
        """Render one chunk, in training with `draws`. Without `looks` the host reads nothing of fixed shapes."""
        sampling = self.sampling(training=draws is not None)
        if looks:
            rays.require_finite()
            sampling = replace(sampling, capacity=1.0)  # whoever looks drops no point
        if bins is not None:
            sampling = replace(sampling, bins=bins, fine_bins=round(sampling.fine_bins * bins / sampling.bins))
        try:
            shown = render_rays(self.coarse, self.fine, rays, self.box, sampling, self.grid, self.background, draws)
            if looks and shown.counts is not None and shown.samples is not None and int(shown.counts.invalid):
                require_density(shown.samples.density)
                raise self._diverged("density of the coarse pass")
            return shown
        except BadDensity as error:
            raise self._diverged(f"density of sample {error.sample} of ray {first + error.ray}") from error
        except FloatingPointError as error:  # the coarse pass gave weights that are not finite
            raise Diverged(self.step, self._first_not_finite("weight")) from error

    def loss(self, rays: Rays, colours: Tensor, draws: Draws, looks: bool = False) -> StepLoss:
        """Return the error of display colours, with that of the coarse pass if there is one (as the original)."""
        rendering = self._rendered(rays, draws, looks=looks)
        loss = self.error(rendering.colour, colours)
        if rendering.coarse_colour is not None:
            loss = loss + self.error(rendering.coarse_colour, colours)
        return StepLoss(loss, rendering.network_evaluations, rendering.counts)

    def _checked_loss(self, rays: Rays, colours: Tensor, draws: Draws) -> StepLoss:
        result = self.loss(rays, colours, draws, looks=True)
        if not math.isfinite(result.loss.item()):
            raise self._diverged("loss")
        return result

    def _look(self, norm: Tensor) -> None:
        if not math.isfinite(norm.item()):
            raise Diverged(self.step, self._first_not_finite("gradient"))

    def refresh_grid(self) -> None:
        settings = self.settings.grid
        since = self.step - settings.first_step
        if self.grid is None or since < 0 or since % settings.every:
            return
        share = 1.0 if since == 0 else settings.share
        generator = generator_for(self.seed, self.step, "grid")
        self.network_evaluations += self.grid.refresh(self.field, share, generator)
        if not bool(torch.isfinite(self.grid.density).all()):
            # a NaN exceeds no threshold: the cell would count as empty for good
            raise Diverged(self.step, "density in the occupancy grid")

    def _diverged(self, where: str) -> Diverged:
        """Return the error, which names a weight that is not finite rather than `where`."""
        return Diverged(self.step, where if _all_finite(self._weights.values()) else self._first_not_finite("weight"))

    def _first_not_finite(self, what: str) -> str:
        for name, weight in self._weights.items():
            tensor = weight.grad if what == "gradient" else weight
            if tensor is not None and not bool(torch.isfinite(tensor).all()):
                return f"{what} of {name}"
        return f"norm of all {what}s"


def _norms(tensors: list[Tensor]) -> tuple[Float[Tensor, " tensors"], Float[Tensor, ""]]:
    """Return the norm of each tensor, and that of all together."""
    norms = torch.stack(torch._foreach_norm(tensors))
    return norms, torch.linalg.vector_norm(norms)


def _by_layer(norms: Iterable[tuple[str, float]]) -> dict[str, float]:
    """Return the norms of the gradients of layers, from those of their weights and biases."""
    squares: dict[str, float] = {}
    for name, norm in norms:
        layer = LAYER + name.removeprefix("coarse.").removesuffix(".weight").removesuffix(".bias")
        squares[layer] = squares.get(layer, 0.0) + norm**2
    return {layer: math.sqrt(square) for layer, square in squares.items()}


def _all_finite(tensors: Iterable[Tensor]) -> bool:
    """Return whether all values are finite, with a single synchronisation if every norm is finite, the usual case."""
    listed = [tensor.detach() for tensor in tensors]
    return bool(torch.isfinite(_norms(listed)[1])) or all(bool(torch.isfinite(tensor).all()) for tensor in listed)
