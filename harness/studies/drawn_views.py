"""View sets in the Blender format that need no renderer: a disc on a white background, or random noise."""

import math
import tempfile
from pathlib import Path

import numpy as np

from scenes.view_sets.formats.transforms import write_transforms
from scenes.view_sets.images import write_png
from scenes.view_sets.view_set import ViewSet, read_view_set

FOV_X_RADIANS = 0.6911112
DISTANCE = 4.0311
GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))


def poses(count: int, turn: float) -> np.ndarray:
    """Return camera-to-world matrices [count, 4, 4], OpenGL axes, spread over the upper hemisphere, looking inward."""
    matrices = np.tile(np.eye(4), (count, 1, 1))
    for index, elevation in enumerate(np.linspace(0.2, 1.1, count)):
        azimuth = GOLDEN_ANGLE * index + turn
        level = math.cos(elevation)
        back = np.array([level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation)])
        right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
        matrices[index, :3] = np.stack([right, np.cross(back, right), back, DISTANCE * back], axis=1)
    return matrices


def disc_image(size: int, colour: np.ndarray) -> np.ndarray:
    """Draw the unit ball in one flat colour, straight RGBA [size, size, 4]: the same from every side."""
    centre = (np.arange(size) + 0.5 - 0.5 * size) / (0.5 * size / math.tan(0.5 * FOV_X_RADIANS))
    radius = np.hypot(*np.meshgrid(centre, centre))
    inside = radius < math.tan(math.asin(1.0 / DISTANCE))
    return np.concatenate([np.tile(colour, (size, size, 1)), inside[..., None]], axis=-1).astype(np.float32)


def write_disc(folder: Path, size: int, train: int, test: int, seed: int) -> None:
    """Write a view set that a small network learns in a few steps."""
    image = disc_image(size, np.random.default_rng(seed).uniform(0.1, 0.7, 3))
    _write(folder, {"train": [image] * train, "test": [image] * test})


def disc_views(size: int, train: int, test: int, seed: int) -> ViewSet:
    with tempfile.TemporaryDirectory() as folder:
        write_disc(Path(folder) / "views", size, train, test, seed)
        return read_view_set(Path(folder) / "views")


def write_noise(folder: Path, size: int, train: int, test: int) -> None:
    """Write a view set that cannot be learnt; memory and time do not depend on what the images show."""
    generator = np.random.default_rng(0)

    def noise() -> np.ndarray:
        return generator.uniform(size=(size, size, 4)).astype(np.float32)

    _write(folder, {"train": [noise() for _ in range(train)], "test": [noise() for _ in range(test)]})


def _write(folder: Path, images: dict[str, list[np.ndarray]]) -> None:
    for turn, (split, pictures) in enumerate(images.items()):
        (folder / split).mkdir(parents=True)
        for index, picture in enumerate(pictures):
            write_png(folder / split / f"r_{index}.png", picture)
        names = [f"./{split}/r_{index}" for index in range(len(pictures))]
        write_transforms(folder / f"transforms_{split}.json", FOV_X_RADIANS, names, poses(len(pictures), float(turn)))
