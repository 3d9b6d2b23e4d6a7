"""Times to a target agree with hand-written curves, SciPy's Kaplan–Meier, and simulated runs of known truth."""

import math
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.stats import CensoredData, ecdf, norm

from harness.records.cells import USUAL, CellRecord
from harness.records.claims import ClaimFile
from harness.records.targets import Reach, TargetComparison, read_targets, write_targets
from harness.records.verdict import OPEN, Verdict
from harness.verdicts.estimates import nested
from harness.verdicts.statistics import half_widths
from harness.verdicts.survival import chosen_target, compared, first_reached, kaplan_meier, reach, targets
from tests.harness.cells import cell, checkpoint, diverged, with_core_seconds

THIRTY = ClaimFile(id="theirs", title="Their paper", methods=("qnerf",), claims=(), target=30.0)


def run(method: str, seed: int, scores: list[float], scene: str = "lego", pace: float = 0.1) -> CellRecord:
    """Return a cell that is scored after 10, 100, 1000 … steps of `pace` seconds each."""
    curve = [checkpoint(10 ** (k + 1), pace * 10 ** (k + 1), score) for k, score in enumerate(scores)]
    return cell(scene, method, seed, curve)


def of(cells: list[CellRecord], axis: str = "steps", scene: str = "lego", target: float = 24.0) -> TargetComparison:
    return compared(cells, "qnerf", "nerf", axis, target, scene)  # type: ignore[arg-type]


def test_the_first_crossing_is_linear_in_log_time() -> None:
    points = [(10.0, 20.0), (100.0, 24.0), (1000.0, 22.0), (10000.0, 26.0)]
    assert first_reached(points, 20.0) == (10.0, "earlier")
    assert first_reached(points, 22.0) == (pytest.approx(math.sqrt(10.0 * 100.0)), "reached")
    assert first_reached(points, 24.0) == (pytest.approx(100.0), "reached")
    assert first_reached(points, 25.0) == (pytest.approx(1000.0 * 10**0.75), "reached")
    assert first_reached(points, 26.5) == (10000.0, "never")


def test_what_is_known_of_a_run() -> None:
    soon = reach(run("nerf", 0, [20, 24, 26]), "seconds", 22)
    assert (soon.time, soon.known, soon.why) == (pytest.approx(math.sqrt(10)), "reached", "")
    late = reach(run("nerf", 0, [20, 24, 26]), "steps", 27)
    assert (late.time, late.known, late.why) == (1000.0, "never", "ended at 26.00 dB")
    fallen = replace(run("nerf", 0, [20, 28]), status="diverged", steps=150)
    assert (reach(fallen, "steps", 22).known, reach(fallen, "steps", 22).why) == ("never", "diverged")
    assert reach(diverged("lego", "nerf", 0), "steps", 22).time == 7.0
    empty_cell = cell("lego", "nerf", 0, [checkpoint(10, 1.0, None)])
    assert (reach(empty_cell, "steps", 22).known, reach(empty_cell, "steps", 22).why) == ("never", "has no score")


def test_core_seconds_are_an_axis_where_every_run_has_counted_them() -> None:
    cells = [run(method, 0, [20, 24, 26], pace=0.1) for method in ("nerf", "qnerf")]
    counted = [with_core_seconds(cell, 3.0) for cell in cells]
    assert {row.axis for row in targets(counted, ["nerf", "qnerf"]).reaches} == {"steps", "seconds", "core_seconds"}
    assert {row.axis for row in targets([counted[0], cells[1]], ["nerf", "qnerf"]).comparisons} == {"steps", "seconds"}
    by_wall, by_cores = (reach(counted[0], axis, 22.0).time for axis in ("seconds", "core_seconds"))
    assert by_cores == pytest.approx(3 * by_wall)


