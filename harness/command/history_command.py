"""`python -m harness history`: its options, what it does, and how `gate` and `speed` append to its file."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from harness.command.options import add_shared, reported, require_folder

if TYPE_CHECKING:
    from harness.execution.progress import Progress

HISTORY = Path("out/history.jsonl")


def add_history_option(command: argparse.ArgumentParser) -> None:
    told = "file that gets a line of the figures, for `python -m harness history` (default: history.jsonl beside --out)"
    command.add_argument("--history", type=Path, metavar="FILE", help=told)


def add_history_options(command: argparse.ArgumentParser) -> None:
    command.description = (
        "The figures of every `gate` and `nox -s speed` that appended to FILE, drawn over the runs: which of them "
        "changed, between which commits, on which class of processor."
    )
    add = command.add_argument
    add("file", type=Path, nargs="?", default=HISTORY, metavar="FILE", help=f"default: {HISTORY}")
    add_shared(command, "--out", default=Path("out/history"), help="folder of the page (default: out/history)")


def run_history(options: argparse.Namespace, show: "Progress") -> int:
    """Write history.json and history.html; raises `InputError` for a file without runs."""
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


def remember(file: Path | None, record: Path, of_class: str, show: "Progress") -> None:
    """Append the figures of a record of studies to the history; where that cannot be written, a line says so."""
    import time

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
    file = file or record.parent.parent / HISTORY.name
    try:
        append(file, run)
    except OSError as error:  # what was measured is not lost
        show.line(f"{file}: {error.strerror}; the figures are not in the history, name another file (--history)")
