"""What a scene requires of a method and of its renderer, derived from the scene's description alone."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from scenes.scene import Description

LAMBERTIAN = frozenset({"diffuse", "null", "twosided", "mask", "bumpmap", "normalmap", "blendbsdf"})
"""BSDFs that look the same from every side; the wrappers among them if all that they wrap does."""
MEDIA = frozenset({"homogeneous", "heterogeneous"})
_NO_BSDF = frozenset(
    {
        "scene", "mesh", "sphere", "cube", "rectangle", "disk", "cylinder",
        "obj", "ply", "serialized", "sdfgrid", "bsplinecurve", "linearcurve", "shapegroup",
        "instance", "merge", "ref", "constant", "envmap", "directional", "area",
        "point", "spot", "rgb", "spectrum", "uniform", "srgb", "bitmap",
        "checkerboard", "mesh_attribute", "volume", "gridvolume", "constvolume", "homogeneous", "heterogeneous",
        "isotropic", "hg",
    }
)  # fmt: skip


@dataclass(frozen=True)
class Needs:
    """What cannot be left out, and for each what in the scene decides it."""

    view_direction: bool
    """Something looks different from another side."""
    participating_media: bool
    background_model: bool
    """Always False here: light comes from infinitely far away without being seen, so alpha is known."""
    reasons: dict[str, str]
    """Name of the field above → why it is as it is."""


def needs(description: Description) -> Needs:
    """A type that this module does not know counts as one that looks different from every side."""
    types = {entry["type"] for entry in entries(description) if "type" in entry}
    media = sorted(types & MEDIA)
    shiny = sorted(types - LAMBERTIAN - _NO_BSDF)
    return Needs(
        view_direction=bool(shiny or media),
        participating_media=bool(media),
        background_model=False,
        reasons={
            "view_direction": f"not Lambertian: {' '.join(shiny + media)}"
            if shiny or media
            else "every surface is Lambertian and lit statically",
            "participating_media": f"media: {' '.join(media)}" if media else "no participating medium",
            "background_model": "alpha is known",
        },
    )


def left_out(needed: Needs, bounds: np.ndarray) -> list[dict[str, str]]:
    """What a method and the renderer can do without, as `{"what": …, "reason": …}` rows; `bounds` is [2, 3]."""
    low, high = (" ".join(f"{value:.2f}" for value in corner) for corner in bounds)
    rows = [{"what": "samples outside the box", "reason": f"everything lies between ({low}) and ({high})"}]
    for what, field in (
        ("view-direction branch", "view_direction"),
        ("volumetric integrator", "participating_media"),
        ("background model", "background_model"),
    ):
        if not getattr(needed, field):
            rows.append({"what": what, "reason": needed.reasons[field]})
    return rows


def entries(description: Description) -> Iterator[Description]:
    """The description and every dictionary inside it."""
    yield description
    for value in description.values():
        if isinstance(value, dict):
            yield from entries(value)
