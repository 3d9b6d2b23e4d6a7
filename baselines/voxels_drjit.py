"""A radiance field without a network: density and spherical harmonics on a voxel grid, differentiated by Dr.Jit.

It is the peer of a different kind: Plenoxels (Fridovich-Keil et al. 2022) and DVGO (Sun et al. 2022) without their
engineering, coarse to fine. Importing this module imports Dr.Jit but not Mitsuba.
"""

import importlib
import math
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, TypeAlias

import drjit as dr
import torch
from jaxtyping import Float, Int
from torch import Tensor

from baselines.contract import Box, Densities, Points, Rays, Rendering
from baselines.methods.explicit import VoxelSettings
from baselines.numerics.amplifier import softplus_shift
from baselines.numerics.bounds import ray_box
from baselines.numerics.sampling import points_in_bins, uniform_edges

JitArray: TypeAlias = Any
"""An array of Dr.Jit, of the CPU or of a GPU; Dr.Jit has no common type of them."""
THIN = 0.05
"""The optical depth below which 1 − exp(−τ) is computed from its series, as Dr.Jit has no expm1. The omitted terms are
below 3e-9 of the result, while the difference would lose a digit for each power of ten.
"""


def corners(unit: JitArray, shape: tuple[int, int, int]) -> list[tuple[JitArray, JitArray]]:
    """Return index and weight of each of the eight voxels around points in [0, 1]³ in a grid of `shape` (x, y, z)
    voxels. Values belong to voxel centres, and the border is extended.

    The interpolation is that of Mitsuba's `gridvolume` and torch's `grid_sample(align_corners=False,
    padding_mode="border")`.
    """
    integer = dr.int32_array_t(type(unit.x))
    low, high, share = [], [], []
    for position, voxels in zip(unit, shape, strict=True):
        at = position * voxels - 0.5
        below = dr.floor(at)
        low.append(dr.clip(integer(below), 0, voxels - 1))
        high.append(dr.clip(integer(below) + 1, 0, voxels - 1))
        share.append(at - below)
    weighted = []
    for corner in range(8):
        upper = [bool(corner >> axis & 1) for axis in range(3)]
        x, y, z = (high[axis] if upper[axis] else low[axis] for axis in range(3))
        wx, wy, wz = (share[axis] if upper[axis] else 1.0 - share[axis] for axis in range(3))
        weighted.append(((z * shape[1] + y) * shape[0] + x, wx * wy * wz))
    return weighted


def interpolated(values: JitArray, at: list[tuple[JitArray, JitArray]], kind: type) -> JitArray:
    """Interpolate a flat array that holds one `kind` (a number, or a few adjacent numbers) per voxel."""
    return sum(weight * dr.gather(kind, values, dr.uint32_array_t(type(index))(index)) for index, weight in at)


def softplus(x: Any) -> JitArray:
    """Return log(1 + exp x), without overflow."""
    return dr.maximum(x, 0.0) + dr.log(1.0 + dr.exp(-dr.abs(x)))


def lost(tau: JitArray) -> JitArray:
    """Return 1 − exp(−τ), accurate to all digits, and so is its gradient."""
    series = tau * (1.0 - tau * (1 / 2 - tau * (1 / 6 - tau * (1 / 24 - tau * (1 / 120 - tau / 720)))))
    thin = tau < THIN
    return dr.select(thin, series, 1.0 - dr.exp(-dr.select(thin, 1.0, tau)))


over_rays = partial(dr.block_reduce, dr.ReduceOp.Add)


Backend = Literal["llvm", "cuda"]

CHANNELS = ("red", "green", "blue")
USUAL = VoxelSettings()
DEGREE = 1
"""The degree of the spherical harmonics, where colour depends on the direction."""


@dataclass(frozen=True)
class Samples:
    """Points along the rays that meet the box, as Dr.Jit arrays."""

    origin: JitArray
    direction: JitArray
    t: JitArray
    delta: JitArray
    """The bin lengths of the points, ray after ray."""
    rays: int
    bins: int


