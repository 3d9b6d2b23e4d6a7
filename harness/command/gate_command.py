"""`python -m harness gate | history`; `speed` appends to the history as well."""

import argparse
import shlex
import time
from pathlib import Path

from harness.command.options import Command, Options, flag, option, reported, require_folder, require_use, shared
from harness.execution.progress import Progress
from harness.gate.gates import KINDS, Gate, gates
from scenes.files.errors import InputError

LIMITS, HISTORY_FILE = Path("gates/limits.json"), Path("out/history.jsonl")

GATE: Options = {
    "--only": option("gates, or beginnings of their names: changed worse.qnerf images …", "NAME", nargs="+"),
    "--renew": flag("measure the limits and references of committed code again, and write them"),
    "--limits": option(f"limits of the gates (default: {LIMITS})", "FILE", Path, default=LIMITS),
    **shared("--view-sets", "--out", "--list"),
    "--history": {},
    "--quiet": option("no progress, and no table"),
}
FIGURES = (
    "The figures of every `gate` and `nox -s speed` that appended to FILE, drawn over the runs: which figures changed, "
    "between which commits, on which class of processor."
)
HISTORY: Options = {
    "file": option(f"default: {HISTORY_FILE}", "FILE", Path, nargs="?", default=HISTORY_FILE),
    "--out": option("folder of the page (default: out/history)", default=Path("out/history")),
}


def run_gate(options: argparse.Namespace, show: Progress) -> int:
    table = chosen(options.only)
    require_use(options, "without --renew", not options.renew, "history")
    if options.list:
        for gate in table:
            print(f"{gate.name:34} {gate.what}{gate.unit and f', {gate.unit}'}")
        print(f"{len(gates())} gates")
        return 0

    from harness.gate.gate_run import SHELF, context_for, renew, run
    from harness.machine.processor_class import class_here
    from harness.run_folder.folder_lock import locked_folder
    from harness.run_folder.output_folder import fresh_folder, make_ours

    out = options.out or fresh_folder("gate", resume=False)
    # raises before a folder is made
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
    """Return the gates whose names are or begin with one of `names`; raises `InputError` for a name without a gate."""
    table = gates()
    if names is None:
        return table

    def begins(gate: Gate, start: str) -> bool:
        return gate.name == start or gate.name.startswith(start.removesuffix(".") + ".")

    if unknown := [name for name in names if not any(begins(gate, name) for gate in table)]:
        raise InputError(
            f"--only: no gate's name begins with {' '.join(map(repr, unknown))}; known: {' '.join(KINDS)}, "
            "and what --list prints"
        )
    return tuple(gate for gate in table if any(begins(gate, name) for name in names))


def run_history(options: argparse.Namespace, show: Progress) -> int:
    from harness.machine.provenance import code_here
    from harness.records.study import SHELVES, write_studies
    from harness.verdicts.history.figures_over_runs import figures_over_runs
    from harness.verdicts.history.past_runs import read_history

    require_folder(options.out)
    runs, damaged = read_history(options.file)
    record = figures_over_runs(runs, damaged, {"file": str(options.file)}, code_here())
    write_studies(options.out / SHELVES["history"], record)
    for study in record.studies:
        show.line(f"{study.info.title}: {study.scale}")
        for answer in study.answers:
            show.line(f"  {answer}")
    return reported(options.out)


def remember(file: Path | None, record: Path, of_class: str, show: Progress) -> None:
    """Append the figures of a record of studies to the history; a failure to write it is only reported."""
    from harness.records.study import read_studies
    from harness.verdicts.history.past_runs import PastRun, append

    studies = read_studies(record)
    figures = {check.id: check for _, check in studies.checks() if check.id and check.value is not None}
    facts = studies.provenance
    run = PastRun(
        when=time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        command=studies.shelf,
        commit=facts["commit"],
        of_class=of_class,
        processor=facts["processor"],
        threads=facts["threads"],
        values={name: float(check.value) for name, check in figures.items() if check.value is not None},
        units={name: check.unit for name, check in figures.items() if check.unit},
    )
    file = file or record.parent.parent / HISTORY_FILE.name
    try:
        append(file, run)
    except OSError as error:
        show.line(f"{file}: {error.strerror}; the figures are not in the history, name another file (--history)")


COMMANDS = {
    "gate": Command("has anything changed, and is it worse? (exit code 4)", GATE, run_gate),
    "history": Command("when did figures of gate and speed change?", HISTORY, run_history, FIGURES),
}
