"""`python -m harness run`: its options, and what it does; the options of a plan serve other commands as well."""

import argparse
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.command.options import add_shared
from harness.command.tensorboard_command import also_written, checked
from harness.execution.executors import (
    add_executor_options,
    chosen_machine,
    device_and_bfloat16,
    device_here,
    unused_by,
)
from harness.machine.cores import physical_cores
from harness.plan.defaults import RENDER_LIMIT
from scenes.files.errors import InputError

if TYPE_CHECKING:
    import torch

    from harness.execution.progress import Progress
    from harness.execution.run import Verify
    from harness.plan.profiles import Machine, Plan

LEAST_SEEDS = 3
"""The fewest seeds with which omissions are verified: the interval of two is six times as wide."""
PROFILES = ("smoke", "reduced", "stress", "ladder", "converged", "full")


def add_run_options(run: argparse.ArgumentParser) -> None:
    add_plan_options(run)
    run.add_argument("--baseline", metavar="METHOD", help="compare with it (default: nerf, else the first method)")
    run.add_argument(
        "--claims", nargs="+", type=Path, default=[], metavar="FILE", help="claims to test (docs/claims.md)"
    )
    run.add_argument("--claim", nargs="+", default=[], metavar="LINE", help='such as "mine - nerf >= 1.5 dB"')
    add_executor_options(run)
    add_shared(run, "--out", help="output folder (default: a fresh out/PROFILE-TIME)")
    add_shared(run, "--resume", help="go on with the missing cells of --out")
    add_shared(run, "--dry-run")
    verify = "train with and without everything that is left out (exit code 3)"
    run.add_argument(
        "--lpips", type=Path, metavar="FILE", help="weights of LPIPS, to score with (docs/read-the-report.md)"
    )
    run.add_argument("--verify-omissions", action="store_true", help=verify)
    run.add_argument("--tensorboard", action="store_true", help="write each cell to OUT/tensorboard as it ends")
    run.add_argument("--no-serving", action="store_true", help="do not measure view cache and attention at the end")
    add_shared(run, "--quiet")


def add_plan_options(command: argparse.ArgumentParser) -> None:
    """Add the options that say what is trained on what, for how long."""
    add = command.add_argument
    add("--profile", default="reduced", metavar="|".join(PROFILES), help="how much (default: reduced)")
    add_shared(command, "--scenes", help="scenes to train on (default: the profile's)")
    add_shared(command, "--methods", help="methods to compare (default: the profile's)")
    add("--seeds", type=int, metavar="N", help="number of seeds")
    add("--first-seed", type=int, metavar="K", help="the first of them (default: 0)")
    add("--budget-steps", type=int, metavar="N", help="training steps of each cell")
    add("--budget-seconds", type=float, metavar="S", help="training seconds of each cell, on its own clock")
    add("--budget-core-seconds", type=float, metavar="S", help="processor seconds of each cell's training, all threads")
    add_shared(command, "--resolution", help="width of the views")
    add_shared(command, "--device")
    precisions = ("auto", "float32", "bfloat16", "float16")
    why = "of matrix products alone (default: the profile's, where the processor has such products)"
    add("--precision", default="auto", choices=precisions, help=why)
    add(
        "--optimiser",
        choices=("adam", "soap", "muon"),
        help="of all methods, with its own rates (default: the profile's)",
    )
    add("--without", nargs="+", metavar="NAME", help="accelerations to switch off: fused recurrence grid clipping …")
    add("--need", nargs="+", metavar="NAME", help="parts to have whatever a scene needs: view_direction outside_box …")
    add("--no-need", nargs="+", metavar="NAME", help="parts to leave out whatever a scene needs")
    add_scene_options(command)
    add_shared(command, "--view-sets")


