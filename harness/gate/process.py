"""Measuring in a fresh process: which instructions torch uses is settled when it is imported, and by its environment.

The class of a processor is what decides the order in which its library sums, and so the last bits of every number.
"""

import os
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from harness.machine.stopping import end_with_parent
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
    """Run `function(*given)` in a fresh process. Raises `RuntimeError` with its error output if it fails."""
    return in_children(function, [given])[0]


def in_children(function: Callable[..., Result], given: Sequence[tuple[Any, ...]]) -> list[Result]:
    """Run `function` on each of `given`, in fresh processes side by side."""
    context = get_context("spawn")
    children = []
    try:
        for one in given:
            ours, theirs = context.Pipe(duplex=False)
            process = context.Process(target=_answer, args=(theirs, function, one), daemon=True)
            process.start()
            theirs.close()
            children.append((ours, process))
        return [_received(ours) for ours, _ in children]
    finally:
        for _, process in children:
            process.kill()  # it has said what it had to
            process.join()


def _received(connection: Connection) -> Any:
    try:
        failed, answer = connection.recv()
    except EOFError:
        failed, answer = True, "it ended without an answer"
    if failed:
        raise RuntimeError(f"the process that measures: {answer}")
    return answer


def _answer(connection: Connection, function: Callable[..., Any], given: tuple[Any, ...]) -> None:
    end_with_parent()
    from harness.machine.device import keep_freed_memory, use_threads

    use_threads(1)
    keep_freed_memory()
    try:
        connection.send((False, function(*given)))
    except Exception as error:
        connection.send((True, f"{type(error).__name__}: {error}"))
    connection.close()
    # without the interpreter's teardown, in which OpenImageIO's bindings print warnings that no user asked for
    os._exit(0)
