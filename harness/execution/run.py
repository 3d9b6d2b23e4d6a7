"""Plan → view sets → cells → records: the main path, from top to bottom."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from harness.execution.executors import device_here, run_groups
from harness.execution.ground_truth import render_view_sets
from harness.execution.local_executor import run_locally
from harness.execution.progress import Progress
from harness.execution.run_record import scene_record
from harness.machine.mixed_code import clocks_apart, code_apart, made_elsewhere
from harness.machine.provenance import core_module_lines
from harness.plan.caveats import deviations, not_tested
from harness.plan.group_task import GroupTask
from harness.plan.profiles import Extra, Machine, Plan
from harness.records.cells import (
    CellRecord,
    RunRecord,
    SceneRecord,
    cell_path,
    read_cells,
    read_cells_of,
    write_comparisons,
    write_run,
)
from harness.records.snapshot import drop_folder
from harness.records.targets import write_targets
from harness.run_folder.earlier_run import costs_more, earlier_run, notices_of, with_measured
from harness.run_folder.phases import Phases
from harness.verdicts.comparisons import compare
from harness.verdicts.paper import printed
from harness.verdicts.survival import targets

Verify = Callable[
    [Plan, list[CellRecord], list[SceneRecord], dict[str, Path], Machine, Path, Progress], list[SceneRecord]
]
"""The function `harness.studies.choices.omissions.verify_run`: returns the scenes' records, with the savings and
costs of omissions.
"""
Serve = Callable[[Path, str, Path, Progress], None]
"""The function `harness.studies.serving.serving_run.after_run` of output folder, device, cache of view sets."""


def run(
    plan: Plan,
    out: Path,
    view_sets: Path,
    machine: Machine,
    command: str,
    show: Progress,
    verify: Verify | None = None,
    serve: Serve | None = None,
) -> int:
    """Execute the plan into `out`, which is ours already (`harness.run_folder.output_folder`), without finished cells.

    `verify` then tries what each scene does not need with and without; `serve` measures view cache and attention last,
    which changes nothing of the run. Returns exit code 0, or 3 if a cell diverged or failed or an omission costs more
    than its bound. Raises `InputError` before any training for wrong input.
    """
    import torch

    from harness.machine.device import use_threads
    from harness.machine.provenance import provenance
    from harness.plan.plugins import origins

    earlier = earlier_run(out)
    phases = Phases(earlier.phases if earlier else {})
    use_threads(machine.threads)
    origin = {
        **provenance(torch.device(device_here(machine))),
        "executor": machine.executor,
        **origins(plan.all_methods()),
    }
    origin |= notices_of(earlier)
    with phases.timed("render"):
        folders = view_set_folders(plan, view_sets, show)
        scenes = with_measured([scene_record(plan, name, folders[name], out) for name in plan.scenes], earlier)

    def write(finished: bool) -> None:
        there = list(read_cells_of(out, sorted(plan.cells())))
        apart = [*clocks_apart(there), *code_apart(there)]
        write_run(out, _run_record(plan, command, scenes, origin, phases.seconds(), finished, apart))

    write(finished=False)
    try:
        with phases.timed("train"):
            _train(plan, folders, machine, out, origin, show)
    except KeyboardInterrupt:
        write(finished=False)
        raise KeyboardInterrupt(_kept(out, plan)) from None
    cells = _compared(out, plan)
    write(finished=True)
    if verify:
        with phases.timed("verify"):
            scenes = verify(plan, cells, scenes, folders, machine, out, show)
        write(finished=True)
    if serve:
        try:
            with phases.timed("serve"):
                serve(out, device_here(machine), view_sets, show)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(f"the run is complete; `python -m reports {out}` makes its report") from None
        write(finished=True)
    # a method that cannot run on this machine is no failure; its cells name what is missing
    ended = sum(cell.status in ("done", "not_available") for cell in cells)
    return 0 if ended == len(plan.cells()) and not costs_more(scenes) else 3


def _train(
    plan: Plan, folders: dict[str, Path], machine: Machine, out: Path, origin: dict[str, Any], show: Progress
) -> None:
    """Train the missing cells; the executor's notes are stored in `origin`."""
    tasks = _tasks(plan, folders, machine, out)
    kept = list(read_cells_of(out, sorted(plan.cells())))
    elsewhere = made_elsewhere(kept, origin, out)
    if elsewhere and (tasks or code_apart(kept)):
        show.line(elsewhere)
    show.start_training(len(plan.cells()), sum(len(task.methods) for task in tasks))
    for event in run_groups(machine, tasks, origin["commit"], run_locally):
        if event.notice is not None:
            show.line(event.notice)
            if event.notice not in (notices := origin.setdefault("notices", [])):
                notices.append(event.notice)
        if event.cell is not None:
            show.cell(event.cell)
        if event.share is not None:
            show.trained(event.task, event.share)
            if event.share == 1.0:
                _compared(out, plan)
    drop_folder(out)


def _compared(out: Path, plan: Plan) -> list[CellRecord]:
    """Write comparisons and targets of the complete groups, so that a stopped run has some; returns all its cells."""
    cells = list(read_cells_of(out, sorted(plan.cells())))
    ended = Counter((cell.scene, cell.seed) for cell in cells)
    whole = [cell for cell in cells if ended[cell.scene, cell.seed] == len(plan.methods_of(cell.scene, cell.seed))]
    if whole:
        write_comparisons(out, compare(whole, list(plan.all_methods())))
        everywhere = [cell for cell in whole if cell.method in plan.methods]
        write_targets(out, targets(everywhere, list(plan.methods)))
    return cells


