"""The class of a processor, which decides the order in which its library sums, and so the last bits of every number.

Which instructions torch uses is settled when it is imported, and by its environment: another class is measured in a
process of its own.
"""

import os
import platform
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import Any, TypeVar

from harness.machine.stopping import in_workers
from scenes.files.errors import InputError

Result = TypeVar("Result")

FORCED: dict[str, dict[str, str]] = {
    "default": {"ATEN_CPU_CAPABILITY": "default", "MKL_ENABLE_INSTRUCTIONS": "SSE4_2", "ONEDNN_MAX_CPU_ISA": "SSE41"},
    "avx2": {"ATEN_CPU_CAPABILITY": "avx2", "MKL_ENABLE_INSTRUCTIONS": "AVX2", "ONEDNN_MAX_CPU_ISA": "AVX2"},
    "avx512": {
        "ATEN_CPU_CAPABILITY": "avx512",
        "MKL_ENABLE_INSTRUCTIONS": "AVX512",
        "ONEDNN_MAX_CPU_ISA": "AVX512_CORE",
    },
}
"""Class → environment that forces its instructions, from the oldest on."""
OWN = {key: os.environ.get(key) for key in FORCED["default"]}
"""The environment of this process's own class."""


def class_here() -> str:
    """Return the class of this process: that of the processor, unless its environment forces another."""
    import torch

    capability = str(torch.backends.cpu.get_cpu_capability()).lower().replace("no avx", "default")
    machine = platform.machine()
    return capability if machine in ("x86_64", "AMD64") else f"{machine}_{capability}"


def classes_here() -> tuple[str, ...]:
    """Return the classes that can be measured on this machine, its own one last."""
    own = class_here()
    return tuple(FORCED)[: tuple(FORCED).index(own) + 1] if own in FORCED else (own,)


def environment_of(name: str) -> Mapping[str, str | None]:
    """Return what a process of class `name` needs, None for what must not be set. Raises `InputError` if this processor
    cannot be one of it.
    """
    possible = classes_here()
    if name not in possible:
        raise InputError(f"--class {name}: this processor can be measured as {' or '.join(possible)}")
    return OWN if name == class_here() else FORCED[name]


@contextmanager
def forced(name: str) -> Iterator[None]:
    """Make processes that start within this context be of class `name`."""
    before = {key: os.environ.get(key) for key in OWN}
    _set(environment_of(name))
    try:
        yield
    finally:
        _set(before)


def _set(environment: Mapping[str, str | None]) -> None:
    for key, value in environment.items():
        if value is None:
            os.environ.pop(key, None)
        else:
            os.environ[key] = value


def in_child(function: Callable[..., Result], *given: Any) -> Result:
    """Return `function(*given)`, called in a fresh process of one thread."""
    (result,) = in_workers([partial(function, *given)], 1)
    return result
