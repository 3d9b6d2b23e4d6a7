"""LPIPS (Zhang et al. 2018), version 0.1 with AlexNet, from a file of weights that the user provides.

The file contains the state of the package `lpips`; docs/read-the-report.md says how to make it on a connected machine.
"""

from functools import cache
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load
from torch import Tensor
from torch.nn import functional

from harness.records.json_record import file_digest
from scenes.files.errors import InputError, short

LAYERS = (("net.slice1.0", (64, 3, 11, 11)), ("net.slice2.3", (192, 64, 5, 5)), ("net.slice3.6", (384, 192, 3, 3)),
          ("net.slice4.8", (256, 384, 3, 3)), ("net.slice5.10", (256, 256, 3, 3)))  # fmt: skip
"""The convolutions whose outputs are compared, and the shapes of their weights."""
STRIDES, PADDINGS, POOLED = (4, 1, 1, 1, 1), (2, 2, 1, 1, 1), (False, True, True, False, False)
SHIFT, SCALE = (-0.030, -0.088, -0.188), (0.458, 0.448, 0.450)
SMALLEST = 31
"""The minimum number of pixels of a side: with fewer, nothing is left after the layers' strides."""


class Lpips:
    """The distance of two images by the features of a network: 0 for equal images, larger is worse."""

    def __init__(self, file: Path) -> None:
        """Read the weights. Raises `InputError`, naming the file, for anything but the state of LPIPS."""
        try:
            self.digest = file_digest(file)
            weights = load(file.read_bytes())
        except (OSError, SafetensorError) as error:
            raise InputError(f"--lpips {file}: cannot be read ({short(error, 120)}); name the weights") from error
        shapes: dict[str, tuple[int, ...]] = {f"{name}.weight": shape for name, shape in LAYERS}
        shapes |= {f"{name}.bias": shape[:1] for name, shape in LAYERS}
        shapes |= {f"lin{place}.model.1.weight": (1, shape[0], 1, 1) for place, (_, shape) in enumerate(LAYERS)}
        for name, shape in shapes.items():
            given = tuple(weights[name].shape) if name in weights else "missing"
            if given != shape or not bool(torch.isfinite(weights[name]).all()):
                raise InputError(
                    f"--lpips {file}: {name} is {given}, not finite numbers {shape}; save LPIPS with AlexNet"
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
        for (name, _), stride, padding, pooled in zip(LAYERS, STRIDES, PADDINGS, POOLED, strict=True):
            x = functional.max_pool2d(x, 3, 2) if pooled else x
            weight, bias = self.weights[f"{name}.weight"], self.weights[f"{name}.bias"]
            x = functional.relu(functional.conv2d(x, weight, bias, stride, padding))
            features.append(x)
        return features


def _unit(x: Tensor) -> Tensor:
    return x / (x.square().sum(dim=1, keepdim=True).sqrt() + 1e-10)


@cache
def lpips_of(file: Path) -> Lpips:
    """Return the distance by the weights of a file, which each process reads once; errors as in `Lpips`."""
    return Lpips(file)
