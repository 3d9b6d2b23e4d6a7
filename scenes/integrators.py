"""What a scene costs with the volumetric integrator and without, and how far apart the two images are."""

import time
from dataclasses import dataclass

import numpy as np

from scenes.catalog import scene_named
from scenes.errors import InputError
from scenes.pixels import display_from_linear, over_white
from scenes.render import LoadedScene, seed_from
from scenes.store import check_resolution
from scenes.variant import choose_variant
from scenes.viewpoints import all_poses, evenly_spread

INTEGRATORS = ("path", "volpath")
BLOCK = 8
"""Pixels along each side of what is compared: noise of a single pixel is far above what matters."""


@dataclass(frozen=True)
class Comparison:
    """The same views twice, with independent noise."""

    scene: str
    seconds: dict[str, float]
    """Of rendering all views, by integrator; compiling is not counted."""
    samples: int
    """Camera paths of all views together, of one integrator."""
    squared: list[float]
    """Of each view: mean over blocks and channels of the squared difference of the two mean display colours over white,
    less what noise adds to it: unbiased, and below 0 by chance where nothing differs."""


def compared(scene_name: str, resolution: int, views: int, spp: int, variant: str | None = None) -> Comparison:
    """The integrators take turns in going first. Raises `InputError` for an unknown scene, less than one view, or fewer
    than 2 samples.
    """
    scene = scene_named(scene_name)
    check_resolution(resolution)
    if views < 1:
        raise InputError(f"--views {views}: choose 1 or more")
    if spp < 2:
        raise InputError(f"--spp {spp}: two halves are needed to take the noise out; choose 2 or more")
    everything = all_poses("test", scene.view_from)
    poses = everything[evenly_spread(views, everything, "test views")]
    chosen = choose_variant(variant)
    loaded = {name: LoadedScene.of(scene, chosen, resolution, integrator=name) for name in INTEGRATORS}
    for one in loaded.values():
        one.colour(poses[0], spp, seed_from("warm-up"))
    seconds = dict.fromkeys(INTEGRATORS, 0.0)
    squared = []
    for number, pose in enumerate(poses):
        halves = {}
        for name in INTEGRATORS if number % 2 else reversed(INTEGRATORS):
            began = time.perf_counter()
            images = [loaded[name].colour(pose, spp // 2, seed_from(scene_name, number, name, half)) for half in "ab"]
            seconds[name] += time.perf_counter() - began
            halves[name] = [in_blocks(over_white(display_from_linear(image))) for image in images]
        (a, b), (c, d) = halves["path"], halves["volpath"]
        # two independent differences: their product has the square of what both show for its mean, and no noise
        squared.append(float(np.mean((a - c) * (b - d))))
    return Comparison(scene_name, seconds, views * resolution**2 * (spp // 2 * 2), squared)


def in_blocks(image: np.ndarray) -> np.ndarray:
    """Means [rows, columns, 3] of an image [h, w, 3] over blocks of `BLOCK` pixels; a rest at the border is left."""
    side = min(BLOCK, *image.shape[:2])
    rows, columns = (size // side for size in image.shape[:2])
    whole = image[: rows * side, : columns * side].astype(np.float64)
    return whole.reshape(rows, side, columns, side, 3).mean(axis=(1, 3))
