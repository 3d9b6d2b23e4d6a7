"""Lenses with distortion, and the resampling of their images to a pinhole with square pixels and a centred axis."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import map_coordinates

from scenes.files.errors import InputError
from scenes.view_sets.pixels import straight_from_premultiplied

CENTRED = 0.51
"""The maximum offset of an axis from the centre, in pixels: some programs write the centre of the middle pixel."""
SQUARE = 1e-3
LONGEST = 16.0
"""The maximum focal length of the search, in focal lengths of the lens."""


@dataclass(frozen=True)
class Lens:
    """Brown's model as COLMAP and OpenCV have it; lengths in pixels, the corner of the first pixel is (0, 0)."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0

    @property
    def is_pinhole(self) -> bool:
        straight = not any((self.k1, self.k2, self.p1, self.p2))
        centred = max(abs(self.cx - self.width / 2), abs(self.cy - self.height / 2)) <= CENTRED
        return straight and centred and abs(self.fx - self.fy) <= SQUARE * self.fx

    def scaled(self, width: int, height: int) -> "Lens":
        """Return the lens of the same images at another size."""
        across, down = width / self.width, height / self.height
        focal = {"fx": self.fx * across, "fy": self.fy * down, "cx": self.cx * across, "cy": self.cy * down}
        return replace(self, width=width, height=height, **focal)

    def seen_at(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return column and row in the image of directions (x, y, 1) in the camera's frame, y down."""
        square = x * x + y * y
        radial = 1.0 + self.k1 * square + self.k2 * square * square
        column = x * radial + 2.0 * self.p1 * x * y + self.p2 * (square + 2.0 * x * x)
        row = y * radial + 2.0 * self.p2 * x * y + self.p1 * (square + 2.0 * y * y)
        return self.fx * column + self.cx, self.fy * row + self.cy

    def holds(self, focal: float) -> bool:
        """Return whether a pinhole of this focal length sees nothing outside the image, and no folding."""
        half = np.array([0.5 * self.width, 0.5 * self.height]) / focal
        across, down = np.linspace(-half[0], half[0], 65), np.linspace(-half[1], half[1], 65)
        x = np.concatenate([across, across, np.full(65, -half[0]), np.full(65, half[0])])
        y = np.concatenate([np.full(65, -half[1]), np.full(65, half[1]), down, down])
        column, row = self.seen_at(x, y)
        inside = (column >= 0) & (column <= self.width) & (row >= 0) & (row <= self.height)
        square = x * x + y * y
        return bool(inside.all() and (1.0 + 3.0 * self.k1 * square + 5.0 * self.k2 * square * square > 0.0).all())

    def pinhole_focal(self, where: str) -> float:
        """Return the focal length of the widest centred pinhole whose pixels all lie in the image.

        Raises `InputError`, which names `where`, if there is none.
        """
        if self.is_pinhole:
            return self.fx
        narrow, wide = LONGEST * max(self.fx, self.fy), 0.25 * min(self.fx, self.fy)
        if not self.holds(narrow):
            raise InputError(f"{where}: no pinhole fits into this lens ({self}); undistort the images")
        for _ in range(50):
            middle = 0.5 * (narrow + wide)
            narrow, wide = (middle, wide) if self.holds(middle) else (narrow, middle)
        return narrow

    def as_pinhole(self, rgba: np.ndarray, focal: float) -> np.ndarray:
        """Resample straight RGBA [h, w, 4] of this lens to a pinhole of that focal length, linearly."""
        column, row = np.meshgrid(np.arange(self.width) + 0.5, np.arange(self.height) + 0.5)
        at, down = self.seen_at((column - 0.5 * self.width) / focal, (row - 0.5 * self.height) / focal)
        premultiplied = np.concatenate([rgba[..., :3] * rgba[..., 3:], rgba[..., 3:]], axis=-1)
        places = np.stack([down - 0.5, at - 0.5])
        seen = [map_coordinates(part, places, order=1, mode="nearest") for part in np.moveaxis(premultiplied, -1, 0)]
        return straight_from_premultiplied(np.stack(seen, axis=-1)).clip(0.0, 1.0).astype(np.float32)
