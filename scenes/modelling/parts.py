"""Solids put together: copies, mirror images, and groups by material."""

from collections.abc import Callable, Iterable

import numpy as np

from scenes.modelling.scene import Description
from scenes.modelling.solids import Solid, creased, mesh


def merged(solids: Iterable[Solid]) -> Solid:
    """Return many solids as one; `uv` and `normals` survive if every part has them."""
    parts = list(solids)
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    all_uv = [part.uv for part in parts if part.uv is not None]
    all_normals = [part.normals for part in parts if part.normals is not None]
    return Solid(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + offset for part, offset in zip(parts, offsets, strict=True)]),
        np.concatenate(all_uv) if len(all_uv) == len(parts) else None,
        np.concatenate(all_normals) if len(all_normals) == len(parts) else None,
    )


def around(solid: Solid, count: int) -> Solid:
    """Return that many copies, evenly turned about z."""
    return merged(solid.turned(360.0 * turn / count) for turn in range(count))


def mirrored(solid: Solid) -> Solid:
    """Return the solid and its mirror image, left and right of the plane y = 0."""
    return merged([solid, solid.scaled(1.0, -1.0, 1.0)])


Parts = dict[str, list[Solid]]


def together(*groups: Parts) -> Parts:
    """Merge many groups into one, material by material."""
    result: Parts = {}
    for group in groups:
        for material, solids in group.items():
            result.setdefault(material, []).extend(solids)
    return result


def each(parts: Parts, change: Callable[[Solid], Solid]) -> Parts:
    """Return the parts with every solid changed in the same way, e.g. moved."""
    return {material: [change(solid) for solid in solids] for material, solids in parts.items()}


def meshes(parts: Parts, materials: dict[str, Description]) -> Description:
    """Return one entry of a scene description per material; solids without normals are `creased`."""
    description: Description = {}
    for material, solids in parts.items():
        solid = merged(solid if solid.normals is not None else creased(solid) for solid in solids)
        description[material] = mesh(solid, materials[material])
    return description
