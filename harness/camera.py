"""One pinhole camera: what a view is asked for by."""

import math
from dataclasses import dataclass

import numpy as np
import torch

from baselines.contract import Rays
from harness.rays import Cameras


@dataclass(frozen=True, eq=False)
class Camera:
    """Pose and intrinsics; frames and pixels as in `CONVENTIONS.md`. Compared by identity: what makes two views the
    same is `harness.view_cache.keys`' to say.

    Raises `ValueError` for a pose or a length that is not finite, an empty picture, or near and far out of order.
    """

    camera_to_world: np.ndarray
    """float64 [4, 4], OpenGL axes."""
    width: int
    height: int
    focal: float
    """In pixels."""
    near: float
    far: float

    def __post_init__(self) -> None:
        pose = np.array(self.camera_to_world, dtype=np.float64)
        if pose.shape != (4, 4) or not np.isfinite(pose).all():
            raise ValueError(f"a pose is a finite 4 × 4 matrix, not {pose.tolist()}")
        if self.width < 1 or self.height < 1:
            raise ValueError(f"{self.width} × {self.height} pixels: a view has at least one")
        if not (math.isfinite(self.focal) and self.focal > 0.0):
            raise ValueError(f"focal length {self.focal}: must be a positive number of pixels")
        if not (math.isfinite(self.far) and 0.0 <= self.near < self.far):
            raise ValueError(f"near {self.near} and far {self.far}: must be distances, near the smaller one")
        pose.setflags(write=False)
        object.__setattr__(self, "camera_to_world", pose)

    def resized(self, width: int) -> "Camera":
        """The same view in pictures of another width; the shape is kept to the nearest pixel."""
        scale = width / self.width
        height = max(1, round(self.height * scale))
        return Camera(self.camera_to_world, width, height, self.focal * scale, self.near, self.far)

    def at(self, camera_to_world: np.ndarray) -> "Camera":
        """The same lens elsewhere."""
        return Camera(camera_to_world, self.width, self.height, self.focal, self.near, self.far)

    def cameras(self, device: torch.device) -> Cameras:
        """As a set of one."""
        pose = self.camera_to_world[None].copy()  # torch warns of an array that it may not write to
        return Cameras.of(pose, self.width, self.height, self.focal, self.near, self.far).to(device)

    def rays(self, device: torch.device) -> Rays:
        """Of all pixels, row by row."""
        return self.cameras(device).all_rays(0)
