"""python -m harness COMMAND: parse, call, exit code."""

import argparse
import errno
import os
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from harness.evidence import options as evidence_options
from harness.filming import options as filming_options
from harness.gate import options as gate_options
from harness.serving import options as serving_options
from harness.speed import options as speed_options
from harness.stability import options as stability_options
from harness.viewer import options as viewer_options

if TYPE_CHECKING:
    import torch

    from harness.plan import Plan
    from harness.progress import Progress

LEAST_SEEDS = 3
"""With which omissions are verified: the interval of two is six times as wide."""
PROFILES = ("smoke", "reduced", "stress", "ladder", "full")


def parser() -> argparse.ArgumentParser:
    """The options of each command; those of `run` are the same in every nox session."""
    top = argparse.ArgumentParser(prog="python -m harness", description="Train radiance-field methods side by side.")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    run = commands.add_parser("run", help="render, train, score and record a comparison")
    _add_plan_options(run)
    run.add_argument("--workers", type=int, metavar="N", help="processes (default: one a core on CPU, one on a GPU)")
    run.add_argument("--executor", default="local", choices=("local",), help="where cells run")
    run.add_argument("--out", type=Path, metavar="DIR", help="output folder (default: a fresh out/PROFILE-TIME)")
    run.add_argument("--resume", action="store_true", help="go on with the missing cells of --out")
    run.add_argument("--dry-run", action="store_true", help="print the plan and its estimated cost, do nothing")
    run.add_argument(
        "--verify-omissions",
        action="store_true",
        help="train with and without everything that is left out (exit code 3)",
    )
    run.add_argument("--no-serving", action="store_true", help="do not measure view cache and attention at the end")
    run.add_argument("--quiet", action="store_true", help="no progress")
    rates = commands.add_parser("sweep", help="learning rates of every method on validation views, as JSON")
    _add_plan_options(rates)
    rates.add_argument("--out", type=Path, required=True, metavar="FILE", help="JSON file to write")
    repair = commands.add_parser("repair", help="which candidate becomes qnerf_repaired, by a fixed protocol, as JSON")
    repair.add_argument("--device", default="auto", choices=("auto", "cpu", "cuda"), help="ROCm is torch's cuda")
    repair.add_argument("--view-sets", type=Path, default=Path("out/view_sets"), metavar="DIR", help="view-set cache")
    repair.add_argument("--out", type=Path, required=True, metavar="FILE", help="JSON file to write")
    pairs = commands.add_parser("equivalence", help="what empty-space skipping and precision change in scores, as JSON")
    _add_plan_options(pairs)
    pairs.add_argument("--changes", nargs="+", default=["grid", "precision"], choices=("grid", "precision"))
    pairs.add_argument("--out", type=Path, required=True, metavar="FILE", help="JSON file to write")
    left = commands.add_parser("omissions", help="what leaving out what a scene does not need saves and costs, as JSON")
    _add_plan_options(left)
    left.set_defaults(methods=["nerf"], seeds=3)
    left.add_argument("--out", type=Path, required=True, metavar="FILE", help="JSON file to write")
    speed = commands.add_parser("speed", help="measure how fast training, rendering and scoring are on this machine")
    speed_options.add_options(speed)
    stability = commands.add_parser("stability", help="try the catalogue of stiff and extreme cases")
    stability_options.add_options(stability)
    evidence = commands.add_parser(
        "evidence", help="the studies that a verdict rests on, and the comparer's calibration"
    )
    evidence_options.add_options(evidence)
    film = commands.add_parser("render", help="a camera path through a finished run, its methods side by side")
    filming_options.add_options(film)
    serving = commands.add_parser("serving", help="measure view cache, attention and first frame on a finished run")
    serving_options.add_options(serving)
    gate = commands.add_parser("gate", help="regression gates: this code against reviewed limits (exit code 4)")
    gate_options.add_options(gate)
    view = commands.add_parser("view", help="look at a finished run in the browser, methods side by side")
    viewer_options.add_options(view)
    return top


