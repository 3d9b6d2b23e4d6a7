"""What every case about scenes says in the same way: of the ground truth, of each method, and which scenes it needs."""

from collections.abc import Callable, Iterator
from math import isfinite
from pathlib import Path
from typing import Literal

import numpy as np

from harness.ground_truth import render_view_sets
from harness.records import CellRecord
from harness.stability.scene_truth import LARGEST_Z, Views, read_views_and_truth, unexplained, worst_z
from harness.stability.situation import Finding, Situation, whose
from harness.stability.trained_scenes import Trained, learnt_nothing, scores_table, trained, unscored
from harness.stability_record import Outcome, judged
from scenes.catalog import scene_named
from scenes.transforms import read_transforms
from scenes.truth import Truth

PROFILE = "stress"
ITEM = 10
SCENES: dict[str, tuple[str, ...]] = {
    "S1": ("empty", "black", "white"),
    "S2": ("wall", "inside"),
    "S3": ("fog_dense", "fog_thin"),
    "S4": ("wires",),
    "S5": ("mirror", "glass", "glass_air"),
    "S6": ("hdr_emitter", "checker", "grazing", "furnace"),
    "S7": ("tiny", "huge"),
}
"""Case → the scenes that it looks at."""
LARGEST_EXCESS = 1.5
"""Of the mean square difference of pixels from closed form over what noise explains; measured: 0.92 to 1.35."""


def stress(situation: Situation, case: str) -> Trained:
    """The scenes of all cases of this run, trained once."""
    chosen = [name for name in SCENES if name in situation.cases] or list(SCENES)
    wanted = [scene for name in {case, *chosen} for scene in SCENES[name]]
    return trained(situation, PROFILE, wanted, situation.out)


def views_of(found: Trained, scene: str, count: int | None = None) -> Views:
    """The scene's test views beside their closed form."""
    truth = scene_named(scene).truth
    if truth is None:
        raise ValueError(f"scene {scene} has no closed form")
    return views_beside(found.folder(scene), truth, count)


def views_beside(folder: Path, truth: Truth, count: int | None = None) -> Views:
    """The test views of a view set, or the first `count`, beside a closed form."""
    frames = read_transforms(folder, "test")
    names = [file.relative_to(folder.resolve()).with_suffix("").as_posix() for file in frames.files]
    return read_views_and_truth(folder, names[:count], frames.camera_to_world[:count], truth)


def view_set_of(situation: Situation, scene: str) -> Path:
    """A scene's view set as the stress scenes have theirs, rendered where the cache has none, and nothing trained."""
    views = situation.plan(PROFILE).views
    return next(event.path for event in render_view_sets((scene,), views, situation.view_sets) if event.path)


def held_to_closed_form(case: str, scene: str, views: Views, why: str = "") -> Iterator[Outcome]:
    """The rendered ground truth against closed form: the means of whole views, and pixel by pixel."""
    yield judged(
        case, "ground truth", "ours", worst_z(views), LARGEST_Z,
        what=f"{scene}: largest |z| of red, green, blue and opacity against closed form", why=why,
    )  # fmt: skip
    yield judged(
        case, "ground truth", "ours", unexplained(views), LARGEST_EXCESS,
        what=f"{scene}: mean square difference of pixels over what noise explains",
    )  # fmt: skip


def each_method(
    case: str,
    found: Trained,
    scene: str,
    figure: Callable[[CellRecord], float | None],
    bar: float,
    what: str,
    unit: str = "",
    sense: Literal["at_most", "at_least"] = "at_most",
) -> Iterator[Outcome]:
    """`figure` of every cell of the scene against `bar`; None where the cell has none, which is said.

    A cell that learnt nothing keeps its figure and is not judged by it: showing nothing at all comes close to many a
    scene, and is no success on any.
    """
    for cell in found.of(scene):
        missing = unscored(case, cell, f"{scene}: {what}")
        value = None if missing else figure(cell)
        if missing:
            yield missing
        elif value is None:
            yield Outcome(
                case, cell.method, whose(cell.method), "not_applicable", what=f"{scene}: {what}",
                why="its record holds no such score",
            )  # fmt: skip
        elif learnt_nothing(found, cell):
            yield Outcome(
                case, cell.method, whose(cell.method), "not_applicable",
                value if isfinite(value) else None, bar, sense, unit, f"{scene}: {what}",
                f"learnt nothing in {cell.steps} steps: empty collapse; nothing is there to judge",
            )  # fmt: skip
        else:
            why = "; ".join(cell.warnings)
            yield judged(
                case, cell.method, whose(cell.method), value, bar,
                what=f"{scene}: {what}", unit=unit, sense=sense, why=why,
            )  # fmt: skip


def scores(case: str, title: str, found: Trained) -> Finding:
    """Training and test views of the case's scenes side by side."""
    return scores_table(case, title, found, SCENES[case], ITEM)


def mse_over_tests(cell: CellRecord) -> float | None:
    """Mean over the test views of the mean square error, display colour over white."""
    errors = [10.0 ** (-view.psnr / 10.0) for view in cell.views if view.psnr is not None]
    return float(np.mean(errors)) if errors else None
