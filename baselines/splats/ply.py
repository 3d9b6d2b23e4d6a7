"""Gaussians as the PLY file of the reference implementation of 3D Gaussian Splatting, which viewers of splats open.

Its harmonics have the sign (−1)^m of their order m, as Mitsuba's, and its pictures are blurred by 0.3 square pixels.
"""

import math
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import normalize

from baselines.contract import Box
from baselines.splats.gaussians import Gaussians, parts_of

BLURRED = 0.3
"""The variance in square pixels by which the reference implementation blurs its pictures."""
FIXED = ("x", "y", "z", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3", "opacity",
         "f_dc_0", "f_dc_1", "f_dc_2")  # fmt: skip
"""The properties in the order of `baselines.splats.rasteriser.COLUMNS`; the harmonics follow."""
DEGREES = {3 * ((degree + 1) ** 2 - 1): degree for degree in range(4)}
"""Number of harmonics above degree 0 → their degree."""
MOST = 1 << 24
LARGEST = 1e5
"""The largest number and the largest standard deviation: a picture of larger ones overflows."""


def signs(degree: int) -> Float[Tensor, " harmonics"]:
    """Return the sign of each harmonic above degree 0, red, green and blue of one colour after the other."""
    orders = [order for up_to in range(1, degree + 1) for order in range(-up_to, up_to + 1)]
    return torch.tensor([(-1.0) ** order for order in orders]).repeat(3)


def ply_bytes(field: Gaussians) -> bytes:
    """Return the file of a trained scene, in scene units. Each Gaussian is as large as it is drawn here."""
    position, log_scale, quaternion, logit, base, harmonics = parts_of(field.values.detach().float().cpu())
    half = field.box.half_extent
    middle = 0.5 * (field.box.lower + field.box.upper).float().cpu()
    scales = torch.log(field.scales(log_scale) * half)
    rotation = normalize(quaternion, dim=-1)
    harmonics = harmonics.unflatten(1, (-1, 3)).mT.flatten(1) if field.traced else harmonics * signs(field.degree)
    columns = [position * half + middle, scales, rotation, logit, base, harmonics]
    names = [*FIXED, *(f"f_rest_{k}" for k in range(harmonics.shape[1]))]
    header = "".join(f"property float {name}\n" for name in names)
    count = len(position)
    text = f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{header}end_header\n"
    return text.encode() + torch.cat(columns, dim=1).numpy().astype("<f4").tobytes()


def read_ply(file: Path, focal: float) -> Gaussians:
    """Read Gaussians in scene units, drawn as by the reference implementation at a focal length of `focal` pixels.

    Raises `OSError`, and `ValueError` with the reason for a file of something else or with values that are not finite.
    """
    import trimesh

    try:
        with file.open("rb") as content:
            vertices = trimesh.load(content, file_type="ply", process=False).metadata["_ply_raw"]["vertex"]["data"]
        names = vertices.dtype.names
    except OSError:
        raise
    except Exception as error:
        # trimesh passes on any error of its parser
        raise ValueError(f"is not a PLY file of points ({type(error).__name__})") from error
    if missing := [name for name in FIXED if name not in names]:
        raise ValueError(f"has no property {missing[0]}, so it holds no Gaussians")
    rest = sum(name.startswith("f_rest_") for name in names)
    if rest not in DEGREES or not 0 < len(vertices) <= MOST:
        raise ValueError(f"has {len(vertices)} points with {rest} properties f_rest; 0, 9, 24 or 45 are read")
    columns = [*FIXED, *(f"f_rest_{k}" for k in range(rest))]
    values = torch.from_numpy(np.stack([vertices[name].astype(np.float32) for name in columns], axis=1))
    if not bool((values.abs() <= LARGEST).all() and (values[:, 3:6] <= math.log(LARGEST)).all()):
        raise ValueError(f"has values that are not finite, or lengths above {LARGEST:g}")
    if bool((values[:, 6:10].norm(dim=1) == 0.0).any()):
        raise ValueError("has a rotation of length 0")
    values[:, len(FIXED) :] *= signs(DEGREES[rest])
    box = Box(-torch.ones(3), torch.ones(3))  # in which a scene unit is the unit of length
    return Gaussians(box, DEGREES[rest], values, 0.0, 0.0, BLURRED / focal**2)
