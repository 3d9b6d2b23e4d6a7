"""The interface between a method and the code that trains and renders it."""

import hashlib
import math
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn


@dataclass(frozen=True)
class Accelerations:
    """The accelerations. By default all are on, for every method that they can apply to."""

    grid: bool = True
    """Whether an occupancy grid skips empty space (`GridSettings` has its settings)."""
    clipping: bool = True
    """Whether rays are cut to the scene's box, and those that miss it are not sampled."""
    early_stop: bool = True
    """Whether rendering without gradients ends a ray once it is opaque (not where density depends on the chunk)."""
    directions: bool = True
    """Whether scenes that look the same from all sides get no view direction."""
    hull: bool = True
    """Whether nothing is sampled outside the hull of the training images' silhouettes."""
    hidden: bool = True
    """Whether training evaluates nothing behind what the grid measured as opaque (if the density is pointwise)."""

    def without(self, names: tuple[str, ...]) -> "Accelerations":
        """Return a copy with `names` switched off. Raises `ValueError` for an unknown name, listing the known names."""
        known = [acceleration.name for acceleration in fields(self)]
        if unknown := [name for name in names if name not in known]:
            raise ValueError(f"unknown {' '.join(map(repr, unknown))}; known: {' '.join(known)}")
        return replace(self, **dict.fromkeys(names, False))


EVERY_ACCELERATION = Accelerations()
NO_ACCELERATION = Accelerations(*(False for _ in fields(Accelerations)))


UNIT_TOLERANCE = 1e-3


@dataclass(frozen=True)
class Rays:
    """Rays of unit direction, world frame; `near` and `far` are distances along them."""

    origins: Float[Tensor, "rays 3"]
    directions: Float[Tensor, "rays 3"]
    near: float
    far: float

    def __len__(self) -> int:
        return self.origins.shape[0]

    def part(self, start: int, stop: int) -> "Rays":
        return Rays(self.origins[start:stop], self.directions[start:stop], self.near, self.far)

    def to(self, where: torch.device | torch.dtype) -> "Rays":
        return Rays(self.origins.to(where), self.directions.to(where), self.near, self.far)

    def require_finite(self) -> None:
        """Raise `ValueError` naming the first ray with a NaN or an infinity, or the ray whose direction is farthest
        from unit length. The test against a box would take a NaN for a miss, and a renderer would show background.
        """
        if (ray := first_not_finite(self.origins, self.directions)) is not None:
            raise ValueError(
                f"ray {ray} is not finite: origin {self.origins[ray].tolist()}, "
                f"direction {self.directions[ray].tolist()}"
            )
        length = self.directions.norm(dim=-1)
        off = (length - 1.0).abs()
        if len(self) and bool((off > UNIT_TOLERANCE).any()):
            ray = int(off.argmax())
            raise ValueError(
                f"ray {ray} has a direction of length {float(length[ray]):.6g}: distances along it would not be scene "
                "units, and its opacity would depend on that length; normalise it"
            )

    def chosen(self, index: Int[Tensor, " chosen"]) -> "Rays":
        return Rays(self.origins[index], self.directions[index], self.near, self.far)


def first_not_finite(*tensors: Tensor) -> int | None:
    """Return the first row with a NaN or an infinity in any of the tensors; None if there is none."""
    # one sum tests all values: it is finite unless a value is not or, rarely, the values are huge
    if math.isfinite(float(sum(tensor.sum() for tensor in tensors))):
        return None
    finite = torch.stack([torch.isfinite(tensor).reshape(len(tensor), -1).all(dim=-1) for tensor in tensors]).all(dim=0)
    return None if bool(finite.all()) else int(finite.int().argmin())


@dataclass(frozen=True)
class Box:
    """The axis-aligned box outside which the scene is known to be empty."""

    lower: Float[Tensor, " 3"]
    upper: Float[Tensor, " 3"]
    hull: Bool[Tensor, "cells cells cells"] | None = None
    """The cells of the box that the silhouettes allow to hold something; the others are known to be empty."""
    pixels_across: float | None = None
    """The length in pixels of the longest side, at the box's centre in a mean training view; None: not known."""

    def to_unit(self, x: Float[Tensor, "*points 3"]) -> Float[Tensor, "*points 3"]:
        """Map world coordinates to box coordinates in [0, 1]³."""
        return (x - self.lower) / (self.upper - self.lower)

    def from_unit(self, unit: Float[Tensor, "*points 3"]) -> Float[Tensor, "*points 3"]:
        return self.lower + unit * (self.upper - self.lower)

    @property
    def half_extent(self) -> float:
        """Return half of the longest side, in scene units: density is counted per this length."""
        return 0.5 * float((self.upper - self.lower).max())

    def normalised(self, x: Float[Tensor, "*points 3"]) -> Float[Tensor, "*points 3"]:
        """Map world coordinates to centre 0 and longest half-extent 1, as an encoding takes them."""
        return (x - 0.5 * (self.lower + self.upper)) / (0.5 * (self.upper - self.lower).max())