@pytest.mark.parametrize(
    ("best", "target"),
    [
        ([31.0, 30.0, 20.0, 20.0], 30.0), ([31.0, 29.9, 20.0, 20.0], 29.0), ([25.7, 24.2, 23.9], 24.0),
        ([24.0], 24.0), ([24.0, None], 24.0), ([24.0, None, None], None), ([], None),
    ],
)  # fmt: skip
def test_the_target_is_what_half_of_the_baseline_reaches(best: list[float | None], target: float | None) -> None:
    runs = [diverged("lego", "nerf", k) if b is None else run("nerf", k, [10.0, b]) for k, b in enumerate(best)]
    result, why = chosen_target(runs, "nerf", THIRTY)
    assert result == target
    assert "nerf" in why
    if target is not None:
        reached = sum(b is not None and b >= target for b in best)
        assert f"{reached} of {len(best)}" in why
        assert 2 * reached >= len(best)
        others = [run("qnerf", seed, [10.0, 31.0, 35.0]) for seed in range(3)]
        record = targets([*runs, *others], ["nerf", "qnerf"], USUAL, [THIRTY])
        assert (record.target, record.printed, record.baseline) == (target, target == 30.0, "nerf"), "of nerf alone"


def test_without_a_printed_target_it_is_the_largest_whole_number() -> None:
    runs = [run("nerf", seed, [10.0, best]) for seed, best in enumerate((33.7, 32.1, 31.0))]
    for claims in ([], [replace(THIRTY, target=None)]):
        record = targets(runs, ["nerf", "qnerf"], USUAL, claims)
        assert (record.target, record.printed) == (32.0, False)  # two of three
        assert "reach the" not in record.declared


def test_kaplan_meier_is_scipys_and_keeps_lost_runs_at_risk() -> None:
    draw = np.random.default_rng(0)
    for _ in range(50):
        kinds, why = draw.choice(["reached", "never", "earlier"], 12), draw.choice(["diverged", "ended at 3 dB"], 12)
        reaches = [
            Reach("a", "m", k, "steps", float(draw.integers(1, 9)), kind, str(why[k]) if kind == "never" else "")
            for k, kind in enumerate(kinds)
        ]
        times, share, at_risk = kaplan_meier(reaches)
        end = max(row.time for row in reaches)
        watched = [end if row.why == "diverged" else row.time for row in reaches]
        expected = ecdf(CensoredData.right_censored(watched, kinds == "never"))
        assert set(times) == {row.time for row in reaches if row.known != "never"} | {end}
        assert share == pytest.approx(expected.cdf.evaluate(times))
        assert at_risk == [sum(each >= time for each in watched) for time in times]
    half = [Reach("a", "m", k, "steps", 5.0, "reached") for k in range(5)]
    # not as if the diverged had never been; those that failed were at risk until they did
    for why, expected in (("diverged", ([0.5], [10])), ("failed", ([1.0], [5]))):
        lost = [Reach("a", "m", k, "steps", 1.0, "never", why) for k in range(5)]
        assert kaplan_meier([*half, *lost])[1:] == expected


def test_seconds_are_cut_where_the_quicker_method_ended() -> None:
    """nerf is scored after 1, 10 and 100 s, qnerf after 2, 20 and 200 s, with the same scores."""
    cells = [run("nerf", seed, [20, 22, 24], pace=0.1) for seed in range(5)]
    cells += [run("qnerf", seed, [20, 22, 24], pace=0.2) for seed in range(5)]
    at_21 = of(cells, "seconds", target=21.0)
    assert (at_21.horizon, at_21.never, at_21.verdict.sign) == (100.0, (0, 0), "below 0")
    assert at_21.saving == pytest.approx(-100.0)
    # nerf after 84 s, qnerf after 168 s, of which only 100 s were observed for both
    at_limit = of(cells, "seconds", target=22 + 2 * math.log10(8.4))
    assert (at_limit.never, at_limit.saving) == ((5, 0), pytest.approx(-100 * (100 / 84 - 1)))


SAME, SOONER, LATE, AT_ONCE = [20, 24, 28], [22, 26, 30], [10, 11, 12], [25, 26, 28]
Scores = list[int] | str


def cells_of(nerf: list[Scores], qnerf: list[Scores]) -> list[CellRecord]:
    """Return the runs of both methods by seed, each given by its scores or by its status without a score."""
    return [
        replace(diverged("lego", method, seed), status=scores)
        if isinstance(scores, str)
        else run(method, seed, [float(score) for score in scores])
        for method, runs in (("nerf", nerf), ("qnerf", qnerf))
        for seed, scores in enumerate(runs)
    ]


