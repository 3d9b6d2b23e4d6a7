"""Tables of options, the options of several commands, and checks of values; nothing heavy is imported."""

import argparse
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from harness.execution.progress import Progress
from scenes.files.errors import InputError

Options = dict[str, dict[str, Any]]
"""Names of an option, or of a positional argument → the keyword arguments of `add_argument`."""


class Command(NamedTuple):
    """One command of `python -m harness`."""

    help: str
    options: Options
    call: Callable[[argparse.Namespace, Progress], int]
    """Returns the exit code."""
    description: str | None = None


def option(
    help: str,
    metavar: str | tuple[str, ...] | None = None,
    type: Callable[[str], object] | None = None,
    **more: object,
) -> dict[str, Any]:
    """Return keyword arguments of `add_argument`; `SHARED` has defaults for options of the same name."""
    given = {"help": help, "metavar": metavar, "type": type}
    return {name: value for name, value in given.items() if value is not None} | more


def flag(help: str) -> dict[str, Any]:
    return option(help, action="store_true")


SHARED: Options = {
    "--device": option("device; ROCm is torch's cuda", default="auto", choices=("auto", "cpu", "cuda")),
    "--view-sets": option("cache of view sets", "DIR", Path, default=Path("out/view_sets")),
    "--threads": option("threads of rendering (default: all cores but one)", "N", int),
    "--seed": option("seed of the weights to show (default: 0)", "N", int, default=0),
    "--scenes": option("scenes of the run (default: all)", "SCENE", nargs="+"),
    "--methods": option("methods of the run (default: all)", "METHOD", nargs="+"),
    "--resolution": option("width of the pictures (default: that of the run's views)", "PX", int),
    "--out": option("output folder (default: a fresh one in out/)", "DIR", Path),
    "--resume": flag("measure only what --out lacks"),
    "--dry-run": flag("only print the plan and its estimated cost"),
    "--list": flag("only print the known names"),
    "--quick": flag("sizes at which no figure means anything, to try the command itself"),
    "--quiet": flag("no progress"),
    "--lpips": option("weights of LPIPS, to score with (docs/read-the-report.md)", "FILE", Path),
    "--history": option(
        "file to append the figures to, for `python -m harness history` (default: history.jsonl next to --out)",
        "FILE",
        Path,
    ),
}
FINISHED_RUN = option(
    "output folder of a finished run (default: out/latest)", "OUT", Path, nargs="?", default=Path("out/latest")
)


def shared(*names: str) -> Options:
    return {name: {} for name in names}


def add_options(command: argparse.ArgumentParser, options: Options) -> None:
    for names, arguments in options.items():
        command.add_argument(*names.split(), **{**SHARED.get(names, {}), **arguments})


def require_folder(out: Path) -> None:
    """Raise `InputError` for an `--out` that is a file."""
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out}: is a file; name a folder")


def reported(out: Path, quiet: bool = True) -> int:
    """Write the page of `out` in another process, which has only its records, and unless `quiet` prints the verdict.
    Return its exit code: 1 if a signal ended it.
    """
    words = [str(out), "--quiet"] if quiet else [str(out)]
    code = subprocess.run([sys.executable, "-m", "reports", *words], check=False).returncode
    return code if code >= 0 else 1


def require_between(options: argparse.Namespace, **bounds: tuple[float, float]) -> None:
    """Raise `InputError` for a given option that is not finite or not between its bounds."""
    for name, (least, most) in bounds.items():
        value = getattr(options, name, None)
        if value is not None and not (math.isfinite(value) and least <= value <= most):
            number = f"{value:g}" if isinstance(value, float) else value
            raise InputError(f"--{name.replace('_', '-')} {number}: must lie between {least:g} and {most:g}")


def require_use(options: argparse.Namespace, when: str, is_so: bool, *names: str) -> None:
    """Raise `InputError` for one of the options `names` that is given although it means something only `when`."""
    for name in names if not is_so else ():
        value = getattr(options, name, None)
        if value not in (None, False, []):
            words = [] if value is True else value if isinstance(value, list) else [value]
            said = " ".join([f"--{name.replace('_', '-')}", *map(str, words)])
            raise InputError(f"{said}: only {when}; otherwise leave it out")
