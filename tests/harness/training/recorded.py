"""A stand-in for the graph of a GPU: it records the operations of a run, and repeats them on the same memory.

A replay executes no Python of the step. What the host decided while recording stays as it was, and a value that the
host reads cannot be recorded: these are the limits of a CUDA or HIP graph.
"""

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_flatten

READ_BY_THE_HOST = {
    "aten::_local_scalar_dense", "aten::nonzero", "aten::is_nonzero", "aten::equal", "aten::masked_select",
    "aten::unique_dim", "aten::_unique2", "aten::bincount", "aten::item", "aten::repeat_interleave.Tensor",
}  # fmt: skip
DRAWN = ("aten::rand", "aten::randn", "aten::randint", "aten::randperm", "aten::uniform_", "aten::normal_")


class CannotBeCaptured(RuntimeError):
    pass


class Recording(TorchDispatchMode):
    def __init__(self) -> None:
        super().__init__()
        self.operations: list[tuple[Any, tuple[Any, ...], dict[str, Any], Any]] = []

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        name = func._schema.name
        if name in READ_BY_THE_HOST:
            raise CannotBeCaptured(f"{name}: the host would wait for the device")
        if name.startswith(DRAWN):
            raise CannotBeCaptured(f"{name}: numbers that a replay would not draw anew")
        for index in args[1] if name.startswith("aten::index") and isinstance(args[1], list | tuple) else ():
            if isinstance(index, Tensor) and index.dtype == torch.bool:
                raise CannotBeCaptured(f"{name}: a mask as an index has a shape that depends on values")
        result = func(*args, **(kwargs or {}))
        self.operations.append((func, args, kwargs or {}, result))
        return result


def recorded(run: Callable[[], object]) -> Callable[[], object]:
    """Record `run`, and undo nothing: the caller restores the state. Raises `CannotBeCaptured`."""
    recording = Recording()
    with recording:
        run()

    def replay() -> None:
        with torch.no_grad():
            for func, args, kwargs, before in recording.operations:
                for place, value in zip(_tensors(before), _tensors(func(*args, **kwargs)), strict=True):
                    if place.data_ptr() != value.data_ptr():  # neither a view of an input nor changed in place
                        place.copy_(value)

    return replay


def _tensors(value: object) -> list[Tensor]:
    return [leaf for leaf in tree_flatten(value)[0] if isinstance(leaf, Tensor)]
