"""§8 judged: by the spread of the calls, by pictures that would have been stale, by who is first on which scenes."""

from dataclasses import replace
from typing import get_args

import pytest

from harness.records.serving_record import Confusion, Measure, Order, PhiCheck, Reaching, ServingRecord
from reports.claims.claim_list import claims
from reports.claims.ledger import not_tested
from reports.claims.table import claims_grid
from reports.data.beside import Beside
from reports.data.load import Records
from reports.data.wording import UNTESTED
from tests.reports.fake_serving import fake_attention, fake_cache, fake_serving, latency

RETRIEVAL, KEY, PRIORITY, PHI = "section8.1-retrieval", "listing5-key", "section8.2-priority", "eq7-phi"
MINE = (RETRIEVAL, KEY, PRIORITY, PHI)


def judged(records: Records, serving: ServingRecord | None):
    return {one.id: one for one in claims(records, Beside(serving=serving))}


def with_latencies(*found) -> ServingRecord:
    return fake_serving(cache=fake_cache(latencies=list(found)))


RENDER = latency("nerf", "render", 0.05)


def hit(source: str, ratio: float, spread: float = 1.1):
    return latency("nerf", source, 0.05 / ratio, 0.05, spread)


@pytest.mark.parametrize("serving", [None, fake_serving(cache=None, attention=None)])
def test_what_was_not_measured_is_not_tested_and_the_remedy_is_named(whole: Records, serving):
    found = judged(whole, serving)
    assert {found[name].verdict for name in MINE} == {UNTESTED}
    assert all("`python -m harness study serving OUT`" in found[name].note for name in MINE)
    (said,) = [one for one in not_tested([], list(found.values())) if "serving" in one]
    assert said == "4 claims need `python -m harness study serving OUT`."
    assert not [one for one in not_tested([], claims(whole, Beside(serving=fake_serving()))) if "serving" in one]


def test_a_quick_measurement_judges_nothing(whole: Records):
    found = judged(whole, fake_serving(settings={"quick": True}))
    assert {found[name].verdict for name in MINE} == {UNTESTED}
    assert found[RETRIEVAL].note.endswith("without --quick")


@pytest.mark.parametrize(
    ("hits", "verdict"),
    [
        ((hit("level 0", 2000), hit("level 1", 1500), hit("level 2", 70)), "seen"),
        ((hit("level 0", 2000), hit("level 1", 1500), hit("level 2", 40)), "not seen at this scale"),
        ((hit("level 0", 2000), hit("level 1", 800), hit("level 2", 70)), "not seen at this scale"),
        ((hit("level 0", 2000), hit("level 1", 1500), hit("level 2", 52)), "inconclusive"),
        ((hit("level 0", 2000), hit("level 1", 980), hit("level 2", 70)), "inconclusive"),
        ((hit("level 0", 2000), hit("level 1", 1500)), "inconclusive"),
        ((hit("level 2", 70),), "inconclusive"),
        (
            (hit("level 0", 2000), hit("level 1", 1500), hit("level 2", 70), hit("level 2 cold", 30)),
            "not seen at this scale",
        ),
        ((hit("level 0", 2000), hit("level 1", 1500), hit("level 2", 70), hit("level 0 hashed", 60)), "seen"),
        ((hit("level 2", 30),), "not seen at this scale"),
        ((), UNTESTED),
    ],
)
def test_instant_is_judged_by_the_spread_of_memory_and_disk(whole: Records, hits, verdict):
    assert judged(whole, with_latencies(RENDER, *hits))[RETRIEVAL].verdict == verdict


