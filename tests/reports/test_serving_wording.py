"""Serving in sentences: for one and for many, what is missed in the same tone; who is first, and where it loses."""

from dataclasses import replace

import pytest

from harness.serving_record import (
    Allocation,
    Anytime,
    Confusion,
    FirstFrame,
    NotByRegions,
    PhiCheck,
)
from reports.serving_cache import answer as cache_answer
from reports.serving_cache import confused
from reports.serving_races import earlier, first, mean_error, races, reached
from reports.serving_said import allocated, answer, at_cost, averaged, paid, phi_said, plainly, seen_first
from reports.serving_wording import brief, bytes_said, outcome
from tests.reports.fake_serving import (
    fake_attention,
    fake_cache,
    fake_curve,
    latency,
    reaching,
)


def plain(words: str) -> str:
    return words.replace("\u202f", " ")


@pytest.mark.parametrize(
    ("hits", "said"),
    [
        ((latency("nerf", "level 0", 5e-5, 0.05),), "A hit in memory is 1 000 times faster than rendering "
         "(target 1 000: open: the spread reaches across)."),
        ((latency("nerf", "level 2", 1e-3, 0.1),), "A hit on disk is 100 times faster than rendering "
         "(target 50: met)."),
        ((latency("nerf", "level 2", 1e-2, 0.1),), "A hit on disk is 10.0 times faster than rendering (target 50: "
         "missed)."),
    ],
)  # fmt: skip
def test_a_single_kind_of_hit_in_words(hits, said):
    assert plain(cache_answer(fake_cache(latencies=list(hits)))) == said


@pytest.mark.parametrize(
    ("found", "said"),
    [
        ([], ""),
        ([Confusion("a", 1, 1, 0.25, 1)], "would have returned 1 stale picture of 1, off by 0.250 (RMSE of display "
         "colour); ours missed it, as it has to."),
        ([Confusion("a", 4, 0, 0.0, 4)], "would have returned 0 stale pictures of 4; ours missed each of them, as it "
         "has to."),
        ([Confusion("a", 4, 4, 0.1, 3)], "would have returned 4 stale pictures of 4, off by 0.100 (RMSE of display "
         "colour); ours missed only 3 of 4, which is a fault: a."),
    ],
)  # fmt: skip
def test_confusions_in_words(found, said):
    assert confused(found).removeprefix("Listing 5’s key of the pose alone ") == said


@pytest.mark.parametrize(
    ("verdicts", "said"),
    [
        (["holds"], "met"),
        (["does not hold"] * 3, "missed"),
        (["holds", "does not hold", "holds"], "met in 2 of 3 cases, missed in 1"),
        (["inconclusive"], "open: the spread reaches across"),
    ],
)
def test_outcomes_in_words(verdicts, said):
    assert outcome(verdicts) == said


def test_times_and_bytes_in_words():
    assert [brief(one) for one in (0.0, 1.83e-5, 0.0452, 1.2, 3.1e-7)] == [
        "0 s",
        "18.3 µs",
        "45.2 ms",
        "1.20 s",
        "0.310 µs",
    ]
    assert [bytes_said(one) for one in (0, 1, 999, 160_000, 1 << 30)] == [
        "0 bytes",
        "1 byte",
        "999 bytes",
        "160 kB",
        "1.07 GB",
    ]


def one_case(kind="point", **seconds):
    """A picture whose attended and whole error fall at once, in each order after so many seconds."""
    curves = [
        Anytime("chair", "nerf", kind, order, 1, [0.01, at], [0.0, 1.0], [0.1, 0.0], [0.1, 0.0])
        for order, at in seconds.items()
    ]
    return fake_attention(curves=curves, reaching=[reaching(one, 0.1) for one in curves])


def test_one_case_in_words():
    record = one_case(attention=0.02, raster=0.04, spread=0.05)
    assert plain(answer(races(record))) == (
        "In order of attention, what is attended is down to 10 % of the coarse frame’s error sooner than in any other "
        "order in 1 of 1 case of scene and map, on 1 of 1 scene with every map: after 20.0 ms by attention, 40.0 ms in "
        "raster order and 50.0 ms spread."
    )
    assert plain(paid(races(record))[0]) == (
        "Over the whole picture it gets down to 10 % first in 1 of 1 case, and is behind no other order."
    )


def test_where_attention_loses_is_named():
    record = one_case(attention=0.06, raster=0.04, spread=0.08)
    assert [plain(one) for one in paid(races(record))] == [
        "Over the whole picture it gets down to 10 % first in 0 of 1 case; it is behind raster order in all of them.",
        "Where it is not first even in what is attended: chair (point).",
    ]


def test_who_never_gets_there_has_no_median():
    never = [
        replace(one, seconds=None, share_of_time=None) if one.order == "raster" else one
        for one in fake_attention().reaching
    ]
    said = answer(races(fake_attention(reaching=never)))
    assert "by attention" in said
    assert "in raster order" not in said


