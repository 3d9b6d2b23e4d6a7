"""What leaving a part out does to scores and clocks: cells trained with and without it, everything else equal
(`python -m harness study omissions`, `run --verify-omissions`).
"""

import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import Literal

from msgspec import structs

from baselines.amplifiers import AMPLIFIERS
from baselines.catalog import CATALOG
from baselines.composition import LADDERS
from harness.execution.executors import device_here
from harness.execution.ground_truth import read_views
from harness.execution.progress import Progress
from harness.plan.needed import needs_here, pixels_across
from harness.plan.run_plan import Machine, Plan
from harness.records.cells import CellRecord, LeftOut, SceneRecord
from harness.run_folder.earlier_run import UNMEASURED
from harness.studies.choices.arms import PLANNED, Arm, CellArms, CellTask, trained_cells, weigh
from harness.verdicts.statistics import PairedDifference
from scenes.modelling.needs import PARTS, Unit, needs_of, useful_bands
from scenes.view_sets.view_set import ViewSet

Verdict = Literal["within its bound", "costs more", "inconclusive"]
TRAINED = (
    "view_direction",
    "outside_box",
    "empty_space",
    "outside_hull",
    "behind_matter",
    "background_rays",
    "fine_pass",
)
"""The needs whose omission changes what is trained."""
RENDERED = ("behind_opaque",)
"""The needs whose omission changes only how a trained method is rendered."""
CONTROLS = {
    "no view_direction": ("view_direction", ""),
    "Nyquist": ("high_bands", ""),
    "half the bins": ("every_bin", ""),
    "no bands": ("high_bands", "every band of the encoding, the needed ones too"),
}
"""An arm that leaves out what a run keeps → its need, and what it leaves out if that is more. The effect of the first
may need long training to show; the last must show a cost, or the measurement could show none.
"""


@dataclass(frozen=True)
class Omission:
    """What leaving one part out changed on one scene, over seeds."""

    scene: str
    method: str
    name: str
    seconds_saved: float | None
    """The mean over seeds of the core seconds that `clock` names."""
    clock: str
    difference: float | None
    """In dB, the test PSNR without the part minus that with it, below 0 for a loss; for colours, the largest change."""
    interval: tuple[float, float] | None
    """The 95 % interval over seeds; None for the largest value over seeds."""
    pairs: int
    diverged: int
    verdict: Verdict
    what: str = ""
    """What was left out, if that is more than the part `name`."""

    @property
    def title(self) -> str:
        return self.what or PARTS[self.name].what

    @property
    def bound(self) -> float:
        return PARTS[self.name].bound

    @property
    def unit(self) -> Unit:
        return PARTS[self.name].unit

    @property
    def line(self) -> str:
        """Return a line such as `lego: samples outside the box: +1.2 dB [+0.4, +2.0]: within its bound (0.2 dB)`."""
        between = "" if self.interval is None else f" [{self.interval[0]:+.4g}, {self.interval[1]:+.4g}]"
        change = "nothing measured" if self.difference is None else f"{self.difference:+.4g}{between} {self.unit}"
        saved = "" if self.seconds_saved is None else f", {self.seconds_saved:.2f} s saved ({self.clock})"
        return f"{self.scene}: {self.title}: {change}{saved}: {self.verdict} ({self.bound:.2g} {self.unit})"


def verified(
    plan: Plan,
    folders: dict[str, Path],
    scratch: Path,
    workers: int,
    say: Callable[[str], None],
    device: str = "cpu",
    controls: bool = False,
    kept: Path | None = None,
) -> tuple[list[Omission], list[Omission]]:
    """Return what leaving out costs: parts that a scene does not need and, with `controls`, parts that it needs.

    Every cell of the plan is trained once as planned and once more per omission of its scene.
    """
    views = {scene: read_views(folder, plan.views, scratch) for scene, folder in folders.items()}
    cells = []
    tasks = [replace(task, kept=kept) for task in cell_tasks(plan, views, folders, scratch, controls, device)]
    for cell in trained_cells(tasks, workers):
        cells.append(cell)
        scores = (
            f"{name} {'diverged' if arm.psnr is None else f'{arm.psnr:.2f} dB'} in {arm.train_seconds:.1f} s"
            for name, arm in cell.ended.items()
        )
        say(f"{cell.scene} {cell.method} seed {cell.seed}: {', '.join(scores)}")
    omissions = sorted(omissions_of(cells), key=lambda omission: list(folders).index(omission.scene))
    return omissions, controls_of(cells)


