"""The densities in the pictures of a trained method, and the opacity of a pixel of geometry at its largest density."""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from harness.plan.needed import pixels_across
from harness.training.batches import Cameras
from harness.training.learner import Learner
from harness.training.scoring.evaluate import pixel_order, spread_indices
from scenes.view_sets.view_set import ViewSet

VIEWS = 3
"""The number of evenly spread test views whose samples are used."""
RAYS = 4096
"""The maximum number of rays of each view, in one chunk."""
AT_CEILING = 0.99
"""The share of a method's largest density from which a sample counts as at the ceiling."""
QUANTILES = (0.5, 0.9, 0.99)


def quantiles_by_weight(
    values: Float[Tensor, " samples"], weights: Float[Tensor, " samples"], shares: tuple[float, ...]
) -> list[float]:
    """Return for each share the smallest value that, together with all smaller values, has that share of the weight.
    Raises `ValueError` if no sample has a weight.
    """
    if not float(weights.sum()) > 0.0:
        raise ValueError("quantiles of samples without weight")
    ordered, place = values.sort()
    summed = weights[place].double().cumsum(0)
    reached = torch.searchsorted(summed, summed[-1] * torch.tensor(shares, dtype=torch.float64, device=summed.device))
    return [float(ordered[i]) for i in reached.clamp(max=len(ordered) - 1)]


@torch.no_grad()
def rendered_samples(learner: Learner, cameras: Cameras) -> tuple[Tensor, Tensor] | None:
    """Return density (1 / scene unit) and weight of the renderer's samples that have weight, [samples] each, over
    `VIEWS` evenly spread views and `RAYS` random pixels of each in one chunk; None if the pictures are empty, and for a
    method that does not sample points of rays.
    """
    density, weight = [], []
    for view in spread_indices(VIEWS, len(cameras)):
        rays = cameras.all_rays(view)
        chosen = pixel_order(len(rays))[:RAYS].to(rays.origins.device)
        samples = learner.render(rays.chosen(chosen), RAYS).samples
        if samples is None:
            return None
        seen = samples.weight > 0.0
        density.append(samples.density[seen])
        weight.append(samples.weight[seen])
    return (torch.cat(density), torch.cat(weight)) if any(map(len, weight)) else None


def density_properties(learner: Learner, views: ViewSet, test: Cameras) -> dict[str, float | None]:
    """Return a record's properties about the ceiling of density; a pixel has its width at the centre of the box."""
    half, limit = learner.box.half_extent, learner.field.density_limit
    pixel = 2.0 * half / pixels_across(views)
    bounded = math.isfinite(limit)
    known: dict[str, float | None] = {
        "density_limit": limit * half if bounded else None,
        "opacity_of_a_pixel": -math.expm1(-limit * pixel),
    }
    names = [f"density_by_weight_{100 * share:g}" for share in QUANTILES]
    samples = rendered_samples(learner, test)
    if samples is None:
        return {**known, "weight_at_ceiling": None, **dict.fromkeys(names)}
    density, weight = samples
    at_ceiling = float(weight[density >= AT_CEILING * limit].sum()) / float(weight.sum())
    quantiles = quantiles_by_weight(density * half, weight, QUANTILES)
    return {**known, "weight_at_ceiling": at_ceiling, **dict(zip(names, quantiles, strict=True))}
