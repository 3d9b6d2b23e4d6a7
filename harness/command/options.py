"""The options that several commands have, named and explained the same way; nothing heavy is imported for them."""

import argparse
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

SHARED: dict[str, dict[str, Any]] = {
    "--device": {"default": "auto", "choices": ("auto", "cpu", "cuda"), "help": "ROCm is torch's cuda"},
    "--view-sets": {
        "type": Path, "default": Path("out/view_sets"), "metavar": "DIR", "help": "cache of view sets",
    },
    "--threads": {"type": int, "metavar": "N", "help": "that render (default: all cores but one)"},
    "--seed": {"type": int, "default": 0, "metavar": "N", "help": "of the weights that are shown (default: 0)"},
    "--scenes": {"nargs": "+", "metavar": "SCENE", "help": "scenes of the run (default: all)"},
    "--methods": {"nargs": "+", "metavar": "METHOD", "help": "methods of the run (default: all)"},
    "--resolution": {"type": int, "metavar": "PX", "help": "width of the pictures (default: that of the run's views)"},
    "--out": {"type": Path, "metavar": "DIR", "help": "output folder (default: a fresh one in out/)"},
    "--resume": {"action": "store_true", "help": "do what --out lacks"},
    "--dry-run": {"action": "store_true", "help": "print the plan and its estimated cost, do nothing"},
    "--list": {"action": "store_true", "help": "print what can be named, do nothing"},
    "--quick": {"action": "store_true", "help": "sizes at which no figure means anything, to try the command itself"},
    "--quiet": {"action": "store_true", "help": "no progress"},
}  # fmt: skip
"""Map option → the arguments of `add_argument`."""


def add_shared(command: argparse.ArgumentParser, *names: str, **own: Any) -> None:
    """Add options of the table; `own` arguments, such as another `help`, overrule it for all of them."""
    for name in names:
        command.add_argument(name, **{**SHARED[name], **own})


def add_finished_run(command: argparse.ArgumentParser, name: str = "out") -> None:
    """Add the argument that names a finished run."""
    what = "output folder of a finished run (default: out/latest)"
    command.add_argument(name, type=Path, nargs="?", default=Path("out/latest"), metavar="OUT", help=what)


def require_folder(out: Path) -> None:
    """Raise `InputError` for an `--out` that is a file."""
    from scenes.files.errors import InputError

    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out}: is a file; name a folder")


def reported(out: Path) -> int:
    """Have the page of `out` made from its records alone, as every page is; returns the exit code."""
    return subprocess.run([sys.executable, "-m", "reports", str(out), "--quiet"], check=False).returncode


def require_between(options: argparse.Namespace, **bounds: tuple[float, float]) -> None:
    """Raise `InputError` for an option that is given, and not finite and between its bounds."""
    from scenes.files.errors import InputError

    for name, (least, most) in bounds.items():
        value = getattr(options, name)
        if value is not None and not (math.isfinite(value) and least <= value <= most):
            number = f"{value:g}" if isinstance(value, float) else value
            raise InputError(f"--{name.replace('_', '-')} {number}: must lie between {least:g} and {most:g}")
