"""The one table of scenes. A new scene is one file and one line here."""

import importlib

from scenes.errors import InputError
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

CATALOG: dict[str, str] = {**CLASSICS}
"""Scene name → module that holds `SCENE`; imported when asked for, so that listing names costs nothing."""


def scene_named(name: str) -> Scene:
    """The scene of that name; raises `InputError` that lists the known names."""
    if name not in CATALOG:
        raise InputError(f"unknown scene {name!r}; known scenes: {' '.join(CATALOG)}")
    scene: Scene = importlib.import_module(CATALOG[name]).SCENE
    return scene
