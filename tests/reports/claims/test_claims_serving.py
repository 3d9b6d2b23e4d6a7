"""The claims of §8: judged by the spread of calls, by stale pictures, and by the scenes on which an order is first."""

import pytest

from harness.records.study import Check
from reports.claims.ledger import not_tested
from reports.claims.table import claims_grid
from reports.data.load import Records
from reports.data.wording import UNTESTED
from tests.reports.claims.test_claims import claimed
from tests.reports.fake_studies import earlier, fake_serving, hit, phi, stale

RETRIEVAL, KEY, PRIORITY, PHI = "section8.1-retrieval", "listing5-key", "section8.2-priority", "eq7-phi"
MEMORY = (hit("memory.0", 2000), hit("memory.1", 1500))
DISK = hit("disk.warm", 70)


@pytest.mark.parametrize(
    ("serving", "remedy"),
    [
        (None, "OUT`"),
        (fake_serving(latency=None, confusions=None, anytime=None, priorities=None), "OUT`"),
        (fake_serving(settings={"quick": True}), "OUT` without --quick"),
    ],
)
def test_unmeasured_claims_are_not_tested_and_name_the_remedy(whole: Records, serving, remedy: str) -> None:
    claims = claimed(whole, serving=serving)
    own = [claims[name] for name in (RETRIEVAL, KEY, PRIORITY, PHI)]
    assert {claim.verdict for claim in own} == {UNTESTED}
    assert {claim.note for claim in own} == {f"need `python -m harness study serving {remedy}"}
    assert f"4 claims {own[0].note}." in not_tested([], list(claims.values()))
    assert "serving" not in " ".join(not_tested([], list(claimed(whole, serving=fake_serving()).values())))


@pytest.mark.parametrize(
    ("study", "checks", "name", "verdict"),
    [
        ("latency", (*MEMORY, DISK), RETRIEVAL, "seen"),
        ("latency", (*MEMORY, hit("disk.warm", 40)), RETRIEVAL, "not seen at this scale"),
        ("latency", (MEMORY[0], hit("memory.1", 800), DISK), RETRIEVAL, "not seen at this scale"),
        ("latency", (*MEMORY, hit("disk.warm", 52)), RETRIEVAL, "inconclusive"),
        ("latency", (MEMORY[0], hit("memory.1", 980), DISK), RETRIEVAL, "inconclusive"),
        ("latency", MEMORY, RETRIEVAL, "inconclusive"),
        ("latency", (DISK,), RETRIEVAL, "inconclusive"),
        ("latency", (*MEMORY, DISK, hit("disk.cold", 30)), RETRIEVAL, "not seen at this scale"),
        ("latency", (hit("disk.warm", 30),), RETRIEVAL, "not seen at this scale"),
        ("latency", (), RETRIEVAL, UNTESTED),
        ("confusions", stale(2), KEY, "not reproduced"),
        ("confusions", stale(0), KEY, "reproduced"),
        ("anytime", [earlier("attended", 4, "pass")], PRIORITY, "seen"),
        ("anytime", [earlier("attended", 4, "fail")], PRIORITY, "not seen at this scale"),
        ("anytime", [earlier("attended", 4, "inconclusive")], PRIORITY, "inconclusive"),
        ("priorities", [phi(0)], PHI, "not reproduced"),
        ("priorities", [phi(2)], PHI, "reproduced"),
    ],
)
def test_verdicts(whole: Records, study: str, checks: tuple[Check, ...], name: str, verdict: str) -> None:
    assert claimed(whole, serving=fake_serving(**{study: list(checks)}))[name].verdict == verdict


def test_hits_that_miss_the_threshold_are_named(whole: Records) -> None:
    claim = claimed(whole, serving=fake_serving())[RETRIEVAL]
    assert claim.measured == (1050.0, 3000.0)
    assert claim.interval == (pytest.approx(1050 / 1.1), pytest.approx(3300))
    assert claim.note == (
        "rendering against a hit of disk.warm: 70.0×; "
        "rendering against a hit of disk.cold: 30.0×; missed: nerf (rendering against a hit of disk.cold); "
        "its spread includes the threshold: nerf (rendering against a hit of memory.1)"
    )
    assert claim.how.replace("\u202f", " ").endswith("1 000× in memory, 50× on disk")
    measured = claims_grid([claim], "").rows[0][2]
    assert measured.text.replace("\u202f", " ") == "1 050 to 3 000 ×"


def test_the_figures_behind_the_other_verdicts(whole: Records) -> None:
    serving = fake_serving(
        confusions=stale(2, 87.5), anytime=[earlier("attended", 4), earlier("whole", 2)], priorities=[phi(2)]
    )
    claims = claimed(whole, serving=serving)
    assert (claims[KEY].measured, claims[KEY].kind) == (2, "readings")
    assert claims[KEY].note.startswith("of 9 kinds, off by up to 0.857")
    assert claims[KEY].note.endswith("our key is new for 87.5 % of the views")
    assert claims[PRIORITY].note == "earlier in 4 of 6 cases, later in 1; over the whole picture earlier in 2 of 6"
    assert (claims[PHI].measured, claims[PHI].kind) == (2, "readings")
    measured = [claimed(whole, serving=each)[PRIORITY].measured for each in (serving, fake_serving())]
    assert measured == [None, (1.2, 1.9)]
