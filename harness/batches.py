"""(seed, step) → the ray batch that every method gets."""

import math

import torch
from jaxtyping import Float, Int
from torch import Tensor

from baselines.contract import Rays
from harness.attention.drawing import AttendedPixels, mixed
from harness.rays import Cameras
from harness.seeds import generator_for
from harness.settings import RayAttention
from scenes.image_stack import ImageStack
from scenes.pixels import over_white

Batch = tuple[Rays, Float[Tensor, "rays 3"]]


class Batches:
    """Random pixels of all training views, on the device of the cameras. Holds one batch and no image."""

    def __init__(self, cameras: Cameras, rgba: ImageStack, attention: RayAttention = "none") -> None:
        """`rgba` [views, height, width, 4]: straight alpha, display colour. Raises `ValueError` on any other shape.

        `attention` `none`: all pixels alike. `gradients`: half of a batch by the gradients of the images
        (`harness.attention.drawing`), which are looked at once, here.
        """
        expected = (len(cameras), cameras.height, cameras.width, 4)
        if rgba.shape != expected:
            raise ValueError(f"images {rgba.shape}, the cameras need {expected}")
        self.cameras = cameras
        self.rgba = rgba
        self._attended = AttendedPixels.by_gradients(rgba) if attention == "gradients" else None
        self._last: tuple[tuple[int | str, int, int], Batch] | None = None

    def batch(self, seed: int | str, step: int, count: int) -> Batch:
        """`count` rays and their colours over white; depends on nothing but its arguments. Not to be changed."""
        wanted = (seed, step, count)
        if self._last is None or self._last[0] != wanted:
            # kept for the other methods, which are at the same step
            self._last = (wanted, self._drawn(*wanted))
        return self._last[1]

    def _drawn(self, seed: int | str, step: int, count: int) -> Batch:
        index = self._chosen(seed, step, count)
        colours = torch.from_numpy(over_white(self.rgba.pixels(index.numpy())))
        device = self.cameras.camera_to_world.device
        index = index.to(device)
        width, pixels = self.cameras.width, self.cameras.width * self.cameras.height
        rays = self.cameras.rays(index // pixels, index % width, index % pixels // width)
        return rays, colours.to(device)

    def _chosen(self, seed: int | str, step: int, count: int) -> Int[Tensor, " count"]:
        """Numbered through all views row by row."""
        pixels = math.prod(self.rgba.shape[:3])
        if self._attended is None:
            return torch.randint(pixels, (count,), generator=generator_for(seed, step, "batch"))
        return mixed(self._attended, pixels, count, seed, step)