def add_scene_options(command: argparse.ArgumentParser) -> None:
    """Add the options for images, or a scene to render, of the user's own."""
    add = command.add_argument
    images = (
        "train on these images, a scene each: Blender's, nerfstudio's, COLMAP's or LLFF's folder, or a tiny-NeRF .npz"
    )
    add("--view-set", type=Path, nargs="+", metavar="PATH", help=images)
    scene = (
        "render your own scene instead: Mitsuba .xml, or .py with SCENE. It has your rights: Python is code, and an "
        "XML file can make Mitsuba read any file; use what you trust"
    )
    add("--scene-file", type=Path, metavar="FILE", help=scene)
    limit = f"seconds that --scene-file, or one of its views, may take (default: {RENDER_LIMIT:g}, or more if large)"
    add("--render-limit", type=float, metavar="S", help=limit)
    corners = ("X0", "Y0", "Z0", "X1", "Y1", "Z1")
    add("--bounds", nargs=6, type=float, metavar=corners, help="box that holds what is seen, for every --view-set")
    add("--near", type=float, metavar="D", help="distance from the camera at which anything is seen, for --view-set")
    add("--far", type=float, metavar="D", help="distance up to which anything is seen, for --view-set")


def scene_source(options: argparse.Namespace) -> dict[str, Any]:
    """Return arguments of `harness.plan.profiles.planned`; raises `InputError` for numbers that are no region."""
    from scenes.view_sets.source import Region

    given = [f"--{name}" for name in ("bounds", "near", "far") if getattr(options, name) is not None]
    if given and options.view_set is None:
        raise InputError(f"{' '.join(given)}: only for --view-set; what we render says where it lies")
    try:
        region = Region(tuple(options.bounds) if options.bounds else None, options.near, options.far)
    except InputError as error:
        raise InputError(f"{' '.join(given)}: {error}") from error
    return {
        "view_set": options.view_set,
        "scene_file": options.scene_file,
        "render_limit": options.render_limit,
        "region": region if given else None,
    }


def run_run(options: argparse.Namespace, show: "Progress") -> int:
    from msgspec import structs

    from harness.execution.run import run
    from harness.plan.profiles import known_names
    from harness.records.cells import read_cells
    from harness.run_folder.output_folder import claimed, fresh_folder, latest_folder, point_latest_to
    from harness.verdicts.claim_files import claims_of
    from harness.verdicts.last_doubling import in_words, last_doublings
    from scenes.files.errors import InputError

    checked(options)
    plan, device = planned_by(options, show.line)
    if options.baseline is not None:
        known_names("--baseline", [options.baseline], list(plan.methods))
        plan = replace(plan, roles=structs.replace(plan.roles, baseline=options.baseline))
    plan = replace(plan, claims=tuple(claims_of(plan.all_methods(), plan.scenes, options.claims, options.claim)))
    if options.lpips is not None:
        plan = _with_lpips(plan, options)
    if options.verify_omissions and len(plan.seeds) < LEAST_SEEDS:
        raise InputError(
            f"--verify-omissions: {len(plan.seeds)} seeds tell nothing about an interval; --seeds {LEAST_SEEDS} or more"
        )
    machine = chosen_machine(options, device, len(plan.groups()), show.line)
    say: Callable[[str], None] = print if options.dry_run else show.line
    for line in plan_lines(plan, machine, physical_cores()):
        say(line)
    if options.dry_run or not (options.quiet or options.profile == "smoke"):  # whose run takes hardly longer
        from harness.execution.cost import estimate_apart

        before = options.out if options.resume else None
        extras = options.verify_omissions, not options.no_serving
        estimate = estimate_apart(plan, machine, options.view_sets, *extras, before)
        for line in estimate.lines:
            say(line)
        show.expect(estimate.phases)
    if options.dry_run:
        return 0
    out = options.out or fresh_folder(options.profile, options.resume)
    before = latest_folder()
    try:
        with claimed(out, plan, machine, options.resume, show.line):
            point_latest_to(out)
            shown = also_written(options, out, show)
            afterwards = _afterwards(options, plan, machine, out, shown)
            code = run(plan, out, options.view_sets, machine, options.line, shown, *afterwards)
    except InputError:
        if before is not None and latest_folder() is None:  # its folder was given up again
            point_latest_to(before)
        raise
    cells = list(read_cells(out))
    for row in last_doublings(cells, list(plan.methods)):
        show.line(in_words(row))
    counts = Counter(cell.status for cell in cells)
    outcome = ", ".join(f"{count} {status}" for status, count in sorted(counts.items()))
    show.line(f"{outcome}; records in {out / 'records'}")
    return code


