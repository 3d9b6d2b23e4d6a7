"""The first Gaussians of a scene, and their relocation without thresholds on gradients: 3D Gaussian Splatting as
Markov Chain Monte Carlo (Kheradmand et al. 2024, arXiv 2404.09591). Its random walk of faint Gaussians and its pull
towards few and small ones are left out: from the surface of the hull, a short training scores higher without them.
"""

import math

import torch
from jaxtyping import Float, Int
from torch import Tensor

from baselines.contract import Box
from baselines.splats.rasteriser import OPACITY

MOST_COPIES = 51
"""The maximum number of Gaussians that replace one Gaussian at a time, itself included."""
ORDERS = torch.arange(1, MOST_COPIES + 1, dtype=torch.float64)
TERMS = torch.tensor(
    [
        [-((-1.0) ** k) * math.comb(copies, k) / math.sqrt(k) for k in range(1, MOST_COPIES + 1)]
        for copies in range(MOST_COPIES + 1)
    ],
    dtype=torch.float64,
)
"""Number of copies → the factor of each power of their opacity in their joint weight along a line."""


def first_values(
    box: Box, count: int, columns: int, opacity: float, generator: torch.Generator
) -> Float[Tensor, "gaussians columns"]:
    """Return grey balls at random places on the surface of the silhouettes' hull, which they fill, or in the box."""
    sides = (box.upper - box.lower) / box.half_extent
    if box.hull is None or not bool(box.hull.any()):
        unit, spacing = torch.rand(count, 3, generator=generator), float(sides.prod() / count) ** (1 / 3)
    else:
        shell = box.hull & ~_surrounded(box.hull)
        cells = torch.nonzero(shell)
        chosen = cells[torch.randint(len(cells), (count,), generator=generator)]
        unit = (chosen + torch.rand(count, 3, generator=generator)) / torch.tensor(box.hull.shape)
        cell = float((sides / torch.tensor(box.hull.shape)).prod()) ** (1 / 3)
        spacing = cell * math.sqrt(len(cells) / count)
    values = torch.zeros(count, columns)
    values[:, :3] = (unit - 0.5) * sides
    values[:, 3:6] = math.log(0.5 * spacing)
    values[:, 6] = 1.0
    values[:, OPACITY] = math.log(opacity / (1.0 - opacity))
    return values


def _surrounded(cells: Tensor) -> Tensor:
    """Return the occupied cells whose six neighbours are occupied; beyond the border nothing is."""
    padded = torch.nn.functional.pad(cells, (1, 1, 1, 1, 1, 1), value=False)
    inner = slice(1, -1)
    result = cells.clone()
    for axis in range(3):
        for side in (slice(0, -2), slice(2, None)):
            index = [inner, inner, inner]
            index[axis] = side
            result &= padded[tuple(index)]
    return result


def split_among(
    opacity: Float[Tensor, " chosen"], copies: Int[Tensor, " chosen"]
) -> tuple[Float[Tensor, " chosen"], Float[Tensor, " chosen"]]:
    """Return the opacity of each of `copies` Gaussians in one place that together let through as much light as one of
    `opacity`, and the factor of their scale that keeps the colour along a ray (Eq. 9 of Kheradmand et al., with its
    inner sums of binomial coefficients in closed form). All are float64, and `copies` at most `MOST_COPIES`.
    """
    each = 1.0 - (1.0 - opacity).pow(1.0 / copies)
    together = (TERMS[copies] * each[:, None].pow(ORDERS)).sum(dim=1)
    return each, opacity / together


def relocated(
    values: Float[Tensor, "gaussians columns"], more: int, dead: float, generator: torch.Generator
) -> tuple[Float[Tensor, "all columns"], Int[Tensor, " moved"]]:
    """Move Gaussians of opacity ≤ `dead` to others, drawn by opacity, and add `more`. Return all, and which changed."""
    opacity = torch.sigmoid(values[:, OPACITY])
    faint = torch.nonzero(opacity <= dead)[:, 0]
    alive = torch.nonzero(opacity > dead)[:, 0]
    if not len(alive):
        return values, faint[:0]
    places = torch.cat([faint, torch.arange(len(values), len(values) + more)])
    if not len(places):
        return values, places
    drawn = alive[torch.multinomial(opacity[alive], len(places), replacement=True, generator=generator)]
    sources, first, copies = torch.unique(drawn, return_inverse=True, return_counts=True)
    each, wider = split_among(opacity[sources].double(), (copies + 1).clamp(max=MOST_COPIES))
    each = each.clamp(dead, 1.0 - 1e-6)
    values = torch.cat([values, values.new_zeros(more, values.shape[1])])
    shared = values[sources].clone()
    shared[:, OPACITY] = torch.log(each / (1.0 - each)).float()
    shared[:, 3:6] += torch.log(wider).float()[:, None]
    values[sources] = shared
    values[places] = shared[first]
    return values, torch.cat([sources, places])
