"""The table of commands: parse, call, exit code."""

import argparse
import errno
import os
import re
import shlex
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NoReturn

from harness.command import gate_command as gate
from harness.command import judge_command as judge
from harness.command import look_commands as look
from harness.command import machine_commands as machine
from harness.command import run_command as run
from harness.command import settings_commands as settings
from harness.command import study_commands as study
from harness.command.options import Command, add_options
from harness.execution.executors import leave
from harness.execution.progress import chosen_progress
from harness.machine.wait_policy import wait_policy
from scenes.files.errors import DamagedRecord, InputError, as_text, readable
from scenes.files.installed import packages_needed
from scenes.files.standard_output import go_on_unheard
from scenes.files.stopping import stop_on_signals

STUDIES = study.STUDIES | settings.STUDIES
"""`python -m harness study NAME`, and `python -m harness NAME` for short."""
STUDY = Command(
    "measure a question: evidence, stability, speed, serving, conformance, …",
    {},
    lambda options, show: STUDIES[options.study].call(options, show),
)
COMMANDS = {
    **run.COMMANDS,
    **judge.COMMANDS,
    **gate.COMMANDS,
    **look.COMMANDS,
    "study": STUDY,
    **machine.COMMANDS,
}


def parser(program: str = "python -m harness") -> argparse.ArgumentParser:
    """Return the parser with the options of each command; those of `run` are the same in every nox session."""
    top = argparse.ArgumentParser(prog=program, description="Train radiance-field methods side by side.")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    _add(commands, COMMANDS)
    return top


NEGATIVE_NUMBER = re.compile(r"-\d*\.?\d+([eE][+-]?\d+)?$")
"""A word that is not an option; the pattern of argparse before Python 3.14 has no exponent."""


def _add(commands: "argparse._SubParsersAction[argparse.ArgumentParser]", table: dict[str, Command]) -> None:
    for name, command in table.items():
        added = commands.add_parser(name, help=command.help, description=command.description)
        add_options(added, command.options)
        if command is STUDY:
            _add(added.add_subparsers(dest="study", required=True, metavar="NAME"), STUDIES)
        added.allow_abbrev = False  # `--with` must not be read as `--without`
        added._negative_number_matcher = NEGATIVE_NUMBER


def parsed(arguments: list[str], program: str = "python -m harness") -> argparse.Namespace:
    """Parse the arguments; the name of a study is short for `study NAME`."""
    return parser(program).parse_args(["study", *arguments] if arguments and arguments[0] in STUDIES else arguments)


def main(arguments: list[str], program: str = "python -m harness") -> int:
    """Return 0 done · 1 a bug · 2 bad usage or input · 3 a cell diverged or failed · 4 a gate failed · 130 stopped."""
    options = parsed(arguments, program)
    show = chosen_progress(getattr(options, "quiet", False) or getattr(options, "dry_run", False))

    def ended(why: str, code: int) -> int:
        show.close()
        print(why, file=sys.stderr)
        return code

    try:
        options.line = as_text(shlex.join(["python", "-m", "harness", *arguments]))
        return COMMANDS[options.command].call(options, show)
    except (InputError, DamagedRecord) as mistake:
        return ended(f"error: {mistake}", 2)
    except OSError as error:
        if error.errno in (errno.EMFILE, errno.ENFILE):
            return ended("error: no more files may be opened; allow more (ulimit -n 1024), then --resume", 2)
        names = (errno.ENAMETOOLONG, errno.ELOOP, errno.ENOTDIR, errno.EISDIR, errno.EPERM, errno.EEXIST, errno.EIO)
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, *names):
            raise
        return ended(f"error: {readable(str(error.filename))}: {error.strerror}; repair that, then --resume", 2)
    except KeyboardInterrupt as stop:
        left = "finished cells are kept; use --resume and --out" if "resume" in options else "nothing is kept"
        return ended(f"interrupted: {str(stop) or left}", 130)
    finally:
        show.close()
        leave()


def ours_first(environment: Mapping[str, str]) -> dict[str, str]:
    """Return variables with which child processes find this program first, and no package of the current folder."""
    root = str(Path(__file__).resolve().parents[2])
    others = [path for path in environment.get("PYTHONPATH", "").split(os.pathsep) if path and path != root]
    return {"PYTHONSAFEPATH": "1", "PYTHONPATH": os.pathsep.join([root, *others])}


def run_as_process(call: Callable[[list[str]], int], arguments: list[str]) -> NoReturn:
    """Call a command and end this process with its exit code."""
    os.environ.update(wait_policy(os.environ))  # before torch is imported; child processes inherit it
    os.environ.update(ours_first(os.environ))
    go_on_unheard()
    stop_on_signals()
    with packages_needed():
        code = call(arguments)
    sys.stdout.flush()
    sys.stderr.flush()
    # skip the interpreter's teardown, in which OpenImageIO's bindings print warnings
    os._exit(code)
