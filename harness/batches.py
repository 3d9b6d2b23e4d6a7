"""(seed, step) → the ray batch that every method gets."""

import torch
from jaxtyping import Float
from torch import Tensor

from baselines.contract import Rays
from harness.rays import Cameras
from harness.seeds import generator_for


class Batches:
    """Random pixels of all training views."""

    def __init__(self, cameras: Cameras, colours: Float[Tensor, "views height width 3"]) -> None:
        self.cameras = cameras
        self.colours = colours.reshape(-1, 3)

    def batch(self, seed: int | str, step: int, count: int) -> tuple[Rays, Float[Tensor, "rays 3"]]:
        """`count` rays and their colours; depends on nothing but its arguments."""
        generator = generator_for(seed, step, "batch")
        index = torch.randint(len(self.colours), (count,), generator=generator).to(self.colours.device)
        width, pixels = self.cameras.width, self.cameras.width * self.cameras.height
        rays = self.cameras.rays(index // pixels, index % width, index % pixels // width)
        return rays, self.colours[index]
