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
    Way,
)
from reports.serving_cache import answer as cache_answer
from reports.serving_cache import confused
from reports.serving_races import At, earlier, first, mean_error, races
from reports.serving_said import allocated, answer, averaged, compared, pairs_of, phi_said, plainly, seen_first, totals
from reports.serving_wording import brief, bytes_said, outcome
from tests.reports.fake_serving import (
    fake_attention,
    fake_cache,
    fake_curve,
    latency,
    reachings,
)


def plain(words: str) -> str:
    return words.replace("\u202f", " ")


@pytest.mark.parametrize(
    ("hits", "said"),
    [
        ((latency("nerf", "level 0", 5e-5, 0.05),), "A hit in memory, of a method that is no longer trained, is "
         "1 000 times faster than rendering "
         "(target 1 000: open: the spread reaches across)."),
        ((latency("nerf", "level 2", 1e-3, 0.1),), "A hit on disk, with the file in the operating system’s memory, is "
         "100 times faster than rendering "
         "(target 50: met)."),
        ((latency("nerf", "level 2", 1e-2, 0.1),), "A hit on disk, with the file in the operating system’s "
         "memory, is 10.0 times faster than "
         "rendering (target 50: missed)."),
        ((latency("nerf", "level 0 hashed", 1e-3, 0.1), latency("nerf", "level 2 cold", 1e-3, 0.1)),
         "A hit in memory, where the weights are hashed at every call, is 100 times faster than rendering (target "
         "1 000: missed). A hit on disk, with the file dropped from the operating system’s memory, is 100 times faster "
         "than rendering (target 50: met)."),
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
        (["seen"], "met"),
        (["not seen at this scale"] * 3, "missed"),
        (["seen", "not seen at this scale", "seen"], "met in 2 of 3 cases, missed in 1"),
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


def one_case(around=1.001, **seconds):
    """A picture whose errors fall at once, in each order after so many seconds."""
    curves = [
        Anytime(
            "chair", "nerf", "point", order, 1, [0.01, at], [0.0, 1.0], (at, at), [0.1, 0.0], [0.1, 0.0], [0.1, 0.0]
        )
        for order, at in seconds.items()
    ]
    return fake_attention(curves=curves, reaching=reachings(curves, around))


def test_one_case_in_words():
    record = one_case(attention=0.02, raster=0.04, spread=0.05)
    assert plain(answer(races(record))) == (
        "Until 10 % of the coarse frame’s error is left in the whole picture: 20.0 ms by attention, 40.0 ms in raster "
        "order and 50.0 ms spread; the order by attention is first in 1 of 1 case of scene and map."
    )
    assert [plain(one) for one in compared(races(record))] == [
        "In the whole picture, attention against raster order: earlier in 1; against pixels spread over the picture: "
        "earlier in 1.",
        "In the quarter of the regions in which the coarse frame is most wrong, which no map chooses, attention is "
        "first in 1 of 1 case.",
        "In the quarter of the regions that is attended most it is first in 1 of 1 case: before other orders of "
        "regions by construction, as the map that orders them also says which are attended.",
    ]


def test_where_attention_loses_is_named():
    record = one_case(attention=0.06, raster=0.04, spread=0.08, plain=0.03)
    assert compared(races(record))[0] == (
        "In the whole picture, attention against raster order: earlier in 0, later in 1 (all of them); against pixels "
        "spread over the picture: earlier in 1; against plain rendering: earlier in 0, later in 1 (all of them)."
    )
    assert totals(record) == [
        "Seconds until all is there, against plain rendering, which has no coarse frame and shows nothing before its "
        "first call is done: 2.00 times by attention, 1.33 times in raster order and 2.67 times spread."
    ]
    assert totals(one_case(attention=0.06, raster=0.04)) == []


def test_repeats_that_overlap_are_undecided():
    record = one_case(around=1.5, attention=0.02, raster=0.04)
    assert "first in 0 of 1 case (1 undecided: repeats overlap) of scene" in answer(races(record))
    assert compared(races(record))[0].endswith("raster order: earlier in 0, undecided in 1.")


def test_who_never_gets_there_has_no_median():
    never = [
        replace(one, seconds=None, spread=None) if one.order == "raster" else one for one in fake_attention().reaching
    ]
    said = answer(races(fake_attention(reaching=never)))
    assert "by attention" in said
    assert "in raster order" not in said


def at(seconds, spread=1.0):
    return At(seconds, seconds / spread, seconds * spread)


def test_races_compare_orders():
    assert first({"attention": at(1.0), "raster": at(2.0), "spread": None}) == "attention"
    assert first({"attention": at(1.0), "raster": at(2.0, 2.0)}) is None
    assert first({"attention": at(1.0), "raster": at(1.0)}) is None
    assert first({"attention": None, "raster": None}) is None
    assert first({"attention": None}) is None
    assert earlier({"attention": at(1.0), "raster": None}, "attention", "raster")
    assert not earlier({"attention": None, "raster": None}, "attention", "raster")
    assert not earlier({"attention": at(1.0), "raster": at(1.0)}, "attention", "raster")
    assert not earlier({"attention": at(1.0, 1.5), "raster": at(2.0, 1.5)}, "attention", "raster")
    assert earlier({"attention": at(1.0, 1.3), "raster": at(2.0, 1.3)}, "attention", "raster")


def test_an_error_averaged_over_time_is_that_of_steps():
    ones, total = [1.0] * 3, (4.0, 4.0)
    curve = Anytime("chair", "nerf", "point", "raster", 1, [1.0, 2.0, 4.0], ones, total, ones, [8.0, 2.0, 0.0], ones)
    assert mean_error(curve, 4.0, "hardest") == pytest.approx((8.0 + 2 * 2.0) / 3)
    assert mean_error(curve, 7.0, "hardest") == pytest.approx((8.0 + 2 * 2.0) / 6)
    assert mean_error(curve, 3.0, "hardest") == pytest.approx((8.0 + 2.0) / 2)
    assert mean_error(curve, 4.0, "whole") == pytest.approx(1.0)
    assert mean_error(curve, 1.0, "whole") is None


def test_averages_over_time_are_ratios():
    alike = {"seconds": [0.1 * k for k in range(26)], "rmse_hardest": [0.1] * 26, "rmse_whole": [0.2] * 26}
    curves = [replace(fake_curve("chair", "point", order, 1.0), **alike) for order in ("attention", "raster")]
    same = fake_attention(curves=curves)
    (said,) = averaged(same)
    assert (
        "against raster order, the error of the whole picture is 1.00 times as large, that of the hardest quarter 1.00 "
        "times" in said
    )
    assert "spread" not in said
    assert averaged(fake_attention(curves=[])) == []


def placed(way: Way, against: int, evaluations: float, attended: float, whole: float = 0.1) -> Allocation:
    own = 0.0 if way == "even" else 0.1 * evaluations
    return Allocation("chair", "nerf", "point", way, against, 1, 8.0, evaluations, own, 0.001 * evaluations, (0.0, 9.0),
                      attended, whole, None, None)  # fmt: skip


def test_allocation_is_compared_with_its_own_even_picture():
    even = [placed("even", 8, 100.0, 0.2), placed("even", 16, 200.0, 0.1)]
    (said,) = allocated([*even, placed("samples", 8, 150.0, 0.1)])
    assert said == (
        "With as many samples it is 1.00 times as large in the whole picture and 0.50 times in what is attended, but "
        "that is no equal cost, as empty space needs no evaluation: it takes 1.50 times the evaluations and 1.50 times "
        "the seconds."
    )
    (said,) = allocated([*even, placed("evaluations", 16, 202.0, 0.12, 0.11)])
    assert plain(said) == (
        "At the same total cost, in network evaluations and with those of finding out where samples belong (10 % of "
        "them), samples by attention leave an error of the integral that is 1.10 times as large in the whole picture "
        "and 1.20 times in what is attended, against the same for each ray; it takes 1.01 times the evaluations and "
        "1.01 times the seconds."
    )
    assert allocated(even) == []
    assert pairs_of([*even, placed("samples", 9, 150.0, 0.1)], "samples") == []


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


def test_a_missed_first_frame_is_called_missed_and_says_how_coarse_it_is():
    said = plain(seen_first(FirstFrame("chair", ["nerf", "qnerf"], 40, 40, 0.71, 1.2, 1, [4, 2], [21.26, None])))
    assert said == (
        "The viewer’s first frame of nerf and qnerf side by side on chair, 40 × 40 px with methods loaded and nothing "
        "in the cache, is computed after 710 ms (target 0.5 s: missed), coarse: nerf a ray for each 4 × 4 px at 21.3 "
        "dB of the whole picture and qnerf a ray for each 2 × 2 px; all of it after 1.20 s, both on the server, "
        "without the way to a browser; the slowest of 1 call."
    )
