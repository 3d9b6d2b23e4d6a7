"""Pixels → rays of one pinhole camera; (seed, step) → the ray batch that every method gets.

The pixel-centre and axis convention of `CONVENTIONS.md` is implemented only here. Pixels are drawn uniformly, or mostly
where the images are covered and have contrast; no method affects the choice.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from baselines.contract import Rays
from harness.machine.stopwatch import Stopwatch
from harness.plan.seeds import generator_for
from scenes.view_sets.image_stack import ImageStack
from scenes.view_sets.pixels import over_white
from scenes.view_sets.source import contrast, covered_pixels


@dataclass(frozen=True)
class Cameras:
    """The pinhole cameras of one split, on a device."""

    camera_to_world: Float[Tensor, "views 4 4"]
    width: int
    height: int
    focal: float
    """The focal length in pixels."""
    near: float
    far: float

    @staticmethod
    def of(camera_to_world: np.ndarray, width: int, height: int, focal: float, near: float, far: float) -> "Cameras":
        return Cameras(torch.as_tensor(camera_to_world, dtype=torch.float32), width, height, focal, near, far)

    def __len__(self) -> int:
        return self.camera_to_world.shape[0]

    def to(self, device: torch.device) -> "Cameras":
        return replace(self, camera_to_world=self.camera_to_world.to(device))

    def rays(self, view: Int[Tensor, " rays"], column: Int[Tensor, " rays"], row: Int[Tensor, " rays"]) -> Rays:
        """Return rays through pixel centres, `(column + 0.5, row + 0.5)`, with unit directions."""
        x = (column + 0.5 - 0.5 * self.width) / self.focal
        y = -(row + 0.5 - 0.5 * self.height) / self.focal
        in_camera = torch.stack([x, y, -torch.ones_like(x)], dim=-1)
        matrix = self.camera_to_world[view]
        in_world = torch.einsum("rij,rj->ri", matrix[:, :3, :3], in_camera)
        directions = torch.nn.functional.normalize(in_world, dim=-1)
        return Rays(matrix[:, :3, 3], directions, self.near, self.far)

    def all_rays(self, view: int) -> Rays:
        """Return the rays of every pixel of one view, row by row."""
        device = self.camera_to_world.device
        index = torch.arange(self.width * self.height, device=device)
        return self.rays(torch.full_like(index, view), index % self.width, index // self.width)


@dataclass(frozen=True, eq=False)
class Camera:
    """A pose and intrinsics; frames and pixels as in `CONVENTIONS.md`. Compared by identity: `harness.playback.keys`
    decides when two views are the same. Raises `ValueError` for a pose or a length that is not finite, an empty
    picture, or near and far out of order.
    """

    camera_to_world: np.ndarray
    """The pose, float64 [4, 4], OpenGL axes."""
    width: int
    height: int
    focal: float
    """The focal length in pixels."""
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
        """Return the same view in pictures of another width; the aspect ratio is kept to the nearest pixel."""
        scale = width / self.width
        return replace(self, width=width, height=max(1, round(self.height * scale)), focal=self.focal * scale)

    def at(self, camera_to_world: np.ndarray) -> "Camera":
        return replace(self, camera_to_world=camera_to_world)

    def cameras(self, device: torch.device) -> Cameras:
        pose = self.camera_to_world[None].copy()  # torch warns of an array that it may not write to
        return Cameras.of(pose, self.width, self.height, self.focal, self.near, self.far).to(device)

    def rays(self, device: torch.device) -> Rays:
        """Return the rays of all pixels, row by row."""
        return self.cameras(device).all_rays(0)


class Batch(NamedTuple):
    """Rays and their true colours, and the time of making them; 0 where that does not count."""

    rays: Rays
    colours: Float[Tensor, "rays 3"]
    seconds: float = 0.0
    core_seconds: float = 0.0


RESIDENT_SHARE = 0.25
"""The maximum share of a GPU's memory for the training images; larger sets are read pixel by pixel."""
RESIDENT_BYTES = 2**26
"""The maximum of the processor's memory for them: a hundred images, 230 pixels wide."""


