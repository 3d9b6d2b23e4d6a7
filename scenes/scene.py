"""A scene: what it holds, as plain data, and from where it is seen."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

Description = dict[str, Any]
"""A Mitsuba scene dictionary made of plain data alone, without sensor and integrator.

Three things differ from what `mitsuba.load_dict` takes, so that a description can be hashed and inspected
without Mitsuba; `scenes.render` converts them:

* `{"type": "mesh", "vertices": float32 [V, 3], "faces": uint32 [F, 3], "bsdf": {...}}`, optionally with
  `"uv"` float32 [V, 2] and `"normals"` float32 [V, 3];
* a bitmap texture or an environment map holds its pixels: `{"type": "bitmap", "data": float32 [h, w, 3]}`
  (linear RGB unless `"raw"`), `{"type": "envmap", "data": float32 [h, w, 3]}`;
* a transform is a float array [4, 4].

Emitters are infinitely far away (constant, envmap, directional): what has a shape is the object.
"""


@dataclass(frozen=True)
class Scene:
    """What Mitsuba renders."""

    name: str
    title: str
    """What is seen and what makes it hard, in a few words; shown in the report."""
    build: Callable[[], Description]
    """Deterministic: two calls give equal descriptions."""
    view_from: Literal["hemisphere", "sphere"] = "hemisphere"
    max_depth: int = 6
    """Longest light path; refraction needs more than diffuse reflection."""
    near: float = 2.0
    far: float = 6.0
