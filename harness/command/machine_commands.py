"""`python -m harness completion SHELL | doctor`.

Shells complete by the name of a program, which for `python -m harness` is python. So the completion script defines a
function (in tcsh an alias) `harness` that calls it, and completes that.
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
    # compdef exists once compinit was called, which a fresh account does not do
    "zsh": "whence compdef >/dev/null || { autoload -Uz compinit && compinit -i }\n"
    'harness() {\n  python -m harness "$@"\n}\n',
    "tcsh": "alias harness 'python -m harness'\n",
    "fish": "function harness\n  python -m harness $argv\nend\n",
}
"""Shell → its definition of `harness`."""


COMPLETION: Options = {
    "shell": option(
        'bash and zsh: eval "$(python -m harness completion SHELL)"; fish: … | source; tcsh: … > FILE; source FILE',
        choices=tuple(SHELLS),
    )
}
DOCTOR: Options = {"--json": flag("print one JSON list instead of lines")}


def run_completion(options: argparse.Namespace, show: "Progress") -> int:
    sys.stdout.write(script(options.shell, options.parser))
    return 0


def script(shell: str, parser: argparse.ArgumentParser) -> str:
    """Return the script for the commands of `parser`, with the names that this installation knows."""
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
    """Yield the actions of the parser and of its commands; sets the `prog` of each."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for name, command in action.choices.items():
                command.prog = f"{parser.prog} {name}"
                yield from _actions(command)


def run_doctor(options: argparse.Namespace, show: "Progress") -> int:
    from harness.machine.doctor import findings

    known = []
    for finding in findings():
        known.append(finding)
        if not options.json:
            show.line(f"{finding.verdict:8} {finding.what}: {finding.found}")
            if finding.verdict != "ok":
                show.line(f"         → {finding.to_do}")
    lacking = [finding.what for finding in known if finding.verdict == "missing" and finding.needed]
    if options.json:
        show.line(json.dumps([asdict(finding) for finding in known], indent=2, ensure_ascii=False))
    else:
        show.line(f"missing, and needed: {', '.join(lacking)}" if lacking else "nothing that is needed is missing")
    return 2 if lacking else 0


COMMANDS = {
    "doctor": Command("show what this machine has, and how to get the rest", DOCTOR, run_doctor),
    "completion": Command("print a completion script for your shell", COMPLETION, run_completion),
}
