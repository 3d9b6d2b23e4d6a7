"""The table of commands: parse, call, exit code."""

import argparse
import errno
import os
import re
import shlex
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, NoReturn

from harness.command import (
    gate_command,
    history_command,
    judge_command,
    look_commands,
    machine_commands,
    run_command,
    settings_commands,
    study_commands,
    tensorboard_command,
)
from harness.execution.executors import leave
from harness.machine.wait_policy import wait_policy
from scenes.files.installed import packages_needed
from scenes.files.standard_output import go_on_unheard
from scenes.files.stopping import stop_on_signals

if TYPE_CHECKING:
    from harness.execution.progress import Progress


class Command(NamedTuple):
    """One command of `python -m harness`."""

    help: str
    add_options: Callable[[argparse.ArgumentParser], None]
    call: "Callable[[argparse.Namespace, Progress], int]"
    """Returns the exit code."""


# fmt: off
COMMANDS: dict[str, Command] = {
    "run": Command("render, train, score and record a comparison", run_command.add_run_options, run_command.run_run),
    "judge": Command("verdicts on anybody's table of results",
                     judge_command.add_judge_options, judge_command.run_judge),
    "score": Command("scores of pictures that another program rendered",
                     judge_command.add_score_options, judge_command.run_score),
    "compare": Command("how far two outputs of the same plan differ",
                       judge_command.add_compare_options, judge_command.run_compare),
    "gate": Command("has anything changed, and is it worse? (exit code 4)",
                    gate_command.add_gate_options, gate_command.run_gate),
    "history": Command("when did figures of gate and speed change?",
                       history_command.add_history_options, history_command.run_history),
    "view": Command("look at a finished run in the browser", look_commands.add_view_options, look_commands.run_view),
    "render": Command("a camera path through a finished run, its methods side by side",
                      look_commands.add_render_options, look_commands.run_render),
    "study": Command("measure a question: evidence, stability, speed, serving, conformance, …",
                     lambda command: _add(command.add_subparsers(dest="study", required=True, metavar="NAME"), STUDIES),
                     lambda options, show: STUDIES[options.study].call(options, show)),
    "doctor": Command("what this machine has, and how to get the rest",
                      machine_commands.add_doctor_options, machine_commands.run_doctor),
    "tensorboard": Command("write a run's cells for TensorBoard",
                           tensorboard_command.add_tensorboard_options, tensorboard_command.run_tensorboard),
    "completion": Command("print a completion script for your shell",
                          machine_commands.add_completion_options, machine_commands.run_completion),
}
STUDIES: dict[str, Command] = {
    "evidence": Command("the studies that a verdict rests on",
                        study_commands.add_evidence_options, study_commands.run_evidence),
    "frontier": Command("families of radiance fields at budgets of core seconds",
                        study_commands.add_frontier_options, study_commands.run_frontier),
    "stability": Command("try the catalogue of stiff and extreme cases",
                         study_commands.add_stability_options, study_commands.run_stability),
    "speed": Command("measure how fast training, rendering and scoring are on this machine",
                     study_commands.add_speed_options, study_commands.run_speed),
    "serving": Command("measure view cache, attention and first frame on a finished run",
                       study_commands.add_serving_options, study_commands.run_serving),
    "conformance": Command("hold methods to the contract of the catalogue (exit code 3)",
                           study_commands.add_conformance_options, study_commands.run_conformance),
    "sweep": Command("learning rates of every method on validation views, as JSON",
                     settings_commands.add_sweep_options, settings_commands.run_sweep),
    "families": Command("the same few trials of every family of the frontier, on validation views, as JSON",
                        settings_commands.add_families_options, settings_commands.run_families),
    "constants": Command("the unit of density and the start of the field of each method, on validation views, as JSON",
                         settings_commands.add_constants_options, settings_commands.run_constants),
    "equivalence": Command("what empty-space skipping and precision change in scores, as JSON",
                           settings_commands.add_equivalence_options, settings_commands.run_equivalence),
    "omissions": Command("what leaving out what a scene does not need saves and costs, as JSON",
                         settings_commands.add_omissions_options, settings_commands.run_omissions),
    "scaling": Command("the paper's full table on GPUs, on paper",
                       study_commands.add_scaling_options, study_commands.run_scaling),
}
"""`python -m harness study NAME`, and `python -m harness NAME` for short."""
# fmt: on