@pytest.mark.parametrize(
    ("nerf", "qnerf", "expected"),
    [
        # 24 dB after 100 steps; a gain of 2 dB at each checkpoint brings it to √1000
        ([SAME] * 5, [SOONER] * 5, {"saving": 100 * (1 - 10**-0.5), "difference": 10**1.5 - 100, "sign": "above 0"}),
        ([SAME] * 4, [SOONER] * 4, {"pairs": 4, "never": (0, 0), "earlier": (0, 0), "horizon": 1000.0}),
        ([SAME] * 4, [SOONER] * 4, {"saving": 100 * (1 - 10**-0.5), "verdict": OPEN}),  # too few for a verdict
        ([SOONER] * 5, [SAME] * 5, {"saving": 100 * (1 - 10**0.5), "sign": "below 0"}),
        # a run that ends low or diverges counts as long as it was watched: 1000 steps in place of 100
        ([SAME] * 4, [SAME, SAME, SAME, LATE], {"saving": 100 * (1 - 10**0.25), "never": (1, 0), "unpaired": 0}),
        ([SAME] * 4, [SAME, SAME, SAME, "diverged"], {"saving": 100 * (1 - 10**0.25), "never": (1, 0), "unpaired": 0}),
        ([SAME] * 4, [SAME, SAME, SAME, LATE], {"difference": (1000 - 100) / 4, "verdict": OPEN, "pairs": 4}),
        ([SAME] * 6, [SAME] * 5, {"saving": 0.0, "unpaired": 1, "size": "smaller than matters"}),
        # a run that a full disk stopped must not count as never reaching the target
        ([SAME] * 4, ["error"] * 4, {"saving": None, "pairs": 0, "unpaired": 4, "verdict": OPEN}),
        ([SAME] * 4, ["diverged"] * 4, {"saving": -900.0, "pairs": 4, "never": (4, 0), "unpaired": 0}),
        ([SAME] * 6, ["error", *[SOONER] * 5], {"saving": 100 * (1 - 10**-0.5), "pairs": 5, "sign": "above 0"}),
        # a run above the target at its first checkpoint counts with that time: at most 10 steps against 100
        ([SAME] * 3, [AT_ONCE] * 3, {"saving": 90.0, "earlier": (3, 0)}),
        # at once against never is at least 99 % of the time watched: no width, and a verdict by counting
        ([LATE] * 5, [AT_ONCE] * 5, {"saving": 99.0, "interval": None, "verdict": OPEN}),
        ([LATE] * 6, [AT_ONCE] * 6, {"simultaneous": None, "difference_interval": None, "sign": "above 0"}),
        # if no run reaches the target, or all reached it before the first checkpoint, no size is small
        ([LATE] * 3, [LATE] * 3, {"saving": None, "interval": None, "pairs": 3, "verdict": OPEN}),
        ([AT_ONCE] * 3, [AT_ONCE] * 3, {"saving": None, "interval": None, "pairs": 3, "verdict": OPEN}),
    ],
)
def test_savings_of_runs_that_get_there_end_below_diverge_or_fail(
    nerf: list[Scores], qnerf: list[Scores], expected: dict[str, object]
) -> None:
    row = of(cells_of(nerf, qnerf))
    for name, value in expected.items():
        held = getattr(row.verdict if name in ("sign", "size") else row, name)
        assert held == (value if isinstance(value, Verdict | str) else pytest.approx(value)), name


def test_late_against_never_is_not_called_small() -> None:
    """nerf reaches it just before the end, qnerf never: the observed times are nearly equal, the true ones unknown."""
    cells = [run("nerf", seed, [20, 24, 26.001 + 0.001 * seed]) for seed in range(5)]
    row = of([*cells, *(run("qnerf", seed, [20, 24, 25.9]) for seed in range(5))], target=26.0)
    assert row.never == (5, 0)
    assert -5.0 < row.simultaneous[0] < row.simultaneous[1] < 5.0
    assert row.verdict.size != "smaller than matters"


