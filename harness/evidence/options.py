"""`python -m harness evidence`: its options, and how they are checked. Nothing heavy is imported to show the help."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harness.progress import Progress


def add_options(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    add("--studies", nargs="+", metavar="STUDY", help="calibration factorial …: studies to do (default: all)")
    add("--quick", action="store_true", help="sizes at which no figure means anything, to try the studies themselves")
    add("--device", default="auto", choices=("auto", "cpu", "cuda"), help="ROCm is torch's cuda")
    add("--workers", type=int, metavar="N", help="processes (default: one a core on CPU, one on a GPU)")
    add("--view-sets", type=Path, default=Path("out/view_sets"), metavar="DIR", help="cache of view sets")
    add(
        "--out",
        type=Path,
        metavar="DIR",
        help="output folder; that of a finished run gets the studies into its report (default: a fresh one)",
    )
    add("--resume", action="store_true", help="do what --out lacks")
    add("--list", action="store_true", help="print the studies, do nothing")
    add("--quiet", action="store_true", help="no progress")


def run_evidence(options: argparse.Namespace, show: "Progress") -> int:
    """0, or 3 where a check fails; raises `InputError` for what cannot be."""
    from harness.evidence.studies import STUDIES

    if options.list:
        for study in STUDIES.values():
            print(f"{study.info.id:18} {study.seconds / 60:3.0f} min  {study.info.question}")  # noqa: T201
        return 0

    from harness.device import available_cores, chosen_device
    from harness.evidence_record import EVIDENCE_FILE
    from harness.folder_lock import locked_folder
    from harness.output_folder import fresh_folder
    from harness.plan import Machine, known_names
    from scenes.errors import InputError

    studies = known_names("--studies", options.studies or list(STUDIES), list(STUDIES))
    if options.resume and options.out is None:
        raise InputError("--resume: name the folder to go on with, --out DIR")
    if options.workers is not None and not 1 <= options.workers <= 256:
        raise InputError(f"--workers {options.workers}: must lie between 1 and 256")

    from harness.evidence.runner import run

    device, cores = chosen_device(options.device), available_cores()
    workers = options.workers or (cores if device.type == "cpu" else 1)
    machine = Machine(device.type, workers, max(1, cores // workers))
    out = options.out or fresh_folder("evidence", resume=False)
    with locked_folder(out):
        code = run(list(studies), out, options.view_sets, machine, options.quick, options.resume, show)
    show.line(f"studies in {out / EVIDENCE_FILE}")
    return code
