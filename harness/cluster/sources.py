"""What a node must have in common with the driver for its cells to belong to the run: our sources and packages."""

import hashlib
import platform
from functools import cache
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGES = ("harness", "scenes", "baselines")
"""Of ours: what a cell needs, sent to every node."""
CHECKED = ("torch", "numpy", "drjit", "OpenImageIO", "flip-evaluator", "scipy", "safetensors", "jaxtyping")
"""Of others: what a cell's bits or scores may depend on. Mitsuba is needed where view sets are rendered alone."""
PROGRAM = "this program"
"""Among `versions`, our own sources."""


def our_folders() -> list[Path]:
    """The folder of each of `PACKAGES`, as this process imports it: on a node each may lie somewhere else."""
    return [Path(next(iter(import_module(name).__path__))).resolve() for name in PACKAGES]


@cache
def versions() -> dict[str, str]:
    """Python, `CHECKED`, and a digest of our own sources, of this process, as they were when it was first asked."""
    found = {"Python": platform.python_version(), PROGRAM: _digest(our_folders())}
    return found | {name: installed(name) for name in CHECKED}


@cache
def installed(package: str) -> str:
    """The version of a package, which is not imported; "not installed" where there is none."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def differences(ours: dict[str, str], theirs: dict[str, str]) -> str:
    """What differs, in words; empty where nothing does."""
    return ", ".join(
        f"{name} {theirs.get(name, 'unknown')} instead of {value}"
        for name, value in ours.items()
        if theirs.get(name) != value
    )


def changed_since(ours: dict[str, str]) -> str:
    """`differences` to this process, with our own sources read again."""
    return differences(ours, {**versions(), PROGRAM: _digest(our_folders())})


def _digest(folders: list[Path]) -> str:
    """16 hexadecimal digits of every Python file's name and bytes."""
    found = hashlib.sha256()
    for folder in folders:
        for file in sorted(folder.rglob("*.py")):
            found.update(file.relative_to(folder.parent).as_posix().encode())
            found.update(hashlib.sha256(file.read_bytes()).digest())
    return found.hexdigest()[:16]