def test_races_compare_orders():
    assert first({"attention": 1.0, "raster": 2.0, "spread": None}) == "attention"
    assert first({"attention": 1.0, "raster": 1.0}) is None
    assert first({"attention": None}) is None
    assert earlier({"attention": 1.0, "raster": None}, "attention", "raster")
    assert not earlier({"attention": None, "raster": None}, "attention", "raster")
    assert not earlier({"attention": 1.0, "raster": 1.0}, "attention", "raster")


@pytest.mark.parametrize(
    ("error", "at"),
    [
        ([1.0, 0.5, 0.1, 0.0], 3.0),
        ([1.0, 0.05, 0.5, 0.0], 4.0),
        ([1.0, 0.5, 0.4, 0.3], None),
        ([0.0, 0.0, 0.0, 0.0], 1.0),
    ],
)
def test_an_error_is_reached_where_it_stays(error, at):
    assert reached([1.0, 2.0, 3.0, 4.0], error, 0.1) == at


def test_the_time_of_the_record_is_that_of_its_curve():
    for one in fake_attention().curves:
        assert reached(one.seconds, one.rmse_attended, 0.1) == reaching(one, 0.1).seconds


def test_an_error_averaged_over_time_is_that_of_steps():
    curve = Anytime("chair", "nerf", "point", "raster", 1, [1.0, 2.0, 4.0], [0.0, 0.5, 1.0], [8.0, 2.0, 0.0], [1.0] * 3)
    assert mean_error(curve, 4.0, False) == pytest.approx((8.0 + 2 * 2.0) / 3)
    assert mean_error(curve, 7.0, False) == pytest.approx((8.0 + 2 * 2.0) / 6)
    assert mean_error(curve, 3.0, False) == pytest.approx((8.0 + 2.0) / 2)
    assert mean_error(curve, 4.0, True) == pytest.approx(1.0)
    assert mean_error(curve, 1.0, True) is None


def test_averages_over_time_are_ratios():
    alike = {"seconds": [0.1 * k for k in range(26)], "rmse_attended": [0.1] * 26, "rmse_whole": [0.2] * 26}
    curves = [replace(fake_curve("chair", "point", order, 1.0), **alike) for order in ("attention", "raster")]
    same = fake_attention(curves=curves)
    (said,) = averaged(same)
    assert (
        "against raster order, the attended error is 1.00 times as large, that of the whole picture 1.00 times" in said
    )
    assert "spread" not in said
    assert averaged(fake_attention(curves=[])) == []


def placed(by: bool, bins: float, evaluations: float, attended: float, whole: float = 0.1) -> Allocation:
    return Allocation("chair", "nerf", "point", by, 1, bins, evaluations, 0.1, attended, whole, None, None)


def test_allocation_is_compared_at_the_same_total():
    pair = [placed(False, 8.0, 100.0, 0.2), placed(True, 7.9, 150.0, 0.1), placed(True, 16.0, 900.0, 0.001)]
    (said,) = allocated(pair)
    assert "With as many samples it is 0.50 times and 1.00 times as large, but at 1.50 times the network" in said
    assert "ground truth" not in said
    assert allocated(pair[:1]) == []


def test_allocation_is_compared_at_the_same_cost():
    """Between 100 and 400 evaluations the error of the plain one falls from 0.4 to 0.1: at 200 it is 0.2."""
    plain_ones = [placed(False, 8.0, 100.0, 0.4), placed(False, 32.0, 400.0, 0.1)]
    one = placed(True, 16.0, 200.0, 0.1)
    assert at_cost([*plain_ones, one], one) == pytest.approx((0.2, 0.1))
    first = allocated([*plain_ones, one])[0]
    assert "is 0.50 times as large in what is attended and 1.00 times in the whole picture" in first
    assert "in 1 case." in first
    for evaluations in (99.0, 401.0):
        assert at_cost(plain_ones, replace(one, evaluations=evaluations)) is None
    assert at_cost(plain_ones, replace(one, evaluations=400.0)) == pytest.approx((0.1, 0.1))
    assert at_cost(plain_ones, replace(one, attention="mask")) is None


def test_phi_says_what_was_found():
    (said,) = phi_said(PhiCheck(1.618034, 1, 0, 0))
    assert "Of 1 map looked at" in said
    assert said.endswith("a common factor scales all alike and changes nothing.")
    (said,) = phi_said(PhiCheck(1.618034, 5, 1, 0))
    assert said.endswith(
        "changed the order in 1 and the samples in 0: which a common factor cannot do: a fault of rounding, or of ours."
    )
    assert phi_said(PhiCheck(0.0, 0, 0, 0)) == []


def test_methods_that_are_rendered_plainly_are_said_once_with_every_scene():
    found = [
        NotByRegions("qnerf", scene, "points share a call.", off) for scene, off in (("chair", 0.01), ("lego", 0.02))
    ]
    assert plainly(found) == [
        "qnerf is not rendered by regions: points share a call. By regions its picture would be off by 0.0100 on chair "
        "and 0.0200 on lego (RMSE of display colour)."
    ]


def test_a_missed_first_frame_is_called_missed():
    said = seen_first(FirstFrame("chair", ["nerf"], 40, 40, 0.71, 1.2, 1))
    assert "first frame of nerf on chair" in said
    assert "(target 0.5 s: missed)" in said
    assert said.endswith("the slowest of 1 call.")
