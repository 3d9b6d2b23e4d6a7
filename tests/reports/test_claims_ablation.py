"""Table 4 from the factorial study, or from the run itself."""

import json
from dataclasses import replace

import pytest

from harness.evidence_record import Check, Effect, EvidenceRecord, StudyInfo, StudyRecord
from harness.records import Comparison
from reports.beside import Beside
from reports.claims import claims
from reports.claims_ablation import untested
from reports.ledger import UNTESTED
from reports.load import Records
from reports.page import page
from reports.publish import write_published
from reports.selection import Selection
from reports.summary import summary
from reports.untested import not_tested

LISTING_2 = ("nerf_phi_encoding_amplifier", "nerf_phi_encoding")
EQUATION_4 = ("nerf_phi_encoding_equation4", "nerf_phi_encoding")
CLAIM = "table4-nerf_phi_encoding_amplifier-psnr"
DERIVED = "not printed but derived from rounded figures, which leave +0.5 to +0.7 dB open"


def effect(pair: tuple[str, str], difference: float | None, half: float = 0.1, **changes) -> Effect:
    near = None if difference is None else (difference - half, difference + half)
    wide = None if difference is None else (difference - 3 * half, difference + 3 * half)
    one = Effect(*pair, "lego", "psnr", "steps", difference, near, wide, 3, "better", 0.3, 3, 0)
    return replace(one, **changes)


def study(*effects: Effect) -> EvidenceRecord:
    info = StudyInfo("factorial", "title", "question?", "method")
    one = StudyRecord(info, scale="lego; 3 seeds; 500 steps", effects=list(effects))
    return EvidenceRecord({}, {}, [one], finished=True)


def judged(records: Records, evidence: EvidenceRecord | None):
    return {one.id: one for one in claims(records, Beside(evidence=evidence))}


@pytest.mark.parametrize(
    ("difference", "verdict"), [(-2.5, "does not hold"), (0.4, "inconclusive"), (0.9, "holds"), (None, UNTESTED)]
)
def test_listing_2_is_judged_by_the_interval_of_its_family(whole: Records, difference, verdict):
    claim = judged(whole, study(effect(LISTING_2, difference)))[CLAIM]
    assert (claim.printed, claim.measured, claim.verdict) == (0.6, difference, verdict)
    assert claim.scale == "lego; 3 seeds; 500 steps"
    assert claim.runs is None, "the study's runs are not the report's"
    if difference is not None:
        assert claim.interval == (difference - 0.1 * 3, difference + 0.1 * 3)


def test_equation_4_stands_beside_and_is_not_judged(whole: Records):
    claim = judged(whole, study(effect(LISTING_2, -2.5), effect(EQUATION_4, 0.61, verdict="inconclusive")))[CLAIM]
    assert claim.verdict == "does not hold"
    assert claim.note.startswith("with the amplifier of Eq. 4: +0.61 [+0.31, +0.91] (inconclusive); not printed")
    alone = judged(whole, study(effect(EQUATION_4, 0.61)))[CLAIM]
    assert (alone.verdict, alone.measured) == (UNTESTED, None)


@pytest.mark.parametrize(
    "changes", [{"scene": "all"}, {"metric": "ssim"}, {"budget": "seconds"}, {"against": "nerf"}, {"name": "qnerf"}]
)
def test_only_the_row_above_on_lego_at_equal_steps_will_do(whole: Records, changes):
    claim = judged(whole, study(effect(LISTING_2, 0.9, **changes)))[CLAIM]
    assert (claim.verdict, claim.measured) == (UNTESTED, None)


def test_lost_pairs_settle_nothing(whole: Records):
    assert judged(whole, study(effect(LISTING_2, -2.5, unpaired=1)))[CLAIM].verdict == "inconclusive"


