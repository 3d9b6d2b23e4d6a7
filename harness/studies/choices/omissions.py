"""What leaving something out does to scores and clocks: cells trained with and without it, the rest the same.

What concerns rendering alone is judged on one set of weights, rendered both ways.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from baselines.catalog import CATALOG
from harness.plan.needed import needs_of
from harness.plan.profiles import Plan
from harness.studies.choices.arms import Arm, CellArms, CellTask
from harness.verdicts.statistics import PairedDifference, paired_difference
from scenes.modelling.needs import PARTS, Unit

if TYPE_CHECKING:
    from scenes.view_sets.view_set import ViewSet

Verdict = Literal["within its bound", "costs more", "inconclusive"]
TRAINED = ("view_direction", "outside_box", "empty_space", "fine_pass")
"""The needs whose omission changes what is trained."""
CONTROLS = {
    "no view_direction": ("view_direction", ""),
    "no bands": ("high_bands", "every band of the encoding, the needed ones too"),
}
"""An arm that leaves something out although it is needed → its need, and what it is. The effect of the first may take
long training to show; the second must cost visibly, or nothing here could.
"""
RENDERED = ("behind_opaque",)
"""The needs whose omission changes how a trained method is rendered, and nothing else."""


@dataclass(frozen=True)
class Omission:
    """What leaving one thing out on one scene changed, over seeds."""

    scene: str
    method: str
    name: str
    seconds_saved: float | None
    """The mean over seeds, on the clock that `clock` names; for `participating_media`, of rendering the view set."""
    clock: str
    difference: float | None
    """In dB, the test PSNR without the part minus that with it, so that a value below 0 is a loss. As a colour, the
    largest change and, for the integrators, the root mean square over blocks of pixels.
    """
    interval: tuple[float, float] | None
    """The 95 % interval, paired over seeds (over views for `participating_media`); None for the largest value over all
    seeds.
    """
    pairs: int
    diverged: int
    verdict: Verdict
    train_seconds_saved: float | None = None
    what: str = ""
    """What was left out if it is more than what `name` stands for."""

    @property
    def title(self) -> str:
        return self.what or PARTS[self.name].what

    @property
    def bound(self) -> float:
        return PARTS[self.name].bound

    @property
    def unit(self) -> Unit:
        return PARTS[self.name].unit


def judged(costs: PairedDifference, bound: float, exact: bool = False) -> Verdict:
    """Return the verdict; `costs` says how much worse the result became.

    within its bound   the whole interval lies below the bound; the mean, where `exact` says that nothing is random
    costs more         the whole interval lies above it
    inconclusive       anything else, and a difference of scores that has no interval
    """
    if exact:
        return "within its bound" if costs.mean <= bound else "costs more"
    if costs.interval is None:
        return "inconclusive"
    low, high = costs.interval
    if high <= bound:
        return "within its bound"
    return "costs more" if low > bound else "inconclusive"


def verifiable(views: "ViewSet", plan: Plan, method: str) -> tuple[str, ...]:
    """Return what this scene does not need, plan and method would otherwise have, and training or rendering can try."""
    train, parts = plan.train, CATALOG[method].parts
    # a voxel grid has no such sampling, and Listing 4 takes every point of the whole ray
    sampled = parts is not None and parts.quadrature != "listing4"
    has = {
        "fine_pass": train.fine_bins > 0,
        "empty_space": train.grid.cells > 0 and train.accelerations.grid,
        "outside_box": train.accelerations.clipping,
        "behind_opaque": train.accelerations.early_stop,
    }
    found = needs_of(views)
    return tuple(
        name
        for name in (*TRAINED, *RENDERED)
        if name in found and not found[name].needed and has.get(name, True) and (sampled or name == "view_direction")
    )


def cell_tasks(
    plan: Plan, folders: dict[str, Path], scratch: Path, controls: bool = False, device: str = "cpu"
) -> list[CellTask]:
    """Return each cell of the plan with everything left out that its scene does not need, and again with each of these.

    With `controls`, the first scene is also trained without bands, and without the view direction if it needs that.
    """
    from harness.execution.ground_truth import read_views

    tasks = []
    names: dict[tuple[str, str], tuple[str, ...]] = {}
    needed: dict[str, bool] = {}
    for scene, folder in folders.items():
        views = read_views(folder, plan.views, scratch)
        names |= {(scene, method): verifiable(views, plan, method) for method in plan.methods}
        direction = needs_of(views).get("view_direction")
        needed[scene] = direction is not None and direction.needed
    for scene, method, seed in plan.cells():
        mine = names[scene, method]
        again = tuple(name for name in mine if name in RENDERED)
        arms = {"as planned": Arm(rendered_with=again)}
        arms |= {name: Arm(need=(name,)) for name in mine if name in TRAINED}
        if controls and scene == plan.scenes[0] and CATALOG[method].parts is not None:
            arms["no bands"] = Arm(position_bands=0)
            if needed[scene]:
                arms["no view_direction"] = Arm(no_need=("view_direction",))
        tasks.append(CellTask(scene, method, seed, folders[scene], scratch, plan, arms, device))
    return tasks


def omissions_of(cells: list[CellArms]) -> list[Omission]:
    """Return one omission per scene, method and part, in the order in which the cells have them."""
    found = []
    for scene, method in dict.fromkeys((cell.scene, cell.method) for cell in cells):
        chosen = [cell for cell in cells if (cell.scene, cell.method) == (scene, method)]
        for name in [name for name in chosen[0].ended if name in TRAINED]:
            found.append(_of_training(chosen, name, "as planned", name))
        for name in dict.fromkeys(name for cell in chosen for name in cell.ended["as planned"].rerendered):
            found.append(_of_rendering(chosen, name))
    return found


def controls_of(cells: list[CellArms]) -> list[Omission]:
    """Return what leaving out costs if the part is needed."""
    found = []
    for scene, method in dict.fromkeys((cell.scene, cell.method) for cell in cells):
        chosen = [cell for cell in cells if (cell.scene, cell.method) == (scene, method)]
        for arm, (name, what) in CONTROLS.items():
            if arm in chosen[0].ended:
                found.append(replace(_of_training(chosen, name, arm, "as planned"), what=what))
    return found


def _of_training(cells: list[CellArms], name: str, without: str, with_it: str) -> Omission:
    """Compare the arms named by `without`, which lack the part, and `with_it`, which have it."""
    pairs = [(cell.ended[without], cell.ended[with_it]) for cell in cells]
    whole = [(a, b) for a, b in pairs if a.psnr is not None and b.psnr is not None]
    differences = np.array([(a.psnr or 0.0) - (b.psnr or 0.0) for a, b in whole])
    result = paired_difference(differences) if len(whole) else None
    verdict = judged(paired_difference(-differences), PARTS[name].bound) if result else "inconclusive"
    if any(a.psnr is None and b.psnr is not None for a, b in pairs):
        verdict = "costs more"  # a cell that ends for lack of the part is worth less than any score
    training = [b.train_seconds - a.train_seconds for a, b in whole]
    rendering = [b.render_seconds - a.render_seconds for a, b in whole]
    return Omission(
        cells[0].scene,
        cells[0].method,
        name,
        float(np.mean(training) + np.mean(rendering)) if whole else None,
        "training and rendering the test views",
        result.mean if result else None,
        result.interval if result else None,
        len(whole),
        len(pairs) - len(whole),
        verdict,
        float(np.mean(training)) if whole else None,
    )


def _of_rendering(cells: list[CellArms], name: str) -> Omission:
    every = [cell.ended["as planned"] for cell in cells]
    whole = [one.rerendered[name] for one in every if name in one.rerendered]
    largest = max(one.largest_change for one in whole) if whole else 0.0
    return Omission(
        cells[0].scene,
        cells[0].method,
        name,
        float(np.mean([one.seconds - one.seconds_with for one in whole])) if whole else None,
        "rendering the test views",
        largest if whole else None,
        None,
        len(whole),
        len(every) - len(whole),
        judged(PairedDifference(largest, None, None, len(whole)), PARTS[name].bound, True) if whole else "inconclusive",
    )
