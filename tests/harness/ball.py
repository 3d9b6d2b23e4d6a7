"""A posed-image folder in the Blender format, drawn by a formula: a coloured ball, no renderer needed."""

import math
import shutil
from pathlib import Path

import numpy as np

from scenes.view_sets.formats.transforms import write_transforms
from scenes.view_sets.images import write_png

FOV_X_RADIANS = 0.6911112
DISTANCE = 4.0311
SUBPIXELS = 3
GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))


def pose(azimuth: float, elevation: float) -> np.ndarray:
    """Return camera to world [4, 4], OpenGL axes, looking at the origin from `DISTANCE`; z is up."""
    back = np.array([math.cos(elevation) * math.cos(azimuth), math.cos(elevation) * math.sin(azimuth), 0.0])
    back[2] = math.sin(elevation)
    right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    matrix = np.eye(4)
    matrix[:3, :4] = np.stack([right, np.cross(back, right), back, DISTANCE * back], axis=1)
    return matrix


def ball_view(camera_to_world: np.ndarray, size: int) -> np.ndarray:
    """Return straight RGBA [size, size, 4] of the unit ball, coloured by its normal in dark and light bands."""
    centres = (np.arange(size * SUBPIXELS) + 0.5) / SUBPIXELS
    column, row = np.meshgrid(centres, centres)
    focal = 0.5 * size / math.tan(0.5 * FOV_X_RADIANS)
    in_camera = np.stack([(column - size / 2) / focal, -(row - size / 2) / focal, -np.ones_like(row)], axis=-1)
    d = in_camera @ camera_to_world[:3, :3].T
    d /= np.linalg.norm(d, axis=-1, keepdims=True)
    o = camera_to_world[:3, 3]
    along = -(d @ o)
    inside = 1.0 - (o @ o - along**2)
    hit = inside > 0
    normal = o + (along - np.sqrt(np.where(hit, inside, 0.0)))[..., None] * d
    light = np.where(np.floor(3 * normal[..., 2]) % 2 == 0, 1.0, 0.5)
    colour = (0.5 + 0.45 * normal) * light[..., None] * hit[..., None]

    def mean(values: np.ndarray) -> np.ndarray:
        return values.reshape(size, SUBPIXELS, size, SUBPIXELS, -1).mean(axis=(1, 3))

    alpha = mean(hit.astype(float))
    straight = mean(colour) / np.where(alpha > 0, alpha, 1.0)
    return np.concatenate([straight, alpha], axis=-1)


def write_ball(folder: Path, size: int = 24, train: int = 10, test: int = 3) -> Path:
    """Write a view set of the ball, with poses spread over the upper half sphere."""
    for split, count, turn in (("train", train, 0.0), ("test", test, 1.0)):
        elevations = np.linspace(0.2, 1.1, count)
        poses = np.array([pose(GOLDEN_ANGLE * i + turn, elevation) for i, elevation in enumerate(elevations)])
        (folder / split).mkdir(parents=True)
        for i, matrix in enumerate(poses):
            write_png(folder / split / f"r_{i}.png", ball_view(matrix, size))
        write_transforms(
            folder / f"transforms_{split}.json", FOV_X_RADIANS, [f"./{split}/r_{i}" for i in range(count)], poses
        )
    return folder


def ball_with_validation_views(folder: Path) -> Path:
    """Write a view set of the ball whose validation views are its test views."""
    write_ball(folder)
    shutil.copytree(folder / "test", folder / "val")
    poses = (folder / "transforms_test.json").read_text()
    (folder / "transforms_val.json").write_text(poses.replace("./test/", "./val/"))
    return folder
