"""Pixels → rays: the pixel-centre and axis convention of `CONVENTIONS.md` lives here alone."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from baselines.contract import Rays


@dataclass(frozen=True)
class Cameras:
    """Pinhole cameras of one split on a device."""

    camera_to_world: Float[Tensor, "views 4 4"]
    width: int
    height: int
    focal: float
    """In pixels."""
    near: float
    far: float

    @staticmethod
    def of(camera_to_world: np.ndarray, width: int, height: int, focal: float, near: float, far: float) -> "Cameras":
        return Cameras(torch.as_tensor(camera_to_world, dtype=torch.float32), width, height, focal, near, far)

    def __len__(self) -> int:
        return self.camera_to_world.shape[0]

    def to(self, device: torch.device) -> "Cameras":
        return Cameras(self.camera_to_world.to(device), self.width, self.height, self.focal, self.near, self.far)

    def rays(self, view: Int[Tensor, " rays"], column: Int[Tensor, " rays"], row: Int[Tensor, " rays"]) -> Rays:
        """Rays through pixel centres, `(column + 0.5, row + 0.5)`, unit directions."""
        x = (column + 0.5 - 0.5 * self.width) / self.focal
        y = -(row + 0.5 - 0.5 * self.height) / self.focal
        in_camera = torch.stack([x, y, -torch.ones_like(x)], dim=-1)
        matrix = self.camera_to_world[view]
        in_world = torch.einsum("rij,rj->ri", matrix[:, :3, :3], in_camera)
        directions = torch.nn.functional.normalize(in_world, dim=-1)
        return Rays(matrix[:, :3, 3], directions, self.near, self.far)

    def all_rays(self, view: int) -> Rays:
        """Every pixel of one view, row by row."""
        device = self.camera_to_world.device
        index = torch.arange(self.width * self.height, device=device)
        return self.rays(torch.full_like(index, view), index % self.width, index // self.width)