def verify_run(
    plan: Plan,
    machine: Machine,
    out: Path,
    show: Progress,
    cells: list[CellRecord],
    scenes: list[SceneRecord],
    folders: dict[str, Path],
) -> list[SceneRecord]:
    """Return `scenes` with what leaving out saved and changed, measured with one method. Its cells are kept in
    OUT/omissions until all have ended.
    """
    done = {cell.method for cell in cells if cell.status == "done"}
    trained = [name for name in plan.methods if name in done]  # methods that only explain a result do not count
    if not trained:
        show.line("--verify-omissions: nothing is measured, as no cell of the plan is done; the records say why")
        return scenes
    one_method = replace(plan, methods=("nerf",) if "nerf" in trained else tuple(trained[:1]))
    device, kept = device_here(machine), out / "omissions"
    omissions, _ = verified(one_method, folders, out, machine.workers, show.line, device, kept=kept)
    shutil.rmtree(kept, ignore_errors=True)
    for omission in too_costly(omissions):
        show.line(f"left out at too high a price: {omission.line}")
    by_scene = {scene.name: [omission for omission in omissions if omission.scene == scene.name] for scene in scenes}
    return [
        structs.replace(scene, left_out=with_measurements(scene.left_out, by_scene[scene.name])) for scene in scenes
    ]


def too_costly(omissions: list[Omission]) -> list[Omission]:
    return [omission for omission in omissions if omission.verdict == "costs more"]


def with_measurements(rows: list[LeftOut], omissions: list[Omission]) -> list[LeftOut]:
    measured = {
        omission.name: {name: getattr(omission, name, blank) for name, blank in UNMEASURED.items()}
        for omission in omissions
    }
    return [structs.replace(row, **measured.get(row.name, {})) for row in rows]


def as_json(
    omissions: list[Omission], controls: list[Omission], plan: Plan, provenance: dict[str, object]
) -> dict[str, object]:
    def rows(table: list[Omission]) -> list[dict[str, object]]:
        return [{**asdict(row), "what": row.title, "bound": row.bound, "unit": row.unit} for row in table]

    return {
        "what": "each scene with everything left out that it does not need, against the same with one of these done; "
        "controls: something left out that is needed",
        "provenance": provenance,
        "settings": plan.settings(),
        "omissions": rows(omissions),
        "controls": rows(controls),
    }


def verdict_on(costs: PairedDifference | None, bound: float) -> Verdict:
    """Compare the complete interval of `costs`, which say how much worse the result became, with `bound`."""
    if costs is None or costs.interval is None:
        return "inconclusive"
    low, high = costs.interval
    if high <= bound:
        return "within its bound"
    return "costs more" if low > bound else "inconclusive"


def verifiable(views: ViewSet, plan: Plan, method: str) -> tuple[str, ...]:
    """Return what this scene does not need, plan and method otherwise have, and training or rendering can test."""
    train, parts = plan.train, CATALOG[method].parts
    # a voxel grid has no such sampling, and Listing 4 takes every point of the complete ray
    sampled = parts is not None and parts.quadrature != "listing4"
    shared = ("view_direction", "background_rays")
    has = {
        "fine_pass": train.fine_bins > 0,
        "empty_space": train.grid.cells > 0 and train.accelerations.grid,
        "outside_box": train.accelerations.clipping,
        "behind_opaque": train.accelerations.early_stop,
        "behind_matter": parts is not None and AMPLIFIERS[parts.amplifier](None).pointwise,
    }
    needs = needs_here(train, views)
    return tuple(
        name
        for name in (*TRAINED, *RENDERED)
        if name in needs and not needs[name].needed and has.get(name, True) and (sampled or name in shared)
    )


