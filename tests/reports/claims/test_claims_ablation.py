"""Table 4 from the factorial study, or from the run itself."""

import json

import pytest

from harness.records.cells import Comparison, Estimate
from harness.records.study import Effect, Studies, StudyInfo, StudyRecord, check
from reports.claims.claim_list import claims
from reports.claims.scores import NEEDS_STUDY
from reports.data.beside import Beside
from reports.data.load import Records
from reports.data.selection import Selection
from reports.data.wording import UNTESTED
from reports.run.publish import summary, write_published
from reports.run.run_page import page
from tests.replacing import replace

LISTING_2 = ("nerf_phi_encoding_amplifier", "nerf_phi_encoding")
EQUATION_4 = ("nerf_phi_encoding_equation4", "nerf_phi_encoding")
CLAIM = "table4-nerf_phi_encoding_amplifier-psnr"
DERIVED = "the paper prints rounded totals: this step is between +0.5 and +0.7 dB"


def effect(pair: tuple[str, str], difference: float | None, half: float = 0.1, **changes) -> Effect:
    near = None if difference is None else (difference - half, difference + half)
    wide = None if difference is None else (difference - 3 * half, difference + 3 * half)
    here = Estimate(near, wide, 3, "better", 0.3, None)
    one = Effect(*pair, "lego", "psnr", "steps", difference, near, wide, 3, "better", 0.3, 3, 0, "", here)
    return replace(one, **changes)


def study(*effects: Effect) -> Studies:
    info = StudyInfo("factorial", "title", "question?", "method")
    one = StudyRecord(info, scale="lego; 3 seeds; 500 steps", findings=list(effects))
    return Studies("evidence", {}, {}, [one], finished=True)


def judged(records: Records, evidence: Studies | None):
    return {one.id: one for one in claims(records, Beside(evidence=evidence))}


@pytest.mark.parametrize(
    ("difference", "verdict"),
    [(-2.5, "not seen at this scale"), (0.25, "inconclusive"), (0.6, "seen"), (2.0, "not seen at this scale"),
     (None, UNTESTED)],
)  # fmt: skip
def test_listing_2_is_judged_by_the_interval_of_its_family(whole: Records, difference, verdict):
    claim = judged(whole, study(effect(LISTING_2, difference)))[CLAIM]
    assert (claim.printed, claim.measured, claim.verdict) == (0.6, difference, verdict)
    assert claim.runs is None, "the study's runs are not the report's"
    if difference is not None:
        assert claim.scale == "lego; 3 seeds; 500 steps"
        assert claim.interval == (difference - 0.1 * 3, difference + 0.1 * 3)


def test_equation_4_stands_beside_and_is_not_judged(whole: Records):
    claim = judged(whole, study(effect(LISTING_2, -2.5), effect(EQUATION_4, 0.61, verdict="inconclusive")))[CLAIM]
    assert claim.verdict == "not seen at this scale"
    assert claim.note == f"with the amplifier of Eq. 4: +0.61 [+0.31, +0.91] (inconclusive); {DERIVED}"
    alone = judged(whole, study(effect(EQUATION_4, 0.61)))[CLAIM]
    assert (alone.verdict, alone.measured) == (UNTESTED, None)


@pytest.mark.parametrize(
    "changes", [{"scene": "all"}, {"metric": "ssim"}, {"budget": "seconds"}, {"against": "nerf"}, {"name": "qnerf"}]
)
def test_only_the_row_above_on_lego_at_equal_steps_will_do(whole: Records, changes):
    claim = judged(whole, study(effect(LISTING_2, 0.9, **changes)))[CLAIM]
    assert (claim.verdict, claim.measured) == (UNTESTED, None)


def test_lost_pairs_are_said_and_two_seeds_settle_nothing(whole: Records):
    claim = judged(whole, study(effect(LISTING_2, -2.5, unpaired=1)))[CLAIM]
    assert (claim.verdict, claim.note) == ("not seen at this scale", f"1 pair could not be judged; {DERIVED}")
    assert judged(whole, study(effect(LISTING_2, -2.5, pairs=2)))[CLAIM].verdict == "inconclusive"


def test_the_runs_own_comparison_comes_before_the_study(whole: Records):
    here = Estimate((0.0, 0.2), (0.0, 0.2), 1, "better", 0.1, 1.0)
    own = Comparison("lego", *LISTING_2, "psnr", "steps", 0.1, (0.0, 0.2), "better", 0.1, 3, 0, None, 1, here, None)
    records = replace(whole, comparisons=[*whole.comparisons, own])
    for evidence in (None, study(effect(LISTING_2, 0.6))):
        claim = judged(records, evidence)[CLAIM]
        assert (claim.measured, claim.verdict) == (0.1, "not seen at this scale")
        assert claim.runs == Selection("lego", *LISTING_2, "psnr", "steps")
    missing = judged(whole, None)[CLAIM]
    assert (missing.verdict, missing.note) == (UNTESTED, NEEDS_STUDY)


def test_ssim_has_its_own_margin(whole: Records):
    pair = ("nerf_phi_encoding", "nerf")
    for difference, verdict in ((0.007, "seen"), (0.02, "not seen at this scale")):
        claim = judged(whole, study(effect(pair, difference, 0.001, metric="ssim")))["table4-nerf_phi_encoding-ssim"]
        assert (claim.printed, claim.verdict) == (0.006, verdict)


def test_quick_evidence_judges_nothing(whole: Records):
    quick = replace(study(effect(LISTING_2, -2.5)), settings={"quick": True})
    assert (judged(whole, quick)[CLAIM].verdict, judged(whole, quick)[CLAIM].measured) == (UNTESTED, None)


def test_what_speaks_against_the_evidence_is_said(whole: Records):
    sound = study(effect(LISTING_2, -2.5))
    assert "not" not in judged(whole, sound)[CLAIM].note.removesuffix(DERIVED)
    assert "the evidence was not finished" in judged(whole, replace(sound, finished=False))[CLAIM].note
    checks = [check("share of A/A comparisons", 0.2, high=0.05), check("share of planted effects", 0.9, low=0.8)]
    failing = StudyRecord(StudyInfo("calibration", "title", "question?", "method"), findings=checks)
    doubted = judged(whole, replace(sound, studies=[*sound.studies, failing]))[CLAIM]
    assert "1 of 2 checks of calibration failed" in doubted.note


def test_what_is_left_untested_of_the_ablation_is_said_and_only_that(whole: Records):
    steps = (("nerf_phi_encoding", "nerf"), LISTING_2, ("qnerf", "nerf_phi_encoding_amplifier"))
    every = [effect(pair, 0.1, metric=metric) for pair in steps for metric in ("psnr", "ssim")]

    def said(evidence: Studies | None) -> list[str]:
        return [one for one in summary(whole, Beside(evidence=evidence))["not_tested"] if "ablation" in one]

    assert said(study(*every)) == []
    assert said(None) == ["6 claims need the ablation study: `nox -s evidence -- --out out/latest`."]
    assert said(study(*every[1:])) == ["1 claim needs the ablation study: `nox -s evidence -- --out out/latest`."]
    assert "6 claims need the ablation study: <code>nox -s evidence" in page(whole)


def test_what_is_published_is_judged_by_the_same_evidence(whole: Records, tmp_path):
    write_published(whole, tmp_path, Beside(evidence=study(effect(LISTING_2, -2.5))))
    rows = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))["claims"]
    row = next(row for row in rows if row["id"] == CLAIM)
    assert (row["measured"], row["verdict"]) == (-2.5, "not seen at this scale")
