"""§8 judged: by the spread of the calls, by pictures that would have been stale, by who is first on which scenes."""

import pytest

from harness.records.study import Check, Studies
from reports.claims.claim_list import claims
from reports.claims.ledger import Claim, not_tested
from reports.claims.table import claims_grid
from reports.data.beside import Beside
from reports.data.load import Records
from reports.data.wording import UNTESTED
from tests.reports.fake_serving import earlier, fake_serving, hit, phi, stale

RETRIEVAL, KEY, PRIORITY, PHI = "section8.1-retrieval", "listing5-key", "section8.2-priority", "eq7-phi"
MINE = (RETRIEVAL, KEY, PRIORITY, PHI)


def judged(records: Records, serving: Studies | None) -> dict[str, Claim]:
    return {one.id: one for one in claims(records, Beside(serving=serving))}


@pytest.mark.parametrize("serving", [None, fake_serving(latency=None, confusions=None, anytime=None, priorities=None)])
def test_what_was_not_measured_is_not_tested_and_the_remedy_is_named(whole: Records, serving: Studies | None) -> None:
    found = judged(whole, serving)
    assert {found[name].verdict for name in MINE} == {UNTESTED}
    assert all("`python -m harness study serving OUT`" in found[name].note for name in MINE)
    (needs,) = [one for one in not_tested([], list(found.values())) if "serving" in one]
    assert needs == "4 claims need `python -m harness study serving OUT`."
    assert not [one for one in not_tested([], claims(whole, Beside(serving=fake_serving()))) if "serving" in one]


def test_a_quick_measurement_judges_nothing(whole: Records) -> None:
    found = judged(whole, fake_serving(settings={"quick": True}))
    assert {found[name].verdict for name in MINE} == {UNTESTED}
    assert found[RETRIEVAL].note.endswith("without --quick")


MEMORY = (hit("memory.0", 2000), hit("memory.1", 1500))


@pytest.mark.parametrize(
    ("hits", "verdict"),
    [
        ((*MEMORY, hit("disk.warm", 70)), "seen"),
        ((*MEMORY, hit("disk.warm", 40)), "not seen at this scale"),
        ((hit("memory.0", 2000), hit("memory.1", 800), hit("disk.warm", 70)), "not seen at this scale"),
        ((*MEMORY, hit("disk.warm", 52)), "inconclusive"),
        ((hit("memory.0", 2000), hit("memory.1", 980), hit("disk.warm", 70)), "inconclusive"),
        (MEMORY, "inconclusive"),
        ((hit("disk.warm", 70),), "inconclusive"),
        ((*MEMORY, hit("disk.warm", 70), hit("disk.cold", 30)), "not seen at this scale"),
        ((hit("disk.warm", 30),), "not seen at this scale"),
        ((), UNTESTED),
    ],
)
def test_instant_is_judged_by_the_spread_of_memory_and_disk(
    whole: Records, hits: tuple[Check, ...], verdict: str
) -> None:
    assert judged(whole, fake_serving(latency=list(hits)))[RETRIEVAL].verdict == verdict


def test_what_misses_the_bar_is_named(whole: Records) -> None:
    claim = judged(whole, fake_serving())[RETRIEVAL]
    assert claim.measured == (1050.0, 3000.0)
    assert claim.interval == (pytest.approx(1050 / 1.1), pytest.approx(3300))
    assert claim.note == (
        "rendering against a hit of disk.warm: 70.0×; "
        "rendering against a hit of disk.cold: 30.0×; missed: nerf (rendering against a hit of disk.cold); "
        "its spread reaches across the bar: nerf (rendering against a hit of memory.1)"
    )
    assert claim.how.replace("\u202f", " ").endswith("1 000× in memory, 50× on disk")
    rows = {row[0].text: row for row in claims_grid([claim], "").rows}
    measured = rows["Cached views are retrieved instantly"][2]
    assert measured.text.replace("\u202f", " ") == "1 050 to 3 000 ×"


@pytest.mark.parametrize(("kinds", "verdict"), [(2, "not reproduced"), (0, "reproduced")])
def test_the_hash_of_the_pose_is_judged_by_kinds_of_change(whole: Records, kinds: int, verdict: str) -> None:
    claim = judged(whole, fake_serving(confusions=stale(kinds, 87.5)))[KEY]
    assert (claim.verdict, claim.measured, claim.kind) == (verdict, kinds, "readings")
    assert claim.note.startswith("of 9 kinds, off by up to 0.857")
    assert claim.note.endswith("our key is new for 87.5 % of the views")


@pytest.mark.parametrize(
    ("status", "verdict"),
    [("pass", "seen"), ("fail", "not seen at this scale"), ("inconclusive", "inconclusive")],
)
def test_priority_is_judged_by_who_is_earlier(whole: Records, status: str, verdict: str) -> None:
    claim = judged(whole, fake_serving(anytime=[earlier("attended", 4, status), earlier("whole", 2)]))[PRIORITY]
    assert (claim.verdict, claim.measured) == (verdict, None)
    assert claim.note == "earlier in 4 of 6 cases, later in 1; over the whole picture earlier in 2 of 6"
    assert judged(whole, fake_serving())[PRIORITY].measured == (1.2, 1.9)


@pytest.mark.parametrize(("changed", "verdict"), [(0, "not reproduced"), (2, "reproduced")])
def test_phi_takes_part_where_it_changes_something(whole: Records, changed: int, verdict: str) -> None:
    claim = judged(whole, fake_serving(priorities=[phi(changed)]))[PHI]
    assert (claim.verdict, claim.measured, claim.kind) == (verdict, changed, "readings")
    assert "of 18 maps; the priorities sum to 1.618, not to 1" in claim.note
