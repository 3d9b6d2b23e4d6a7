"""The specification of a rendered view set, and the digest that names it in the cache."""

import importlib.metadata
from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from scenes.files.digest import digest_of
from scenes.modelling.needs import needs
from scenes.modelling.normalise import Similarity
from scenes.modelling.placement import Placement
from scenes.modelling.scene import Description, Scene
from scenes.rendering.render import OWN_SCENES_VERSION, RENDERER_VERSION
from scenes.view_sets.manifest import SCHEMA
from scenes.view_sets.viewpoints import FOV_X_RADIANS, SPLITS, all_poses, evenly_spread


@dataclass(frozen=True)
class NoiseTarget:
    """The noise that a split may have, instead of a number of samples (`scenes.rendering.samples`)."""

    ceiling_db: float
    """The PSNR of an image with that noise against the same image without noise."""
    most: int
    least: int = 4


@dataclass(frozen=True)
class Order:
    scene: Scene
    description: Description
    """The description as it is rendered: normalised where necessary."""
    similarity: Similarity | None
    resolution: int
    counts: dict[str, int]
    spp: Mapping[str, int | NoiseTarget]
    integrator: str | None = None
    """The integrator, `path` or `volpath`; None: what the scene needs."""

    def poses(self, split: str) -> tuple[np.ndarray, np.ndarray]:
        """Return the indices [n] of the viewpoints in the full split, and their cameras [n, 4, 4]."""
        everything = all_poses(split, self.scene.view_from)  # type: ignore[arg-type]
        chosen = evenly_spread(self.counts[split], everything, f"{split} views")
        return chosen, everything[chosen]

    @property
    def focal(self) -> float:
        return float(0.5 * self.resolution / np.tan(0.5 * FOV_X_RADIANS))

    def digest(self, variant: str) -> str:
        """Return the hexadecimal digest of everything that the images depend on; a `NoiseTarget` counts as such."""
        scene = self.scene
        facts = {
            "format": SCHEMA,
            "renderer": RENDERER_VERSION,
            **({"own scenes": OWN_SCENES_VERSION} if self.scene.file is not None else {}),
            "versions": versions(),
            "variant": variant,
            "description": self.description,
            "needs": {name: need.needed for name, need in needs(self.description).items()},
            **({"integrator": self.integrator} if self.integrator else {}),
            "scene": [scene.name, scene.title, scene.view_from, scene.max_depth, scene.near, scene.far],
            "emitters_seen": scene.emitters_seen,
            "box": scene.box,
            "normalised": similarity_facts(self.similarity),
            "resolution": self.resolution,
            "fov": FOV_X_RADIANS,
            "spp": {split: spp if isinstance(spp, int) else asdict(spp) for split, spp in self.spp.items()},
            "viewpoints": {split: self.poses(split)[0] for split in SPLITS},
            "cameras": {split: self.poses(split)[1] for split in SPLITS},
        }
        return digest_of(as_rendered(facts))


REMAINDER = 1e-9
"""The share of an array's largest number below which a number counts as a rounding error of 0."""


def as_rendered(value: object) -> object:
    """Return plain data with its numbers as Mitsuba gets them, float32, and rounding errors of 0 in arrays as 0: view
    sets rendered on another processor, whose matrix products have other last bits, stay valid.
    """
    if isinstance(value, dict):
        return {key: as_rendered(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [as_rendered(inner) for inner in value]
    if not isinstance(value, float | np.ndarray) or (numbers := np.asarray(value)).dtype.kind != "f":
        return value
    least = REMAINDER * np.abs(numbers).max(initial=0.0)
    with np.errstate(over="ignore"):
        return np.where(np.abs(numbers) < least, 0.0, numbers).astype(np.float32)


def similarity_facts(change: Similarity | Placement | None) -> dict[str, object] | None:
    """Return the manifest's entry: x in the view set = scale · rotation · x in the description + shift."""
    if change is None:
        return None
    turned = {"rotation": change.rotation.tolist()} if isinstance(change, Placement) else {}
    return {"scale": change.scale, "shift": [float(value) for value in change.shift], **turned}


def versions() -> dict[str, str]:
    return {name: importlib.metadata.version(name) for name in ("mitsuba", "drjit")}
