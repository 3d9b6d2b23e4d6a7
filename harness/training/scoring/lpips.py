"""LPIPS (Zhang et al. 2018), version 0.1 with AlexNet or VGG-16, from a file of weights that the user provides.

The file holds the state of the package `lpips`; docs/read-the-report.md says how to make it.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load
from torch import Tensor
from torch.nn import functional

from scenes.files.digest import file_digest
from scenes.files.errors import InputError, short


@dataclass(frozen=True)
class Stage:
    """Rectified convolutions; the features that are compared are those of the last."""

    pool: tuple[int, int] | None
    """The size and the stride of the max pooling before them."""
    convolutions: tuple[tuple[str, tuple[int, ...]], ...]
    """The names and shapes of their weights."""
    stride: int = 1
    padding: int = 1


def _vgg(place: int, numbers: tuple[int, ...], before: int, channels: int) -> Stage:
    shapes = [(channels, before, 3, 3), *[(channels, channels, 3, 3)] * (len(numbers) - 1)]
    names = [f"net.slice{place}.{number}" for number in numbers]
    return Stage((2, 2) if place > 1 else None, tuple(zip(names, shapes, strict=True)))


NETWORKS = {
    "alex": (
        Stage(None, (("net.slice1.0", (64, 3, 11, 11)),), 4, 2),
        Stage((3, 2), (("net.slice2.3", (192, 64, 5, 5)),), 1, 2),
        Stage((3, 2), (("net.slice3.6", (384, 192, 3, 3)),)),
        Stage(None, (("net.slice4.8", (256, 384, 3, 3)),)),
        Stage(None, (("net.slice5.10", (256, 256, 3, 3)),)),
    ),
    "vgg": (
        _vgg(1, (0, 2), 3, 64),
        _vgg(2, (5, 7), 64, 128),
        _vgg(3, (10, 12, 14), 128, 256),
        _vgg(4, (17, 19, 21), 256, 512),
        _vgg(5, (24, 26, 28), 512, 512),
    ),
}
SHIFT, SCALE = (-0.030, -0.088, -0.188), (0.458, 0.448, 0.450)
SMALLEST = 31
"""The minimum number of pixels of a side: with fewer, nothing is left after the strides of AlexNet."""


class Lpips:
    """The distance of two images by the features of a network: 0 for equal images, larger is worse."""

    def __init__(self, file: Path) -> None:
        """Read the weights. Raises `InputError`, naming the file, for anything but the state of LPIPS."""
        try:
            self.digest = file_digest(file)
            weights = load(file.read_bytes())
        except (OSError, SafetensorError) as error:
            raise InputError(f"--lpips {file}: cannot be read ({short(error, 120)}); name the weights") from error
        self.network = "vgg" if "net.slice1.2.weight" in weights else "alex"
        """The name of the network in the package `lpips`."""
        self.stages = NETWORKS[self.network]
        shapes: dict[str, tuple[int, ...]] = {}
        for place, stage in enumerate(self.stages):
            for name, shape in stage.convolutions:
                shapes |= {f"{name}.weight": shape, f"{name}.bias": shape[:1]}
            shapes[f"lin{place}.model.1.weight"] = (1, stage.convolutions[-1][1][0], 1, 1)
        for name, shape in shapes.items():
            given = tuple(weights[name].shape) if name in weights else "missing"
            if given != shape or not bool(torch.isfinite(weights[name]).all()):
                raise InputError(
                    f"--lpips {file}: {name} is {given}, not finite numbers {shape}; save LPIPS with alex or vgg"
                )
        self.weights = {name: weights[name].float() for name in shapes}

    @torch.no_grad()
    def __call__(self, image: np.ndarray, truth: np.ndarray) -> float | None:
        """Return the distance of display colour over white [h, w, 3] in 0 … 1; None if a side is below `SMALLEST`."""
        if min(image.shape[:2]) < SMALLEST:
            return None
        total = 0.0
        for place, (first, second) in enumerate(zip(self._features(image), self._features(truth), strict=True)):
            difference = (_unit(first) - _unit(second)).square()
            total += float(functional.conv2d(difference, self.weights[f"lin{place}.model.1.weight"]).mean())
        return total

    def _features(self, image: np.ndarray) -> list[Tensor]:
        shift, scale = (torch.tensor(values)[:, None, None] for values in (SHIFT, SCALE))
        x = torch.from_numpy(np.ascontiguousarray(image, dtype=np.float32)).permute(2, 0, 1)
        x = ((2.0 * x - 1.0 - shift) / scale)[None]
        features = []
        for stage in self.stages:
            x = functional.max_pool2d(x, *stage.pool) if stage.pool else x
            for name, _ in stage.convolutions:
                weight, bias = self.weights[f"{name}.weight"], self.weights[f"{name}.bias"]
                x = functional.relu(functional.conv2d(x, weight, bias, stage.stride, stage.padding))
            features.append(x)
        return features


def _unit(x: Tensor) -> Tensor:
    return x / (x.square().sum(dim=1, keepdim=True).sqrt() + 1e-10)


@cache
def lpips_of(file: Path) -> Lpips:
    """Return the distance by the weights of a file, which each process reads once; errors as in `Lpips`."""
    return Lpips(file)
