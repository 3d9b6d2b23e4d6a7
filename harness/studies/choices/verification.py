"""Every omission verified on the real thing: `python -m harness study omissions` and `run --verify-omissions`."""

import json
import math
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import structs

from harness.execution.executors import device_here
from harness.execution.progress import Progress
from harness.plan.needed import needs_of
from harness.plan.profiles import Machine, Plan
from harness.records.cells import CellRecord, LeftOut, SceneRecord
from harness.studies.choices.arms import CellArms, trained_cells
from harness.studies.choices.omissions import Omission, cell_tasks, controls_of, judged, omissions_of
from harness.verdicts.statistics import paired_difference
from scenes.files.errors import InputError
from scenes.modelling.needs import PARTS

INTEGRATOR_VIEWS = 6
INTEGRATOR_SPP = 64
"""The fewest samples: with fewer, noise is larger than the bound."""
CLOCK_OF_RENDERING = "rendering the view set"


def verified(
    plan: Plan,
    folders: dict[str, Path],
    scratch: Path,
    workers: int,
    say: Callable[[str], None],
    device: str = "cpu",
    controls: bool = False,
) -> tuple[list[Omission], list[Omission]]:
    """Return what is left out on each scene of the plan, and `controls`: what leaving out something needed costs.

    Every cell of the plan is trained once as planned and once more for each omission of its scene.
    """
    cells = []
    for cell in trained_cells(cell_tasks(plan, folders, scratch, controls, device), workers):
        cells.append(cell)
        say(_line_of_cell(cell))
    found = omissions_of(cells)
    for scene, folder in folders.items():
        if (one := _of_integrator(plan, scene, folder, scratch)) is not None:
            found.append(one)
    order = list(folders)
    found.sort(key=lambda one: order.index(one.scene))
    return found, controls_of(cells)


def verify_run(
    plan: Plan,
    cells: list[CellRecord],
    scenes: list[SceneRecord],
    folders: dict[str, Path],
    machine: Machine,
    out: Path,
    show: Progress,
) -> list[SceneRecord]:
    """Return `scenes` with what leaving out saved and changed, by one method."""
    trained = [name for name in plan.methods if any(cell.method == name and cell.status == "done" for cell in cells)]
    if not trained:
        return scenes
    one_method = replace(plan, methods=("nerf",) if "nerf" in trained else tuple(trained[:1]))
    found, _ = verified(one_method, folders, out, machine.workers, show.line, device_here(machine))
    for one in too_costly(found):
        show.line(f"left out at too high a price: {line_of(one)}")
    return [
        structs.replace(scene, left_out=filled(scene.left_out, [one for one in found if one.scene == scene.name]))
        for scene in scenes
    ]


def line_of(one: Omission) -> str:
    """Return a line such as `lego: samples outside the box: +1.2 dB [+0.4, +2.0], 3.1 s saved, within its bound of 0.2
    dB`.
    """
    between = "" if one.interval is None else f" [{one.interval[0]:+.4g}, {one.interval[1]:+.4g}]"
    change = "nothing measured" if one.difference is None else f"{one.difference:+.4g}{between} {one.unit}"
    saved = "" if one.seconds_saved is None else f", {one.seconds_saved:.2f} s saved ({one.clock})"
    return f"{one.scene}: {one.title}: {change}{saved}: {one.verdict} ({one.bound:.2g} {one.unit})"


def too_costly(found: list[Omission]) -> list[Omission]:
    return [one for one in found if one.verdict == "costs more"]


def filled(rows: list[LeftOut], found: list[Omission]) -> list[LeftOut]:
    """Return the `rows` of one scene with what was measured on it."""
    by_name = {one.name: one for one in found}
    return [_filled(row, by_name[row.name]) if row.name in by_name else row for row in rows]


def as_json(found: list[Omission], controls: list[Omission], plan: Plan, origin: dict[str, Any]) -> dict[str, Any]:
    """Return the omissions as JSON; `origin` is the provenance of the measurement."""
    return {
        "what": "each scene with everything left out that it does not need, against the same with one of these done; "
        "controls: something left out that is needed",
        "provenance": origin,
        "settings": plan.settings(),
        "omissions": [_as_row(one) for one in found],
        "controls": [_as_row(one) for one in controls],
    }


def compared_integrators(scene: str, resolution: int, views: int, spp: int) -> dict[str, Any]:
    """Return `scenes.rendering.checks.Comparison` as plain data, from a process of its own. Raises `InputError`."""
    options = {"resolution": resolution, "views": views, "spp": spp}
    command = [sys.executable, "-m", "scenes", "integrators", scene]
    command += [part for name, value in options.items() for part in (f"--{name}", str(value))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode == 2:
        raise InputError(done.stderr.strip().removeprefix("scenes: "))
    if done.returncode:
        raise RuntimeError(f"comparing integrators ended with exit code {done.returncode}: {done.stderr[-2000:]}")
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def omission_of_integrators(found: dict[str, Any], samples: int) -> Omission:
    """Return the omission on a complete view set, to which the seconds of `samples` are scaled."""
    seconds = found["seconds"]["volpath"] - found["seconds"]["path"]
    squares = paired_difference(np.array(found["squared"]))
    interval = None if squares.interval is None else (_root(squares.interval[0]), _root(squares.interval[1]))
    return Omission(
        scene=found["scene"],
        method="",
        name="participating_media",
        seconds_saved=seconds * samples / found["samples"],
        clock=CLOCK_OF_RENDERING,
        difference=_root(squares.mean),
        interval=interval,
        pairs=squares.units,
        diverged=0,
        verdict=judged(squares, PARTS["participating_media"].bound ** 2),
    )


def _root(square: float) -> float:
    """Return the root of an unbiased square, which may lie below 0 by chance."""
    return math.sqrt(max(square, 0.0))


def _of_integrator(plan: Plan, scene: str, folder: Path, scratch: Path) -> Omission | None:
    """Return the omission of the medium; None for a view set or a scene from elsewhere, or if the medium is needed."""
    from harness.execution.ground_truth import read_views

    need = needs_of(read_views(folder, plan.views, scratch)).get("participating_media")
    if plan.view_set or plan.scene_file or need is None or need.needed:
        return None
    views = plan.views
    samples = ((views.train + views.val) * views.spp_train + views.test * views.spp_test) * views.resolution**2
    count = min(INTEGRATOR_VIEWS, views.test)
    spp = max(views.spp_test, INTEGRATOR_SPP)
    return omission_of_integrators(compared_integrators(scene, views.resolution, count, spp), samples)


def _filled(row: LeftOut, one: Omission) -> LeftOut:
    return structs.replace(
        row,
        seconds_saved=one.seconds_saved,
        difference=one.difference,
        interval=one.interval,
        clock=one.clock,
        verdict=one.verdict,
    )


def _as_row(one: Omission) -> dict[str, Any]:
    return {**asdict(one), "what": one.title, "bound": one.bound, "unit": one.unit}


def _line_of_cell(cell: CellArms) -> str:
    scores = (
        f"{name} {'diverged' if one.psnr is None else f'{one.psnr:.2f} dB'} in {one.train_seconds:.1f} s"
        for name, one in cell.ended.items()
    )
    return f"{cell.scene} {cell.method} seed {cell.seed}: {', '.join(scores)}"
