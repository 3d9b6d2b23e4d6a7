"""python -m harness COMMAND: parse, call, exit code."""

import argparse
import errno
import os
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from harness import board_options, compare_options, completion_options, scaling_options, scene_options
from harness.conformance import options as conformance_options
from harness.doctor import options as doctor_options
from harness.evidence import options as evidence_options
from harness.executors import add_executor_options, chosen_machine, device_and_bfloat16, leave
from harness.filming import options as filming_options
from harness.gate import options as gate_options
from harness.judge import options as judge_options
from harness.serving import options as serving_options
from harness.speed import options as speed_options
from harness.stability import options as stability_options
from harness.viewer import options as viewer_options

if TYPE_CHECKING:
    import torch

    from harness.plan import Plan
    from harness.progress import Progress
    from harness.runner import Serve, Verify

LEAST_SEEDS = 3
"""With which omissions are verified: the interval of two is six times as wide."""
PROFILES = ("smoke", "reduced", "stress", "ladder", "full")
OTHERS: dict[str, Callable[..., int]] = {
    "scaling": scaling_options.run_scaling,
    "compare": compare_options.run_compare,
    "speed": speed_options.run_speed,
    "stability": stability_options.run_stability,
    "evidence": evidence_options.run_evidence,
    "render": filming_options.run_render,
    "serving": serving_options.run_serving,
    "gate": gate_options.run_gate,
    "judge": judge_options.run_judge,
    "conformance": conformance_options.run_conformance,
    "doctor": doctor_options.run_doctor,
    "view": viewer_options.run_view,
    "tensorboard": board_options.run_tensorboard,
}
"""Commands with a module of their own."""


def parser() -> argparse.ArgumentParser:
    """The options of each command; those of `run` are the same in every nox session."""
    top = argparse.ArgumentParser(prog="python -m harness", description="Train radiance-field methods side by side.")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    run = commands.add_parser("run", help="render, train, score and record a comparison")
    _add_plan_options(run)
    add_executor_options(run)
    run.add_argument("--out", type=Path, metavar="DIR", help="output folder (default: a fresh out/PROFILE-TIME)")
    run.add_argument("--resume", action="store_true", help="go on with the missing cells of --out")
    run.add_argument("--dry-run", action="store_true", help="print the plan and its estimated cost, do nothing")
    run.add_argument(
        "--verify-omissions",
        action="store_true",
        help="train with and without everything that is left out (exit code 3)",
    )
    board_options.add_run_option(run)
    run.add_argument("--no-serving", action="store_true", help="do not measure view cache and attention at the end")
    run.add_argument("--quiet", action="store_true", help="no progress")
    rates = commands.add_parser("sweep", help="learning rates of every method on validation views, as JSON")
    _add_plan_options(rates)
    rates.add_argument("--out", type=Path, required=True, metavar="FILE", help="JSON file to write")
    repair = commands.add_parser("repair", help="which candidate becomes qnerf_repaired, by a fixed protocol, as JSON")
    repair.add_argument("--device", default="auto", choices=("auto", "cpu", "cuda"), help="ROCm is torch's cuda")
    repair.add_argument("--view-sets", type=Path, default=Path("out/view_sets"), metavar="DIR", help="view-set cache")
    repair.add_argument("--quick", action="store_true", help="sizes at which no figure means anything")
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
    stability_options.add_options(commands.add_parser("stability", help="try the catalogue of stiff and extreme cases"))
    compare_options.add_options(commands.add_parser("compare", help="how far two outputs of the same plan differ"))
    evidence_options.add_options(commands.add_parser("evidence", help="the studies that a verdict rests on"))
    film = commands.add_parser("render", help="a camera path through a finished run, its methods side by side")
    filming_options.add_options(film)
    serving = commands.add_parser("serving", help="measure view cache, attention and first frame on a finished run")
    serving_options.add_options(serving)
    gate = commands.add_parser("gate", help="has anything changed, and is it worse? (exit code 4)")
    gate_options.add_options(gate)
    judge_options.add_options(commands.add_parser("judge", help="verdicts on anybody's table of results"))
    conforms = commands.add_parser("conformance", help="hold methods to the contract of the catalogue (exit code 3)")
    conformance_options.add_options(conforms)
    doctor_options.add_options(commands.add_parser("doctor", help="what this machine has, and how to get the rest"))
    board_options.add_options(commands.add_parser("tensorboard", help="write a run's cells for TensorBoard"))
    completion_options.add_options(commands.add_parser("completion", help="print a completion script for your shell"))
    scaling_options.add_options(commands.add_parser("scaling", help="the paper's full table on GPUs, on paper"))
    viewer_options.add_options(commands.add_parser("view", help="look at a finished run in the browser"))
    for one in commands.choices.values():
        one.allow_abbrev = False  # `--with` is no `--without`
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
    scene_options.add_options(command)
    add("--view-sets", type=Path, default=Path("out/view_sets"), metavar="DIR", help="cache of view sets")