def cell_tasks(
    plan: Plan,
    views: dict[str, ViewSet],
    folders: dict[str, Path],
    scratch: Path,
    controls: bool = False,
    device: str = "cpu",
) -> list[CellTask]:
    """Return each cell of the plan without everything that its scene does not need, and again with each of these parts.

    With `controls`, also without what every run keeps: bands above the Nyquist limit and half of the bins; the first
    scene also without any band, and without the view direction if it needs that.
    """
    tasks = []
    for scene, method, seed in plan.cells():
        names = verifiable(views[scene], plan, method)
        arms = {PLANNED: Arm(rendered_with=tuple(name for name in names if name in RENDERED))}
        arms |= {name: Arm(need=(name,)) for name in names if name in TRAINED}
        parts = CATALOG[method].parts
        if controls and parts is not None:
            bands = useful_bands(pixels_across(views[scene]) / 2, LADDERS[parts.encoding].base)
            arms |= {"Nyquist": with_bands(plan, bands), "half the bins": with_half_the_bins(plan)}
        if controls and parts is not None and scene == plan.scenes[0]:
            arms["no bands"] = with_bands(plan, 0)
            direction = needs_of(views[scene]).get("view_direction")
            if direction is not None and direction.needed:
                arms["no view_direction"] = Arm(no_need=("view_direction",))
        tasks.append(CellTask(scene, method, seed, folders[scene], scratch, plan, arms, device))
    return tasks


def with_bands(plan: Plan, bands: int) -> Arm:
    return Arm({"network": replace(plan.train.network, position_bands=bands)})


def with_half_the_bins(plan: Plan) -> Arm:
    per_pixel = plan.train.bins_per_pixel
    return Arm({"bins": round(0.5 * plan.train.bins), "bins_per_pixel": per_pixel and 0.5 * per_pixel})


def omissions_of(cells: list[CellArms]) -> list[Omission]:
    omissions = []
    for alike in _by_method(cells):
        omissions += [_of_training(alike, name, PLANNED, name) for name in alike[0].ended if name in TRAINED]
        rerendered = dict.fromkeys(name for cell in alike for name in cell.ended[PLANNED].rerendered)
        omissions += [_of_rendering(alike, name) for name in rerendered]
    return omissions


def controls_of(cells: list[CellArms]) -> list[Omission]:
    return [
        replace(_of_training(alike, name, arm, PLANNED), what=what)
        for alike in _by_method(cells)
        for arm, (name, what) in CONTROLS.items()
        if arm in alike[0].ended
    ]


def _by_method(cells: list[CellArms]) -> list[list[CellArms]]:
    keys = dict.fromkeys((cell.scene, cell.method) for cell in cells)
    return [[cell for cell in cells if (cell.scene, cell.method) == key] for key in keys]


def _of_training(cells: list[CellArms], name: str, without: str, with_it: str) -> Omission:
    pairs = [(cell.ended[without], cell.ended[with_it]) for cell in cells]
    result = weigh((a.psnr, b.psnr) for a, b in pairs)
    verdict = verdict_on(weigh((b.psnr, a.psnr) for a, b in pairs), PARTS[name].bound)
    if any(a.psnr is None and b.psnr is not None for a, b in pairs):
        verdict = "costs more"  # a cell that fails without the part is worse than any score
    saved = [
        b.core_seconds + b.rendering_core_seconds - a.core_seconds - a.rendering_core_seconds
        for a, b in pairs
        if a.psnr is not None and b.psnr is not None
    ]
    return Omission(
        cells[0].scene,
        cells[0].method,
        name,
        seconds_saved=fmean(saved) if saved else None,
        clock="training and rendering the test views",
        difference=result.mean if result else None,
        interval=result.interval if result else None,
        pairs=len(saved),
        diverged=len(pairs) - len(saved),
        verdict=verdict,
    )


def _of_rendering(cells: list[CellArms], name: str) -> Omission:
    """Judge the largest change of a colour, which is not random."""
    again = [arm.rerendered[name] for cell in cells if name in (arm := cell.ended[PLANNED]).rerendered]
    largest = max(arm.largest_change for arm in again)
    return Omission(
        cells[0].scene,
        cells[0].method,
        name,
        seconds_saved=fmean(arm.core_seconds - arm.core_seconds_without for arm in again),
        clock="rendering the test views",
        difference=largest,
        interval=None,
        pairs=len(again),
        diverged=len(cells) - len(again),
        verdict="within its bound" if largest <= PARTS[name].bound else "costs more",
    )
