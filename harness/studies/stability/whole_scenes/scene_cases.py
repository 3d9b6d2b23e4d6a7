"""S1, S2, S7: nothing to see, too close, far too small or large.

The ground truth is compared with closed forms, then each method with the ground truth.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import torch
from msgspec import structs

from harness.execution.ground_truth import read_views
from harness.plan.schedule import Budget
from harness.records.cells import CellRecord
from harness.records.study import Check, Owner, Table, check
from harness.studies.framework import Found
from harness.studies.stability.stability_context import Rows, StabilityContext, error_of
from harness.studies.stability.whole_scenes.scene_truth import (
    ITEM,
    LARGEST_Z,
    PROFILE,
    SceneRun,
    Views,
    each_method,
    held_to_closed_form,
    learnt_nothing,
    mse_over_tests,
    scores_table,
    shown,
    stress,
    view_set_of,
    views_beside,
    views_of,
    worst_z,
)
from harness.training import evaluate
from harness.training.batches import Batches
from harness.training.cell_training import BILLBOARD_GAP_DB, warnings_of
from harness.training.learner import train
from harness.training.lockstep import box_of as box_of_views
from harness.training.trainer import Trainer
from scenes.catalog.stress import scales
from scenes.catalog.stress.plain import nothing
from scenes.files.errors import InputError
from scenes.modelling.normalise import Similarity, box_of, check_scale
from scenes.view_sets.pixels import over_white

LARGEST_MSE = {"empty": 1e-5, "black": 6e-3}


def nothing_to_see(context: StabilityContext) -> Iterator[Found]:
    """S1: nothing to see."""
    run = stress(context, "S1")
    for scene in ("empty", "black", "white"):
        views = views_of(run, scene)
        yield from held_to_closed_form(scene, views)
        yield from _scores_of_the_truth_itself(context, run, scene)
        if scene == "white":  # over white, its opacity alone tells it from nothing and from a white veil
            what = "mean opacity within the silhouette, less that outside"
            yield from each_method(run, scene, what, partial(_silhouette, run, views), low=0.5)
        else:
            what, high = "mean square error over the test views", LARGEST_MSE[scene]
            yield from each_method(run, scene, what, mse_over_tests, high=high)
            what, figure = "mean opacity where there is nothing", partial(_mean_opacity, run, views, _outside)
            yield from each_method(run, scene, what, figure, high=0.02)
    yield scores_table("S1", "Nothing to see", run)


def _scores_of_the_truth_itself(context: StabilityContext, run: SceneRun, scene: str) -> Iterator[Check]:
    """Check a view against itself: every score must be a number, or None if it is not defined."""
    split = run.view_set(context, scene).test
    image, rgba = over_white(split.rgba[0]), split.rgba[0]
    itself = evaluate.View(image, rgba[..., 3], np.zeros(rgba.shape[:2]))
    scores = structs.asdict(evaluate.view_scores(itself, split, 0))
    numbers = [value for name, value in scores.items() if name != "view" and value is not None]
    textbook = list(textbook_scores(image, image).values())
    owners: dict[str, Owner] = {"harness": "ours", "textbook formulas": "usual"}
    for (subject, owner), values in zip(owners.items(), (numbers, textbook), strict=True):
        what = f"{scene}: scores of a view against itself that are not finite"
        count = np.count_nonzero(~np.isfinite(values))
        yield check(what, float(count), high=0.0, subject=subject, owner=owner)


def textbook_scores(image: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """Return PSNR of an error that may be 0, and SSIM of complete images [h, w, 3] without its two constants."""
    x, y = image.astype(np.float64), truth.astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        psnr = -10.0 * np.log10(np.mean((x - y) ** 2))
        mean_x, mean_y = x.mean(), y.mean()
        covariance = ((x - mean_x) * (y - mean_y)).mean()
        structure = 2 * mean_x * mean_y * 2 * covariance
        ssim = structure / ((mean_x**2 + mean_y**2) * (x.var() + y.var()))
    return {"psnr": float(psnr), "ssim": float(ssim)}


def _outside(views: Views) -> np.ndarray:
    nothing_there: np.ndarray = views.truth[0, ..., 3] == 0.0
    return nothing_there


def _inside(views: Views) -> np.ndarray:
    return views.covered[0]


def _mean_opacity(run: SceneRun, views: Views, where: Callable[[Views], np.ndarray], cell: CellRecord) -> float | None:
    """Return the mean over the pixels that `where` picks of a view, to the 8 bits of the stored picture."""
    values = [view.opacity[where(views.of(view.view))] for view in shown(run, cell)]
    return float(np.concatenate(values).mean()) if values else None


def _silhouette(run: SceneRun, views: Views, cell: CellRecord) -> float | None:
    inside, outside = (_mean_opacity(run, views, where, cell) for where in (_inside, _outside))
    return None if inside is None or outside is None else inside - outside


def too_close(context: StabilityContext) -> Iterator[Found]:
    """S2: too close."""
    run = stress(context, "S2")
    rows: Rows = []
    for scene in ("wall", "inside"):
        views = views_of(run, scene)
        yield from held_to_closed_form(scene, views)
        what, error = f"{scene}: largest error of rendered depth", depth_error(views)
        yield check(what, error, high=1e-3, unit="scene units", subject="ground truth")
        what = "test views above a copy of the nearest training view"
        yield from each_method(run, scene, what, above_the_copy, low=0.0, unit="dB")
        rows += depth_rows(run, scene, views)
    columns = ["scene", "method", "error of depth", "error of the best constant", "what came of it"]
    title = "Depth, root mean square error in scene units, recorded and not judged"
    yield Table("s2-depth", ITEM, title, columns, rows)
    yield _billboard(context)
    yield scores_table("S2", "Too close", run)


def depth_error(views: Views) -> float:
    """Return the largest error of a completely covered pixel's depth, scene units; NaN if there is none."""
    if not views.covered.any():
        return float("nan")
    return float(np.abs(views.depth - views.true_depth)[views.covered].max())


