"""Effects → forests: every difference is on the axis, no interval makes it useless, each row has its figures."""

from harness.records.study import Effect
from harness.records.verdict import OPEN, Verdict
from reports.drawing.figure import svg
from reports.studies.forest import effects_grid, forest_key, forests, limits_of
from tests.reports.fake_studies import effect


def an_effect(difference: float | None, alone=None, together=None, name: str = "part", **more) -> Effect:
    return effect(name, "", difference, interval=alone, simultaneous=together, **{"verdict": OPEN, **more})


def test_an_axis_holds_zero_every_difference_and_the_band_but_no_huge_interval():
    effects = [an_effect(0.3, (-90.0, 90.0), (-900.0, 900.0)), an_effect(-1.0, (-1.1, -0.9), (-1.2, -0.8))]
    low, high = limits_of(effects, 0.2)
    assert -2.0 < low < -1.0 < 0.0 < 0.3 < high < 1.0
    for few in ([], [an_effect(None)], [an_effect(0.0, (0.0, 0.0))]):
        low, high = limits_of(few, 0.0)
        assert low < 0.0 < high


def test_a_row_has_its_marks_its_figures_and_its_verdict():
    rows = [
        an_effect(0.3, (0.1, 0.5), (-0.2, 0.8)),
        an_effect(0.9, verdict=Verdict("above 0", "smaller than matters"), note="Eq. 4", unpaired=1),
        an_effect(None, name="nothing", against="nerf"),
    ]
    (drawn,) = forests(rows, {"psnr": 0.2}).values()
    traces = {trace.label: (trace.x, trace.y, trace.x_high) for trace in drawn.traces}
    assert traces["own interval"] == ((0.1,), (0.0,), (0.5,))
    assert traces["simultaneous interval"] == ((-0.2,), (0.0,), (0.8,))
    assert traces["difference, sign known"][:2] == ((0.9,), (1.0,))
    assert traces["difference, sign open"][:2] == ((0.3,), (0.0,))
    assert traces["±0.2\u202fdB, the smallest effect of interest"][0] == (-0.2, 0.2, 0.2, -0.2)
    assert drawn.rows == ("part", "part (Eq. 4; 1 pair not judged)", "nothing − nerf")
    assert drawn.figures == ("+0.30  [+0.10, +0.50]  ?", "+0.90    ▲=", "–    ?")
    assert "part (Eq. 4; 1 pair not judged) +0.90    ▲= above 0, smaller than matters" in drawn.alt


def test_parts_come_before_methods_and_single_scenes_only_in_the_table():
    methods = [an_effect(0.1, name="qnerf", against="nerf")]
    parts = [an_effect(0.1, name=f"{scene} part", scene=scene) for scene in ("lego", "all")]
    alone = [an_effect(0.1, metric="ssim", scene=scene) for scene in ("lego", "ship")]
    drawn = forests([*methods, *parts, *alone], {})
    assert list(drawn) == [("psnr", "steps", "all"), ("ssim", "steps", "lego"), ("ssim", "steps", "ship")]
    assert drawn["psnr", "steps", "all"].rows == ("all part", "qnerf − nerf")
    assert len(effects_grid([*methods, *parts, *alone]).rows) == 5


def test_the_table_has_a_false_discovery_rate_where_p_is_known():
    """Benjamini and Hochberg by hand: of 0.01, 0.02, 0.5 the q are 3 × 0.01, 3 × 0.02 / 2, 0.5."""
    grid = effects_grid([an_effect(0.1, p=p) for p in (0.02, 0.5, None, 0.01)])
    place = [column.label for column in grid.columns].index("q")
    assert [row[place].value for row in grid.rows] == [0.03, 0.5, None, 0.03]
    assert all(column.label != "q" for column in effects_grid([an_effect(0.1)]).columns)


def test_the_key_states_the_sizes_of_the_families():
    assert "each comparison stands for itself" in forest_key([an_effect(0.1, family=1)])
    for families, said in (([12], "12"), ([1, 12], "1 to 12")):
        words = f"all of a family of {said} comparisons hold together in 95 % of repetitions"
        assert words in forest_key([an_effect(0.1, family=family) for family in families])


def test_a_band_as_wide_as_a_number_can_be_is_drawn():
    (panel,) = forests([an_effect(0.3, (0.1, 0.5))], {"psnr": 1e308}).values()
    assert "<svg" in svg(panel, "wide")
