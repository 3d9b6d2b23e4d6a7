"""The criteria of cases about scenes: noise, closed forms, gaps, refusals, broken methods; and one run for all of them,
in which nothing is trained twice and no scene is dropped. Nothing here is trained.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.command.plan_options import planned
from harness.execution import run as execution
from harness.plan.run_plan import Plan
from harness.records.cells import CellRecord, RunRecord, SceneRecord, write_cell, write_run
from harness.studies.stability.stability_context import StabilityContext
from harness.studies.stability.whole_scenes import ladder_cases, scene_cases, scene_truth
from harness.studies.stability.whole_scenes.ladder_cases import RungScore
from harness.studies.stability.whole_scenes.scene_truth import SceneRun, Views
from scenes.catalog.entries import STRESS
from scenes.catalog.ladders.ladders import LADDERS
from scenes.catalog.stress.wires import RESOLUTION
from scenes.modelling.normalise import Similarity
from scenes.modelling.truth import Seen, pixel_means
from scenes.view_sets.image_stack import ImageStack
from scenes.view_sets.view_set import Split, ViewSet
from scenes.view_sets.viewpoints import FOV_X_RADIANS
from tests.harness.cells import cell, checkpoint, diverged
from tests.harness.studies.stability.made_up import context_in, pictured, run_of


def noisy_views(bias: float = 0.0, noise: float = 0.05, seed: int = 0) -> Views:
    """Two views of 40 × 40 with known truth and correctly estimated noise."""
    generator = np.random.default_rng(seed)
    truth = generator.uniform(0.2, 0.8, (2, 40, 40, 4))
    halves = [truth + bias + noise * math.sqrt(2) * generator.standard_normal(truth.shape) for _ in range(2)]
    variance = (halves[0] - halves[1]) ** 2 / 4
    depth = np.ones(truth.shape[:3])
    return Views(("a", "b"), (halves[0] + halves[1]) / 2, variance, truth, depth, depth)


def test_noise_is_within_the_limits_and_a_bias_is_not() -> None:
    scores = [scene_truth.worst_z(noisy_views(seed=seed)) for seed in range(20)]
    assert max(scores) < 4.0
    assert 0.8 < np.mean(scores) < 2.5, "the largest of four normal numbers"
    assert scene_truth.unexplained(noisy_views()) == pytest.approx(1.0, abs=0.1)
    # a tenth of the noise of a pixel: invisible in it, and four standard errors of the mean of 3200
    assert scene_truth.worst_z(noisy_views(bias=0.007)) > 4.0
    assert scene_truth.unexplained(noisy_views(bias=0.05)) > 1.5


def test_without_noise_nothing_may_differ() -> None:
    assert scene_truth.z_score(0.25, 0.25, 0.0) == 0.0
    assert scene_truth.z_score(0.25, 0.26, 0.0) == math.inf
    assert scene_truth.z_score(1.0, 0.0, 0.25) == 2.0
    assert scene_truth.unexplained(noisy_views(noise=0.0)) == 0.0
    assert scene_truth.worst_z(noisy_views(noise=0.0, bias=0.01)) == math.inf


def test_depth_is_compared_where_a_pixel_is_covered() -> None:
    views = noisy_views()
    run = run_of(Path(), cell("wall", "nerf", 0, []))
    (none,) = scene_cases.depth_of_truth(scene_of(run, views, "wall"))
    assert none.is_broken, "no pixel is completely covered"
    ones = np.ones_like(views.truth)
    depth = views.depth.copy()
    depth[1, 3, 3] = 1.5
    covered = Views(views.names, ones, views.variance, ones, depth, views.true_depth)
    (half,) = scene_cases.depth_of_truth(scene_of(run, covered, "wall"))
    assert half.value == pytest.approx(0.5)
    assert views.of("b").names == ("b",)
    assert np.array_equal(views.of("b").truth[0], views.truth[1])


def test_textbook_scores_of_identical_images_are_not_finite() -> None:
    flat = np.ones((8, 8, 3))
    assert scene_cases.textbook_scores(flat, flat)["psnr"] == math.inf
    assert math.isnan(scene_cases.textbook_scores(flat, flat)["ssim"])
    picture = np.random.default_rng(0).uniform(size=(8, 8, 3))
    assert scene_cases.textbook_scores(picture, picture)["ssim"] == pytest.approx(1.0)
    assert scene_cases.textbook_scores(picture, picture + 0.1)["psnr"] == pytest.approx(20.0)


def made(scene: str, *warnings: str, **facts: str) -> CellRecord:
    return cell(scene, "nerf", 0, [checkpoint(1, 1.0, 20.0)], warnings=list(warnings), **facts)


@pytest.mark.parametrize(
    ("record", "error", "status", "is_broken"),
    [
        (made("wires"), 0.5, "pass", False),
        (made("wires", "gap: x"), 0.5, "pass", False),
        (made("wires", "empty collapse: x"), 0.5, "not_applicable", False),
        (made("wires"), 0.99, "fail", True),
        (diverged("wires", "nerf", 0), 0.5, "fail", True),
        (diverged("wires", "qnerf", 0), 0.5, "fail", False),
        (made("wires", status="not_available", reason="no LLVM"), 0.5, "not_available", False),
    ],
)
def test_a_cell_is_judged_unless_it_learnt_nothing_or_is_not_available(
    record: CellRecord, error: float, status: str, is_broken: bool, tmp_path: Path
) -> None:
    run = run_of(tmp_path, record)
    (outcome,) = scene_truth.each_method(run, record.scene, "error", lambda _: error, high=0.9)
    assert (outcome.status, outcome.is_broken) == (status, is_broken)
    assert outcome.value == (error if record.status == "done" else None), "the figure is recorded in any case"
    assert (record.reason or "") in outcome.why
    (row,) = scene_truth.scores_table("S4" if record.scene == "wires" else "S1", run).rows
    for words in (outcome.why, str(row[-1])):
        assert ("learnt nothing" in words) == (status == "not_applicable")


def test_a_picture_that_is_dark_without_opacity_is_judged(tmp_path: Path) -> None:
    pictures = pictured(tmp_path, np.zeros((8, 8, 3)))
    run = run_of(tmp_path, cell("glass_air", "qnerf", 0, [], pictures=pictures, warnings=["empty collapse: x"]))
    (outcome,) = scene_truth.each_method(run, "glass_air", "share", lambda _: -70.0, low=0.3)
    assert outcome.status == "fail"


def scene_of(run: SceneRun, views: Views, name: str = "white") -> scene_cases.StressScene:
    return scene_cases.StressScene(context_in(run.out), run, name, views)


def test_scores_that_are_compared_with_a_trivial_picture() -> None:
    ones = np.ones((1, 4, 4, 4))
    depth = np.repeat([[8.0, 9.0]], 8).reshape(1, 4, 4)
    record = cell("wall", "nerf", 0, [], scores={"psnr": 15.8, "psnr_floor": 13.6, "depth_rmse": 2.4})
    scene = scene_of(run_of(Path(), record), Views(("a",), ones, ones, ones, depth, depth))
    assert scene_cases.above_the_copy(scene, record) == pytest.approx(2.2)
    assert scene_cases.over_best_constant(scene, record) == pytest.approx(4.8)
    record.scores.update({"psnr": None, "depth_rmse": None})
    assert scene_cases.above_the_copy(scene, record) is scene_cases.over_best_constant(scene, record) is None


def test_a_white_veil_is_not_a_silhouette(tmp_path: Path) -> None:
    """The figure is 0 if everything is opaque, and 1 if only the silhouette is."""
    truth = np.zeros((1, 8, 8, 4))
    truth[0, 4:] = 1.0
    views = Views(("test/r_0",), truth, truth, truth, truth[..., 0], truth[..., 0])
    for opacity, figure in ((np.ones((8, 8)), 0.0), (truth[0, ..., 0], 1.0)):
        record = cell("white", "nerf", 0, [], pictures=pictured(tmp_path, np.stack([opacity] * 3, -1)))
        assert scene_cases.silhouette(scene_of(run_of(tmp_path, record), views), record) == pytest.approx(figure)


def test_the_closed_form_of_a_pixel_is_free_of_bias(monkeypatch: pytest.MonkeyPatch) -> None:
    """Edges at the same place of every pixel: even grids have the same error everywhere, random points only noise."""
    size, fov = 24, FOV_X_RADIANS
    wide = 2 * math.tan(fov / 2) / size

    def stripes(o: np.ndarray, d: np.ndarray) -> Seen:
        light = (d[:, 0] / -d[:, 2] / wide % 1.0 < 0.53).astype(float)
        return Seen(np.repeat(light[:, None], 3, axis=1), np.ones(len(d)), np.ones(len(d)))

    def pull(seed: int) -> float:
        mean, variance, _ = scene_truth.closed_form(stripes, np.eye(4), size, size, seed)
        return scene_truth.z_score(float(mean[..., 0].mean()), 0.53, float(variance[..., 0].sum()) / size**4)

    assert max(abs(pull(seed)) for seed in range(6)) < 4.0

    def even(*arguments: object) -> tuple[np.ndarray, np.ndarray]:
        return pixel_means(*arguments[:5])  # type: ignore[arg-type]

    monkeypatch.setattr(scene_truth, "pixel_means", even)
    assert abs(pull(0)) > 4.0


@pytest.mark.slow
def test_wires_that_pixel_centres_miss_are_rendered_in_proportion() -> None:
    z, hits = scene_cases.z_of_thin_wires(1e-2, 48)
    assert abs(z) < 4.0
    assert hits > 100


def test_raw_scales_are_refused_and_the_unit_is_not() -> None:
    assert all(scene_cases.refused(change) for change in scene_cases.RAW.values())
    assert not scene_cases.refused(Similarity(1.0, (0.0, 0.0, 0.0)))


def test_every_stress_scene_has_its_case_and_the_size_it_is_made_for() -> None:
    assert sorted(scene for scenes in scene_truth.SCENES.values() for scene in scenes) == sorted(STRESS)
    assert sorted([*scene_cases.FIGURES, *scene_truth.SCENES["S7"]]) == sorted(STRESS)
    assert planned(scene_truth.PROFILE, precision="float32").views.resolution == RESOLUTION


def test_a_grazing_ray_is_cut_exactly_and_samples_are_not() -> None:
    ours, usual = scene_cases._grazing_chord()
    assert (ours.status, usual.status) == ("pass", "fail")
    assert usual.value is not None
    assert usual.value > 0.05


def test_covered_share_is_in_proportion_to_width() -> None:
    """By area from thick wires, and by enough rays to hit the thin ones."""
    assert scene_cases.covered_share(0.1, 40, 0) == pytest.approx(scene_cases.covered_share(0.1, 40, 8), rel=0.05)
    assert scene_cases.covered_share(1e-4, 12, 1) == 0.0, "rays through pixel centres miss them all"


def test_the_image_in_the_mirror_lies_behind_it() -> None:
    assert 0.1 < scene_cases.virtual_depth() < 2.0


# one run for all cases

planned_scenes: list[tuple[str, ...]] = []


def scene_record(name: str) -> SceneRecord:
    return SceneRecord(name, name, f"{name}-folder", 8, 8, {}, 2.0, 6.0, [[-1.0] * 3, [1.0] * 3], 40.0, 15.0, {}, [])


def write(plan: Plan, folder: Path, finished: bool = True) -> None:
    for key in plan.cells():
        write_cell(folder, cell(*key, [checkpoint(10, 1.0, 20.0)]))
    scenes = [scene_record(name) for name in plan.scenes]
    methods = {name: name for name in plan.methods}
    write_run(folder, RunRecord("smoke", "", scenes, methods, [], [0], plan.settings(), {}, {}, finished, []))


@pytest.fixture
def context(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> StabilityContext:
    planned_scenes.clear()

    def fake(plan: Plan, folder: Path, *others: object) -> None:
        planned_scenes.append(plan.scenes)
        write(plan, folder)

    monkeypatch.setattr(execution, "run", fake)
    return context_in(tmp_path, "nerf", "qnerf", quick=False)


def test_existing_cells_are_not_trained_again_and_a_later_case_never_narrows_the_record(
    context: StabilityContext,
) -> None:
    for _ in range(3):
        run = scene_truth.trained(context, "smoke", ["lego"], context.out)
    assert planned_scenes == [("lego",)]
    assert [cell.method for cell in run.of("lego")] == ["nerf", "nerf", "qnerf", "qnerf"]
    assert run.folder("lego") == context.view_sets / "lego-folder"
    both = scene_truth.trained(context, "smoke", ["hotdog"], context.out)
    assert planned_scenes == [("lego",), ("hotdog", "lego")]
    assert {scene for scene, _ in both.cells} == {"hotdog", "lego"}
    assert [scene.name for scene in both.run.scenes] == ["hotdog", "lego"]
    scene_truth.trained(context, "smoke", ["lego"], context.out)
    assert len(planned_scenes) == 2


def test_a_stopped_or_damaged_run_or_one_with_other_settings_is_run_again(context: StabilityContext) -> None:
    write(context.plan("smoke", ["lego"]), context.out, finished=False)
    scene_truth.trained(context, "smoke", ["lego"], context.out)
    assert planned_scenes == [("lego",)]
    scene_truth.trained(replace(context, methods=("nerf",)), "smoke", ["lego"], context.out)
    assert len(planned_scenes) == 2
    (context.out / "records" / "run.json").write_text("{")
    scene_truth.trained(context, "smoke", ["lego"], context.out)
    assert len(planned_scenes) == 3


# broken methods


def views_of(rgba: np.ndarray) -> ViewSet:
    test = Split(("test/r_0",), np.eye(4)[None], ImageStack.of([rgba.astype(np.float32)]))
    none = Split((), np.zeros((0, 4, 4)), ImageStack((8, 8, 4)))
    box = np.array([[-1.0] * 3, [1.0] * 3])
    return ViewSet(Path(), "x", "x", 8, 8, 0.7, 2.0, 6.0, box, none, none, test)


def half_covered() -> np.ndarray:
    """A white upper half, and a lower half covered by stripes of 0.2 and 0.8, whose variance is 0.09."""
    rgba = np.zeros((8, 8, 4))
    rgba[4:, ::2, :3], rgba[4:, 1::2, :3] = 0.2, 0.8
    rgba[4:, :, 3] = 1.0
    return rgba


def shown_as(tmp_path: Path, stripes: float, psnr: float) -> tuple[SceneRun, CellRecord]:
    """A cell that shows the background exactly, and the stripes with that contrast about their mean."""
    image = np.ones((8, 8, 3))
    image[4:, ::2], image[4:, 1::2] = 0.5 - 0.3 * stripes, 0.5 + 0.3 * stripes
    record = cell("frequency_1", "nerf", 0, [checkpoint(1, 1.0, psnr)], pictures=pictured(tmp_path, image))
    return run_of(tmp_path, record), record


@pytest.mark.parametrize(("contrast", "share"), [(1.0, 1.0), (0.0, 0.0), (0.5, 0.75)])
def test_looks_are_judged_within_the_silhouette(tmp_path: Path, contrast: float, share: float) -> None:
    run, record = shown_as(tmp_path, contrast, 20.0)
    assert scene_truth.share_of_looks(run, record, views_of(half_covered())) == pytest.approx(share, abs=0.01)


def test_shape_is_judged_over_complete_views() -> None:
    variance = (0.5 * 1.0 + 0.25 * 0.04 + 0.25 * 0.64) - 0.75**2
    mse = scene_truth.mse_over_tests(cell("frequency_1", "nerf", 0, []))
    assert mse == pytest.approx(0.01)
    assert ladder_cases.share_of_views(0.01, views_of(half_covered())) == pytest.approx(1 - 0.01 / variance)
    assert scene_truth.colour_variance(np.array([[0.2, 0.5, 0.8]] * 3)) == pytest.approx(0.0), "about one colour"


def test_only_a_silhouette_is_broken_and_so_is_a_cell_without_scores(tmp_path: Path) -> None:
    run, record = shown_as(tmp_path, 0.0, 13.0)
    views = views_of(half_covered())
    assert ladder_cases.score_of(run, record, views, looks=True).broken.startswith("explains")
    complete = ladder_cases.score_of(run, record, views, looks=False)
    assert complete.broken == "", "the silhouette is most of a complete view"
    score = ladder_cases.score_of(run, diverged("frequency_1", "nerf", 0), views, looks=True)
    assert score == (None, "diverged: not finite at step 7: loss")


GOOD, BROKEN = RungScore(0.9, ""), RungScore(0.1, "explains 10%")


def test_the_worst_of_several_seeds_and_the_first_broken_rung_count() -> None:
    none = RungScore(None, "diverged: x")
    assert ladder_cases.worst([GOOD, BROKEN]) is BROKEN
    assert ladder_cases.worst([BROKEN, none, GOOD]) is none
    assert ladder_cases.rungs_climbed([GOOD, GOOD, BROKEN, GOOD, BROKEN]) == 2
    assert ladder_cases.rungs_climbed([GOOD] * 5) == 5


@pytest.mark.parametrize(
    ("ladder", "method", "climbed", "status", "broke"),
    [
        ("frequency", "nerf", [GOOD, *[BROKEN] * 4], "pass", False),
        ("frequency", "nerf", [BROKEN] * 5, "fail", True),
        ("frequency", "qnerf", [BROKEN] * 5, "fail", False),
        ("scale", "nerf", [GOOD] * 5, "pass", False),
        ("scale", "nerf", [*[GOOD] * 4, BROKEN], "fail", True),
    ],
)
def test_a_method_of_this_harness_must_climb_the_required_rungs(
    ladder: str, method: str, climbed: list[RungScore], status: str, broke: bool
) -> None:
    run = run_of(Path(), cell(f"{ladder}_1", method, 0, []))
    outcome = ladder_cases.outcome_of(LADDERS[ladder], run, method, climbed)
    assert (outcome.status, outcome.is_broken) == (status, broke)


def test_a_method_that_is_not_available_does_not_fail() -> None:
    assert set(ladder_cases.LEAST_RUNGS) == set(LADDERS)
    missing = cell("frequency_1", "nerf", 0, [], status="not_available", reason="no LLVM")
    none = [RungScore(None, "not_available: no LLVM")] * 5
    outcome = ladder_cases.outcome_of(LADDERS["frequency"], run_of(Path(), missing), "nerf", none)
    assert (outcome.status, outcome.why, outcome.is_broken) == ("not_available", "no LLVM", False)
