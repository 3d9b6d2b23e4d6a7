"""`python -m harness study sweep | repair | equivalence | omissions`: what a setting changes, each as one JSON file."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from harness.command.run_command import add_plan_options, planned_by

if TYPE_CHECKING:
    from harness.execution.progress import Progress


def add_sweep_options(command: argparse.ArgumentParser) -> None:
    add_plan_options(command)
    _add_file(command)


def add_repair_options(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    add("--device", default="auto", choices=("auto", "cpu", "cuda"), help="ROCm is torch's cuda")
    add("--view-sets", type=Path, default=Path("out/view_sets"), metavar="DIR", help="view-set cache")
    add("--quick", action="store_true", help="sizes at which no figure means anything")
    _add_file(command)


def add_equivalence_options(command: argparse.ArgumentParser) -> None:
    add_plan_options(command)
    command.add_argument("--changes", nargs="+", default=["grid", "precision"], choices=("grid", "precision"))
    _add_file(command)


def add_omissions_options(command: argparse.ArgumentParser) -> None:
    add_plan_options(command)
    command.set_defaults(methods=["nerf"], seeds=3)
    _add_file(command)


def _add_file(command: argparse.ArgumentParser) -> None:
    command.add_argument("--out", type=Path, required=True, metavar="FILE", help="JSON file to write")


def run_sweep(options: argparse.Namespace, show: "Progress") -> int:
    from harness.execution.run import view_set_folders
    from harness.machine.device import use_threads
    from harness.records.json_record import write_json
    from harness.studies.choices.sweep import as_json, sweep

    plan, device = planned_by(options)
    _check_file(options.out)
    use_threads(1)  # small products: a second thread costs more than it gains
    rows = []
    for row in sweep(plan, view_set_folders(plan, options.view_sets, show), device, options.out.parent):
        rows.append(row)
        score = "diverged" if row.psnr_val is None else f"{row.psnr_val:.2f} dB"
        show.line(f"{row.scene} {row.method} at {row.learning_rate:g}: {score} on validation views")
    result = as_json(rows, plan)
    write_json(options.out, result)
    show.line(f"best: {result['best']}")
    return 0


def run_repair(options: argparse.Namespace, show: "Progress") -> int:
    from harness.execution.run import view_set_folders
    from harness.machine.device import chosen_device, multiplies_bfloat16, use_threads
    from harness.records.json_record import write_json
    from harness.studies.choices.repair_search import as_json, search, search_plan

    device = chosen_device(options.device)
    _check_file(options.out)
    use_threads(1)  # processor seconds count every thread
    plan = search_plan(multiplies_bfloat16(device), options.quick)
    rows = []
    for row in search(plan, view_set_folders(plan, options.view_sets, show), device, options.out.parent):
        rows.append(row)
        score = "diverged" if row.psnr_val is None else f"{row.psnr_val:.2f} dB"
        show.line(f"{row.scene} seed {row.seed} {row.method}: {score} on validation views, {row.steps} steps")
    result = as_json(rows, plan, device)
    write_json(options.out, result)
    show.line(f"chosen: {result['chosen']}")
    return 0


def run_equivalence(options: argparse.Namespace, show: "Progress") -> int:
    from harness.execution.run import view_set_folders
    from harness.machine.device import available_cores
    from harness.records.json_record import write_json
    from harness.studies.choices.equivalence import as_json, pairs

    plan, _ = planned_by(options)
    _check_file(options.out)
    folders = view_set_folders(plan, options.view_sets, show)
    found = []
    for pair in pairs(plan, options.changes, folders, options.out.parent, available_cores()):
        found.append(pair)
        scores = ["diverged" if value is None else f"{value:.2f} dB" for value in (pair.psnr, pair.psnr_changed)]
        show.line(f"{pair.scene} {pair.method} seed {pair.seed}, {pair.change}: {scores[0]} → {scores[1]}")
    result = as_json(found, plan)
    write_json(options.out, result)
    for row in result["summary"]:
        show.line(f"{row['change']}, {row['method']}: {row['difference']} dB {row['interval']}, {row['verdict']}")
    return 0


def run_omissions(options: argparse.Namespace, show: "Progress") -> int:
    from harness.execution.run import view_set_folders
    from harness.machine.device import available_cores
    from harness.machine.provenance import provenance
    from harness.records.json_record import write_json
    from harness.studies.choices.verification import as_json, line_of, too_costly, verified

    plan, device = planned_by(options)
    _check_file(options.out)
    folders = view_set_folders(plan, options.view_sets, show)
    workers = available_cores() if device.type == "cpu" else 1
    found, controls = verified(plan, folders, options.out.parent, workers, show.line, device.type, controls=True)
    write_json(options.out, as_json(found, controls, plan, provenance(device)))
    for one in found:
        show.line(line_of(one))
    for one in controls:
        show.line(f"control, needed: {line_of(one)}")
    return 3 if too_costly(found) else 0


def _check_file(path: Path) -> None:
    from scenes.files.errors import InputError

    if not path.parent.is_dir() or path.is_dir():
        raise InputError(f"--out {path}: name a file in a folder that exists")
