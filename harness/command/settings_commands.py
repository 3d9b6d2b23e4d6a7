"""`python -m harness study sweep | constants | families | omissions`: effects of settings, as JSON."""

import argparse
import shutil
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from harness.command.options import Command, Options, flag, option, require_between, require_use, shared
from harness.command.plan_options import PLAN_OPTIONS, planned_by
from harness.execution.progress import Progress
from harness.plan.defaults import BEST_PAIRS
from scenes.files.atomic import require_suffix
from scenes.files.errors import InputError
from scenes.files.json_object import JsonObject

if TYPE_CHECKING:
    import torch

    from harness.plan.run_plan import Plan

Row = TypeVar("Row")


FILE: Options = {
    "--out": option("JSON file to write", "FILE", required=True),
    "--resume": option("use the cells that a stopped command left in FILE.cells"),
}
SWEEP: Options = {**PLAN_OPTIONS, **FILE}
FAMILIES: Options = {**shared("--device", "--view-sets", "--quick"), **FILE}
CONSTANTS: Options = {
    **PLAN_OPTIONS,
    **FILE,
    "--resume": option("train only what a stopped search has not written into FILE"),
    "--carry": option("train only the best pairs of this search, which had fewer steps", "FILE", Path),
    "--best": option(f"number of pairs of each method that --carry takes over (default: {BEST_PAIRS})", "N", int),
    "--adopt": flag("write the choice for this profile into the file from which methods take their constants"),
}
OMISSIONS: Options = {
    **PLAN_OPTIONS,
    "--methods": PLAN_OPTIONS["--methods"] | {"default": ["nerf"]},
    "--seeds": PLAN_OPTIONS["--seeds"] | {"default": 3},
    **FILE,
}


def run_sweep(options: argparse.Namespace, show: Progress) -> int:
    from harness.studies.choices.sweep import SweepRow, as_json, sweep

    plan, device = planned_by(options)
    plan = plan.with_validation_views()

    def line(row: SweepRow) -> str:
        tried = row.tried
        betas = " and ".join(f"{beta:g}" for beta in tried.betas)
        rate = f"{tried.learning_rate:g} falling to {tried.last_learning_rate:g} ({tried.decay}), β {betas}"
        where = f"{tried.covered_share:.0%} covered"
        score = f"{_decibels(row.psnr_val)} on validation views"
        return f"{row.scene} {row.method}, {tried.optimiser} at {rate}, {where}: {score}"

    result = _written(options.out, as_json(_rows(options, show, sweep, plan, device, line), plan))
    show.line(f"best: {result['means'][0]}; of each method {result['best']}")
    return 0


def run_families(options: argparse.Namespace, show: Progress) -> int:
    from harness.machine.device import chosen_device, multiplies_bfloat16
    from harness.machine.provenance import provenance
    from harness.studies.choices.families import TRIALS, FamilyRow, as_json, search, search_plan

    device = chosen_device(options.device)
    plan = search_plan(multiplies_bfloat16(device), options.quick)

    def line(row: FamilyRow) -> str:
        what = TRIALS[row.family][row.trial].what
        score = row.why or f"{_decibels(row.psnr_val)} on validation views after {row.steps} steps"
        return f"{row.family}, {row.trial} ({what}), {row.scene}: {score}"

    rows = _rows(options, show, search, plan, device, line)
    for family, means in _written(options.out, as_json(rows, plan, provenance(device)))["means"].items():
        scores = [f"{trial} {'no score' if mean is None else f'{mean:.2f} dB'}" for trial, mean in means.items()]
        show.line(f"{family}: {', '.join(scores)}")
    return 0