def test_over_scenes_of_which_one_says_nothing_no_size_is_small() -> None:
    cells = cells_of([SAME] * 3, [SAME] * 3)
    row = of([replace(each, scene="mic") for each in cells] + cells_of([LATE] * 3, [LATE] * 3), scene="all")
    assert (row.saving, row.verdict) == (0, OPEN)


@pytest.mark.parametrize(
    ("theirs", "ours", "ends"),
    [
        ((27.0, 27.5, 28.0), (29.0, 30.0, 31.0), (0, 1)),
        ((25.0, 27.5, 28.0), (29.0, 30.0, 31.0), (0, None)),
        ((27.0, 27.5, 28.0), (25.0, 30.0, 31.0), (None, 1)),
        ((25.0, 27.5, 28.0), (29.0, 25.0, 31.0), (None, None)),
    ],
)
def test_the_saving_to_the_target_is_a_bound_on_the_side_that_was_not_seen(
    theirs: tuple[float, ...], ours: tuple[float, ...], ends: tuple[int | None, int | None]
) -> None:
    cells = [run("nerf", seed, [20, 24, final]) for seed, final in enumerate(theirs)]
    cells += [run("qnerf", seed, [20, 24, final]) for seed, final in enumerate(ours)]
    row = of(cells, target=26.0)
    assert row.interval is not None
    assert (row.at_least, row.at_most) == tuple(None if end is None else row.interval[end] for end in ends)


TRUE_SAVING, HORIZON, NOISE = 18.0, 1000.0, 0.2
SHARES = (1.0, 1 - TRUE_SAVING / 100)


def drawn_times(target_time: float, studies: int, scenes: int = 8, seeds: int = 3) -> np.ndarray:
    """Return the times of nerf and qnerf to the target [2, studies, scenes, seeds]."""
    noise = np.random.default_rng(5).normal(0, NOISE, (2, studies, scenes, seeds))
    return target_time * np.array(SHARES)[:, None, None, None] * np.exp(noise)


def cells_with(times: np.ndarray, target: float) -> list[CellRecord]:
    """Return cells that gain 4 dB per factor of 10 in steps, and reach `target` after `times` [2, scenes, seeds]."""
    return [
        run(method, seed, [target + 4 * math.log10(step / time) for step in (10, 100, 1000)], scene=f"scene{place}")
        for method, of_method in zip(("nerf", "qnerf"), times, strict=True)
        for place, row in enumerate(of_method)
        for seed, time in enumerate(row)
    ]


def restricted_saving(target_time: float) -> float:
    """Return the true restricted saving, by a sum over normal quantiles."""
    noise = np.log(target_time) + NOISE * norm.ppf((np.arange(20_000) + 0.5) / 20_000)
    theirs, ours = (np.minimum(noise + math.log(share), math.log(HORIZON)).mean() for share in SHARES)
    return -100 * math.expm1(ours - theirs)


@pytest.mark.parametrize(("target_time", "share"), [(800.0, 0.95), (950.0, 0.8)])
def test_a_saving_under_censoring_holds_what_it_claims_in_95_percent(target_time: float, share: float) -> None:
    truth = restricted_saving(target_time)
    assert truth < share * TRUE_SAVING, "the restricted saving is another quantity than that to the target"
    times = drawn_times(target_time, 2000)
    ratios = np.log(np.minimum(times[1], HORIZON) / np.minimum(times[0], HORIZON))
    bounds = []
    for estimate in (nested.on_these_scenes, nested.scenes_like_these):
        result = estimate(ratios)
        saving, half = -100 * np.expm1(result.mean), half_widths(result)
        low, high = (-100 * np.expm1(result.mean + sign * half) for sign in (1, -1))
        assert np.mean((low <= truth) & (truth <= high)) == pytest.approx(0.95, abs=0.02)
        bounds.append(np.mean(low <= TRUE_SAVING))
    assert min(bounds) > 0.975, "a bound where only nerf is cut short"

    row = compared(cells_with(times[:, 0], 25.0), "qnerf", "nerf", "steps", 25.0, "all")
    assert row.never[1] > 0
    assert row.saving == pytest.approx(-100 * np.expm1(ratios[0].mean()))
    assert row.interval == pytest.approx((low[0], high[0]))
    assert row.scenes_like_these.interval == row.interval
    assert saving[0] == pytest.approx(row.saving)


