"""`python -m harness run` as a user types it, in a process of its own and in this one."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from harness.command.main import main

ROOT = Path(__file__).parents[2]
TINY = shlex.split("--profile smoke --resolution 24 --methods nerf qnerf --seeds 2 --budget-steps 34 --workers 1")
CELLS = [("nerf", 0), ("nerf", 1), ("qnerf", 0), ("qnerf", 1)]


def command(*arguments: str | Path) -> list[str]:
    return [sys.executable, "-m", "harness", "run", *map(str, arguments)]


def on_one_core() -> None:
    """Bind the process to one core: the same bits on every machine, and no threads that wait on a busy core."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


def shell(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command(*arguments), cwd=ROOT, capture_output=True, text=True, preexec_fn=on_one_core)


def refused(capsys: pytest.CaptureFixture[str], *arguments: str | Path, command: str = "run") -> str:
    """Return the single line with which a bad call ends; an exception fails the test."""
    assert main([command, *map(str, arguments)]) == 2
    _, said = capsys.readouterr()
    assert said.startswith("error: ")
    assert said.count("\n") == 1
    return said
