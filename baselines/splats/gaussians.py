"""A scene of 3-D Gaussians with spherical harmonics (3D Gaussian Splatting, arXiv 2308.04079), projected to a camera.

Every Gaussian is widened by part of a pixel of the training views in space, not in the picture (Yu et al. 2024, arXiv
2311.16493), so that a picture of another size shows the same scene.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import cast

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import normalize

from baselines.contract import Box, Densities, Points, Rays, Rendering
from baselines.numerics.compositing import hit_distance
from baselines.splats.rasteriser import COLUMNS, MOST_OPAQUE, NEAREST, Drawn, Eye, add_densities
from baselines.splats.ray_cells import RayCells


def rotations(quaternions: Float[Tensor, "gaussians 4"]) -> Float[Tensor, "gaussians 3 3"]:
    """Return the rotation matrices of quaternions w, x, y, z of any length but 0."""
    w, x, y, z = normalize(quaternions, dim=-1).unbind(dim=-1)
    rows = [
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ]  # fmt: skip
    return torch.stack(rows, dim=-1).reshape(-1, 3, 3)


def parts_of(values: Float[Tensor, "gaussians columns"]) -> tuple[Tensor, ...]:
    """Return the columns by part, in the order of `COLUMNS`, and the harmonics [gaussians, 3 · terms] last."""
    sizes = list(COLUMNS.values())
    parts: tuple[Tensor, ...] = values.split([*sizes, values.shape[1] - sum(sizes)], dim=1)
    return parts


def on_plane(directions: Float[Tensor, "rays 3"], axes: Float[Tensor, "3 3"]) -> Float[Tensor, "rays 2"]:
    """Return where rays meet the plane at distance 1, of which `axes` are the directions right, down and forward."""
    seen = directions @ axes
    return seen[:, :2] / seen[:, 2:]


@dataclass(frozen=True, eq=False)
class Pencil:
    """The rays of one camera, as points of the plane at distance 1 in front of it."""

    origin: Float[Tensor, " 3"]
    axes: Float[Tensor, "3 3"]
    """The directions right, down and forward as columns; any rotation about forward will do."""
    near: float
    cells: RayCells

    @staticmethod
    def of(origin: Float[Tensor, " 3"], directions: Float[Tensor, "rays 3"], near: float) -> "Pencil":
        """Sort the rays, which begin at `near`. Raises `ValueError` if they span half a sphere: no plane shows it."""
        forward = normalize(directions.mean(dim=0), dim=0)
        right = torch.zeros(3).index_fill(0, forward.abs().argmin(), 1.0)
        right = normalize(right - (right @ forward) * forward, dim=0)
        axes = torch.stack([right, torch.linalg.cross(forward, right), forward], dim=1)
        if bool((directions @ forward < 1e-2).any()):
            raise ValueError("rays of one camera that span half a sphere: splats are drawn on a plane")
        return Pencil(origin, axes, near, RayCells.of(on_plane(directions, axes).numpy()))


@dataclass(eq=False)
class Gaussians:
    """The learnt scene: a `baselines.contract.LearnedField` that draws itself."""

    box: Box
    degree: int
    """The degree of the spherical harmonics; 0 if colour does not depend on the direction."""
    values: Float[Tensor, "gaussians columns"]
    """The numbers of `COLUMNS`, then the harmonics of red, green and blue."""
    pixel: float
    """The side of a pixel of the training views in the middle of the box, in halves of the box's longest side."""
    widened: float
    """The standard deviation, in units of `pixel`, by which a Gaussian is widened."""
    blurred: float = 0.0
    """The variance by which the reference implementation, in place of widening, blurs a picture at distance 1."""
    traced: bool = False
    """Whether Mitsuba traces the scene, in which case the harmonics have its signs, and its order: red, green and blue
    of one term after the other.
    """
    pointwise: bool = field(default=True, init=False)
    density_limit: float = field(default=math.inf, init=False)

    @property
    def columns(self) -> int:
        return sum(COLUMNS.values()) + 3 * ((self.degree + 1) ** 2 - 1)

    def parameter_counts(self) -> dict[str, int]:
        counts = {name: len(self.values) * size for name, size in COLUMNS.items()}
        counts["harmonics"] = self.values.numel() - sum(counts.values())
        return {**counts, "total": self.values.numel()}

    def state_dict(self) -> dict[str, Tensor]:
        return {"gaussians": self.values.detach(), "pixel": torch.tensor(self.pixel, dtype=torch.float64)}

    def scales(self, log_scale: Float[Tensor, "gaussians 3"]) -> Float[Tensor, "gaussians 3"]:
        """Return the widened standard deviations along a Gaussian's axes, in halves of the box's longest side."""
        return (torch.exp(2.0 * log_scale) + (self.widened * self.pixel) ** 2).sqrt()

    def draw(
        self, pencil: Pencil, values: Float[Tensor, "gaussians columns"]
    ) -> tuple[Float[Tensor, "rays 4"], Float[Tensor, " rays"], int]:
        """Draw `values`, differentiable once with respect to them. Return colour and depth without a background, times
        opacity; the transmittance; and how often a Gaussian was drawn on a ray. Lengths are in halves of the box's
        longest side.
        """
        origin = self.box.normalised(pencil.origin).to(values.dtype).numpy()
        nearest = max(NEAREST, pencil.near / self.box.half_extent)
        eye = Eye(origin, pencil.axes.to(values.dtype).numpy(), self.widened * self.pixel, self.blurred, nearest)
        return cast("tuple[Tensor, Tensor, int]", Drawn.apply(pencil.cells, eye, values))

    def render(self, rays: Rays) -> Rendering:
        """Render rays of any cameras over white, one camera after the other, with colours in 0 … 1 as a picture holds
        them. Raises `ValueError` as `Pencil.of`.
        """
        colour, opacity = torch.ones(len(rays), 3), torch.zeros(len(rays))
        depth, drawn = torch.full((len(rays),), rays.far), 0
        for of_camera in _by_camera(rays.origins):
            origin = rays.origins[of_camera][0]
            out, through, count = self.draw(Pencil.of(origin, rays.directions[of_camera], rays.near), self.values)
            colour[of_camera] = (out[:, :3] + through[:, None]).clamp(0.0, 1.0)
            opacity[of_camera] = 1.0 - through
            depth[of_camera] = hit_distance(out[:, 3] * self.box.half_extent, opacity[of_camera], rays.far)
            drawn += count
        return Rendering(colour, opacity, depth, drawn)

    @torch.no_grad()
    def density(self, x: Points) -> Densities:
        """Return the sum of the Gaussians at points of the scene. The density of each gives its opacity to a ray
        through the centre of a ball of the same volume.
        """
        position, log_scale, quaternion, logit, *_ = parts_of(self.values)
        scales = self.scales(log_scale)
        opacity = torch.sigmoid(logit[:, 0]).clamp(max=MOST_OPAQUE)
        side = scales.prod(dim=-1).pow(1.0 / 3.0)
        peak = -torch.log1p(-opacity) / (math.sqrt(2.0 * math.pi) * side * self.box.half_extent)
        whitened = rotations(quaternion).mT / scales[:, :, None]
        points = self.box.normalised(x)
        total = np.zeros(len(x), dtype=np.float32)
        far = (4.0 * scales.amax(dim=-1)).numpy()
        add_densities(points.numpy(), position.numpy(), whitened.contiguous().numpy(), peak.numpy(), far, total)
        return torch.from_numpy(total)

    def density_before_and_after(self, x: Points) -> tuple[Densities, Densities]:
        sigma = self.density(x)
        return sigma, sigma


def _by_camera(origins: Float[Tensor, "rays 3"]) -> Iterator[Int[Tensor, " chosen"] | slice]:
    """Yield the rays of each origin; nearly always there is only one origin."""
    if bool((origins == origins[:1]).all()):
        if len(origins):
            yield slice(None)
        return
    _, camera = torch.unique(origins, dim=0, return_inverse=True)
    for number in range(int(camera.max()) + 1):
        yield torch.nonzero(camera == number)[:, 0]
