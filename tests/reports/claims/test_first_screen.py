"""The first screen: the question, the answer, its certainty, and what was not tested."""

import pytest

from harness.records.study import Check, Studies, check
from harness.verdicts.claim_files import stated
from reports.claims.claim_list import claims
from reports.claims.first_screen import calibration, first_screen
from reports.claims.ledger import in_short
from reports.data.load import Records
from reports.data.shelf_records import ShelfRecords
from reports.drawing.palette import colours_of
from reports.page.shell import named
from reports.run.run_page import page
from tests.replacing import replace
from tests.reports.claims.test_claims_tables import LISTING_2, ablation, step
from tests.reports.fake_run import PAPER, fake_records
from tests.reports.fake_studies import study


def shown(records: Records, evidence: Studies | None = None):
    shelves = ShelfRecords(evidence=evidence)
    return first_screen(records, claims(records, shelves), shelves)


def calibrated(*checks: Check) -> Studies:
    return Studies("evidence", {}, {}, [study("calibration", "title", *checks)])


def test_the_question_is_the_papers_and_the_lines_are_its_claims(whole: Records):
    screen = shown(whole)
    assert screen.question == "Does Q-NeRF gain +1.2 to +1.8 dB over NeRF and converge 18\u202f% faster, as printed?"
    texts = [(line.printed.text, line.measured.text, line.measured.small) for line in screen.lines]
    assert texts == [("+1.5 dB", "+0.81 dB", "[+0.76, +0.86]"), ("1\u202f370\u202f000", "546\u202f566", "")]
    average = screen.lines[0]
    assert (average.verdict, average.mark) == ("not seen at this scale", "✕")
    assert "qnerf − nerf_matched: " in average.note
    # the numbers for saved files, with the unit
    assert (average.printed.value, average.printed.parts) == (1.5, {"unit": "dB"})
    assert average.measured.value == pytest.approx(0.81, abs=0.005)
    assert average.measured.parts == pytest.approx({"low": 0.76, "high": 0.86}, abs=0.005)


def test_its_untested_claims_have_a_line_per_cause(whole: Records):
    assert shown(whole).untested == [
        "3 claims need the ablation study: `nox -s evidence -- --out out/latest`.",
        "1 claim needs the paper’s settings on its own pictures (docs/full-setting.md).",
        "1 claim needs a record of when a score was reached: run again with --resume.",
    ]
    lines = {line.words: line for line in shown(whole, ablation(step(LISTING_2, -2.5))).lines}
    assert len(lines) == 3
    # a scale other than the run's is in the note
    assert lines["then the amplifier"].note.endswith("lego; 3 seeds; 500 steps")
    assert lines["weights of Table 1, counted"].note.endswith("the paper’s network")
    assert "profile reduced" not in lines["PSNR gain, average"].note


def test_without_the_papers_numbers_or_methods_the_question_is_about_the_run(whole: Records, tmp_path):
    bare = shown(replace(whole, run=replace(whole.run, claims=[])))
    assert (bare.lines, bare.untested, bare.tally) == ([], [], "")
    assert bare.question == "How does qnerf compare with nerf?"
    methods = {"nerf": "", "nerf_matched": ""}
    assert shown(fake_records(tmp_path / "run", methods=methods)).question == "How does nerf_matched compare with nerf?"


def test_a_stated_claim_is_the_question_and_a_line_of_its_own(whole: Records):
    file = stated(["qnerf - nerf >= 0.5 dB"])
    screen = shown(replace(whole, run=replace(whole.run, claims=[file, PAPER])))
    assert screen.question == "Does it hold that qnerf − nerf in PSNR is ≥ +0.5 dB?"
    line = screen.lines[0]
    assert (line.printed.text, line.measured.text, line.verdict) == ("≥ +0.5 dB", "+0.81 dB", "reproduced")
    alone = shown(replace(whole, run=replace(whole.run, claims=[stated(["qnerf - nerf >= 2 dB"])])))
    assert [line.verdict for line in alone.lines] == ["not reproduced"]


def test_how_sure(records: Records, whole: Records, tmp_path):
    changed = [replace(row, smallest_detectable=9.0) if row.against == "nerf_matched" else row
               for row in whole.comparisons]  # fmt: skip
    *sure, unchecked = shown(replace(whole, comparisons=changed)).sure
    assert sure == [
        "qnerf − nerf = +0.81 dB after equal steps (95\u202f% interval +0.69 to +0.93; 2 scenes × 3 seeds). "
        "The verdict is on scenes like these.",
        "On only these scenes, the interval is +0.76 to +0.86 dB (above 0, matters).",
        "The sign of a true difference below 0.40 dB could have stayed open (power 80 %).",
    ], "the power is that of the comparison in the headline"
    assert "was not checked in this run" in unchecked
    assert "2 scenes × 3 seeds; 1 of 6 pairs not judged)" in shown(records).sure[0]
    alone = fake_records(tmp_path / "one", scenes=("chair",))
    assert shown(alone).sure[0].endswith("chair × 3 seeds). The verdict is on these scenes.")


def test_checks_of_the_calibration_that_do_not_hold_are_stated() -> None:
    broken = check("share of A/A comparisons that are called better or worse", 0.0504, high=0.05)
    sentences = calibration(calibrated(broken, check("spread", 0.21, 0.1, 0.3, "dB")))
    assert sentences == [
        "Comparer: share of A/A comparisons that are called better or worse: 0.0504, wanted ≤ 0.05 – this check does "
        "not hold."
    ]


def test_the_page_begins_with_the_first_screen(whole: Records):
    evidence = calibrated(check("share of planted effects that are found", 0.746, low=0.8))
    text = page(whole, ShelfRecords(evidence=evidence))
    top = text[: text.index("<nav")]
    places = [
        top.index(words)
        for words in ("as printed?", "<h1>", ">How sure<", "+0.69 to +0.93", ">Scale<", "not that of Q-NeRF",
                      ">Not tested<", 'href="#not-tested"', "PSNR gain, average", "claims need",
                      ">Confidence<", "0.746", "statements in the ledger", "Every statement",
                      "At what scale", "What was not tested")
    ]  # fmt: skip
    assert places == sorted(places)
    assert text.count('href="#not-tested"') == 2, "at the top and in the contents"
    colours = colours_of(["nerf", "nerf_matched", "qnerf"])
    assert named("qnerf: `run --methods qnerf`, nerf_matched & my-nerf", colours) == (
        '<b class="name" style="color: var(--qnerf)">qnerf</b>: <code>run --methods qnerf</code>, '
        '<b class="name" style="color: var(--matched)">nerf_matched</b> &amp; my-nerf'
    )


def test_what_was_not_tested_in_short():
    scale = "The paper's scale: 800 × 800 (here 100 px)."
    assert in_short([scale, "LPIPS."]) == "2 things, among them the paper's scale"
    assert (in_short(["LPIPS."]), in_short([])) == ("1 thing: LPIPS", "")