def _with_lpips(plan: "Plan", options: argparse.Namespace) -> "Plan":
    """Return the plan with the weights of `--lpips`; raises `InputError` if they cannot be used."""
    from harness.records.cells import read_cells
    from harness.training.scoring.lpips import lpips_of

    if options.executor == "ray":
        raise InputError("--lpips: the file is on this machine alone; leave it out, or run here (--executor local)")
    digest = lpips_of(options.lpips).digest
    for cell in read_cells(options.out) if options.resume and options.out else ():
        if cell.provenance.get("lpips", digest) != digest:
            raise InputError(f"--lpips {options.lpips}: not the weights that {options.out} was scored with; give those")
    return replace(plan, lpips=str(options.lpips.resolve()))


def _afterwards(
    options: argparse.Namespace, plan: "Plan", machine: "Machine", out: Path, show: "Progress"
) -> "tuple[Verify | None, Callable[[], None] | None]":
    """Return the measurements that follow once a run is trained."""
    verify, serve = None, None
    if options.verify_omissions:
        from harness.studies.choices.omissions import verify_run

        verify = partial(verify_run, plan, machine, out, show)
    if not options.no_serving:
        from harness.studies.serving.serving_run import after_run

        serve = partial(after_run, out, device_here(machine), options.view_sets, show)
    return verify, serve


def plan_lines(plan: "Plan", machine: "Machine", cores: int) -> list[str]:
    """Return the plan in words, for the terminal of a machine with so many physical cores."""
    network, views = plan.train.network, plan.views
    own = f"{plan.scene_file}: " if plan.scene_file else ""
    rendered = f"{own}{views.train} train / {views.val} val / {views.test} test views a scene"
    source = " ".join(plan.view_set) if plan.view_set else rendered
    return [
        f"profile {plan.profile}: {len(plan.cells())} cells of {plan.budget.in_words} each",
        f"  scenes   {' '.join(plan.scenes)}",
        f"  methods  {' '.join(plan.methods)}",
        f"  seeds    {' '.join(map(str, plan.seeds))}",
        *(f"  also     {' '.join(extra.methods)} on {extra.scene}, {_seeds(extra.seeds)}" for extra in plan.extras),
        f"  views    {views.resolution} px wide; {source}",
        f"  network  {network.depth} × {network.width}, L = {network.position_bands}/{network.direction_bands}, "
        f"{plan.train.rays} rays a step, {plan.train.precision} products",
        f"  machine  {machine.device}, {_at_once(machine)} of {machine.threads} thread{'s' * (machine.threads > 1)}"
        f"{unused_by(machine, cores)}",
    ]


def _seeds(seeds: tuple[int, ...]) -> str:
    """Return the seeds in words: `seeds 0 1 2`."""
    return f"seed{'s' if len(seeds) > 1 else ''} {' '.join(map(str, seeds))}"


def _at_once(machine: "Machine") -> str:
    if machine.executor == "ray":
        return "as many groups at once as the Ray cluster has room for, each"
    if machine.executor == "submitit":
        return f"at most {machine.workers} jobs at once"
    return f"{machine.workers} worker{'s' * (machine.workers > 1)}"


def planned_by(options: argparse.Namespace, *say: Callable[[str], None]) -> "tuple[Plan, torch.device]":
    from harness.plan.profiles import planned

    amount = (
        "scenes",
        "methods",
        "seeds",
        "first_seed",
        "budget_steps",
        "budget_seconds",
        "budget_core_seconds",
        "resolution",
    )
    given = {name: getattr(options, name) for name in (*amount, "without", "need", "no_need", "optimiser")}
    precision = None if options.precision == "auto" else options.precision
    plan = planned(options.profile, **given, **scene_source(options), precision=precision)
    if options.command != "run":  # what explains a run's result is no part of other measurements
        plan = plan.alone()
    # last, as it may join a cluster
    device, bfloat16 = device_and_bfloat16(options, *say)
    if options.precision == "auto" and not bfloat16:
        plan = plan.in_float32()  # the processor is faster in it
    return plan, device
