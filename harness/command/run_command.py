"""`python -m harness run | tensorboard`."""

import argparse
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from harness.command.machine_options import MACHINE_OPTIONS, chosen_machine, unused_by
from harness.command.options import Command, Options, flag, option, reported
from harness.command.plan_options import PLAN_OPTIONS, planned_by
from harness.execution.progress import Progress, signs_of_life
from harness.machine.cores import physical_cores
from harness.run_folder.live_page import LivePage
from scenes.files.errors import InputError

if TYPE_CHECKING:
    import torch

    from harness.plan.run_plan import Machine, Plan
    from harness.records.cells import CellRecord

LEAST_SEEDS = 3
"""The minimum number of seeds to verify omissions with: the interval of two is six times as wide."""
RUN: Options = {
    **PLAN_OPTIONS,
    "--baseline": option("method to compare with (default: nerf, else the first method)", "METHOD"),
    "--claims": option("claims to test (docs/claims.md)", "FILE", Path, nargs="+", default=[]),
    "--claim": option('such as "mine - nerf >= 1.5 dB"', "LINE", nargs="+", default=[]),
    **MACHINE_OPTIONS,
    "--splats": option(
        "Gaussians that another program trained, a .ply per scene in the order of the scenes: scored, not trained",
        "FILE",
        Path,
        nargs="+",
    ),
    "--out": option("output folder (default: a fresh out/PROFILE-TIME)"),
    "--resume": option("train the missing cells of --out"),
    "--dry-run": {},
    "--lpips": {},
    "--verify-omissions": flag("train with and without everything that is left out (exit code 3)"),
    "--page": flag("also write report.html: after the first group, again as others end, and at the end"),
    "--tensorboard": flag("write each cell to OUT/tensorboard when it ends"),
    "--quiet": {},
}
TENSORBOARD: Options = {"run": option("output folder of a run, finished or not", "OUT", Path)}


def run_run(options: argparse.Namespace, show: Progress) -> int:
    from harness.execution.run import run
    from harness.records.cells import read_cells
    from harness.run_folder.output_folder import claimed, fresh_folder, latest_folder, point_latest_to
    from harness.verdicts.last_doubling import in_words, last_doublings

    if options.tensorboard:
        from harness.run_folder.board import require_tensorboard

        require_tensorboard("--tensorboard")
    out = options.out or fresh_folder(options.profile, options.resume)
    say: Callable[[str], None] = partial(print, flush=True) if options.dry_run else show.line
    page = LivePage(out, show.line) if options.page and not options.dry_run else None
    if not options.dry_run:
        say(f"output folder {out}")
    plan, device = _planned(options, out, show)
    machine = chosen_machine(options, device, len(plan.groups()), show.line)
    for line in plan_lines(plan, machine, physical_cores()):
        say(line)
    if options.dry_run or not (options.quiet or options.profile == "smoke"):  # its run takes hardly longer
        from harness.execution.cost import estimate

        finished = out if options.resume else None
        with signs_of_life("estimating the cost from a few steps of every method", say):
            cost = estimate(plan, machine, options.view_sets, options.verify_omissions, finished)
        for line in cost.lines:
            say(line)
        show.expect(cost.phases)
    if options.dry_run:
        return 0
    before = latest_folder()
    try:
        with claimed(out, plan, machine, options.resume, show.line):
            point_latest_to(out)
            shown = also_written(options, out, show)
            verify = None
            if options.verify_omissions:
                from harness.studies.choices.omissions import verify_run

                verify = partial(verify_run, plan, machine, out, shown)
            renew = page.renew if page else lambda: None
            code = run(plan, out, options.view_sets, machine, options.line, shown, verify, renew)
    except InputError:
        if before is not None and latest_folder() is None:  # the claimed folder was removed
            point_latest_to(before)
        raise
    finally:
        if page is not None:
            page.close()
    cells = list(read_cells(out))
    for row in last_doublings(cells, list(plan.methods)):
        show.line(in_words(row))
    counts = Counter(cell.status for cell in cells)
    outcome = ", ".join(f"{count} {status}" for status, count in sorted(counts.items()))
    show.line(f"{outcome}; records in {out / 'records'}")
    if page is not None:
        show.close()
        page_code = reported(out, quiet=options.quiet)
        return max(code, page_code) if page_code in (0, 3) else page_code
    show.line(f"write the page: radiance-verdict report {out}")
    return code


def _planned(options: argparse.Namespace, out: Path, show: Progress) -> "tuple[Plan, torch.device]":
    """Return the plan with its roles, claims and LPIPS, and its device. Raises `InputError`."""
    from msgspec import structs

    from harness.plan.names import known_names
    from harness.verdicts.claim_files import claims_of

    plan, device = planned_by(options, show.line)
    if options.baseline is not None:
        known_names("--baseline", [options.baseline], list(plan.methods))
        plan = replace(plan, roles=structs.replace(plan.roles, baseline=options.baseline))
    plan = replace(plan, claims=tuple(claims_of(plan.all_methods(), plan.scenes, options.claims, options.claim)))
    if options.splats is not None:
        plan = _with_splats(plan, options, device)
    if options.lpips is not None:
        plan = _with_lpips(plan, options, out)
    if options.verify_omissions and len(plan.seeds) < LEAST_SEEDS:
        raise InputError(
            f"--verify-omissions: {len(plan.seeds)} seeds are too few for an interval; --seeds {LEAST_SEEDS} or more"
        )
    return plan, device