def run_constants(options: argparse.Namespace, show: Progress) -> int:
    from harness.machine.provenance import provenance
    from harness.records.json_record import write_json
    from harness.studies.choices.constants import READINGS, ConstantsRow, as_json, best_of, read_rows, search

    options.methods = options.methods or list(READINGS)
    plan, device = planned_by(options)
    plan = plan.with_validation_views()
    if unknown := [method for method in plan.methods if method not in READINGS]:
        raise InputError(f"--methods: {unknown[0]} has no constants to search; known: {' '.join(READINGS)}")
    if plan.budget.steps is None:
        raise InputError("constants: trains for equal steps; leave out --budget-seconds and --budget-core-seconds")
    require_between(options, best=(1, 8))
    require_use(options, "with --carry", options.carry is not None, "best")
    carried = best_of(read_rows(options.carry), plan.methods, options.best or BEST_PAIRS) if options.carry else None

    def line(row: ConstantsRow) -> str:
        start = "as printed" if row.constants.start is None else f"{row.constants.start:g}"
        what = f"unit {row.constants.unit:g}, start {start}, {row.steps} steps"
        return f"{row.scene} {row.method}, {what}: {_decibels(row.psnr_val)} on validation views"

    folders = _folders(options, plan, show)
    finished = read_rows(options.out, plan) if options.resume else []
    rows: list[ConstantsRow] = []
    origin = provenance(device)
    result = as_json(finished, plan, origin, carried)
    for fresh in search(plan, folders, options.out.parent, _workers(device), device.type, finished, carried):
        rows += fresh
        for row in fresh:
            show.line(line(row))
        result = as_json(list(dict.fromkeys([*rows, *finished])), plan, origin, carried)
        write_json(options.out, result)
    if options.adopt:
        from baselines.methods.chosen import adopt

        asked = plan.methods if carried else READINGS
        if lacking := [method for method in asked if method not in result["chosen"]]:
            raise InputError(f"--adopt: {options.out} has no choice for {lacking[0]}; search all methods to the end")
        adopt(plan.profile, result["chosen"])
    for method, pair in result["chosen"].items():
        show.line(f"chosen for {method}: {pair}")
    return 0


def run_omissions(options: argparse.Namespace, show: Progress) -> int:
    from harness.machine.provenance import provenance
    from harness.studies.choices.omissions import as_json, too_costly, verified

    plan, device = planned_by(options)
    folders = _folders(options, plan, show)
    workers = _workers(device)
    omissions, controls = verified(
        plan, folders, options.out.parent, workers, show.line, device.type, controls=True, kept=_kept(options)
    )
    _written(options.out, as_json(omissions, controls, plan, provenance(device)))
    for omission in omissions:
        show.line(omission.line)
    for control in controls:
        show.line(f"control, needed: {control.line}")
    return 3 if too_costly(omissions) else 0


def _rows(
    options: argparse.Namespace,
    show: Progress,
    search: Callable[..., Iterable[Row]],
    plan: "Plan",
    device: "torch.device",
    line: Callable[[Row], str],
) -> list[Row]:
    """Train what a search tries, and show a line of each row."""
    folders = _folders(options, plan, show)
    rows: list[Row] = []
    for row in search(plan, folders, options.out.parent, _workers(device), device.type, _kept(options)):
        rows.append(row)
        show.line(line(row))
    return rows


def _folders(options: argparse.Namespace, plan: "Plan", show: Progress) -> dict[str, Path]:
    """Return the view sets of `plan`, rendered if missing; raises `InputError` if `--out` cannot be a file."""
    from harness.execution.ground_truth import view_set_folders

    require_suffix(options.out, ".json", "--out")
    if not options.out.parent.is_dir():
        raise InputError(f"--out {options.out}: name a file in a folder that exists")
    return view_set_folders(plan, options.view_sets, show)


def _workers(device: "torch.device") -> int:
    from harness.machine.device import available_cores

    return available_cores() if device.type == "cpu" else 1


def _kept(options: argparse.Namespace) -> Path:
    """Return the folder of finished cells next to the file, emptied without `--resume`."""
    folder = _cells_of(options.out)
    if not options.resume:
        shutil.rmtree(folder, ignore_errors=True)
    return folder


def _cells_of(file: Path) -> Path:
    return file.with_name(f"{file.name}.cells")


def _decibels(psnr: float | None) -> str:
    return "diverged" if psnr is None else f"{psnr:.2f} dB"


def _written(file: Path, result: JsonObject) -> JsonObject:
    from harness.records.json_record import write_json

    write_json(file, result)
    shutil.rmtree(_cells_of(file), ignore_errors=True)
    return result


STUDIES = {
    "sweep": Command("try learning rates of every method on validation views", SWEEP, run_sweep),
    "families": Command("try a few settings of each family on validation views", FAMILIES, run_families),
    "constants": Command("search unit and start of density on validation views", CONSTANTS, run_constants),
    "omissions": Command("measure what omitting unneeded parts saves and costs", OMISSIONS, run_omissions),
}