def above_the_copy(cell: CellRecord) -> float | None:
    """Return the score above the copy; a method that paints its training images before the cameras falls below it."""
    test, floor = cell.scores.get("psnr"), cell.scores.get("psnr_floor")
    return None if test is None or floor is None else test - floor


def depth_rows(run: SceneRun, scene: str, views: Views) -> Rows:
    """Return every method beside what one distance for all pixels would reach, which needs no learning at all."""
    constant = float(views.true_depth[views.covered].std())
    rows: Rows = []
    for cell in run.of(scene):
        error = cell.scores.get("depth_rmse")
        if error is None:
            outcome = f"no depth: {cell.status}"
        elif learnt_nothing(run, cell):
            outcome = "learnt nothing"
        else:
            outcome = "better than the constant" if error < constant else "worse than the constant"
        rows.append([scene, cell.method, error, constant, outcome])
    return rows


FEW_VIEWS, STEPS = 6, 200
FOG = 20.0
"""The offset added to every raw density at the start: softplus of it is opaque within a bin, so the first bin is all
that is seen, and no gradient reaches what lies behind. A density without a bias, scaled up, starts like that.
"""


def _billboard(context: StabilityContext) -> Check:
    """Check that a billboard is named, every training image painted in front of its own camera: `nerf` is trained on a
    few views of the black scene, with fog before every camera at the start.

    Rays run from near to far, as in the original: cut to a box that all cameras share, they would have to share what
    is painted on it as well.
    """
    plan, cpu = context.plan(PROFILE), torch.device("cpu")
    views = read_views(view_set_of(context, "black"), replace(plan.views, train=FEW_VIEWS), context.scratch)
    accelerations = plan.train.accelerations.without(("clipping", "grid", "early_stop"))
    settings = replace(plan.train, accelerations=accelerations, grid=replace(plan.train.grid, cells=0))
    batches = Batches(evaluate.cameras_of(views, views.train, cpu), views.train.rgba)
    budget = Budget(4 if context.quick else STEPS, None)
    learner = Trainer("nerf", box_of_views(views, cpu), settings, budget, "billboard", cpu)
    with torch.no_grad():
        learner.coarse.density_head.bias.add_(FOG)
    train(learner, batches.stream("billboard", settings.rays))
    images = list(evaluate.render_split(learner, evaluate.cameras_of(views, views.test, cpu), chunk=4096))
    scores = {
        "psnr": evaluate.quick_scores(images, views.test)["psnr"],
        "psnr_train": evaluate.train_psnr(learner, views, FEW_VIEWS, chunk=4096),
        "psnr_floor": evaluate.floor_psnr(views),
    }
    opacity = float(np.mean([image.opacity.mean() for image in images]))
    warnings = warnings_of(scores, opacity, grid_emptied=False)
    test, training, floor = (score or 0.0 for score in scores.values())
    why = (
        f"training views {training:.1f} dB, test views {test:.1f} dB, a copy of the nearest training "
        f"view {floor:.1f} dB; median depth {np.median([image.depth for image in images]):.2f}, rays begin at "
        f"{views.near:g}; the name needs a gap of {BILLBOARD_GAP_DB:g} dB, and test views below the copy"
    )
    what = "fog planted before the cameras is named a billboard"
    named = any(warning.startswith("billboard:") for warning in warnings)
    return check(what, float(named), low=1.0, why=why, subject="harness")


RAW = {
    "scale 1e-4": scales.TINY,
    "scale 1e4, 1e5 away": scales.HUGE,
    "scale 1e4": Similarity(1e4, (0.0, 0.0, 0.0)),
    "1e3 away": Similarity(1.0, (0.0, 0.0, 1e3)),
    "1e4 away": Similarity(1.0, (1e4, 0.0, 0.0)),
    "1e5 away": Similarity(1.0, (0.0, 1e5, 0.0)),
}
LARGEST_APART_DB = 1.5
"""The largest difference in dB: the two differ in their random numbers alone."""


def scaled(context: StabilityContext) -> Iterator[Found]:
    """S7: far too small or large."""
    run = stress(context, "S7")
    unit = views_beside(view_set_of(context, "scale_1"), nothing)
    for scene in ("tiny", "huge"):
        views = views_beside(run.folder(scene), nothing)
        # another rendering of the same thing, and its noise, in place of a closed form
        beside = replace(views, truth=unit.rendered, variance=views.variance + unit.variance, true_depth=unit.depth)
        what = f"{scene}: largest |z| of red, green, blue and opacity against the scene at unit scale"
        yield check(what, worst_z(beside), high=LARGEST_Z, subject="ground truth")
    for name, change in RAW.items():
        yield check(f"as it is refused: {name}", float(refused(change)), low=1.0, subject="harness")
    huge = {cell.method: cell.scores.get("psnr") for cell in run.of("huge")}

    def apart(cell: CellRecord) -> float | None:
        psnr, other = cell.scores.get("psnr"), huge.get(cell.method)
        return None if psnr is None or other is None else abs(psnr - other)

    yield from each_method(run, "tiny", "test views of tiny and huge apart", apart, high=LARGEST_APART_DB, unit="dB")
    yield scores_table("S7", "Far too small, large or far away", run)


def refused(change: Similarity) -> bool:
    """Whether the unit scene in another unit would be refused if somebody rendered it as it is."""
    box = box_of(scales.described(change))
    assert box is not None
    return error_of(InputError, check_scale, box) is not None
