"""`python -m harness scaling`: its option, and what it does."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harness.progress import Progress


def add_options(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--speed", type=Path, default=Path("docs/speed.json"), metavar="FILE", help="what `nox -s speed` measured here"
    )


def run_scaling(options: argparse.Namespace, show: "Progress") -> int:
    """Prints the page; raises `DamagedRecord` or `InputError` for a file that does not say enough."""
    import sys

    from harness.scaling_page import page
    from harness.speed_record import read_speed

    sys.stdout.write(page(read_speed(options.speed)))
    return 0
