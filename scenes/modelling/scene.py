"""A scene: its contents, as plain data, and its cameras."""

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING, Any, Literal

from scenes.files.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np

    from scenes.modelling.placement import Placement
    from scenes.modelling.truth import Truth

Corners = tuple[tuple[float, float, float], tuple[float, float, float]]
Description = dict[str, Any]
"""A Mitsuba scene dictionary of plain data, without sensor and integrator.

It differs in three points from the input of `mitsuba.load_dict`, so that it can be hashed and inspected without
Mitsuba; `scenes.rendering.render` converts them:

* `{"type": "mesh", "vertices": float32 [V, 3], "faces": uint32 [F, 3], "bsdf": {...}}`, optionally with
  `"uv"` float32 [V, 2] and `"normals"` float32 [V, 3];
* a bitmap texture or an environment map holds its pixels: `{"type": "bitmap", "data": float32 [h, w, 3]}`
  (linear RGB unless `"raw"`), `{"type": "envmap", "data": float32 [h, w, 3]}`;
* a transform is a float array [4, 4].

Light comes from infinitely far away (constant, envmap, directional) and is not visible itself, or from shapes that glow
(area). These are visible if the scene has `emitters_seen`, which excludes a sky, because a sky would be visible too.
"""


@dataclass(frozen=True)
class Scene:
    name: str
    title: str
    """The contents and their difficulty; shown in the report."""
    build: Callable[[], Description]
    """Builds the description; two calls give equal descriptions."""
    view_from: Literal["hemisphere", "sphere"] = "hemisphere"
    max_depth: int = 6
    """The longest light path; refraction needs more than diffuse reflection."""
    near: float = 2.0
    far: float = 6.0
    emitters_seen: bool = False
    """Whether a camera sees shapes that glow; such a scene has no sky."""
    box: Corners | None = None
    """The lower and upper corner of the possible extent, for a scene without shapes."""
    truth: "Truth | None" = None
    """The closed form of what a ray sees (`scenes.modelling.truth`), if there is one."""
    file: "Path | None" = None
    """The user's file (`scenes.catalog.scene_file`), if it comes from one."""
    load: "Callable[[ModuleType], tuple[Any, Placement, np.ndarray]] | None" = None
    """Map Mitsuba → its scene, the placement in the view set, and its box [2, 3] in the file: for a file that only
    Mitsuba understands (`scenes.catalog.mitsuba_xml`), whose description holds the facts known without Mitsuba.
    """

    def __post_init__(self) -> None:
        if not 0 < self.near < self.far < float("inf"):
            raise InputError(
                f"scene {self.name}: near {self.near} and far {self.far}: distances must be positive and finite, "
                "near the smaller one"
            )
