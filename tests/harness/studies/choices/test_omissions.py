"""Which parts are left out, how they are forced in or out, and the verdicts on leaving them out."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from harness.command.plan_options import planned
from harness.execution.progress import Lines, Progress
from harness.plan.needed import LEFT_OUT_BY, for_scene, kept, needs_here
from harness.plan.run_plan import Machine, Plan
from harness.plan.schedule import Budget
from harness.records.cells import LeftOut, empty_cell
from harness.studies.choices import omissions
from harness.studies.choices.arms import Arm, CellArms, CellTask, Ended, Rerendered, trained_cell
from harness.studies.choices.omissions import omissions_of, verifiable
from harness.verdicts.statistics import paired_difference
from scenes.modelling.needs import PARTS, Need, Needs, as_rows, left_out, needs_of, with_needs
from scenes.view_sets.image_stack import ImageStack
from scenes.view_sets.view_set import ViewSet, read_view_set
from tests.harness.ball import write_ball
from tests.harness.tiny import SCORE, TRAIN, VIEWS

BY_SILHOUETTES = ("outside_hull", "behind_matter", "background_rays")
SOLID: Needs = {
    name: Need(name, name in ("fine_pass", "linear_quadrature", "depth_metric"), "as it is")
    for name in PARTS
    if name not in ("high_bands", "every_bin", *BY_SILHOUETTES)
}
"""The needs of a Lambertian surface without a medium."""
COVERING = replace(TRAIN, covered_share=0.8)


def known(views: ViewSet, needs: Needs) -> ViewSet:
    """`views` with the record of rendered ones."""
    return replace(views, rendered={"needs": as_rows(needs), "left_out": left_out(needs)})


def ball_plan() -> Plan:
    plan = planned("smoke", methods=["nerf"], seeds=1, precision="float32")
    return replace(plan, train=TRAIN, score=SCORE, views=VIEWS, budget=Budget(6, None), scenes=("ball",))


@pytest.mark.parametrize(("name", "acceleration"), LEFT_OUT_BY.items())
def test_a_part_is_forced_in_by_either_option(name: str, acceleration: str) -> None:
    by_need, by_without = planned("smoke", need=[name]), planned("smoke", without=[acceleration])
    assert by_need == by_without
    assert not getattr(by_need.train.accelerations, acceleration)
    assert by_need.settings()["views"]["need"] == (name,)


def test_parts_are_forced_out_and_nothing_by_default() -> None:
    plan = planned("full", no_need=["view_direction", "fine_pass", "empty_space"])
    assert plan.views.no_need == ("view_direction", "fine_pass", "empty_space")
    assert plan.train.fine_bins == 0
    assert plan.train.grid.cells > 0
    assert planned("reduced", need=["fine_pass"]).train.fine_bins == 64
    for profile in ("smoke", "reduced", "full"):
        assert (planned(profile).views.need, planned(profile).views.no_need) == ((), ())


def test_depth_is_scored_where_there_is_one(ball: ViewSet) -> None:
    stack = ball.test.rgba  # any images will do
    deep = replace(ball, test=replace(ball.test, depth=stack))
    fog = {**SOLID, "depth_metric": Need("depth_metric", False, "a medium has no depth")}
    assert with_needs(known(deep, SOLID), (), ()).test.depth is stack
    assert with_needs(known(deep, fog), (), ()).test.depth is None
    assert with_needs(known(deep, fog), ("depth_metric",), ()).test.depth is stack
    assert with_needs(deep, (), ()).test.depth is stack


def test_settings_follow_the_scene(ball: ViewSet) -> None:
    train = replace(TRAIN, fine_bins=8)
    assert for_scene(train, ball) == train, "nothing is known, nothing is changed"
    assert for_scene(train, known(ball, SOLID)) == train
    fog = {
        **SOLID,
        "empty_space": Need("empty_space", True, "a medium fills the box"),
        "fine_pass": Need("fine_pass", False, "smooth"),
    }
    assert for_scene(train, known(ball, fog)) == replace(kept(train, ("empty_space",)), fine_bins=0)
    assert not for_scene(train, known(ball, fog)).accelerations.grid


def test_only_what_makes_a_difference_is_tried(ball: ViewSet) -> None:
    plan = replace(ball_plan(), train=COVERING)
    views = known(ball, SOLID)
    of_scene = ("view_direction", "outside_box", "empty_space")
    assert verifiable(views, plan, "nerf") == (*of_scene, *BY_SILHOUETTES, "behind_opaque")
    assert verifiable(ball, plan, "nerf") == BY_SILHOUETTES, "silhouettes are known of all images"
    dense = replace(plan, train=replace(COVERING, grid=replace(TRAIN.grid, cells=0)))
    assert verifiable(views, dense, "nerf") == ("view_direction", "outside_box", "background_rays", "behind_opaque")
    assert "behind_matter" not in verifiable(views, plan, "qnerf"), "its density depends on the chunk"
    clipped_no_more = replace(plan, train=kept(COVERING, ("outside_box", "behind_opaque", *BY_SILHOUETTES)))
    assert verifiable(views, clipped_no_more, "nerf") == ("view_direction", "empty_space")
    for method in ("voxels_drjit", "qnerf_listing4"):
        assert verifiable(views, plan, method) == ("view_direction", "background_rays"), "other parts are not in it"


def test_silhouettes_tell_what_they_leave(ball: ViewSet) -> None:
    """Nothing is left out of images without a background; what is forced in is needed."""
    needs = needs_here(COVERING, ball)
    assert set(needs) == set(BY_SILHOUETTES)
    assert not any(need.needed for need in needs.values())
    assert f"{100 * ball.hull.mean():.0f} % of the box" in needs["outside_hull"].reason
    assert needs_here(COVERING, with_needs(ball, ("outside_hull",), ()))["outside_hull"].needed
    opaque = ImageStack.of(np.concatenate([rgba[..., :3], np.ones_like(rgba[..., 3:])], -1) for rgba in ball.train.rgba)
    full = replace(ball, train=replace(ball.train, rgba=opaque))
    needed = {name for name, need in needs_here(COVERING, full).items() if need.needed}
    assert needed == {"outside_hull", "background_rays"}
    assert needs_here(replace(TRAIN, grid=replace(TRAIN.grid, cells=0)), ball) == {}


def test_every_cell_has_an_arm_for_each_omission(ball: ViewSet, tmp_path: Path) -> None:
    views = {"ball": known(ball, {**SOLID, "view_direction": Need("view_direction", True, "conductor")})}
    (task,) = omissions.cell_tasks(ball_plan(), views, {"ball": tmp_path}, tmp_path)
    assert task.arms == {
        "as planned": Arm(rendered_with=("behind_opaque",)),
        "outside_box": Arm(need=("outside_box",)),
        **{name: Arm(need=(name,)) for name in ("empty_space", "outside_hull", "behind_matter")},
    }
    (task,) = omissions.cell_tasks(ball_plan(), views, {"ball": tmp_path}, tmp_path, controls=True)
    assert task.arms["no view_direction"] == Arm(no_need=("view_direction",))
    assert task.arms["no bands"] == omissions.with_bands(ball_plan(), 0)
    # 24 pixels and their 12 cycles: 2⁴ is enough
    assert task.arms["Nyquist"] == omissions.with_bands(ball_plan(), 4)
    assert task.arms["half the bins"].train["bins"] == TRAIN.bins // 2


@pytest.mark.slow
def test_arms_share_batches_and_weights(tmp_path: Path) -> None:
    """An arm that changes nothing has the same score, even if its weights are rendered again; the others have not."""
    arms = {
        "as planned": Arm(rendered_with=("behind_opaque",)),
        "again": Arm(),
        "outside_box": Arm(need=("outside_box",)),
        "no direction": Arm(no_need=("view_direction",)),
        "no bands": omissions.with_bands(ball_plan(), 0),
        "outside_hull": Arm(need=("outside_hull",)),
        "half the bins": omissions.with_half_the_bins(ball_plan()),
    }
    plan = replace(ball_plan(), budget=Budget(16, None))
    cell = trained_cell(CellTask("ball", "nerf", 0, write_ball(tmp_path / "ball"), tmp_path, plan, arms))
    as_planned, again, *others = cell.ended.values()
    assert again.psnr == as_planned.psnr
    assert all(arm.psnr is not None and arm.psnr != as_planned.psnr for arm in others)
    assert all(arm.core_seconds > 0 and arm.rendering_core_seconds > 0 for arm in cell.ended.values())
    opaque = as_planned.rerendered["behind_opaque"]
    assert opaque.largest_change <= PARTS["behind_opaque"].bound
    assert min(opaque.core_seconds, opaque.core_seconds_without) > 0.0


def ended(psnr: float | None, seconds: float = 2.0, largest: float | None = None) -> Ended:
    again = {} if largest is None else {"behind_opaque": Rerendered(3.0, 1.0, largest)}
    return Ended(psnr, seconds, again, seconds, 0.5)


def cells_with(*scores: tuple[float | None, float | None], largest: float = 5e-5) -> list[CellArms]:
    """Cells with the scores (as planned, with empty space sampled) by seed."""
    return [
        CellArms("lego", "nerf", seed, {"as planned": ended(a, 2.0, largest), "empty_space": ended(b, 5.0)})
        for seed, (a, b) in enumerate(scores)
    ]


def test_an_omission_is_without_less_with() -> None:
    trained, rendered = omissions_of(cells_with((20.0, 20.1), (21.0, 21.1), (22.0, 22.13)))
    assert trained.difference == pytest.approx(-0.11)
    assert trained.interval is not None
    assert trained.interval[0] < -0.11 < trained.interval[1] < 0
    assert (rendered.name, rendered.difference, rendered.interval) == ("behind_opaque", 5e-5, None)
    for omission, saved in ((trained, 3.0), (rendered, 2.0)):
        assert omission.seconds_saved == pytest.approx(saved)
        assert omission.verdict == "within its bound"


def test_what_costs_more_is_named() -> None:
    costly = omissions_of(cells_with((20.0, 21.0), (21.0, 22.1), (22.0, 22.9), largest=2e-4))
    assert [omission.verdict for omission in costly] == ["costs more"] * 2
    assert omissions.too_costly(costly) == costly
    assert "lego: samples in empty space: -1" in costly[0].line
    assert costly[0].line.endswith("costs more (0.2 dB)")


def test_a_cell_that_only_diverges_without_the_part_costs_more() -> None:
    omission, _ = omissions_of(cells_with((None, 20.0), (20.0, 20.0)))
    assert (omission.verdict, omission.diverged, omission.pairs) == ("costs more", 1, 1)
    other, _ = omissions_of(cells_with((20.0, None), (20.0, 20.0), (21.0, 21.0)))
    assert (other.verdict, other.diverged, other.pairs) == ("within its bound", 1, 2)
    nothing, _ = omissions_of(cells_with((None, None)))
    assert (nothing.verdict, nothing.difference, nothing.seconds_saved) == ("inconclusive", None, None)


@pytest.mark.parametrize(
    ("costs", "verdict"),
    [
        ([0.05, 0.06, 0.04], "within its bound"),
        ([-3.0, -2.0, -2.5], "within its bound"),
        ([0.5, 0.6, 0.55], "costs more"),
        ([-0.5, 0.9, 0.3], "inconclusive"),
        ([0.3, 0.35, 0.2], "inconclusive"),  # it differs from 0, but not from the bound
        ([0.9], "inconclusive"),
    ],
)
def test_verdicts(costs: list[float], verdict: str) -> None:
    assert omissions.verdict_on(paired_difference(np.array(costs)), 0.2) == verdict


def test_controls_have_the_opposite_sign() -> None:
    """A value below 0 is what leaving out the needed part loses."""
    arms = {"as planned": ended(25.0), "no view_direction": ended(22.0), "no bands": ended(19.0)}
    cells = [CellArms("lego", "nerf", seed, arms) for seed in range(2)]
    direction, bands = omissions.controls_of(cells)
    assert (direction.name, direction.difference, direction.verdict) == ("view_direction", -3.0, "costs more")
    assert (bands.name, bands.difference) == ("high_bands", -6.0)
    assert "needed ones too" in bands.title
    assert omissions.controls_of(cells_with((1.0, 1.0))) == []


def test_what_was_measured_fills_what_was_left_out() -> None:
    rows = [
        LeftOut("samples in empty space", "mostly", None, None, None, "empty_space"),
        LeftOut("background model", "alpha", None, None, None),
    ]
    omission, _ = found = omissions_of(cells_with((20.0, 20.1), (21.0, 21.1)))
    measured, untouched = omissions.with_measurements(rows, found)
    for name in ("difference", "seconds_saved", "interval", "verdict"):
        assert getattr(measured, name) == getattr(omission, name) is not None
    assert untouched == rows[1]


def test_forcing_does_not_change_what_is_read(tmp_path: Path) -> None:
    from harness.execution.ground_truth import read_views

    folder = write_ball(tmp_path / "ball", size=24)
    forced = read_views(folder, replace(VIEWS, no_need=("view_direction",)), tmp_path)
    plain = read_view_set(folder)
    assert np.array_equal(forced.test.rgba[0], plain.test.rgba[0])
    assert needs_of(forced)["view_direction"].needed is False
    assert needs_of(plain) == {}


def test_without_a_trained_method_of_the_plan_nothing_is_tried_and_that_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    explaining = empty_cell("ball", "qnerf_printed", 0, "done", "")
    cells = [empty_cell("ball", "nerf", 0, "diverged", "loss"), explaining]
    assert omissions.verify_run(ball_plan(), Machine("cpu", 1, 1), tmp_path, Lines(), cells, [], {}) == []
    assert "no cell of the plan is done" in capsys.readouterr().out


def test_cells_of_a_stopped_verification_are_kept_until_it_ends(
    ball_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stops(tasks: list[CellTask], _: int) -> list[CellArms]:
        for task in tasks:
            assert task.kept is not None
            task.kept.mkdir(exist_ok=True)
            if not (task.kept / "ended").exists():
                (task.kept / "ended").touch()
                raise KeyboardInterrupt
        return []

    monkeypatch.setattr(omissions, "trained_cells", stops)
    cells, folders = [empty_cell("ball", "nerf", 0, "done", "")], {"ball": ball_folder}
    verify = partial(omissions.verify_run, ball_plan(), Machine("cpu", 1, 1), tmp_path, Progress(), cells, [], folders)
    with pytest.raises(KeyboardInterrupt):
        verify()
    assert verify() == []
    assert not list(tmp_path.iterdir())
