"""Plain descriptions and a tiny scene of plain shapes, loaded and rendered with `scalar_rgb`."""

from pathlib import Path
from typing import Any

import numpy as np

from scenes.catalog.stress.patterns import rgb
from scenes.modelling.scene import Description, Scene
from scenes.modelling.solids import Solid, mesh
from scenes.modelling.surfaces import both_sides, matte
from scenes.rendering.render import LoadedScene
from scenes.rendering.store import ensure_view_set
from scenes.rendering.variant import Variant

SCALAR = Variant("scalar_rgb", None, "test")
COUNTS = {"train": 3, "val": 1, "test": 2}
SPP = {"train": 4, "val": 4, "test": 8}


def load(
    description: Description, size: int, width: int | None = None, max_depth: int = 4, emitters_seen: bool = False
) -> LoadedScene:
    scene = Scene("test", "A test scene", lambda: description, max_depth=max_depth, emitters_seen=emitters_seen)
    return LoadedScene(scene, description, SCALAR, width or size, size)


def tiny_description() -> Description:
    corners = np.array([[-1, -1, -0.7], [1, -1, -0.7], [1, 1, -0.7], [-1, 1, -0.7]])
    return {
        "sky": {"type": "constant", "radiance": rgb(1.0, 0.9, 0.8)},
        "ball": {"type": "sphere", "radius": 0.6, "center": [0.2, 0.1, 0.0], "bsdf": matte((0.7, 0.3, 0.1))},
        "floor": mesh(Solid(corners, np.array([[0, 1, 2], [0, 2, 3]])), both_sides({"type": "diffuse"})),
    }


TINY = Scene("tiny", "A ball on a floor", tiny_description, max_depth=4)


def render_tiny(cache: Path, **changes: Any) -> Path:
    """Return the view set of the tiny scene from `ensure_view_set`; keywords override the defaults."""
    options = {"resolution": 16, "counts": COUNTS, "spp": SPP, "variant": "scalar_rgb", **changes}
    return ensure_view_set(TINY, cache_folder=cache, **options)
