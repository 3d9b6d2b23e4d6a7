"""The settings of a process that its cells share: a method that changes them would change the other cells."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch

SHARED: dict[str, tuple[Callable[[], Any], Callable[[Any], Any]]] = {
    "torch's default dtype": (torch.get_default_dtype, torch.set_default_dtype),
    "torch's default device": (torch.get_default_device, torch.set_default_device),
    "torch's number of threads": (torch.get_num_threads, torch.set_num_threads),
    "whether torch records gradients": (torch.is_grad_enabled, torch.set_grad_enabled),
    "whether torch is deterministic": (torch.are_deterministic_algorithms_enabled, torch.use_deterministic_algorithms),
    "numpy's handling of errors": (np.geterr, lambda before: np.seterr(**before)),
}
"""Description → how it is read and set."""


class SharedStateChanged(RuntimeError):
    """A method changed settings of the process; the message says which."""


@contextmanager
def left_as_it_was() -> Iterator[None]:
    """Restore the settings at the end; raises `SharedStateChanged` if one was changed and nothing else is raised."""
    before = {name: read() for name, (read, _) in SHARED.items()}
    changed: list[str] = []
    try:
        yield
    finally:
        for name, (read, put) in SHARED.items():
            if (now := read()) != before[name]:
                put(before[name])
                changed.append(f"{name} from {before[name]} to {now}")
    if changed:
        raise SharedStateChanged(f"changes {', '.join(changed)}, for every cell of the process; restore it")
