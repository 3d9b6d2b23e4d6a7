"""radiance-verdict COMMAND: the commands of `python -m harness`, and `report`, that of `python -m reports`."""

import sys
from pathlib import Path

from harness.command.main import main as command
from harness.command.main import run_as_process

PROGRAM = "radiance-verdict"


def called(arguments: list[str]) -> int:
    """Call the command that the arguments name; returns its exit code."""
    if arguments[:1] == ["report"]:
        from reports.__main__ import main as report

        return report(arguments[1:], f"{PROGRAM} report")
    return command(arguments, PROGRAM)


def main() -> None:
    sys.path.append(str(Path.cwd()))  # a method of the user's own module, behind everything that is installed
    run_as_process(called, sys.argv[1:])
