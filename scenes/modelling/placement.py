"""How a user's scene is turned upright, centred and scaled: by moving the cameras, not its contents."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

VISIBLE_RADIUS = 1.36
"""The radius of a ball about the origin that all cameras see completely: 4.0311 · sin(0.6911 / 2) = 1.366."""


@dataclass(frozen=True)
class Placement:
    """The map: x in the view set = scale · rotation · x in the file + shift."""

    rotation: NDArray[np.float64]
    """The rotation [3, 3]: zero or more quarter turns about an axis."""
    scale: float
    shift: NDArray[np.float64]

    def points(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.scale * (x @ self.rotation.T) + self.shift

    def box(self, corners: NDArray[np.float64]) -> NDArray[np.float64]:
        """Map the corners [2, 3] of a box in the file to those in the view set."""
        return np.sort(self.points(corners), axis=0)

    def camera(self, pose: np.ndarray) -> np.ndarray:
        """Map a camera [4, 4] of the view set to the camera of the same view in the file, also rigid."""
        placed = np.eye(4)
        placed[:3, :3] = self.rotation.T @ pose[:3, :3]
        placed[:3, 3] = self.rotation.T @ (pose[:3, 3] - self.shift) / self.scale
        return placed


def upright(box: np.ndarray, up: np.ndarray) -> Placement:
    """Bring the box [2, 3] into the view of all cameras, with the axis nearest to `up` [3] as z."""
    axis = int(np.abs(up).argmax())
    sign = 1.0 if up[axis] >= 0 else -1.0
    # the file's axes after the upward one become x and y, which keeps it right-handed
    rotation = np.zeros((3, 3))
    rotation[0, (axis + 1) % 3] = 1.0
    rotation[1, (axis + 2) % 3] = sign
    rotation[2, axis] = sign
    scale = VISIBLE_RADIUS / (0.5 * float(np.linalg.norm(box[1] - box[0])))
    return Placement(rotation, scale, -scale * (rotation @ box.mean(axis=0)))