def test_the_record_of_a_run_is_complete_and_can_be_written(tmp_path: Path) -> None:
    cells = cells_with(drawn_times(300.0, 1, scenes=4)[:, 0], 23.0)
    cells[0] = diverged(cells[0].scene, "nerf", 0)
    cells[15] = replace(diverged(cells[15].scene, "qnerf", cells[15].seed), status="not_available")
    methods = ["nerf", "qnerf"]
    record = targets(cells, methods)
    assert len(record.reaches) == 2 * (len(cells) - 1)  # each axis; a cell that was not available is no run
    assert len(record.comparisons) == 2 * len(USUAL.pairs(methods)) * 5
    assert {(row.scene, row.family) for row in record.comparisons} == {("all", 1)} | {
        (f"scene{k}", 4) for k in range(4)
    }
    assert len(record.curves) == 2 * 2 * 5
    for curve in record.curves:
        assert curve.time == sorted(curve.time)
        assert curve.share == sorted(curve.share)
        assert 0 <= curve.share[-1] <= 1
    write_targets(tmp_path, record)
    assert read_targets(tmp_path) == record
    assert read_targets(tmp_path / "older") is None
    found = record.comparison("scene1", "qnerf", "nerf", "seconds")
    assert (found.scene, found.axis) == ("scene1", "seconds")
    assert record.comparison("ship", "qnerf", "nerf", "steps") is None
    nothing = targets([diverged("lego", "nerf", 0)], ["nerf", "qnerf"])
    assert (nothing.target, nothing.reaches, nothing.comparisons) == (None, [], [])


def test_a_run_that_ends_in_empty_collapse_never_reaches_the_target() -> None:
    collapsed = replace(run("qnerf", 0, [20, 31, 14]), warnings=["empty collapse: mean test opacity 0.001"])
    assert (reach(collapsed, "steps", 30.0).known, reach(collapsed, "steps", 30.0).why) == (
        "never", "ended in empty collapse",
    )  # fmt: skip
    assert chosen_target([replace(collapsed, method="nerf")], "nerf")[0] is None


def test_the_sign_of_equal_times_on_scenes_like_these_is_that_of_scenes() -> None:
    """On two scenes, six pairs of equal times settle nothing about other scenes."""
    cells = [
        run(method, seed, scores, scene)
        for scene in ("lego", "chair") for seed in range(3)
        for method, scores in (("qnerf", [25, 26, 27]), ("nerf", [20, 24, 27]))
    ]  # fmt: skip
    row = of(cells, scene="all")
    assert (row.on_these_scenes.verdict.sign, row.scenes_like_these.verdict) == ("above 0", OPEN)
    many = [replace(cell, scene=name) for name in "abcdefgh" for cell in cells if cell.scene == "lego"]
    assert of(many, scene="all").scenes_like_these.verdict.sign == "above 0"


def test_on_another_clock_no_method_is_sooner_than_a_run_above_the_target_at_its_first_checkpoint() -> None:
    """Half of the time per step is half of the time to the first checkpoint, before which nothing is known."""
    early = [run(method, seed, [25, 26], pace=pace) for seed in range(5)
             for method, pace in (("qnerf", 0.1 + 0.001 * seed), ("nerf", 0.2))]  # fmt: skip
    cells = [*early, run("qnerf", 5, [20, 26], pace=0.1), run("nerf", 5, [20, 26], pace=0.2)]
    assert of(cells, "seconds").verdict == OPEN
    later = [run(method, seed, [20, 25 + 0.01 * seed], pace=pace) for seed in range(6)
             for method, pace in (("qnerf", 0.1), ("nerf", 0.2))]  # fmt: skip
    assert of(later, "seconds").verdict.sign == "above 0"