def test_what_misses_the_bar_is_named(whole: Records):
    claim = judged(whole, fake_serving())[RETRIEVAL]
    assert (claim.measured, claim.verdict) == (
        pytest.approx((0.045 / 1.6e-5, 0.075 / 1.4e-5)),
        "not seen at this scale",
    )
    assert claim.interval == pytest.approx((0.045 / 1.6e-5 / 1.3, 0.075 / 1.4e-5 * 1.3))
    assert claim.note == (
        "from disk, file not in the system’s memory: 18.0× to 30.0×; "
        "from disk, file in the system’s memory: 30.0× to 53.6×; "
        "from memory (level 0), weights hashed at the call: 75.0× to 125×; "
        "missed: nerf on chair (disk, file in the system’s memory), nerf on chair (disk, file not in the system’s "
        "memory) and qnerf on chair (disk, file not in the system’s memory); "
        "its spread reaches across the bar: qnerf on chair (disk, file in the system’s memory)"
    )
    assert claim.how.replace("\u202f", " ").endswith("1 000× in memory, 50× on disk")
    assert "of a method that is no longer trained (weights hashed once)" in claim.how
    rows = {row[0].text: row for row in claims_grid([claim], "").rows}
    measured = rows["Cached views are retrieved instantly"][2]
    assert measured.text.replace("\u202f", " ") == "2 812 to 5 357 ×"


def test_another_bar_is_another_verdict(whole: Records):
    easy = replace(fake_cache(), target_disk=10.0)
    assert judged(whole, fake_serving(cache=easy))[RETRIEVAL].verdict == "seen"


def test_weights_hashed_at_every_call_decide_nothing(whole: Records):
    """It is another condition than that of the bar; what a cold disk takes is under it."""
    good = (RENDER, hit("level 0", 2000), hit("level 1", 1500), hit("level 2", 70))
    claim = judged(whole, with_latencies(*good, hit("level 0 hashed", 90)))[RETRIEVAL]
    assert (claim.verdict, claim.measured) == ("seen", pytest.approx((1500, 2000)))
    assert claim.note.endswith("from memory (level 0), weights hashed at the call: 90.0×")
    assert judged(whole, with_latencies(*good, hit("level 2 cold", 30)))[RETRIEVAL].verdict == "not seen at this scale"


@pytest.mark.parametrize(
    ("confusions", "verdict", "stale"),
    [
        (
            [Confusion("a", 4, 3, 0.1, 4), Confusion("b", 2, 0, 0.0, 2), Confusion("c", 9, 9, 0.1, 9)],
            "not reproduced",
            2,
        ),
        ([Confusion("a", 4, 0, 0.0, 4)], "reproduced", 0),
        ([], UNTESTED, None),
    ],
)
def test_the_hash_of_the_pose_is_judged_by_kinds_of_change(whole: Records, confusions, verdict, stale):
    claim = judged(whole, fake_serving(cache=fake_cache(confusions=confusions)))[KEY]
    assert (claim.verdict, claim.measured) == (verdict, stale)
    assert claim.statement == "The hash of its pose tells which picture a view is"
    assert claim.kind == "readings"


def test_the_largest_error_is_named_and_what_nobody_could_see(whole: Records):
    found = [Confusion("near", 4, 4, 1 / 511, 4), Confusion("far", 4, 1, 1 / 509, 4), Confusion("ulp", 4, 0, 0.0, 4)]
    note = judged(whole, fake_serving(cache=fake_cache(confusions=found)))[KEY].note
    assert note == (
        "of 3 kinds of change; off by up to 0.00196 (far; RMSE of display colour); 1 of them visible in "
        "8 bits (RMSE above 1/510), but not near; our key is new for all 12 views"
    )
    assert "all visible in 8 bits (RMSE above 1/510);" in judged(whole, fake_serving())[KEY].note


def test_a_key_of_ours_that_errs_is_counted(whole: Records):
    found = [Confusion("a", 4, 4, 0.1, 3), Confusion("b", 4, 4, 0.1, 4)]
    claim = judged(whole, fake_serving(cache=fake_cache(confusions=found)))[KEY]
    assert claim.note.endswith("our key is new for 7 of 8 views")


