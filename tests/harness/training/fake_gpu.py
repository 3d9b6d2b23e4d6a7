"""A GPU of tensors without values: what the host reads raises an error, and what crosses between devices is listed.

It shows, without a GPU, that a step on one would wait for nothing. It runs in a process of its own: caches that hold
such tensors are of no use to others, and functions that check shapes would read them.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor, nn
from torch._subclasses.fake_tensor import FakeTensorMode
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from baselines.contract import Box, Rays
from baselines.field import training_step
from baselines.numerics.encoding import _angular_frequencies
from harness.training.trainer import Trainer
from harness.training.turns import GivenDraws, in_turns
from tests.harness.tiny import TRAIN, rays_and_colours, trainer

GPU = torch.device("cuda")


class Crossings(TorchDispatchMode):
    """Lists the operations whose tensors are on two devices."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self.operations = 0

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        result = func(*args, **(kwargs or {}))
        self.operations += 1
        tensors = [leaf for leaf in tree_leaves((args, kwargs, result)) if isinstance(leaf, Tensor)]
        if len({tensor.device.type for tensor in tensors}) > 1:
            self.found.append(str(func))
        return result


class Zeros:
    def __init__(self) -> None:
        self.tensors: list[Tensor] = []

    def uniform(self, shape: tuple[int, ...], like: Tensor) -> Tensor:
        self.tensors.append(torch.zeros(shape, device=like.device))
        return self.tensors[-1]


def moved(learner: Trainer, to_gpu: Callable[[Tensor], Tensor]) -> None:
    learner.box = box = Box(to_gpu(learner.box.lower), to_gpu(learner.box.upper))
    for module in learner.fields.modules():
        module._parameters |= {k: nn.Parameter(to_gpu(v)) for k, v in module._parameters.items() if v is not None}
        module._buffers |= {k: to_gpu(v) for k, v in module._buffers.items() if v is not None}
        if hasattr(module, "box"):
            module.box = box
    learner.background = to_gpu(learner.background)
    clipping, grid = learner.clipping, learner.grid
    clipping._usual, clipping._clipped = to_gpu(clipping._usual), to_gpu(clipping._clipped)
    if grid is not None:
        grid.box = box
        grid.occupied, grid.within, grid.density = map(to_gpu, (grid.occupied, grid.within, grid.density))


def crossings(method: str, cells: int, capacity: float, forgotten: bool = False) -> Crossings:
    """Return what crosses in the loss of a step and in its clipping; with `forgotten`, a tensor stays behind."""
    _angular_frequencies.cache_clear()
    learner = trainer(method, replace(TRAIN, fine_bins=8, own={}, grid=replace(TRAIN.grid, cells=cells)))
    in_turns(learner, lambda run: run, None)
    learner.turns.capacity = capacity  # type: ignore[union-attr, misc]
    rays, colours = rays_and_colours()
    with FakeTensorMode() as mode, torch.no_grad():

        def to_gpu(tensor: Tensor) -> Tensor:
            return mode.from_tensor(tensor).to(GPU)

        moved(learner, to_gpu)
        there = Rays(to_gpu(rays.origins), to_gpu(rays.directions), rays.near, rays.far)
        colours, drawn = to_gpu(colours), Zeros()
        learner.loss(there, colours, drawn)  # constants are made here, before a step is captured
        if forgotten:
            learner.background = mode.from_tensor(torch.ones(()))
        with Crossings() as seen, training_step(learner.fields):
            result = learner.loss(there, colours, GivenDraws(drawn.tensors))
            learner.clipping.factor(result.loss)
        assert result.loss.device.type == "cuda"
    return seen


def nothing_crosses() -> None:
    for method in ("nerf", "qnerf", "qnerf_repaired", "qnerf_theorem", "nerf_released"):
        for cells, capacity in ((0, 1.0), (8, 1.0), (8, 0.5)):
            seen = crossings(method, cells, capacity)
            assert seen.operations > 300, "something must be looked at"
            assert not seen.found, f"{method}, {cells} cells, capacity {capacity}: {seen.found}"
    assert crossings("nerf", 0, 1.0, forgotten=True).found
