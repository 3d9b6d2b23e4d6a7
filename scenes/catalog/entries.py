"""The one table of scenes. A new scene is one file and one line here."""

import importlib

from scenes.catalog.ladders.ladders import LADDERS
from scenes.files.errors import InputError
from scenes.modelling.scene import Scene

CLASSICS: dict[str, str] = {
    "chair": "scenes.catalog.classics.chair",
    "drums": "scenes.catalog.classics.drums",
    "ficus": "scenes.catalog.classics.ficus",
    "hotdog": "scenes.catalog.classics.hotdog",
    "lego": "scenes.catalog.classics.lego",
    "materials": "scenes.catalog.classics.materials",
    "mic": "scenes.catalog.classics.mic",
    "ship": "scenes.catalog.classics.ship",
}

STRESS: dict[str, str] = {
    "empty": "scenes.catalog.stress.plain:empty",
    "black": "scenes.catalog.stress.plain:black",
    "white": "scenes.catalog.stress.plain:white",
    "wall": "scenes.catalog.stress.plain:wall",
    "inside": "scenes.catalog.stress.rooms:inside",
    "fog_dense": "scenes.catalog.stress.fog:fog_dense",
    "fog_thin": "scenes.catalog.stress.fog:fog_thin",
    "wires": "scenes.catalog.stress.wires:wires",
    "mirror": "scenes.catalog.stress.mirror:mirror",
    "glass": "scenes.catalog.stress.glass:glass",
    "glass_air": "scenes.catalog.stress.glass:glass_air",
    "hdr_emitter": "scenes.catalog.stress.light:hdr_emitter",
    "checker": "scenes.catalog.stress.checker:checker",
    "grazing": "scenes.catalog.stress.light:grazing",
    "tiny": "scenes.catalog.stress.scales:tiny",
    "huge": "scenes.catalog.stress.scales:huge",
    "furnace": "scenes.catalog.stress.rooms:furnace",
}
"""The stiff and extreme scenes (`scenes.catalog.stress`)."""

RUNGS: dict[str, str] = {
    rung: f"scenes.catalog.ladders.rungs:{rung}" for ladder in LADDERS.values() for rung in ladder.scenes
}  # fmt: skip
"""The scenes that get harder step by step (`scenes.catalog.ladders.ladders`)."""

CATALOG: dict[str, str] = {**CLASSICS, **STRESS, **RUNGS}
"""Map scene name → module that holds it as `SCENE`, or `module:key` in its `SCENES`; imported only when asked for, so
that listing names costs nothing.
"""


def scene_named(name: str) -> Scene:
    """Return the scene of that name; raises `InputError` that lists the known names."""
    if name not in CATALOG:
        raise InputError(f"unknown scene {name!r}; known scenes: {' '.join(CATALOG)}")
    module, _, key = CATALOG[name].partition(":")
    found = importlib.import_module(module)
    scene: Scene = found.SCENES[key] if key else found.SCENE
    return scene