def raced(
    *names: tuple[str, str], slower: tuple[tuple[str, str], ...] = (), overlapping: tuple[tuple[str, str], ...] = ()
) -> ServingRecord:
    """By attention first, but in `slower` after raster order, and in `overlapping` in most repeats alone."""
    found = [
        replace(one, measure=measure)
        for scene, kind in names
        for one in (
            timed(scene, kind, "attention", 0.5 if (scene, kind) in slower else 0.2, (scene, kind) in overlapping),
            timed(scene, kind, "raster", 0.4, (scene, kind) in overlapping),
        )
        for measure in get_args(Measure)
    ]
    return fake_serving(attention=fake_attention(curves=[], reaching=found))


def timed(scene: str, kind: str, order: Order, seconds: float, wide: bool = False) -> Reaching:
    """Times of 0.2 and 0.4 s are apart, unless `wide`."""
    around = (seconds - 0.11, seconds + 0.11) if wide else (0.9 * seconds, 1.1 * seconds)
    return Reaching(scene, "nerf", kind, order, "attended", 0.1, 0.01, seconds, around)


THREE = (("chair", "point"), ("drums", "point"), ("lego", "point"))


@pytest.mark.parametrize(
    ("serving", "verdict"),
    [
        (raced(*THREE), "seen"),
        (raced(*THREE, slower=THREE), "not seen at this scale"),
        (raced(*THREE, slower=THREE[:1]), "inconclusive"),
        (raced(*THREE, ("lego", "mask"), slower=(("lego", "mask"),)), "inconclusive"),
        (raced(*THREE[:2]), "inconclusive"),
        (raced(*THREE[:2], slower=THREE[:2]), "inconclusive"),
        (raced(*THREE, overlapping=THREE), "inconclusive"),
        (raced(*THREE, overlapping=THREE[:1]), "inconclusive"),
        (raced(*THREE, slower=THREE, overlapping=THREE), "inconclusive"),
        (raced(*THREE, slower=THREE[:2], overlapping=THREE[2:]), "inconclusive"),
        (raced(), UNTESTED),
    ],
)
def test_priority_is_judged_over_scenes(whole: Records, serving, verdict):
    assert judged(whole, serving)[PRIORITY].verdict == verdict


def test_the_factor_is_raster_over_attention_from_worst_to_best(whole: Records):
    claim = judged(whole, raced(*THREE, slower=THREE[1:2], overlapping=THREE[2:]))[PRIORITY]
    assert claim.measured == pytest.approx((0.4 / 0.5, 0.4 / 0.2))
    assert claim.note == (
        "earlier in 1 of 3 cases, in all of them on 1 of 3 scenes; undecided, as repeats overlap, in 1; the map that "
        "orders regions says which are attended: earlier by construction, but for the map’s own time; where the coarse "
        "frame is most wrong earlier in 1 of 3; over the whole picture earlier in 1 of 3"
    )


def test_who_never_gets_there_is_later(whole: Records):
    def lost(*orders: Order) -> ServingRecord:
        serving = raced(*THREE)
        found = [
            replace(one, seconds=None, spread=None) if one.order in orders else one
            for one in serving.attention.reaching
        ]
        return replace(serving, attention=replace(serving.attention, reaching=found))

    claim = judged(whole, lost("raster"))[PRIORITY]
    assert (claim.verdict, claim.measured) == ("seen", None)
    assert judged(whole, lost("attention"))[PRIORITY].verdict == "not seen at this scale"
    assert judged(whole, lost("attention", "raster"))[PRIORITY].verdict == "not seen at this scale"


@pytest.mark.parametrize(
    ("phi", "verdict"),
    [
        (PhiCheck(1.618034, 18, 0, 0), "not reproduced"),
        (PhiCheck(1.618034, 18, 0, 2), "reproduced"),
        (PhiCheck(0.0, 0, 0, 0), UNTESTED),
    ],
)
def test_phi_takes_part_where_it_changes_something(whole: Records, phi, verdict):
    claim = judged(whole, fake_serving(attention=fake_attention(phi=phi)))[PHI]
    assert claim.verdict == verdict
    assert claim.statement == "Factor φ changes what is rendered first or how finely"
    assert claim.kind == "readings"
    if phi.maps:
        assert "of 18 maps; the priorities sum to 1.618, not to 1" in claim.note
