"""`python -m harness gate`: its options, and how they are checked. Nothing heavy is imported to show the help."""

import argparse
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from harness.command.history_command import add_history_option, remember
from harness.command.options import add_shared
from harness.gate.gates import KINDS, Gate, gates

if TYPE_CHECKING:
    from harness.execution.progress import Progress

LIMITS = Path("gates/limits.json")


def add_gate_options(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    add("--only", nargs="+", metavar="NAME", help="gates, or beginnings of their names: changed worse.qnerf images …")
    add(
        "--renew",
        action="store_true",
        help="measure limits and references anew, of committed code, and write them",
    )
    add("--limits", type=Path, default=LIMITS, metavar="FILE", help=f"limits to hold to (default: {LIMITS})")
    add_shared(command, "--view-sets", "--out", "--list")
    add("--rank", type=Path, metavar="RUN", help="compare the order of methods with that of a finished run, no more")
    add_history_option(command)
    add_shared(command, "--quiet", help="no progress, and no table")


def run_gate(options: argparse.Namespace, show: "Progress") -> int:
    """Return 0, or 4 if a gate failed; raises `InputError` for invalid options."""
    table = chosen(options.only)
    if options.list:
        for gate in table:
            print(f"{gate.name:34} {gate.what}{gate.unit and f', {gate.unit}'}")
        print(f"{len(gates())} gates")
        return 0
    if options.rank is not None:
        from harness.gate.references import publish

        show.line(publish(options.rank, options.limits.parent))
        return 0

    from harness.gate.gate_run import SHELF, context_for, renew, run
    from harness.machine.processor_class import class_here
    from harness.run_folder.folder_lock import locked_folder
    from harness.run_folder.output_folder import fresh_folder, make_ours

    out = options.out or fresh_folder("gate", resume=False)
    # before a folder is made
    context = context_for(table, options.limits, out, options.view_sets, show, options.renew)
    with locked_folder(out):
        make_ours(out)
        if options.renew:
            return renew(context)
        replay = ["python", "-m", "harness", "gate"]
        if options.limits != LIMITS:
            replay += ["--limits", str(options.limits)]
        code = run(context, shlex.join(replay))
        remember(options.history, out / SHELF.file, class_here(), show)
        return code


def chosen(names: list[str] | None) -> tuple[Gate, ...]:
    """Return the gates of these names, or whose names begin with them; raises `InputError` for one that matches
    none.
    """
    from scenes.files.errors import InputError

    table = gates()
    if names is None:
        return table
    selected = [gate for gate in table if any(_begins(gate.name, name) for name in names)]
    unknown = [name for name in names if not any(_begins(gate.name, name) for gate in table)]
    if unknown:
        raise InputError(
            f"--only: no gate's name begins with {' '.join(map(repr, unknown))}; known: {' '.join(KINDS)}, "
            "and what --list prints"
        )
    return tuple(selected)


def _begins(name: str, start: str) -> bool:
    return name == start or name.startswith(start.removesuffix(".") + ".")