def main(arguments: list[str]) -> int:
    """0 done · 1 our own error · 2 bad usage or input · 3 a cell diverged or failed · 4 a gate failed · 130 stopped."""
    options = parser().parse_args(arguments)
    # after the parsing, so that --help and a mistyped option answer at once
    from harness.json_record import DamagedRecord, as_text
    from harness.progress import chosen_progress
    from scenes.errors import InputError, readable

    show = chosen_progress(getattr(options, "quiet", False) or getattr(options, "dry_run", False))
    try:
        if options.command == "completion":
            return completion_options.run_completion(options, parser())
        ours = {"sweep": _sweep, "repair": _repair, "equivalence": _equivalence, "omissions": _omissions}
        if chosen := {**OTHERS, **ours}.get(options.command):
            return chosen(options, show)
        return _run(options, show, as_text(shlex.join(["python", "-m", "harness", *arguments])))
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


def _planned(options: argparse.Namespace, *say: Callable[[str], None]) -> "tuple[Plan, torch.device]":
    from dataclasses import replace

    from harness.plan import planned

    plan = planned(
        options.profile,
        scenes=options.scenes,
        methods=options.methods,
        seeds=options.seeds,
        budget_steps=options.budget_steps,
        budget_seconds=options.budget_seconds,
        resolution=options.resolution,
        **scene_options.chosen(options),
        precision=None if options.precision == "auto" else options.precision,
        without=options.without,
        need=options.need,
        no_need=options.no_need,
        ray_attention=options.ray_attention,
    )
    if options.command != "run":  # what explains a run's result is no part of other measurements
        plan = replace(plan, extras=())
    # last, as it may join a cluster
    device, bfloat16 = device_and_bfloat16(options, *say)
    if options.precision == "auto" and not bfloat16:
        plan = plan.in_float32()  # the processor is faster in it
    return plan, device


def _run(options: argparse.Namespace, show: "Progress", command: str) -> int:
    from harness.output_folder import claimed, fresh_folder, latest_folder, point_latest_to
    from harness.runner import outcome, plan_lines, run
    from scenes.errors import InputError

    board_options.checked(options)
    plan, device = _planned(options, show.line)
    if options.verify_omissions and len(plan.seeds) < LEAST_SEEDS:
        raise InputError(
            f"--verify-omissions: {len(plan.seeds)} seeds tell nothing about an interval; --seeds {LEAST_SEEDS} or more"
        )
    machine = chosen_machine(options, device, len(plan.groups()), show.line)
    if options.dry_run:
        from harness.cost import estimate_lines

        before = options.out if options.resume else None
        extras = options.verify_omissions, not options.no_serving
        lines = estimate_lines(plan, machine, options.view_sets, *extras, before)
        print(*plan_lines(plan, machine), *lines, sep="\n")
        return 0
    for line in plan_lines(plan, machine):
        show.line(line)
    out = options.out or fresh_folder(options.profile, options.resume)
    before = latest_folder()
    try:
        with claimed(out, plan, machine, options.resume, show.line):
            point_latest_to(out)
            told = board_options.also_written(options, out, show)
            code = run(plan, out, options.view_sets, machine, command, told, *_afterwards(options))
    except InputError:
        if before is not None and latest_folder() is None:  # its folder was given up again
            point_latest_to(before)
        raise
    show.line(f"{outcome(out)}; records in {out / 'records'}")
    return code


def _afterwards(options: argparse.Namespace) -> "tuple[Verify | None, Serve | None]":
    """What is measured once a run is trained."""
    verify = serve = None
    if options.verify_omissions:
        from harness.verification import verify_run

        verify = verify_run
    if not options.no_serving:
        from harness.serving.runner import after_run

        serve = after_run
    return verify, serve


def _sweep(options: argparse.Namespace, show: "Progress") -> int:
    from harness.device import use_threads
    from harness.json_record import write_json
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
    from harness.json_record import write_json
    from harness.repair_search import as_json, search, search_plan
    from harness.runner import view_set_folders

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


def _equivalence(options: argparse.Namespace, show: "Progress") -> int:
    from harness.device import available_cores
    from harness.equivalence import as_json, pairs
    from harness.json_record import write_json
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
    from harness.json_record import write_json
    from harness.provenance import provenance
    from harness.runner import view_set_folders
    from harness.verification import as_json, line_of, too_costly, verified

    plan, device = _planned(options)
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
    from scenes.errors import InputError

    if not path.parent.is_dir() or path.is_dir():
        raise InputError(f"--out {path}: name a file in a folder that exists")


if __name__ == "__main__":
    from scenes.installed import packages_needed
    from scenes.stopping import stop_on_signals

    stop_on_signals()
    with packages_needed():
        code = main(sys.argv[1:])
    sys.stderr.flush()
    # without the interpreter's teardown, in which OpenImageIO's bindings print warnings that no user asked for
    os._exit(code)