class VoxelField:
    """The learnt arrays. Inputs and outputs are torch tensors; everything between is computed by Dr.Jit."""

    density_limit = math.inf
    pointwise = True

    def __init__(
        self, box: Box, voxels: int, view_dependent: bool, backend: Backend, own: VoxelSettings = USUAL
    ) -> None:
        """Create thin grey fog everywhere, with `voxels` along the longest side of the box."""
        self.backend: Backend = backend
        self.types: Any = importlib.import_module(f"drjit.{backend}.ad")
        self.box = box
        self.lower, self.upper = box.lower.tolist(), box.upper.tolist()
        self.own = own
        self.density_unit = own.density_scale / box.half_extent
        self.shift = softplus_shift(own.start / own.density_scale)  # before softplus: a fresh field has its start
        self.degree = DEGREE if view_dependent else 0
        self.shape = shape_of(box, voxels)
        count = math.prod(self.shape)
        sizes = {"density": count, **dict.fromkeys(CHANNELS, count * self.coefficients)}
        self.values = _zeros(self.types.Float, sizes)

    @property
    def coefficients(self) -> int:
        return (self.degree + 1) ** 2

    def parameter_counts(self) -> dict[str, int]:
        density = len(self.values["density"])
        colour = sum(len(self.values[name]) for name in CHANNELS)
        return {"density_grid": density, "colour_grid": colour, "total": density + colour}

    def state_dict(self) -> dict[str, Tensor]:
        """Return `density` [z, y, x] and each colour [z, y, x, coefficients] before softplus and sigmoid."""
        return {name: self._as_grid(name) for name in self.values}

    def filled(self, values: dict[str, Tensor]) -> "VoxelField":
        """Return a field with the values of a `state_dict`. Raises `ValueError` if it is of another box or degree."""
        shape = tuple(values["density"].shape[::-1])
        field = VoxelField(self.box, max(shape), self.degree > 0, self.backend, self.own)
        for name in field.values:
            expected = shape[::-1] if name == "density" else (*shape[::-1], self.coefficients)
            if field.shape != shape or tuple(values[name].shape) != expected:
                raise ValueError(f"{name} of shape {tuple(values[name].shape)}, {expected} in a grid of {field.shape}")
            field.values[name] = self._flat(values[name].reshape(-1))
        return field

    def refined(self, voxels: int) -> "VoxelField":
        finer = VoxelField(self.box, voxels, self.degree > 0, self.backend, self.own)
        for name in self.values:
            grid = self._as_grid(name)
            channels = (grid.unsqueeze(-1) if grid.ndim == 3 else grid).permute(3, 0, 1, 2)
            resized = torch.nn.functional.interpolate(
                channels.unsqueeze(0), size=finer.shape[::-1], mode="trilinear", align_corners=False
            )
            finer.values[name] = self._flat(resized[0].permute(1, 2, 3, 0))
        return finer

    def density(self, x: Points) -> Densities:
        with dr.suspend_grad():
            return self._torch(self._density(corners(self._in_box(self._triple(x)), self.shape)), x.device)

    def density_before_and_after(self, x: Points) -> tuple[Densities, Densities]:
        sigma = self.density(x)
        return sigma, sigma

    def samples(
        self, rays: Rays, bins: int, generator: torch.Generator | None
    ) -> tuple[Samples | None, Int[Tensor, " hits"]]:
        """Return the points of the rays that meet the box, None without such rays, and which these are; random in their
        bins with a generator (training), else midpoints.
        """
        entry, leave, hit = ray_box(rays.origins, rays.directions, self.box.lower, self.box.upper, rays.near, rays.far)
        inside = torch.nonzero(hit)[:, 0]
        if len(inside) == 0:
            return None, inside
        edges = uniform_edges(entry[inside], leave[inside], bins)
        t = points_in_bins(edges, generator)
        origin, direction = self._triple(rays.origins[inside]), self._triple(rays.directions[inside])
        flat_t, delta = self._flat(t), self._flat(torch.diff(edges, dim=-1))
        return Samples(origin, direction, flat_t, delta, len(inside), bins), inside

    def loss_and_gradients(
        self,
        samples: Samples,
        colours: Float[Tensor, "hits 3"],
        share: float,
        smooth: Int[Tensor, " voxels"],
        smoothing: float,
    ) -> tuple[float, float, dict[str, JitArray]]:
        """Return `share` times the sum of squared errors of the display colours over white; the sum of squares of the
        gradient; and the gradient, which includes that of `smoothing` times the mean squared difference of the voxels
        `smooth` from their neighbours.
        """
        dr.enable_grad(self.values)
        shown, _, _ = self._seen(samples)
        truth = self._triple(colours)
        error = share * sum(dr.sum(dr.square(seen - true)) for seen, true in zip(shown, truth, strict=True))
        _finished(smooth.device)
        rough = self._roughness(self.types.UInt32(self.types.TensorXi(smooth.to(torch.int32).contiguous()).array))
        dr.backward(error + smoothing * rough)
        gradients = {name: dr.grad(value) for name, value in self.values.items()}
        dr.disable_grad(self.values)  # leaves plain numbers behind, also after an error
        square = sum(dr.sum(dr.square(gradient)) for gradient in gradients.values())
        dr.eval(error, square, gradients)
        return float(error[0]), float(square[0]), gradients

    def render(self, rays: Rays, bins: int) -> Rendering:
        """Render at the midpoints of the bins, over white."""
        samples, inside = self.samples(rays, bins, None)
        white = torch.ones_like(rays.origins)
        nothing, far = torch.zeros_like(white[:, 0]), torch.full_like(white[:, 0], rays.far)
        if samples is None:
            return Rendering(white, nothing, far, 0)
        with dr.suspend_grad():
            shown, w, opacity = self._seen(samples)
            hit = opacity > 0.0
            depth = dr.select(hit, over_rays(w * samples.t, bins) / dr.select(hit, opacity, 1.0), rays.far)
            device = rays.origins.device
            white[inside] = torch.stack([self._torch(channel, device) for channel in shown], dim=-1)
            nothing[inside] = self._torch(opacity, device)
            far[inside] = self._torch(depth, device)
        return Rendering(white, nothing, far, samples.rays * bins)

    def _seen(self, samples: Samples) -> tuple[list[JitArray], JitArray, JitArray]:
        """Return the rays' colours over white by channel, the weights of their points, and the rays' opacities."""
        types, bins = self.types, samples.bins
        ray = dr.arange(types.UInt32, samples.rays * bins) // bins
        direction = dr.gather(types.Array3f, samples.direction, ray)
        position = dr.fma(direction, samples.t, dr.gather(types.Array3f, samples.origin, ray))
        at = corners(self._in_box(position), self.shape)
        tau = self._density(at) * samples.delta
        before = dr.block_prefix_reduce(dr.ReduceOp.Add, tau, bins, exclusive=True)
        w, T_end = dr.exp(-before) * lost(tau), dr.exp(-over_rays(tau, bins))
        harmonics = dr.sh_eval(direction, self.degree)
        shown = []
        for name in CHANNELS:
            kind = types.Float if self.degree == 0 else types.Array4f
            held = interpolated(self.values[name], at, kind)
            held = [held] if self.degree == 0 else held
            logit = sum(basis * factor for basis, factor in zip(harmonics, held, strict=True))
            shown.append(over_rays(w * (1.0 / (1.0 + dr.exp(-logit))), bins) + T_end)
        return shown, w, over_rays(w, bins)

    def _density(self, at: JitArray) -> JitArray:
        raw = interpolated(self.values["density"], at, self.types.Float)
        return self.density_unit * softplus(raw + self.shift)

    def _roughness(self, voxel: JitArray) -> JitArray:
        """Return the mean squared difference of the chosen voxels from the next voxel along each axis."""
        nx, ny, nz = self.shape
        x, y, z = voxel % nx, voxel // nx % ny, voxel // (nx * ny)
        following = [
            (z * ny + y) * nx + dr.minimum(x + 1, nx - 1),
            (z * ny + dr.minimum(y + 1, ny - 1)) * nx + x,
            (dr.minimum(z + 1, nz - 1) * ny + y) * nx + x,
        ]
        total = 0.0
        for name, values in self.values.items():
            kind = self.types.Float if name == "density" or self.degree == 0 else self.types.Array4f
            here = dr.gather(kind, values, voxel)
            for other in following:
                square = dr.square(dr.gather(kind, values, other) - here)
                total = total + dr.mean(square if kind is self.types.Float else dr.sum(square, axis=0))
        return total

    def _in_box(self, x: JitArray) -> JitArray:
        size = [high - low for low, high in zip(self.lower, self.upper, strict=True)]
        return self.types.Array3f(*((x[i] - self.lower[i]) / size[i] for i in range(3)))

    # the border between torch and Dr.Jit

    def _flat(self, values: Tensor) -> JitArray:
        _finished(values.device)
        return self.types.Float(self.types.TensorXf(values.detach().float().contiguous()).array)

    def _triple(self, x: Points) -> JitArray:
        return self.types.Array3f(*(self._flat(x[:, i]) for i in range(3)))

    def _torch(self, values: JitArray, device: torch.device) -> Tensor:
        held = dr.detach(values)
        dr.eval(held)
        dr.sync_thread()
        return torch.tensor(held.numpy(), device=device)  # a copy, as Dr.Jit reuses its memory

    def _as_grid(self, name: str) -> Tensor:
        shape = self.shape[::-1] if name == "density" else (*self.shape[::-1], self.coefficients)
        return self._torch(self.values[name], torch.device("cpu")).reshape(shape)