class Batches:
    """Random pixels of all training views, on the device of the cameras, whose memory holds small images."""

    def __init__(
        self, cameras: Cameras, rgba: ImageStack, covered_share: float = 0.0, contrast_weight: float = 0.0
    ) -> None:
        """Take `rgba` [views, height, width, 4], display colour with straight alpha; raises `ValueError` for another
        shape. The share `covered_share` of a batch is drawn from covered pixels and their neighbours, each with a
        chance in proportion to 1 + `contrast_weight` times its contrast, relative to the mean contrast of them all.
        """
        expected = (len(cameras), cameras.height, cameras.width, 4)
        if rgba.shape != expected:
            raise ValueError(f"images {rgba.shape}, the cameras need {expected}")
        self.cameras = cameras
        self.rgba = rgba
        self.covered_share = covered_share
        self._covered = covered_pixels(rgba) if covered_share else np.zeros(0, dtype=np.int64)
        self._chances = self._cumulated(contrast_weight) if contrast_weight and len(self._covered) else None
        """The cumulated chances of the covered pixels; None if they are equal."""
        self._rays: dict[int, Rays] = {}
        """View → all its rays, where the images are in memory."""
        self._last: tuple[tuple[int | str, int, int], Batch] | None = None
        self._resident: Float[Tensor, "pixels 3"] | None = None
        """The colours over white of all pixels, on the device."""
        device = cameras.camera_to_world.device
        room: float = RESIDENT_BYTES
        if device.type == "cuda":
            room = RESIDENT_SHARE * torch.cuda.get_device_properties(device).total_memory
        if 12 * math.prod(rgba.shape[:3]) <= room:
            resident = torch.empty((len(rgba), cameras.height * cameras.width, 3), device=device)
            for view in range(len(rgba)):  # one image after the other is in the processor's memory
                resident[view] = torch.from_numpy(over_white(rgba[view])).reshape(-1, 3)
            self._resident = resident.reshape(-1, 3)

    def _cumulated(self, weight: float) -> Float[Tensor, " covered"] | None:
        """Return the cumulated chances of the covered pixels; None if no pixel has a contrast."""
        size = math.prod(self.rgba.shape[1:3])
        ends = np.searchsorted(self._covered, size * np.arange(len(self.rgba) + 1))
        parts = [
            contrast(over_white(image)).reshape(-1)[self._covered[first:last] - view * size]
            for view, (image, (first, last)) in enumerate(zip(self.rgba, pairwise(ends), strict=True))
        ]
        contrasts = np.concatenate(parts).astype(np.float64)
        if not contrasts.any():
            return None
        chances = np.cumsum(1.0 + weight * contrasts / contrasts.mean())
        return torch.from_numpy(chances / chances[-1])

    def batch(self, seed: int | str, step: int, count: int) -> Batch:
        """Return `count` rays and their colours over white, which depend only on the arguments. Do not change them:
        they are kept for the other methods of a group, which are at the same step, with the time that they took.
        """
        key = (seed, step, count)
        if self._last is None or self._last[0] != key:
            self._last = (key, self._timed(lambda: self._drawn(*key)))
        return self._last[1]

    def stream(self, seed: int | str, count: int) -> Callable[[int], Batch]:
        return lambda step: self.batch(seed, step, count)

    def for_learner(
        self, whole_views: bool, seed: int | str, count: int, in_turns: bool = False
    ) -> Callable[[int], Batch]:
        """Return step → batch: `count` rays, or with `whole_views` all pixels of a training view, row by row. A
        learner in turns makes its batches on its own clock; it waits for none if the device holds the images.
        """
        if whole_views:
            return lambda step: self._timed(lambda: self._view(seed, step))
        if in_turns:
            return lambda step: self._drawn(seed, step, count)
        return self.stream(seed, count)

    def _places(self, count: int, generator: torch.Generator) -> Int[Tensor, " pixels"]:
        """Draw from the covered pixels."""
        if self._chances is None:
            return torch.randint(len(self._covered), (count,), generator=generator)
        # the last chance is 1, which no draw reaches
        return torch.searchsorted(
            self._chances, torch.rand(count, generator=generator, dtype=torch.float64), right=True
        )

    def _timed(self, make: Callable[[], Batch]) -> Batch:
        watch = Stopwatch(self.cameras.camera_to_world.device)
        with watch.running():
            batch = make()
        return batch._replace(seconds=watch.seconds, core_seconds=watch.core_seconds)

    def _view(self, seed: int | str, step: int) -> Batch:
        """Return a view; each is drawn once before one is drawn again."""
        turn, place = divmod(step, len(self.cameras))
        view = int(torch.randperm(len(self.cameras), generator=generator_for(seed, turn, "views"))[place])
        if self._resident is None:
            colours = torch.from_numpy(over_white(self.rgba[view])).reshape(-1, 3)
            return Batch(self.cameras.all_rays(view), colours.to(self.cameras.camera_to_world.device))
        if view not in self._rays:
            self._rays[view] = self.cameras.all_rays(view)
        return Batch(self._rays[view], self._resident.view(len(self.cameras), -1, 3)[view])

    def _drawn(self, seed: int | str, step: int, count: int) -> Batch:
        generator = generator_for(seed, step, "batch")
        on_object = round(self.covered_share * count) if len(self._covered) else 0
        index = torch.randint(math.prod(self.rgba.shape[:3]), (count - on_object,), generator=generator)
        if on_object:
            place = self._places(on_object, generator)
            index = torch.cat([torch.from_numpy(self._covered[place.numpy()]), index])
        device = self.cameras.camera_to_world.device
        if self._resident is None:
            colours = torch.from_numpy(over_white(self.rgba.pixels(index.numpy()))).to(device)
            index = index.to(device)
        else:  # the host does not wait: the copy is one of the device's tasks
            index = (index.pin_memory() if device.type == "cuda" else index).to(device, non_blocking=True)
            colours = self._resident[index]
        width, size = self.cameras.width, self.cameras.width * self.cameras.height
        return Batch(self.cameras.rays(index // size, index % width, index % size // width), colours)