def _add_plan_options(command: argparse.ArgumentParser) -> None:
    """What is trained on what, for how long."""
    add = command.add_argument
    add("--profile", default="reduced", metavar="|".join(PROFILES), help="how much (default: reduced)")
    add("--scenes", nargs="+", metavar="SCENE", help="scenes to train on (default: the profile's)")
    add("--methods", nargs="+", metavar="METHOD", help="methods to compare (default: the profile's)")
    add("--seeds", type=int, metavar="N", help="number of seeds, 0 … N−1")
    add("--budget-steps", type=int, metavar="N", help="training steps of each cell")
    add("--budget-seconds", type=float, metavar="S", help="training seconds of each cell, on its own clock")
    add("--resolution", type=int, metavar="PX", help="width of the views")
    add("--device", default="auto", choices=("auto", "cpu", "cuda"), help="ROCm is torch's cuda")
    add(
        "--precision",
        default="auto",
        choices=("auto", "float32", "bfloat16", "float16"),
        help="of matrix products alone (default: the profile's, where the processor has such products)",
    )
    add("--without", nargs="+", metavar="NAME", help="accelerations to switch off: fused recurrence grid clipping …")
    add("--need", nargs="+", metavar="NAME", help="parts to have whatever a scene needs: view_direction outside_box …")
    add("--no-need", nargs="+", metavar="NAME", help="parts to leave out whatever a scene needs")
    add("--ray-attention", metavar="none|gradients", help="how the pixels of a batch are chosen (default: all alike)")
    add("--view-set", type=Path, metavar="DIR", help="train on this folder in the Blender format instead")
    add("--view-sets", type=Path, default=Path("out/view_sets"), metavar="DIR", help="cache of view sets")


def main(arguments: list[str]) -> int:
    """0 done · 1 our own error · 2 bad usage or input · 3 a cell diverged or failed · 4 a gate failed · 130 stopped."""
    options = parser().parse_args(arguments)
    # after the parsing, so that --help and a mistyped option answer at once
    from harness.progress import chosen_progress
    from harness.records import DamagedRecord
    from scenes.errors import InputError

    silent = getattr(options, "quiet", False) or getattr(options, "dry_run", False)
    show = chosen_progress(silent)
    try:
        if options.command == "sweep":
            return _sweep(options, show)
        if options.command == "repair":
            return _repair(options, show)
        if options.command == "equivalence":
            return _equivalence(options, show)
        if options.command == "omissions":
            return _omissions(options, show)
        if options.command == "speed":
            return speed_options.run_speed(options, show)
        if options.command == "stability":
            return stability_options.run_stability(options, show)
        if options.command == "evidence":
            return evidence_options.run_evidence(options, show)
        if options.command == "render":
            return filming_options.run_render(options, show)
        if options.command == "serving":
            return serving_options.run_serving(options, show)
        if options.command == "gate":
            return gate_options.run_gate(options, show)
        if options.command == "view":
            return viewer_options.run_view(options, show)
        return _run(options, show, shlex.join(["python", "-m", "harness", *arguments]))
    except (InputError, DamagedRecord) as mistake:
        show.close()
        print(f"error: {mistake}", file=sys.stderr)
        return 2
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES):
            raise
        show.close()
        print(f"error: {error.filename}: {error.strerror}; mend that and go on with --resume", file=sys.stderr)
        return 2
    except KeyboardInterrupt as stop:
        show.close()
        print(f"interrupted: {str(stop) or 'finished cells are kept; go on with --resume and --out'}", file=sys.stderr)
        return 130
    finally:
        show.close()


def _planned(options: argparse.Namespace) -> "tuple[Plan, torch.device]":
    from harness.device import chosen_device, multiplies_bfloat16
    from harness.plan import planned

    device = chosen_device(options.device)
    precision = options.precision
    if precision == "auto":
        # without bfloat16 products the processor is faster in float32
        precision = None if multiplies_bfloat16(device) else "float32"
    plan = planned(
        options.profile,
        scenes=options.scenes,
        methods=options.methods,
        seeds=options.seeds,
        budget_steps=options.budget_steps,
        budget_seconds=options.budget_seconds,
        resolution=options.resolution,
        view_set=options.view_set,
        precision=precision,
        without=options.without,
        need=options.need,
        no_need=options.no_need,
        ray_attention=options.ray_attention,
    )
    return plan, device