class Adam:
    """Adam (Kingma & Ba) on the flat arrays of a field, computed by Dr.Jit."""

    def __init__(self, field: VoxelField) -> None:
        sizes = {name: len(value) for name, value in field.values.items()}
        self.first, self.second = _zeros(field.types.Float, sizes), _zeros(field.types.Float, sizes)
        self.betas, self.epsilon = field.own.betas, field.own.epsilon
        self.steps = 0

    def state_dict(self) -> dict[str, Tensor]:
        """Return `steps` [], and `first` and `second` moments by the field's arrays, flat."""
        tensors = {"steps": torch.tensor(self.steps)}
        for kind, values in {"first": self.first, "second": self.second}.items():
            tensors |= {f"{kind}.{name}": torch.tensor(value.numpy()) for name, value in values.items()}
        return tensors

    def load_state_dict(self, tensors: dict[str, Tensor]) -> None:
        """Restore the moments; raises `KeyError` if one is missing."""
        self.steps = int(tensors["steps"])
        for kind, values in {"first": self.first, "second": self.second}.items():
            for name, old in values.items():
                values[name] = type(old)(tensors[f"{kind}.{name}"].cpu().numpy())

    def step(self, field: VoxelField, gradients: dict[str, JitArray], rate: float, scale: float) -> None:
        self.steps += 1
        number = field.types.Float
        # opaque, as numbers that change between steps must not be part of the compiled kernel
        share = dr.opaque(number, scale)
        beta_1, beta_2 = self.betas
        ahead = dr.opaque(number, rate / (1.0 - beta_1**self.steps))
        spread = dr.opaque(number, 1.0 / (1.0 - beta_2**self.steps))
        for name, gradient in gradients.items():
            g = dr.detach(gradient) * share
            first = beta_1 * self.first[name] + (1.0 - beta_1) * g
            second = beta_2 * self.second[name] + (1.0 - beta_2) * g * g
            self.first[name], self.second[name] = first, second
            field.values[name] = field.values[name] - ahead * first / (dr.sqrt(second * spread) + self.epsilon)
        dr.eval(field.values, self.first, self.second)


def shape_of(box: Box, voxels: int) -> tuple[int, int, int]:
    """Return the voxels along x, y and z: `voxels` along the longest side, as cubic as that allows."""
    size = (box.upper - box.lower).tolist()
    x, y, z = (max(1, round(voxels * side / max(size))) for side in size)
    return x, y, z


def _zeros(kind: Any, sizes: dict[str, int]) -> dict[str, JitArray]:
    """Return zeros, each in separate memory. Dr.Jit compiles a literal or shared zero into the kernel, so that the
    first steps would need other kernels than later steps.
    """
    return {name: dr.opaque(kind, 0.0, size) for name, size in sizes.items()}


def _finished(device: torch.device) -> None:
    """Wait for torch, whose queue Dr.Jit does not wait for."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)
