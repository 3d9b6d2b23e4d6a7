"""The one table of scenes. A new scene is one file and one name here."""

import importlib

from scenes.catalog.ladders.ladders import LADDERS
from scenes.files.errors import InputError
from scenes.modelling.scene import Scene

CLASSICS: dict[str, str] = {
    name: f"scenes.catalog.classics.{name}"
    for name in ("chair", "drums", "ficus", "hotdog", "lego", "materials", "mic", "ship")
}
_STRESS = {
    "empty": "plain", "black": "plain", "white": "plain", "wall": "plain", "inside": "plain", "fog_dense": "fog",
    "fog_thin": "fog", "wires": "wires", "mirror": "mirror", "glass": "glass", "glass_air": "glass",
    "hdr_emitter": "light", "checker": "wires", "grazing": "light", "tiny": "scales", "huge": "scales",
    "furnace": "plain",
}  # fmt: skip
STRESS: dict[str, str] = {name: f"scenes.catalog.stress.{file}" for name, file in _STRESS.items()}
RUNGS: dict[str, str] = {rung: "scenes.catalog.ladders.rungs" for ladder in LADDERS.values() for rung in ladder.scenes}
CATALOG: dict[str, str] = {**CLASSICS, **STRESS, **RUNGS}
"""Map scene name → the module that holds it as `SCENE` or in `SCENES`; imported on demand."""


def scene_named(name: str) -> Scene:
    """Return the scene of that name; raises `InputError` that lists the known names."""
    if name not in CATALOG:
        raise InputError(f"unknown scene {name!r}; known scenes: {' '.join(CATALOG)}")
    module = importlib.import_module(CATALOG[name])
    scenes: list[Scene] = [module.SCENE] if name in CLASSICS else module.SCENES
    return next(scene for scene in scenes if scene.name == name)