@dataclass(frozen=True)
class Samples:
    """The points of a batch of rays; density and weight are 0 where the field was not evaluated."""

    density: Float[Tensor, "rays points"]
    """The density in 1 / scene unit, as it was rendered."""
    weight: Float[Tensor, "rays points"]
    """The weight w of the point's colour in the ray's colour."""


@dataclass(frozen=True)
class Counts:
    """Counts of a rendering with fixed shapes, on its device: the host has read none of them."""

    invalid: Int[Tensor, ""]
    """The densities that are negative or not finite."""
    needed: Float[Tensor, ""]
    """The share of the points that were to be evaluated; where it exceeds the capacity, the rest were dropped."""

    def joined(self, other: "Counts") -> "Counts":
        return Counts(self.invalid + other.invalid, torch.maximum(self.needed, other.needed))


@dataclass(frozen=True)
class Rendering:
    colour: Float[Tensor, "rays 3"]
    """The display colour over the background."""
    opacity: Float[Tensor, " rays"]
    depth: Float[Tensor, " rays"]
    """The expected distance of the hit; far where nothing was hit."""
    network_evaluations: int
    coarse_colour: Float[Tensor, "rays 3"] | None = None
    """The colour of the coarse pass, if there are two passes."""
    counts: Counts | None = None
    """The counts of a rendering with fixed shapes."""
    samples: Samples | None = None
    """The samples of the last pass; None for several chunks, and for a method that does not sample points of rays."""


@dataclass(frozen=True)
class NetworkSize:
    """The size of the networks, by default that of Table 1 of the paper."""

    depth: int = 8
    width: int = 256
    colour_layers: int = 2
    colour_width: int = 128
    position_bands: int = 10
    direction_bands: int = 4


Precision = Literal["float32", "bfloat16", "float16"]
"""The precision of matrix multiplications; weights, encoding, amplifier and quadrature are always float32."""
DTYPES = {"float32": torch.float32, "bfloat16": torch.bfloat16, "float16": torch.float16}


@dataclass(frozen=True)
class FieldSpec:
    size: NetworkSize
    """The size of the networks that it is compared with."""
    box: Box
    precision: Precision
    seed: int | str
    """The seed, on which the first weights depend and on nothing else (`uniform_weights`)."""
    view_dependent: bool
    """Whether colour may depend on direction; False where the scene looks the same from all sides."""
    own: Any


Points = Float[Tensor, "points 3"]
Densities = Float[Tensor, " points"]
"""Densities in 1 / scene unit."""
Views = Float[Tensor, "rays features"]
"""The output of `RadianceField.encode_directions` for each ray."""
RayOf = Int[Tensor, " points"]
"""The row of `Views` that belongs to each point."""


@runtime_checkable
class DensityField(Protocol):
    """A density for each point in space.

    Density is in 1 / scene unit. A field made for a box k times as large has 1 / k of the density, so that no result
    depends on the unit of length (`Box.half_extent`).
    """

    @property
    def pointwise(self) -> bool:
        """Return whether a point's density does not depend on the other points of the chunk."""

    def density(self, x: Points) -> Densities: ...
    def density_before_and_after(self, x: Points) -> tuple[Densities, Densities]:
        """Return the density entering the amplifier and the density that is rendered; equal without an amplifier."""


@runtime_checkable
class RadianceField(DensityField, Protocol):
    """A density and a colour for each point in space: all that a renderer needs of a method."""

    def encode_directions(self, d: Float[Tensor, "rays 3"]) -> Views: ...
    def density_and_colour(self, x: Points, view: Views, ray: RayOf) -> tuple[Densities, Float[Tensor, "points 3"]]: ...


@runtime_checkable
class LearnedField(DensityField, Protocol):
    @property
    def density_limit(self) -> float:
        """The density that no point exceeds, in 1 / scene unit; infinite where there is no such limit."""

    def parameter_counts(self) -> dict[str, int]:
        """Count the learnt numbers by component, with their `total`."""


@runtime_checkable
class TrainableField(RadianceField, LearnedField, Protocol):
    """The interface of a field that a method makes itself, in addition to that of `torch.nn.Module`."""


def uniform_weights(shape: tuple[int, ...], bound: float, seed: int | str, name: str) -> Float[Tensor, "..."]:
    """Draw a parameter from U(−bound, bound) by (seed, parameter name): equal for equal name and shape."""
    digest = hashlib.blake2b(f"{seed}/{name}".encode(), digest_size=8).digest()
    generator = torch.Generator().manual_seed(int.from_bytes(digest, "little") >> 1)
    return (2.0 * torch.rand(shape, generator=generator, dtype=torch.float32) - 1.0) * bound


def glorot(named: Iterable[tuple[str, nn.Parameter]], seed: int | str) -> None:
    """Set Glorot-uniform matrices and zero biases, as the original NeRF does."""
    with torch.no_grad():
        for name, parameter in named:
            if parameter.ndim == 2:
                bound = (6.0 / sum(parameter.shape)) ** 0.5
                parameter.copy_(uniform_weights(tuple(parameter.shape), bound, seed, name))
            else:
                parameter.zero_()


def counts_by_component(field: nn.Module) -> dict[str, int]:
    counts = {name: sum(weight.numel() for weight in part.parameters()) for name, part in field.named_children()}
    return {**counts, "total": sum(counts.values())}
