"""§8 judged: by the spread of the calls, by pictures that would have been stale, by who is first on which scenes."""

from dataclasses import replace

import pytest

from harness.serving_record import Confusion, PhiCheck, ServingRecord
from reports.beside import Beside
from reports.claims import claims
from reports.claims_table import claims_grid
from reports.ledger import UNTESTED
from reports.load import Records
from reports.untested import not_tested
from tests.reports.fake_serving import fake_attention, fake_cache, fake_curve, fake_serving, latency, reaching

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
    assert all("`python -m harness serving OUT`" in found[name].note for name in MINE)
    (said,) = [one for one in not_tested([], list(found.values())) if "§8" in one]
    assert said.startswith("View cache and attention-prioritised rendering (§8): 4 of 4 statements;")
    assert found["section10-integration"].verdict == UNTESTED


def test_older_runs_said_it_themselves():
    assert not_tested(["View caching and attention-prioritised rendering (§8)."], []) == []


def test_a_quick_measurement_judges_nothing(whole: Records):
    found = judged(whole, fake_serving(settings={"quick": True}))
    assert {found[name].verdict for name in MINE} == {UNTESTED}
    assert found[RETRIEVAL].note.startswith("measured too quickly to be judged")


@pytest.mark.parametrize(
    ("hits", "verdict"),
    [
        ((hit("level 0", 2000), hit("level 1", 1500), hit("level 2", 70)), "holds"),
        ((hit("level 0", 2000), hit("level 1", 1500), hit("level 2", 40)), "does not hold"),
        ((hit("level 0", 2000), hit("level 1", 800), hit("level 2", 70)), "does not hold"),
        ((hit("level 0", 2000), hit("level 1", 1500), hit("level 2", 52)), "inconclusive"),
        ((hit("level 0", 2000), hit("level 1", 980), hit("level 2", 70)), "inconclusive"),
        ((hit("level 0", 2000), hit("level 1", 1500)), "inconclusive"),
        ((hit("level 2", 70),), "inconclusive"),
        ((hit("level 2", 30),), "does not hold"),
        ((), UNTESTED),
    ],
)
def test_instant_is_judged_by_the_spread_of_memory_and_disk(whole: Records, hits, verdict):
    assert judged(whole, with_latencies(RENDER, *hits))[RETRIEVAL].verdict == verdict


def test_what_misses_the_bar_is_named(whole: Records):
    claim = judged(whole, fake_serving())[RETRIEVAL]
    assert (claim.measured, claim.verdict) == (pytest.approx((0.045 / 1.6e-5, 0.075 / 1.4e-5)), "does not hold")
    assert claim.interval == pytest.approx((0.045 / 1.6e-5 / 1.3, 0.075 / 1.4e-5 * 1.3))
    assert claim.note == (
        "from disk 30.0× to 53.6×; missed: disk, nerf on chair; its spread reaches across the bar: disk, qnerf on chair"
    )
    assert claim.how.replace("\u202f", " ").endswith("1 000× in memory, 50× on disk")
    rows = {row[0].text: row for row in claims_grid([claim], "").rows}
    measured = rows["Cached views are retrieved instantly"][2]
    assert measured.text.replace("\u202f", " ") == "2 812 to 5 357 ×"


def test_another_bar_is_another_verdict(whole: Records):
    easy = replace(fake_cache(), target_disk=10.0)
    assert judged(whole, fake_serving(cache=easy))[RETRIEVAL].verdict == "holds"


@pytest.mark.parametrize(
    ("confusions", "verdict", "stale"),
    [
        ([Confusion("a", 4, 3, 0.1, 4), Confusion("b", 2, 0, 0.0, 2)], "does not hold", 3),
        ([Confusion("a", 4, 0, 0.0, 4)], "holds", 0),
        ([], UNTESTED, None),
    ],
)
def test_the_hash_of_the_pose_is_judged_by_stale_pictures(whole: Records, confusions, verdict, stale):
    claim = judged(whole, fake_serving(cache=fake_cache(confusions=confusions)))[KEY]
    assert (claim.verdict, claim.measured) == (verdict, stale)


def test_a_key_of_ours_that_errs_is_counted(whole: Records):
    found = [Confusion("a", 4, 4, 0.1, 3), Confusion("b", 4, 4, 0.1, 4)]
    assert judged(whole, fake_serving(cache=fake_cache(confusions=found)))[KEY].note == (
        "stale of 8 views; our key is new for 7 of them"
    )


def raced(*names: tuple[str, str], slower: tuple[tuple[str, str], ...] = ()) -> ServingRecord:
    """By attention first, but in `slower` after raster order."""
    curves = []
    for scene, kind in names:
        for order in ("attention", "raster", "spread"):
            one = fake_curve(scene, kind, order, 1.0)
            late = 0.5 if order == "attention" and (scene, kind) in slower else 0.0
            curves.append(replace(one, seconds=[at + late for at in one.seconds]))
    return fake_serving(attention=fake_attention(curves=curves, reaching=[reaching(one, 0.1) for one in curves]))


THREE = (("chair", "point"), ("drums", "point"), ("lego", "point"))


@pytest.mark.parametrize(
    ("serving", "verdict"),
    [
        (raced(*THREE), "holds"),
        (raced(*THREE, slower=THREE), "does not hold"),
        (raced(*THREE, slower=THREE[:1]), "inconclusive"),
        (raced(*THREE, ("lego", "mask"), slower=(("lego", "mask"),)), "inconclusive"),
        (raced(*THREE[:2]), "inconclusive"),
        (raced(*THREE[:2], slower=THREE[:2]), "inconclusive"),
        (raced(), UNTESTED),
    ],
)
def test_priority_is_judged_over_scenes(whole: Records, serving, verdict):
    assert judged(whole, serving)[PRIORITY].verdict == verdict


def test_the_factor_is_raster_over_attention_from_worst_to_best(whole: Records):
    serving = raced(*THREE)
    times = {one.order: one.seconds for one in serving.attention.reaching}  # alike on all scenes
    claim = judged(whole, serving)[PRIORITY]
    assert claim.measured == pytest.approx((times["raster"] / times["attention"],) * 2)
    assert claim.note == (
        "earlier in 3 of 3 cases, in all of them on 3 of 3 scenes; over the whole picture first of all orders in 0 of 3"
    )


def test_who_never_gets_there_is_later(whole: Records):
    serving = raced(*THREE)
    never = [
        replace(one, seconds=None, share_of_time=None) if one.order == "raster" else one
        for one in serving.attention.reaching
    ]
    claim = judged(whole, replace(serving, attention=replace(serving.attention, reaching=never)))[PRIORITY]
    assert (claim.verdict, claim.measured) == ("holds", None)
    lost = [replace(one, seconds=None, share_of_time=None) for one in serving.attention.reaching]
    claim = judged(whole, replace(serving, attention=replace(serving.attention, reaching=lost)))[PRIORITY]
    assert claim.verdict == "does not hold"


@pytest.mark.parametrize(
    ("phi", "verdict"),
    [
        (PhiCheck(1.618034, 18, 0, 0), "does not hold"),
        (PhiCheck(1.618034, 18, 0, 2), "holds"),
        (PhiCheck(0.0, 0, 0, 0), UNTESTED),
    ],
)
def test_phi_takes_part_where_it_changes_something(whole: Records, phi, verdict):
    claim = judged(whole, fake_serving(attention=fake_attention(phi=phi)))[PHI]
    assert claim.verdict == verdict
    if phi.maps:
        assert "of 18 maps; the priorities sum to 1.618, not to 1" in claim.note
