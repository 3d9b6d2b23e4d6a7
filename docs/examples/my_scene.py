"""A scene for `--scene-file`: three stacked blocks under a white sky."""

import numpy as np

from scenes.modelling.scene import Description, Scene


def block(size: float, height: float, turn: float, colour: list[float]) -> Description:
    c, s = np.cos(turn), np.sin(turn)
    to_world = np.eye(4)
    to_world[:3, :3] = size * np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    to_world[2, 3] = height
    return {
        "type": "cube",
        "to_world": to_world,
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": colour}},
    }


def build() -> Description:
    return {
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [1.0, 1.0, 1.0]}},
        "low": block(0.6, -0.6, 0.0, [0.2, 0.3, 0.7]),
        "middle": block(0.45, 0.45, 0.5, [0.8, 0.7, 0.2]),
        "top": block(0.25, 1.15, 1.0, [0.7, 0.2, 0.2]),
    }


SCENE = Scene("blocks", "Three blocks: flat faces, sharp edges", build)
