"""Table 4 from the factorial study, or from the run itself."""

import json

import pytest

from harness.records.cells import Comparison, Estimate
from harness.records.study import Effect, Studies, check
from harness.records.verdict import OPEN
from reports.claims.scores import NEEDS_STUDY
from reports.data.load import Records
from reports.data.selection import Selection
from reports.data.shelf_records import ShelfRecords
from reports.data.wording import UNTESTED
from reports.run.saving.publish import summary, write_published
from tests.replacing import replace
from tests.reports.claims.claimed import claimed
from tests.reports.fake_studies import effect, study

LISTING_2 = ("nerf_phi_encoding_amplifier", "nerf_phi_encoding")
EQUATION_4 = ("nerf_phi_encoding_equation4", "nerf_phi_encoding")
CLAIM = "table4-nerf_phi_encoding_amplifier-psnr"
DERIVED = "what is printed are rounded totals: this step is between +0.5 and +0.7 dB"
MISSED = "not seen at this scale"


def step(pair: tuple[str, str], difference: float | None, half: float = 0.1, **changes) -> Effect:
    made = effect(*pair, difference, half, **{"scene": "lego", "verdict": OPEN, "pairs": 3, **changes})
    return replace(made, on_these_scenes=Estimate(made.interval, made.simultaneous, 3, OPEN, 0.3, None))


def ablation(*effects: Effect) -> Studies:
    record = study("factorial", "title", *effects, scale="lego; 3 seeds; 500 steps")
    return Studies("evidence", {}, {}, [record], finished=True)


@pytest.mark.parametrize(
    ("difference", "changes", "verdict"),
    [
        (-2.5, {}, MISSED),
        (0.25, {}, "inconclusive"),
        (0.6, {}, "seen"),
        (2.0, {}, MISSED),
        (None, {}, UNTESTED),
        (-2.5, {"pairs": 2}, "inconclusive"),
        (-2.5, {"unpaired": 1}, MISSED),
        *((0.9, {name: other}, UNTESTED) for name, other in (("scene", "all"), ("metric", "ssim"), ("name", "qnerf"))),
        *((0.9, {name: other}, UNTESTED) for name, other in (("budget", "seconds"), ("against", "nerf"))),
    ],
)
def test_a_part_is_judged_against_the_row_above_it_on_lego_at_equal_steps(whole: Records, difference, changes, verdict):
    claim = claimed(whole, ablation(step(LISTING_2, difference, **changes)))[CLAIM]
    assert (claim.printed, claim.verdict) == (0.6, verdict)
    assert claim.runs is None, "the study's runs are not the report's"
    assert claim.measured == (None if verdict == UNTESTED else difference)
    if "unpaired" in changes:
        assert claim.note == f"1 pair could not be judged; {DERIVED}"
    if verdict != UNTESTED and not changes:
        assert claim.scale == "lego; 3 seeds; 500 steps"
        assert claim.interval == pytest.approx((difference - 0.3, difference + 0.3)), "that of its family"


def test_equation_4_is_in_the_note_and_not_judged(whole: Records):
    claim = claimed(whole, ablation(step(LISTING_2, -2.5), step(EQUATION_4, 0.61, verdict=OPEN)))[CLAIM]
    assert claim.verdict == MISSED
    assert claim.note == f"with the amplifier of Eq. 4: +0.61 [+0.31, +0.91] (sign and size open); {DERIVED}"
    alone = claimed(whole, ablation(step(EQUATION_4, 0.61)))[CLAIM]
    assert (alone.verdict, alone.measured) == (UNTESTED, None)


def test_the_runs_own_comparison_comes_before_the_study(whole: Records):
    here = Estimate((0.0, 0.2), (0.0, 0.2), 1, OPEN, 0.1, 1.0)
    own = Comparison("lego", *LISTING_2, "psnr", "steps", 0.1, (0.0, 0.2), OPEN, 0.1, 3, 0, None, 1, here, None)
    records = replace(whole, comparisons=[*whole.comparisons, own])
    for evidence in (None, ablation(step(LISTING_2, 0.6))):
        claim = claimed(records, evidence)[CLAIM]
        assert (claim.measured, claim.verdict) == (0.1, MISSED)
        assert claim.runs == Selection("lego", *LISTING_2, "psnr", "steps")
    missing = claimed(whole)[CLAIM]
    assert (missing.verdict, missing.note) == (UNTESTED, NEEDS_STUDY)


def test_ssim_has_its_own_margin(whole: Records):
    pair = ("nerf_phi_encoding", "nerf")
    for difference, verdict in ((0.007, "seen"), (0.02, MISSED)):
        claim = claimed(whole, ablation(step(pair, difference, 0.001, metric="ssim")))["table4-nerf_phi_encoding-ssim"]
        assert (claim.printed, claim.verdict) == (0.006, verdict)


def test_doubts_about_the_evidence_are_in_the_note_and_quick_evidence_judges_nothing(whole: Records):
    valid = ablation(step(LISTING_2, -2.5))
    assert claimed(whole, valid)[CLAIM].note == DERIVED
    assert "the evidence was not finished" in claimed(whole, replace(valid, finished=False))[CLAIM].note
    checks = [check("share of A/A comparisons", 0.2, high=0.05), check("share of planted effects", 0.9, low=0.8)]
    doubted = claimed(whole, replace(valid, studies=[*valid.studies, study("calibration", "title", *checks)]))[CLAIM]
    assert "1 of 2 checks of calibration failed" in doubted.note
    quick = claimed(whole, replace(valid, settings={"quick": True}))[CLAIM]
    assert (quick.verdict, quick.measured) == (UNTESTED, None)


@pytest.mark.parametrize(("left_out", "needs"), [(0, []), (1, ["1 claim needs"]), (6, ["6 claims need"])])
def test_the_untested_claims_of_the_ablation_are_counted(whole: Records, left_out: int, needs: list[str]):
    steps = (("nerf_phi_encoding", "nerf"), LISTING_2, ("qnerf", "nerf_phi_encoding_amplifier"))
    every = [step(pair, 0.1, metric=metric) for pair in steps for metric in ("psnr", "ssim")]
    sentences = summary(whole, ShelfRecords(evidence=ablation(*every[left_out:])))["not_tested"]
    remedy = "the ablation study: `nox -s evidence -- --out out/latest`."
    assert [words for words in sentences if "ablation" in words] == [f"{start} {remedy}" for start in needs]


def test_published_claims_are_judged_by_the_same_evidence(whole: Records, tmp_path):
    write_published(whole, tmp_path, ShelfRecords(evidence=ablation(step(LISTING_2, -2.5))))
    rows = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))["claims"]
    row = next(row for row in rows if row["id"] == CLAIM)
    assert (row["measured"], row["verdict"]) == (-2.5, MISSED)