def _run(options: argparse.Namespace, show: "Progress", command: str) -> int:
    from harness.device import available_cores
    from harness.output_folder import claim, fresh_folder, latest_folder, point_latest_to, release
    from harness.plan import Machine
    from harness.runner import outcome, plan_lines, run
    from scenes.errors import InputError

    plan, device = _planned(options)
    if options.verify_omissions and len(plan.seeds) < LEAST_SEEDS:
        raise InputError(
            f"--verify-omissions: {len(plan.seeds)} seeds tell nothing about an interval; --seeds {LEAST_SEEDS} or more"
        )
    cores = available_cores()
    if options.workers is not None and not 1 <= options.workers <= 256:
        raise InputError(f"--workers {options.workers}: must lie between 1 and 256")
    workers = min(options.workers or (cores if device.type == "cpu" else 1), len(plan.groups()))
    machine = Machine(device.type, workers, max(1, cores // workers))
    if options.dry_run:
        from harness.cost import estimate_lines

        print("\n".join([*plan_lines(plan, machine), *estimate_lines(plan, device, workers, machine.threads)]))
        return 0
    for line in plan_lines(plan, machine):
        show.line(line)
    out = options.out or fresh_folder(options.profile, options.resume)
    before = latest_folder()
    claim(out, plan, machine, options.resume)
    point_latest_to(out)
    try:
        extras = options.verify_omissions, not options.no_serving
        code = run(plan, out, options.view_sets, machine, command, show, *extras)
    except InputError:
        release(out)
        if before is not None and not out.exists():
            point_latest_to(before)
        raise
    show.line(f"{outcome(out)}; records in {out / 'records'}")
    return code


def _sweep(options: argparse.Namespace, show: "Progress") -> int:
    from harness.device import use_threads
    from harness.records import write_json
    from harness.runner import view_set_folders
    from harness.sweep import as_json, sweep

    plan, device = _planned(options)
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


def _repair(options: argparse.Namespace, show: "Progress") -> int:
    from harness.device import chosen_device, multiplies_bfloat16, use_threads
    from harness.records import write_json
    from harness.repair_search import as_json, search, search_plan
    from harness.runner import view_set_folders

    device = chosen_device(options.device)
    _check_file(options.out)
    use_threads(1)  # processor seconds count every thread
    plan = search_plan(multiplies_bfloat16(device))
    rows = []
    for row in search(plan, view_set_folders(plan, options.view_sets, show), device, options.out.parent):
        rows.append(row)
        score = "diverged" if row.psnr_val is None else f"{row.psnr_val:.2f} dB"
        show.line(f"{row.scene} seed {row.seed} {row.method}: {score} on validation views, {row.steps} steps")
    result = as_json(rows, plan, device)
    write_json(options.out, result)
    show.line(f"chosen: {result['chosen']}")
    return 0


def _equivalence(options: argparse.Namespace, show: "Progress") -> int:
    from harness.device import available_cores
    from harness.equivalence import as_json, pairs
    from harness.records import write_json
    from harness.runner import view_set_folders

    plan, _ = _planned(options)
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


def _omissions(options: argparse.Namespace, show: "Progress") -> int:
    from harness.device import available_cores
    from harness.records import write_json
    from harness.runner import view_set_folders
    from harness.verification import as_json, line_of, too_costly, verified

    plan, device = _planned(options)
    _check_file(options.out)
    folders = view_set_folders(plan, options.view_sets, show)
    workers = available_cores() if device.type == "cpu" else 1
    found, controls = verified(plan, folders, options.out.parent, workers, show.line, device.type, controls=True)
    write_json(options.out, as_json(found, controls, plan))
    for one in found:
        show.line(line_of(one))
    for one in controls:
        show.line(f"control, needed: {line_of(one)}")
    return 3 if too_costly(found) else 0


def _check_file(path: Path) -> None:
    from scenes.errors import InputError

    if not path.parent.is_dir() or path.is_dir():
        raise InputError(f"--out {path}: name a file in a folder that exists")


if __name__ == "__main__":
    code = main(sys.argv[1:])
    sys.stdout.flush()
    sys.stderr.flush()
    # without the interpreter's teardown, in which OpenImageIO's bindings print warnings that no user asked for
    os._exit(code)
