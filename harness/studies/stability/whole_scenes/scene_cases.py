"""S1, S2, S7: nothing to see, too close, far too small or large.

The ground truth is compared with closed forms, then each method with the ground truth.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from msgspec import structs

from harness.execution.ground_truth import read_views
from harness.records.cells import CellRecord
from harness.records.study import Check, Table, check
from harness.studies.stability.fields.small_training import STEPS, planted_billboard
from harness.studies.stability.stability_context import Finding, StabilityContext
from harness.studies.stability.whole_scenes.scene_truth import (
    ITEM,
    LARGEST_Z,
    PROFILE,
    SceneRun,
    Views,
    depth_error,
    each_method,
    held_to_closed_form,
    learnt_nothing,
    mse_over_tests,
    scores,
    shown,
    stress,
    textbook_scores,
    view_set_of,
    views_beside,
    views_of,
    worst_z,
)
from harness.training.cell_training import BILLBOARD_GAP_DB
from harness.training.evaluate import View, view_scores
from scenes.catalog.stress import scales
from scenes.catalog.stress.plain import nothing
from scenes.files.errors import InputError
from scenes.modelling.normalise import Similarity, box_of, check_scale
from scenes.view_sets.pixels import over_white

LARGEST_MSE = {"empty": 1e-5, "black": 6e-3}


def nothing_to_see(situation: StabilityContext) -> Iterator[Finding]:
    """S1: nothing to see."""
    found = stress(situation, "S1")
    for scene in ("empty", "black", "white"):
        views = views_of(found, scene)
        yield from held_to_closed_form("S1", scene, views)
        yield from _scores_of_the_truth_itself(situation, found, scene)
        if scene == "white":  # over white, its opacity alone tells it from nothing and from a white veil
            yield from each_method(
                "S1", found, scene, partial(_silhouette, found, views), 0.5,
                "mean opacity within the silhouette, less that outside", sense="at_least",
            )  # fmt: skip
            continue
        yield from each_method(
            "S1", found, scene, mse_over_tests, LARGEST_MSE[scene], "mean square error over the test views"
        )
        yield from each_method(
            "S1", found, scene, partial(_mean_opacity, found, views, _outside), 0.02,
            "mean opacity where there is nothing",
        )  # fmt: skip
    yield scores("S1", "Nothing to see", found)


def _scores_of_the_truth_itself(situation: StabilityContext, found: SceneRun, scene: str) -> Iterator[Check]:
    """Check a view against itself: every score must be a number, or None if it is not defined."""
    split = read_views(found.folder(scene), situation.plan(PROFILE).views, situation.scratch).test
    image, rgba = over_white(split.rgba[0]), split.rgba[0]
    ours = view_scores(View(image, rgba[..., 3], np.zeros(rgba.shape[:2])), split, 0)
    numbers = [value for name, value in structs.asdict(ours).items() if name != "view" and value is not None]
    for subject, whose, values in (
        ("harness", "ours", numbers),
        ("textbook formulas", "usual", list(textbook_scores(image, image).values())),
    ):
        yield check(
            f"{scene}: scores of a view against itself that are not finite",
            float(np.count_nonzero(~np.isfinite(values))),
            high=0.0,
            subject=subject,
            owner=whose,  # type: ignore[arg-type]
        )


def _outside(views: Views) -> np.ndarray:
    nothing_there: np.ndarray = views.truth[0, ..., 3] == 0.0
    return nothing_there


def _inside(views: Views) -> np.ndarray:
    return views.covered[0]


def _mean_opacity(
    found: SceneRun, views: Views, where: Callable[[Views], np.ndarray], cell: CellRecord
) -> float | None:
    """Return the mean over the pixels that `where` picks of a view, to the 8 bits of the stored picture."""
    values = [one.opacity[where(views.of(one.view))] for one in shown(found, cell)]
    return float(np.concatenate(values).mean()) if values else None


def _silhouette(found: SceneRun, views: Views, cell: CellRecord) -> float | None:
    inside, outside = (_mean_opacity(found, views, where, cell) for where in (_inside, _outside))
    return None if inside is None or outside is None else inside - outside


def too_close(situation: StabilityContext) -> Iterator[Finding]:
    """S2: too close."""
    found = stress(situation, "S2")
    rows: list[list[str | float | None]] = []
    for scene in ("wall", "inside"):
        views = views_of(found, scene)
        yield from held_to_closed_form("S2", scene, views)
        yield check(
            f"{scene}: largest error of rendered depth",
            depth_error(views),
            high=1e-3,
            unit="scene units",
            subject="ground truth",
        )
        yield from each_method(
            "S2", found, scene, above_the_copy, 0.0, "test views above a copy of the nearest training view",
            unit="dB", sense="at_least",
        )  # fmt: skip
        rows += depth_rows(found, scene, views)
    columns = ["scene", "method", "error of depth", "error of the best constant", "what came of it"]
    yield Table(
        "s2-depth", ITEM, "Depth, root mean square error in scene units, recorded and not judged", columns, rows
    )
    yield _billboard(situation)
    yield scores("S2", "Too close", found)


def above_the_copy(cell: CellRecord) -> float | None:
    """Return the score above the copy; a method that paints its training images before the cameras falls below it."""
    test, floor = cell.scores.get("psnr"), cell.scores.get("psnr_floor")
    return None if test is None or floor is None else test - floor


def depth_rows(found: SceneRun, scene: str, views: Views) -> list[list[str | float | None]]:
    """Return every method beside what one distance for all pixels would reach, which needs no learning at all."""
    constant = best_constant_depth(views)
    rows: list[list[str | float | None]] = []
    for cell in found.of(scene):
        error = cell.scores.get("depth_rmse")
        if error is None:
            said = f"no depth: {cell.status}"
        elif learnt_nothing(found, cell):
            said = "learnt nothing"
        else:
            said = "better than the constant" if error < constant else "worse than the constant"
        rows.append([scene, cell.method, error, constant, said])
    return rows


def best_constant_depth(views: Views) -> float:
    """Return the root mean square error of the one depth that is nearest to all, over covered pixels, scene units."""
    return float(views.true_depth[views.covered].std())


def _billboard(situation: StabilityContext) -> Check:
    """Check that the failure itself, brought about on purpose, is named."""
    plan = situation.plan(PROFILE)
    result = planted_billboard(
        view_set_of(situation, "black"), plan.views, plan.train, situation.scratch, 4 if situation.quick else STEPS
    )
    named = any(warning.startswith("billboard:") for warning in result.warnings)
    return check(
        "fog planted before the cameras is named a billboard",
        float(named),
        low=1.0,
        why=f"training views {result.train:.1f} dB, test views {result.test:.1f} dB, a copy of the nearest training "
        f"view {result.floor:.1f} dB; median depth {result.depth:.2f}, rays begin at {result.near:g}; the name needs "
        f"a gap of {BILLBOARD_GAP_DB:g} dB, and test views below the copy",
        subject="harness",
    )


RAW = {
    "scale 1e-4": scales.TINY,
    "scale 1e4, 1e5 away": scales.HUGE,
    "scale 1e4": Similarity(1e4, (0.0, 0.0, 0.0)),
    "1e3 away": Similarity(1.0, (0.0, 0.0, 1e3)),
    "1e4 away": Similarity(1.0, (1e4, 0.0, 0.0)),
    "1e5 away": Similarity(1.0, (0.0, 1e5, 0.0)),
}


def scaled(situation: StabilityContext) -> Iterator[Finding]:
    """S7: far too small or large."""
    found = stress(situation, "S7")
    unit = views_beside(view_set_of(situation, "scale_1"), nothing)
    for scene in ("tiny", "huge"):
        views = views_beside(found.folder(scene), nothing)
        yield check(
            f"{scene}: largest |z| of red, green, blue and opacity against the scene at unit scale",
            worst_z(against(views, unit)),
            high=LARGEST_Z,
            subject="ground truth",
        )
    for name, change in RAW.items():
        yield check(f"as it is refused: {name}", float(refused(change)), low=1.0, subject="harness")
    other = {cell.method: cell for cell in found.of("huge")}
    yield from each_method(
        "S7", found, "tiny", lambda cell: psnr_apart(cell, other.get(cell.method)), LARGEST_APART_DB,
        "test views of tiny and huge apart", unit="dB",
    )  # fmt: skip
    yield scores("S7", "Far too small, large or far away", found)


LARGEST_APART_DB = 1.5
"""The largest difference in dB: the two differ in their random numbers alone."""


def against(views: Views, unit: Views) -> Views:
    """Return `views` with another rendering of the same thing, and its noise, in place of a closed form."""
    return replace(views, truth=unit.rendered, variance=views.variance + unit.variance, true_depth=unit.depth)


def refused(change: Similarity) -> bool:
    """Whether the unit scene in another unit would be refused if somebody rendered it as it is."""
    box = box_of(scales.described(change))
    assert box is not None
    try:
        check_scale(box)
    except InputError:
        return True
    return False


def psnr_apart(cell: CellRecord, other: CellRecord | None) -> float | None:
    one, two = cell.scores.get("psnr"), other.scores.get("psnr") if other else None
    return None if one is None or two is None else abs(one - two)
