"""Table 4 from the factorial study, or from the run itself."""

import json
from dataclasses import replace

import pytest

from harness.evidence_record import Effect, EvidenceRecord, StudyInfo, StudyRecord
from harness.records import Comparison
from reports.claims import claims
from reports.ledger import UNTESTED
from reports.load import Records
from reports.publish import write_published

LISTING_2 = ("nerf_phi_encoding_amplifier", "nerf_phi_encoding")
EQUATION_4 = ("nerf_phi_encoding_equation4", "nerf_phi_encoding")
CLAIM = "table4-nerf_phi_encoding_amplifier-psnr"


def effect(pair: tuple[str, str], difference: float | None, half: float = 0.1, **changes) -> Effect:
    near = None if difference is None else (difference - half, difference + half)
    wide = None if difference is None else (difference - 3 * half, difference + 3 * half)
    one = Effect(*pair, "lego", "psnr", "steps", difference, near, wide, 3, "better", 0.3, 3, 0)
    return replace(one, **changes)


def study(*effects: Effect) -> EvidenceRecord:
    info = StudyInfo("factorial", "title", "question?", "method")
    return EvidenceRecord({}, {}, [StudyRecord(info, scale="lego; 3 seeds; 500 steps", effects=list(effects))])


def judged(records: Records, evidence: EvidenceRecord | None):
    return {one.id: one for one in claims(records, evidence)}


@pytest.mark.parametrize(
    ("difference", "verdict"), [(-2.5, "does not hold"), (0.4, "inconclusive"), (0.9, "holds"), (None, UNTESTED)]
)
def test_listing_2_is_judged_by_the_interval_of_its_family(whole: Records, difference, verdict):
    claim = judged(whole, study(effect(LISTING_2, difference)))[CLAIM]
    assert (claim.printed, claim.measured, claim.verdict) == (0.6, difference, verdict)
    assert claim.scale == "lego; 3 seeds; 500 steps"
    if difference is not None:
        assert claim.interval == (difference - 0.1 * 3, difference + 0.1 * 3)


def test_equation_4_stands_beside_and_is_not_judged(whole: Records):
    claim = judged(whole, study(effect(LISTING_2, -2.5), effect(EQUATION_4, 0.61, verdict="inconclusive")))[CLAIM]
    assert claim.verdict == "does not hold"
    assert claim.note == "with the amplifier of Eq. 4: +0.61 [+0.51, +0.71] (inconclusive)"
    alone = judged(whole, study(effect(EQUATION_4, 0.61)))[CLAIM]
    assert (alone.verdict, alone.measured) == (UNTESTED, None)


@pytest.mark.parametrize(
    "changes", [{"scene": "all"}, {"metric": "ssim"}, {"budget": "seconds"}, {"against": "nerf"}, {"name": "qnerf"}]
)
def test_only_the_row_above_on_lego_at_equal_steps_will_do(whole: Records, changes):
    claim = judged(whole, study(effect(LISTING_2, 0.9, **changes)))[CLAIM]
    assert (claim.verdict, claim.measured) == (UNTESTED, None)


def test_lost_pairs_settle_nothing(whole: Records):
    assert judged(whole, study(effect(LISTING_2, -2.5, left_aside=1)))[CLAIM].verdict == "inconclusive"


def test_without_the_study_the_run_itself_is_asked(whole: Records):
    own = Comparison("lego", "nerf_phi_encoding", "nerf", "psnr", "steps", 0.1, (0.0, 0.2), "better", 0.1, 3, 0)
    records = replace(whole, comparisons=[*whole.comparisons, own])
    claim = judged(records, None)["table4-nerf_phi_encoding-psnr"]
    assert (claim.measured, claim.verdict) == (0.1, "does not hold")
    assert judged(whole, None)["table4-nerf_phi_encoding-psnr"].verdict == UNTESTED


def test_ssim_has_its_own_rounding(whole: Records):
    pair = ("nerf_phi_encoding", "nerf")
    claim = judged(whole, study(effect(pair, 0.007, 0.0004, metric="ssim")))["table4-nerf_phi_encoding-ssim"]
    assert (claim.printed, claim.verdict) == (0.006, "holds")


def test_what_is_published_is_judged_by_the_same_evidence(whole: Records, tmp_path):
    write_published(whole, tmp_path, study(effect(LISTING_2, -2.5)))
    rows = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))["claims"]
    row = next(row for row in rows if row["id"] == CLAIM)
    assert (row["measured"], row["verdict"]) == (-2.5, "does not hold")
