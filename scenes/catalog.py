"""The one table of scenes. A new scene is one file and one line here."""

import importlib

from scenes.errors import InputError
from scenes.ladders import LADDERS
from scenes.scene import Scene

CLASSICS: dict[str, str] = {
    "chair": "scenes.classics.chair",
    "drums": "scenes.classics.drums",
    "ficus": "scenes.classics.ficus",
    "hotdog": "scenes.classics.hotdog",
    "lego": "scenes.classics.lego",
    "materials": "scenes.classics.materials",
    "mic": "scenes.classics.mic",
    "ship": "scenes.classics.ship",
}

STRESS: dict[str, str] = {
    "empty": "scenes.stress.plain:empty",
    "black": "scenes.stress.plain:black",
    "white": "scenes.stress.plain:white",
    "wall": "scenes.stress.plain:wall",
    "inside": "scenes.stress.rooms:inside",
    "fog_dense": "scenes.stress.fog:fog_dense",
    "fog_thin": "scenes.stress.fog:fog_thin",
    "wires": "scenes.stress.wires:wires",
    "mirror": "scenes.stress.mirror:mirror",
    "glass": "scenes.stress.glass:glass",
    "glass_air": "scenes.stress.glass:glass_air",
    "hdr_emitter": "scenes.stress.light:hdr_emitter",
    "checker": "scenes.stress.checker:checker",
    "grazing": "scenes.stress.light:grazing",
    "tiny": "scenes.stress.scales:tiny",
    "huge": "scenes.stress.scales:huge",
    "furnace": "scenes.stress.rooms:furnace",
}
"""Stiff and extreme scenes (`scenes.stress`)."""

RUNGS: dict[str, str] = {
    rung: f"scenes.ladders.rungs:{rung}" for ladder in LADDERS.values() for rung in ladder.scenes
}  # fmt: skip
"""Scenes that get harder step by step (`scenes.ladders`)."""

CATALOG: dict[str, str] = {**CLASSICS, **STRESS, **RUNGS}
"""Scene name → module that holds it as `SCENE`, or `module:key` in its `SCENES`; imported when asked for, so that
listing names costs nothing."""


def scene_named(name: str) -> Scene:
    """The scene of that name; raises `InputError` that lists the known names."""
    if name not in CATALOG:
        raise InputError(f"unknown scene {name!r}; known scenes: {' '.join(CATALOG)}")
    module, _, key = CATALOG[name].partition(":")
    found = importlib.import_module(module)
    scene: Scene = found.SCENES[key] if key else found.SCENE
    return scene