def _with_splats(plan: "Plan", options: argparse.Namespace, device: "torch.device") -> "Plan":
    from harness.training.kinds.given_splats import given_gaussians
    from scenes.files.digest import file_digest

    files: list[Path] = options.splats
    named = " ".join(map(str, files))
    if device.type != "cpu":
        raise InputError(f"--splats {named}: drawn only by the processor; give --device cpu")
    if options.executor == "ray":
        raise InputError(f"--splats {named}: only on this machine; leave it out, or run here (--executor local)")
    if len(files) != len(plan.scenes):
        raise InputError(
            f"--splats {named}: give a .ply for each of the scenes, in this order: {' '.join(plan.scenes)}"
        )
    for file in files:
        given_gaussians(file, 1.0)  # refuses other files
    return replace(plan, given=tuple((str(file.resolve()), file_digest(file)) for file in files))


def _with_lpips(plan: "Plan", options: argparse.Namespace, out: Path) -> "Plan":
    from harness.records.cells import read_cells
    from harness.training.scoring.lpips import lpips_of

    if options.executor == "ray":
        raise InputError("--lpips: the file is only on this machine; leave it out, or run here (--executor local)")
    digest = lpips_of(options.lpips).digest
    for cell in read_cells(out) if options.resume else ():
        if cell.provenance.get("lpips", digest) != digest:
            raise InputError(f"--lpips {options.lpips}: not the weights that {out} was scored with; give those")
    return replace(plan, lpips=str(options.lpips.resolve()))


def plan_lines(plan: "Plan", machine: "Machine", cores: int) -> list[str]:
    """Describe the plan, for a machine with `cores` physical cores."""
    network, views = plan.train.network, plan.views
    own = f"{plan.scene_file}: " if plan.scene_file else ""
    rendered = f"{own}{views.train} train / {views.val} val / {views.test} test views per scene"
    source = " ".join(plan.view_set) if plan.view_set else rendered
    return [
        f"profile {plan.profile}: {len(plan.cells())} cells of {plan.budget.in_words} each",
        f"  scenes   {' '.join(plan.scenes)}",
        f"  methods  {' '.join(plan.methods)}",
        f"  seeds    {' '.join(map(str, plan.seeds))}",
        *([f"  given    {' '.join(file for file, _ in plan.given)}"] if plan.given else []),
        *(f"  also     {' '.join(extra.methods)} on {extra.scene}, {_seeds(extra.seeds)}" for extra in plan.extras),
        f"  views    {views.resolution} px wide; {source}",
        f"  network  {network.depth} × {network.width}, L = {network.position_bands}/{network.direction_bands}, "
        f"{plan.train.rays} rays per step, {plan.train.precision} matrix multiplications",
        f"  machine  {machine.device}, {_at_once(machine)} of {machine.threads} thread{'s' * (machine.threads > 1)}"
        f"{unused_by(machine, cores)}",
    ]


def _seeds(seeds: tuple[int, ...]) -> str:
    return f"seed{'s' if len(seeds) > 1 else ''} {' '.join(map(str, seeds))}"


def _at_once(machine: "Machine") -> str:
    if machine.executor == "ray":
        return "all groups at once for which the Ray cluster has room, each"
    if machine.executor == "submitit":
        return f"at most {machine.workers} jobs at once"
    return f"{machine.workers} worker{'s' * (machine.workers > 1)}"


def run_tensorboard(options: argparse.Namespace, show: Progress) -> int:
    from harness.records.cells import read_cells
    from harness.run_folder.board import require_tensorboard, write_board

    require_tensorboard("tensorboard")
    count = 0
    for cell in read_cells(options.run):
        write_board(options.run, cell)
        count += 1
    if not count:
        raise InputError(
            f"{options.run}: holds no cell of a run; give the output folder of a run, for instance out/latest"
        )
    show.line(f"{count} cells written; view them with: tensorboard --logdir {options.run / 'tensorboard'}")
    return 0


def also_written(options: argparse.Namespace, out: Path, show: Progress) -> Progress:
    """Return a progress that with `--tensorboard` also writes each cell, after writing those from before a resume."""
    if not options.tensorboard:
        return show
    from harness.records.cells import read_cells
    from harness.run_folder.board import board_folder, write_board

    for cell in read_cells(out):
        if not board_folder(out, cell).is_dir():
            write_board(out, cell)
    return cast("Progress", _Written(out, show))


class _Written:
    """A progress that writes each cell and passes every call on to another progress."""

    def __init__(self, out: Path, show: Progress) -> None:
        self._out, self._show = out, show

    def __getattr__(self, name: str) -> Any:
        return getattr(self._show, name)

    def cell(self, cell: "CellRecord") -> None:
        from harness.run_folder.board import write_board

        write_board(self._out, cell)
        self._show.cell(cell)


COMMANDS = {
    "run": Command("render, train, score and record a comparison", RUN, run_run),
    "tensorboard": Command("write the cells of a run for TensorBoard", TENSORBOARD, run_tensorboard),
}