def _kept(out: Path, plan: Plan) -> str:
    """Return what to do after a run was stopped."""
    found = sum(1 for key in plan.cells() if cell_path(out, *key).exists())
    report = f"`python -m reports {out} --partial` reports them; " if found else ""
    return f"{found} of {len(plan.cells())} cells are kept; {report}go on with --resume --out {out}"


def plan_lines(plan: Plan, machine: Machine) -> list[str]:
    """Return the plan in words, for the terminal."""
    budget = " or ".join(
        text
        for text in (
            f"{plan.budget.steps} steps" if plan.budget.steps else "",
            f"{plan.budget.seconds:g} s of training" if plan.budget.seconds else "",
        )
        if text
    )
    network, views = plan.train.network, plan.views
    own = f"{plan.scene_file}: " if plan.scene_file else ""
    rendered = f"{own}{views.train} train / {views.val} val / {views.test} test views a scene"
    source = " ".join(plan.view_set) if plan.view_set else rendered
    return [
        f"profile {plan.profile}: {len(plan.cells())} cells of {budget} each",
        f"  scenes   {' '.join(plan.scenes)}",
        f"  methods  {' '.join(plan.methods)}",
        f"  seeds    {' '.join(map(str, plan.seeds))}",
        *(f"  also     {' '.join(one.methods)} on {one.scene}, {_seeds(one)}" for one in plan.extras),
        f"  views    {views.resolution} px wide; {source}",
        f"  network  {network.depth} × {network.width}, L = {network.position_bands}/{network.direction_bands}, "
        f"{plan.train.rays} rays a step, {plan.train.precision} products",
        f"  machine  {machine.device}, {_at_once(machine)} of {machine.threads} threads",
    ]


def _seeds(extra: Extra) -> str:
    """Return the seeds in words: `seeds 0 1 2`."""
    return f"seed{'s' if len(extra.seeds) > 1 else ''} {' '.join(map(str, extra.seeds))}"


def _at_once(machine: Machine) -> str:
    if machine.executor == "ray":
        return "as many groups at once as the Ray cluster has room for, each"
    return f"{machine.workers} workers"


def view_set_folders(plan: Plan, cache: Path, show: Progress) -> dict[str, Path]:
    """Map scene → its view set: the user's own, or rendered, or from the cache."""
    if plan.view_set:
        from scenes.view_sets.foreign import source_of

        given = dict(zip(plan.scenes, map(Path, plan.view_set), strict=True))
        for scene, path in given.items():
            for note in source_of(path).notes:
                show.line(f"view set {scene}: {note}")
        return given
    folders: dict[str, Path] = {}
    for event in render_view_sets(plan.scenes, plan.views, cache, plan.scene_file, plan.render_limit):
        if event.note:
            show.line(event.note)
            continue
        show.rendered(event, len(plan.scenes))
        if event.path is not None:
            folders[event.scene] = event.path
    return folders


def _tasks(plan: Plan, folders: dict[str, Path], machine: Machine, out: Path) -> list[GroupTask]:
    """Return the groups that still lack a cell, with those methods. A cell that was not available is tried again."""
    for cell in list(read_cells_of(out, plan.cells())):
        if cell.status in ("error", "not_available"):
            cell_path(out, cell.scene, cell.method, cell.seed).unlink()
    tasks = []
    for scene, seed in plan.groups():
        missing = tuple(name for name in plan.methods_of(scene, seed) if not cell_path(out, scene, name, seed).exists())
        if missing:
            tasks.append(
                GroupTask(
                    scene=scene,
                    seed=seed,
                    methods=missing,
                    view_set=folders[scene],
                    views=plan.views,
                    train=plan.train,
                    score=plan.score,
                    budget=plan.budget,
                    out=out,
                    **machine.of_a_group(),
                )
            )
    return tasks


def _run_record(
    plan: Plan,
    command: str,
    scenes: list[SceneRecord],
    origin: dict[str, Any],
    phases: dict[str, float],
    finished: bool,
    apart: list[str],
) -> RunRecord:
    from harness.plan.plugins import title_of

    return RunRecord(
        profile=plan.profile,
        command=command,
        scenes=scenes,
        methods={name: title_of(name) for name in plan.all_methods()},
        deviations=deviations(plan),
        paper={**printed(), **_measured_beside()},
        seeds=list(plan.seeds),
        settings=plan.settings(),
        provenance=origin,
        phases=phases,
        finished=finished,
        not_tested=[*not_tested(plan), *apart],
    )


def _measured_beside() -> dict[str, Any]:
    """Return the measurements beside the paper's printed numbers that need no training."""
    from harness.execution.run_record import parameters_at_paper_size

    lines = core_module_lines()
    return {
        "parameters_measured": parameters_at_paper_size("qnerf"),
        "sloc_measured": sum(lines.values()),
        "sloc_files": lines,
    }


def outcome(out: Path) -> str:
    """Return one line: how many cells ended how."""
    counts = Counter(cell.status for cell in read_cells(out))
    return ", ".join(f"{count} {status}" for status, count in sorted(counts.items()))
