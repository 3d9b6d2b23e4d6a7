"""The points where a ray enters and leaves a box."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor


def ray_box(
    o: Float[Tensor, "rays 3"],
    d: Float[Tensor, "rays 3"],
    lower: Float[Tensor, " 3"],
    upper: Float[Tensor, " 3"],
    near: float,
    far: float,
) -> tuple[Float[Tensor, " rays"], Float[Tensor, " rays"], Bool[Tensor, " rays"]]:
    """Return entry and exit distance within [near, far], and whether the ray meets the box there.

    This is the slab method. A ray that misses gets an empty interval (exit = entry), so that its bins have length 0.
    Where a component of `d` is zero the ray is inside this slab always or never: division gives ±inf, which is right,
    except 0 · inf exactly on a face of the slab, which counts as inside.
    """
    inverse = 1.0 / (d + 0.0)  # −0 becomes +0: 1 / −0 would put both faces of the slab on the same side
    first = torch.nan_to_num((lower - o) * inverse, nan=-torch.inf, posinf=torch.inf, neginf=-torch.inf)
    second = torch.nan_to_num((upper - o) * inverse, nan=torch.inf, posinf=torch.inf, neginf=-torch.inf)
    entry = torch.minimum(first, second).amax(dim=-1).clamp(min=near)
    leave = torch.maximum(first, second).amin(dim=-1).clamp(max=far)
    hit = leave > entry
    entry = torch.where(hit, entry, near)
    return entry, torch.where(hit, leave, entry), hit