def parser(program: str = "python -m harness") -> argparse.ArgumentParser:
    """Return the parser with the options of each command; those of `run` are the same in every nox session."""
    top = argparse.ArgumentParser(prog=program, description="Train radiance-field methods side by side.")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    _add(commands, COMMANDS)
    return top


NEGATIVE_NUMBER = re.compile(r"-\d*\.?\d+([eE][+-]?\d+)?$")
"""A word that is no option; the pattern of argparse before Python 3.14 has no exponent."""


def _add(commands: "argparse._SubParsersAction[argparse.ArgumentParser]", table: dict[str, Command]) -> None:
    for name, command in table.items():
        added = commands.add_parser(name, help=command.help)
        command.add_options(added)
        added.allow_abbrev = False  # `--with` is no `--without`
        added._negative_number_matcher = NEGATIVE_NUMBER


def parsed(arguments: list[str], program: str = "python -m harness") -> argparse.Namespace:
    """The options that `arguments` choose; the name of a study stands for `study NAME`."""
    top = parser(program)
    options = top.parse_args(["study", *arguments] if arguments and arguments[0] in STUDIES else arguments)
    options.parser = top
    return options


def main(arguments: list[str], program: str = "python -m harness") -> int:
    """0 done · 1 our own error · 2 bad usage or input · 3 a cell diverged or failed · 4 a gate failed · 130 stopped."""
    options = parsed(arguments, program)
    # after the parsing, so that --help and a mistyped option answer at once
    from harness.execution.progress import chosen_progress
    from scenes.files.errors import DamagedRecord, InputError, as_text, readable

    show = chosen_progress(getattr(options, "quiet", False) or getattr(options, "dry_run", False))
    try:
        options.line = as_text(shlex.join(["python", "-m", "harness", *arguments]))
        return COMMANDS[options.command].call(options, show)
    except (InputError, DamagedRecord) as mistake:
        show.close()
        print(f"error: {mistake}", file=sys.stderr)
        return 2
    except OSError as error:
        names = (errno.ENAMETOOLONG, errno.ELOOP, errno.ENOTDIR, errno.EISDIR, errno.EPERM, errno.EEXIST, errno.EIO)
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, *names):
            raise
        show.close()
        print(f"error: {readable(str(error.filename))}: {error.strerror}; repair that, then --resume", file=sys.stderr)
        return 2
    except KeyboardInterrupt as stop:
        show.close()
        left = "finished cells are kept; go on with --resume and --out" if "resume" in options else "nothing is kept"
        print(f"interrupted: {str(stop) or left}", file=sys.stderr)
        return 130
    finally:
        show.close()
        leave()


def ours_first(environment: Mapping[str, str]) -> dict[str, str]:
    """Return variables with which started processes find our packages first, and nothing in the current folder."""
    root = str(Path(__file__).resolve().parents[2])
    others = [path for path in environment.get("PYTHONPATH", "").split(os.pathsep) if path and path != root]
    return {"PYTHONSAFEPATH": "1", "PYTHONPATH": os.pathsep.join([root, *others])}


def run_as_process(call: Callable[[list[str]], int], arguments: list[str]) -> NoReturn:
    """Call a command and end this process with its exit code."""
    os.environ.update(wait_policy(os.environ))  # before torch is imported; every process that is started inherits it
    os.environ.update(ours_first(os.environ))
    go_on_unheard()
    stop_on_signals()
    with packages_needed():
        code = call(arguments)
    sys.stdout.flush()
    sys.stderr.flush()
    # without the interpreter's teardown, in which OpenImageIO's bindings print warnings that no user asked for
    os._exit(code)
