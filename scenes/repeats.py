"""One view rendered again and again with independent random numbers: what regression gates compare."""

from collections.abc import Iterator

import numpy as np

from scenes.catalog import scene_named
from scenes.errors import InputError
from scenes.render import LoadedScene, seed_from
from scenes.variant import choose_variant
from scenes.viewpoints import all_poses

LARGEST = {"resolution": 512, "spp": 65536, "count": 10_000}


def repeated(
    scene_name: str, view: int, resolution: int, spp: int, stream: str, count: int, variant: str | None = None
) -> Iterator[np.ndarray]:
    """`count` estimates float64 [h, w, 4], linear and premultiplied, of a test view; other streams are independent.

    Raises `InputError` for an unknown scene or variant, a view that is not there and sizes that are none.
    """
    scene = scene_named(scene_name)
    poses = all_poses("test", scene.view_from)
    if not 0 <= view < len(poses):
        raise InputError(f"--view {view}: choose 0 to {len(poses) - 1}")
    for name, value in {"resolution": resolution, "spp": spp, "count": count}.items():
        if not 1 <= value <= LARGEST[name]:
            raise InputError(f"--{name} {value}: must lie between 1 and {LARGEST[name]}")
    loaded = LoadedScene.of(scene, choose_variant(variant), resolution)
    for number in range(count):
        yield loaded.colour(poses[view], spp, seed_from(scene_name, stream, number))
