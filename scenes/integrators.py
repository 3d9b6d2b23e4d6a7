"""What a scene costs with the volumetric integrator and without, and how far apart the two images are."""

import time
from dataclasses import dataclass

from scenes.catalog import scene_named
from scenes.errors import InputError
from scenes.pixels import display_from_linear, over_white
from scenes.render import LoadedScene, seed_from
from scenes.variant import choose_variant
from scenes.viewpoints import all_poses, evenly_spread

INTEGRATORS = ("path", "volpath")


@dataclass(frozen=True)
class Comparison:
    """The same views twice, with independent noise."""

    scene: str
    seconds: dict[str, float]
    """Of rendering all views, by integrator; compiling is not counted."""
    samples: int
    """Camera paths of all views together, of one integrator."""
    differences: list[float]
    """Of each view: mean display colour over white by `path`, less the same by `volpath`."""


def compared(scene_name: str, resolution: int, views: int, spp: int, variant: str | None = None) -> Comparison:
    """The integrators take turns in going first. Raises `InputError` for an unknown scene or less than one view."""
    scene = scene_named(scene_name)
    if views < 1:
        raise InputError(f"views {views}: choose 1 or more")
    everything = all_poses("test", scene.view_from)
    poses = everything[evenly_spread(views, everything, "test views")]
    chosen = choose_variant(variant)
    loaded = {name: LoadedScene.of(scene, chosen, resolution, integrator=name) for name in INTEGRATORS}
    for one in loaded.values():
        one.colour(poses[0], spp, seed_from("warm-up"))
    seconds = dict.fromkeys(INTEGRATORS, 0.0)
    differences = []
    for number, pose in enumerate(poses):
        mean = {}
        for name in INTEGRATORS if number % 2 else reversed(INTEGRATORS):
            began = time.perf_counter()
            image = loaded[name].colour(pose, spp, seed_from(scene_name, number, name))
            seconds[name] += time.perf_counter() - began
            mean[name] = float(over_white(display_from_linear(image)).mean())
        differences.append(mean["path"] - mean["volpath"])
    return Comparison(scene_name, seconds, views * resolution**2 * spp, differences)