def test_without_the_study_the_run_itself_is_asked(whole: Records):
    own = Comparison("lego", "nerf_phi_encoding", "nerf", "psnr", "steps", 0.1, (0.0, 0.2), "better", 0.1, 3, 0)
    records = replace(whole, comparisons=[*whole.comparisons, own])
    claim = judged(records, None)["table4-nerf_phi_encoding-psnr"]
    assert (claim.measured, claim.verdict) == (0.1, "does not hold")
    assert claim.runs == Selection("lego", "nerf_phi_encoding", "nerf", "psnr", "steps")
    assert judged(whole, None)["table4-nerf_phi_encoding-psnr"].verdict == UNTESTED


def test_ssim_has_its_own_rounding(whole: Records):
    pair = ("nerf_phi_encoding", "nerf")
    claim = judged(whole, study(effect(pair, 0.007, 0.0004, metric="ssim")))["table4-nerf_phi_encoding-ssim"]
    assert (claim.printed, claim.verdict) == (0.006, "holds")


def test_a_difference_of_two_rounded_figures_has_the_rounding_of_both(whole: Records):
    """33.8 − 33.2 may be 0.5; the +0.7 of the first step stands in a footnote as it is."""
    for difference, verdict in ((0.52, "holds"), (0.5, "inconclusive"), (0.48, "does not hold")):
        claim = judged(whole, study(effect(LISTING_2, difference, 0.005)))[CLAIM]
        assert claim.verdict == verdict
    first = judged(whole, study(effect(("nerf_phi_encoding", "nerf"), 0.62, 0.005)))["table4-nerf_phi_encoding-psnr"]
    assert first.verdict == "does not hold"


def test_quick_evidence_judges_nothing(whole: Records):
    quick = replace(study(effect(LISTING_2, -2.5)), settings={"quick": True})
    assert (judged(whole, quick)[CLAIM].verdict, judged(whole, quick)[CLAIM].measured) == (UNTESTED, None)


def test_what_speaks_against_the_evidence_is_said(whole: Records):
    sound = study(effect(LISTING_2, -2.5))
    assert "not" not in judged(whole, sound)[CLAIM].note.removesuffix(DERIVED)
    assert "the evidence was not finished" in judged(whole, replace(sound, finished=False))[CLAIM].note
    checks = [Check("share of A/A comparisons", 0.2, high=0.05), Check("share of planted effects", 0.9, low=0.8)]
    failing = StudyRecord(StudyInfo("calibration", "title", "question?", "method"), checks=checks)
    doubted = judged(whole, replace(sound, studies=[*sound.studies, failing]))[CLAIM]
    assert "1 of 2 checks of calibration did not hold" in doubted.note


def test_what_is_left_untested_of_the_ablation_is_said_and_only_that(whole: Records):
    steps = (("nerf_phi_encoding", "nerf"), LISTING_2, ("qnerf", "nerf_phi_encoding_amplifier"))
    every = [effect(pair, 0.1, metric=metric) for pair in steps for metric in ("psnr", "ssim")]

    def said(before: list[str], evidence: EvidenceRecord | None) -> list[str]:
        found = claims(whole, Beside(evidence=evidence))
        return [one for one in not_tested(before, found) if "§8" not in one]

    older = ["The paper's scale.", "The ablation of Table 4 in this run: the factorial study"]
    assert said(older, study(*every)) == ["The paper's scale."]
    assert said(older, None)[1].startswith("The ablation of Table 4: 6 of its 6 steps")
    assert said([], study(*every[1:]))[0].startswith("The ablation of Table 4: 1 of its 6 steps")
    assert untested([]) == []
    assert any("6 of its 6 steps" in one for one in summary(whole)["not_tested"])
    assert "6 of its 6 steps" in page(whole)


def test_what_is_published_is_judged_by_the_same_evidence(whole: Records, tmp_path):
    write_published(whole, tmp_path, Beside(evidence=study(effect(LISTING_2, -2.5))))
    rows = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))["claims"]
    row = next(row for row in rows if row["id"] == CLAIM)
    assert (row["measured"], row["verdict"]) == (-2.5, "does not hold")
