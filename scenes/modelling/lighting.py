"""Light from infinitely far away, as entries of a scene description."""

import numpy as np
from numpy.typing import NDArray

from scenes.modelling.scene import Description

Z_UP = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], dtype=np.float64)
"""The rotation of Mitsuba's environment maps, whose up is y, into our world, whose up is z."""


def directions(height: int, width: int) -> np.ndarray:
    """Return the world direction [height, width, 3] of each pixel of an environment map placed with `Z_UP`."""
    theta = (np.arange(height)[:, None] + 0.5) / height * np.pi
    phi = (np.arange(width) + 0.5) / width * 2 * np.pi
    return np.stack(
        np.broadcast_arrays(np.sin(phi) * np.sin(theta), np.cos(phi) * np.sin(theta), np.cos(theta)), axis=-1
    )


def towards(azimuth: float, elevation: float) -> NDArray[np.float64]:
    a, e = np.radians([azimuth, elevation])
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def softbox(
    toward: NDArray[np.float64], azimuth: float, elevation: float, width: float, height: float
) -> NDArray[np.float64]:
    """Return the brightness 0 … 1, [h, w], of a rounded rectangular lamp; half-extents in degrees, soft borders."""
    forward = towards(azimuth, elevation)
    right = np.cross((0.0, 0.0, 1.0), forward)
    right /= np.linalg.norm(right)
    ahead = toward @ forward
    x = np.arctan2(toward @ right, ahead) / np.radians(width)
    y = np.arctan2(toward @ np.cross(forward, right), ahead) / np.radians(height)
    distance = (np.abs(x) ** 4 + np.abs(y) ** 4) ** 0.25
    inside = 1 / (1 + np.exp(np.clip((distance - 1) / (0.25 / 4), -30, 30)))
    return np.asarray(inside * (ahead > 0))


def studio(brightness: float = 0.7) -> Description:
    """Make a grey-blue sky over a warm floor, with a broad key light, a cool fill light and a rim light."""
    toward = directions(64, 128)
    up = toward[..., 2:]
    sky = np.array([0.26, 0.295, 0.34]) + np.array([0.20, 0.23, 0.28]) * np.clip(up, 0, 1)
    floor = np.array([0.22, 0.20, 0.18]) - np.array([0.08, 0.075, 0.07]) * np.clip(-up, 0, 1)
    horizon = 1 / (1 + np.exp(np.clip(-up / 0.05, -30, 30)))
    image = floor + (sky - floor) * horizon
    for colour, box in (
        ((3.6, 3.45, 3.2), softbox(toward, azimuth=35, elevation=52, width=26, height=21)),
        ((0.75, 0.85, 1.0), softbox(toward, azimuth=170, elevation=30, width=34, height=26)),
        ((1.7, 1.6, 1.45), softbox(toward, azimuth=275, elevation=26, width=10, height=30)),
    ):
        image = image + box[..., None] * np.array(colour)
    return {"type": "envmap", "data": (brightness * image).astype(np.float32), "to_world": Z_UP}


def hazed(light: Description, share: float) -> Description:
    """Spread that share of the light from above evenly over the sky: softer shadows, less noise under water."""
    image = light["data"].astype(np.float64)
    up = directions(*image.shape[:2])[..., 2]
    above = up > 0
    weight = np.where(above, np.sqrt(1 - up**2), 0.0)[..., None]
    even = (weight * image).sum(axis=(0, 1)) / weight.sum()
    hazy = np.where(above[..., None], image + share * (even - image), image)
    return light | {"data": hazy.astype(np.float32)}
