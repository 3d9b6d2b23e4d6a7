"""`python -m harness completion SHELL | doctor`: a script that completes commands, options and names; what is missing.

Shells complete by the name of a program, and that of `python -m harness` is python's. The script therefore defines a
function (in tcsh an alias) `harness`, which is `python -m harness`, and completes that.
"""

import argparse
import copy
import json
import sys
from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING

from harness.command.options import Command, Options, flag, option

if TYPE_CHECKING:
    from harness.execution.progress import Progress

SHELLS = {
    "bash": 'harness() {\n  python -m harness "$@"\n}\n',
    # its compdef is there once compinit was called, which a fresh account does not do
    "zsh": "whence compdef >/dev/null || { autoload -Uz compinit && compinit -i }\n"
    'harness() {\n  python -m harness "$@"\n}\n',
    "tcsh": "alias harness 'python -m harness'\n",
    "fish": "function harness\n  python -m harness $argv\nend\n",
}
"""Shell → the definition of `harness` in it."""


COMPLETION: Options = {
    "shell": option(
        'bash and zsh: eval "$(python -m harness completion SHELL)"; fish: … | source; tcsh: … > FILE; source FILE',
        choices=tuple(SHELLS),
    )
}
DOCTOR: Options = {"--json": flag("one JSON list instead of lines")}


def run_completion(options: argparse.Namespace, show: "Progress") -> int:
    sys.stdout.write(script(options.shell, options.parser))
    return 0


def script(shell: str, parser: argparse.ArgumentParser) -> str:
    """Return the script for the commands that `parser` has, with the names that this installation knows."""
    import shtab

    from harness.plan.plugins import method_names
    from harness.plan.profiles import PROFILES
    from scenes.catalog.entries import CATALOG

    parser = copy.deepcopy(parser)
    parser.prog = "harness"
    values = {"scenes": list(CATALOG), "methods": method_names(), "profile": list(PROFILES)}
    for action in _actions(parser):
        if action.dest in values and not action.choices:
            action.choices = values[action.dest]
        elif action.metavar == "DIR":
            action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
        elif action.metavar in ("FILE", "OUT"):
            action.complete = shtab.FILE  # type: ignore[attr-defined]
    return SHELLS[shell] + shtab.complete(parser, shell)


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield the actions of the parser and of its commands, with the names of the commands."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for name, command in action.choices.items():
                command.prog = f"{parser.prog} {name}"
                yield from _actions(command)


def run_doctor(options: argparse.Namespace, show: "Progress") -> int:
    from harness.machine.doctor import findings

    all_findings = []
    for finding in findings():
        all_findings.append(finding)
        if not options.json:
            show.line(f"{finding.verdict:8} {finding.what}: {finding.found}")
            if finding.verdict != "ok":
                show.line(f"         → {finding.to_do}")
    if options.json:
        show.line(json.dumps([asdict(finding) for finding in all_findings], indent=2, ensure_ascii=False))
    lacking = [finding.what for finding in all_findings if finding.verdict == "missing" and finding.needed]
    if not options.json:
        show.line(f"missing, and needed: {', '.join(lacking)}" if lacking else "everything that is needed is there")
    return 2 if lacking else 0


COMMANDS = {
    "doctor": Command("what this machine has, and how to get the rest", DOCTOR, run_doctor),
    "completion": Command("print a completion script for your shell", COMPLETION, run_completion),
}
