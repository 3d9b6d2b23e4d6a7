"""The title and the sentences of the result, and the first screen: question, answer, certainty, what was not tested."""

import numpy as np
import pytest

from harness.records.cells import Comparison, Flagged, Robust, Roles
from harness.records.study import Check, Studies, check
from harness.records.verdict import OPEN, Verdict
from harness.verdicts.changes import change_of
from harness.verdicts.claim_files import stated
from reports.claims.claim_list import claims
from reports.claims.first_screen import calibration, first_screen
from reports.claims.headline import control_of, duels, headline, title_of
from reports.claims.ledger import in_short
from reports.data.load import Records
from reports.data.outcome import Outcome, change_in_words, clause, clauses, doubts, robust_differs, robust_in_words
from reports.data.studies_load import ShelfRecords
from reports.drawing.palette import colours_of
from reports.page.shell import named
from reports.run.run_page import page
from tests.replacing import replace
from tests.reports.claims.test_claims import LOST, with_comparisons, with_run
from tests.reports.claims.test_claims_tables import LISTING_2, ablation, step
from tests.reports.fake_run import METHODS, PAPER, fake_records
from tests.reports.fake_studies import study

ABOVE, BELOW = Verdict("above 0", "open"), Verdict("below 0", "smaller than matters")
MORE, SMALL = Verdict("above 0", "matters"), Verdict("open", "smaller than matters")


def decided(records: Records, **verdicts: Verdict) -> Records:
    """Return the run with verdicts of qnerf set by `rival_budget`."""
    changed = [
        replace(row, verdict=verdicts.get(f"{row.against}_{row.budget}", row.verdict)) if row.method == "qnerf" else row
        for row in records.comparisons
    ]
    return replace(records, comparisons=changed)


def outcome(verdict: Verdict, *differences: float, against: str = "nerf", by_scene: tuple[float, ...] = ()) -> Outcome:
    return Outcome("qnerf", against, differences, verdict, by_scene)


EITHER = "and so is whether it reaches the 0.2 dB that matter"


@pytest.mark.parametrize(
    ("difference", "words"),
    [
        (outcome(MORE, 0.81), "qnerf gains 0.81 dB over nerf, more than the 0.2 dB that matter"),
        (outcome(BELOW, -0.1), "qnerf loses 0.10 dB to nerf, less than the 0.2 dB that matter"),
        (outcome(ABOVE, 0.14), "qnerf gains 0.14 dB over nerf (size open)"),
        (outcome(SMALL, 0.0), "the sign of qnerf − nerf is open (0.00 dB), its size below the 0.2 dB that matter"),
        (outcome(OPEN, -0.3, by_scene=(-0.3,) * 8), f"the sign of qnerf − nerf is open (−0.30 dB), {EITHER}"),
        (outcome(OPEN, 0.1, 0.12), f"the sign of qnerf − nerf is open (+0.10 to +0.12 dB in two runs), {EITHER}"),
        (outcome(ABOVE, 0.137, 0.12, 0.14), "qnerf gains 0.12 to 0.14 dB (three runs) over nerf (size open)"),
        (outcome(OPEN, -3.0, by_scene=(-2.0, -4.0)),
         "qnerf is 3.00 dB below nerf on both scenes; two scenes are too few to predict others"),
        (outcome(OPEN, 0.1, by_scene=(1.0, -1.0, 0.3)),
         "qnerf − nerf is +1.00, −1.00 and +0.30 dB on the three scenes; three scenes are too few to predict others"),
    ],
)  # fmt: skip
def test_a_clause_has_sign_and_size(difference: Outcome, words: str) -> None:
    assert clause(difference) == words


@pytest.mark.parametrize(
    ("vs_control", "words"),
    [
        (None, ""),
        (outcome(MORE, 0.5, against="nerf_matched"),
         "; over nerf_matched, which has the same bandwidth, qnerf gains 0.50 dB, more than the 0.2 dB that matter"),
        (outcome(BELOW, -0.1, against="nerf_matched"),
         "; nerf_matched, which has the same bandwidth, scores 0.10 dB more, less than the 0.2 dB that matter"),
        (outcome(SMALL, 0.0, against="nerf_matched"),
         "; the sign of qnerf − nerf_matched is open (0.00 dB), its size below the 0.2 dB that matter: nerf_matched, "
         "which has the same bandwidth, may do as well"),
    ],
)  # fmt: skip
def test_the_control_follows_the_baseline(vs_control: Outcome | None, words: str) -> None:
    judged = [each for each in (outcome(MORE, 0.81), vs_control) if each]
    assert title_of(judged, "qnerf", "nerf", "nerf_matched", "here") == f"{clause(judged[0])}{words} (here)"


def test_if_nothing_is_known_of_any_pair_one_clause_says_so() -> None:
    both = outcome(OPEN, 0.137, 0.12), outcome(OPEN, -0.3, against="nerf_matched")
    four = [*both, *(replace(each, method="other") for each in both)]
    open_size = "and differences of 0.2 dB or more are not excluded"
    shown = f"shown to differ from nerf or nerf_matched (−0.30 to +0.14 dB), {open_size}"
    assert title_of(both, "qnerf", "nerf", "nerf_matched", "here", ["", "lost"]) == f"qnerf is not {shown} (here); lost"
    assert title_of(four, "qnerf", "nerf", "nerf_matched", "here") == f"Neither qnerf nor other is {shown} (here)"
    few = outcome(OPEN, -3.0, by_scene=(-2.0, -4.0))
    for others in (both[:1], (both[1], few), (outcome(SMALL, 0.0), both[1]), four[:3]):
        assert clauses(others) == "; ".join(map(clause, others))


def test_that_scenes_are_few_is_said_once() -> None:
    on_two = outcome(OPEN, -3.0, by_scene=(-2.0, -4.0))
    other = replace(on_two, method="other", against="nerf_matched")
    known = "qnerf is 3.00 dB below nerf on both scenes; other is 3.00 dB below nerf_matched on both scenes"
    words = f"{known}; two scenes are too few to predict others"
    assert clauses([on_two, other]) == words
    assert title_of([on_two, other], "qnerf", "nerf", None, "here") == f"{words} (here)"


def test_a_gain_of_the_control_itself_is_that_of_bandwidth() -> None:
    gain = replace(outcome(MORE, 0.3), method="nerf_matched")
    alone = f"{clause(gain)}: bandwidth, and constants of its own, make this difference (here)"
    assert title_of([gain], "nerf_matched", "nerf", "nerf_matched", "here") == alone
    lost = "No comparison of qnerf with nerf could be made"
    assert title_of([gain], "qnerf", "nerf", None, "here") == f"{lost}; {clause(gain)} (here)"
    assert title_of([], "qnerf", "nerf", None, "") == lost


RISING = "; training was not finished (twice the steps brought 0.3 dB)"


def test_the_headline_names_both_rivals_and_the_change_from_steps_to_time(whole: Records):
    records = decided(whole, nerf_steps=ABOVE, nerf_seconds=ABOVE, nerf_matched_steps=SMALL, nerf_matched_seconds=BELOW)
    shown = headline(records)
    assert shown.title.startswith("qnerf gains 0.81 dB over nerf (size open);")
    assert shown.title.endswith(f"(at equal steps, on scenes like these){RISING}")
    means = "Mean test PSNR over 2 scenes: nerf 23.35 dB, nerf_matched 24.26 dB and qnerf 24.16 dB."
    assert shown.sentences[0] == means
    assert "comes from bandwidth" in shown.sentences[1]
    assert shown.sentences[2].startswith("From equal steps to equal training time: qnerf − nerf changes by ")
    assert "; qnerf − nerf_matched changes by " in shown.sentences[2]
    assert [(duel.method, duel.against) for duel in duels(records)] == [("qnerf", "nerf"), ("qnerf", "nerf_matched")]


def test_a_change_from_steps_to_time_is_judged_as_one(whole: Records):
    """The verdicts at steps and at time do not matter: the change has its own interval."""
    same = {f"{rival}_{budget}": ABOVE for rival in ("nerf", "nerf_matched") for budget in ("steps", "seconds")}
    records = decided(whole, **same)
    shown = headline(records)
    assert shown.title.endswith(f"(at equal steps, on scenes like these){RISING}")
    flat = [replace(cell, curve=[replace(point, psnr=20.0) for point in cell.curve]) for cell in records.cells]
    assert headline(replace(records, cells=flat)).title == shown.title.removesuffix(RISING)
    other = {name: BELOW if name.endswith("seconds") else ABOVE for name in same}
    assert headline(decided(whole, **other)).sentences == shown.sentences

    def slower(cell):
        curve = [replace(point, seconds=100 * point.seconds) for point in cell.curve]
        return replace(cell, curve=curve, train_seconds=1e4) if cell.method == "qnerf" else cell

    slow = replace(records, cells=[slower(cell) for cell in records.cells])
    assert headline(slow).sentences[-1] != shown.sentences[-1]


def test_further_contenders_share_a_sentence(whole: Records) -> None:
    further = ("first", "second", "third")

    def repeated(rows: list) -> list:
        return rows + [replace(row, method=name) for name in further for row in rows if row.method == "qnerf"]

    names = [*whole.methods, *further]
    run = replace(whole.run, methods=dict.fromkeys(names, ""), settings={**whole.run.settings, "methods": names})
    several = replace(whole, run=run, cells=repeated(whole.cells), comparisons=repeated(whole.comparisons))
    means, others, *_ = headline(several).sentences
    assert all(name in means for name in names)
    title = headline(several).title
    assert title.startswith("qnerf gains 0.81 dB over nerf")
    assert "; first gains 0.81 dB over nerf" in title
    assert "second" not in title
    assert others.startswith("At equal steps, second ")
    assert others.count("nerf_matched") == 2
    assert "third" in others
    assert "first" not in others
    assert not any(words.startswith("At equal steps") for words in headline(whole).sentences)


def test_lost_cells_are_in_the_title(records: Records, whole: Records):
    title = headline(records).title
    assert title.startswith("qnerf gains "), "others are judged"
    assert title.endswith(f"on scenes like these){RISING}; qnerf lost 1 of its 6 runs")
    cells = [replace(whole.cells[0], status="error"), *whole.cells[1:]]
    baselines = headline(decided(replace(whole, cells=cells), nerf_steps=OPEN))
    assert baselines.title.startswith("qnerf is 0.81 dB above nerf on both scenes; two scenes are too few to predict")
    assert baselines.title.endswith("; nerf lost 1 of its 6 runs")
    assert baselines.sentences[0].endswith("Lost runs are not in these means: nerf lost 1 of its 6 runs.")
    lost = [cell for cell in records.cells if (cell.scene, cell.seed) == ("drums", 2)]
    never = headline(replace(records, cells=lost))
    assert never.title == "qnerf diverged, failed or collapsed in every run: nothing can be said of its quality"
    cells = [replace(cell, status="not_available") if cell.method == "qnerf" else cell for cell in whole.cells]
    assert headline(replace(whole, cells=cells)).title == "qnerf was not available: nothing can be said of it"


def test_other_methods_and_roles(whole: Records, tmp_path):
    def headline_of(*names: str):
        methods = {name: METHODS[name] for name in names}
        return headline(fake_records(tmp_path / "_".join(names), methods=methods, seeds=2))

    two = headline_of("nerf", "qnerf")
    assert not any("bandwidth" in sentence for sentence in (two.title, *two.sentences))
    assert headline_of("nerf").title == "Only nerf was run: there is nothing to compare it with"
    listed = with_run(whole, methods={"nerf": "", "nerf_matched": "", "qnerf_theorem": "", "qnerf": ""})
    assert (listed.baseline, listed.control) == ("nerf", "nerf_matched")
    assert listed.contenders == ["qnerf_theorem", "qnerf"]
    given = with_run(listed, roles=Roles("qnerf"))
    assert (given.baseline, given.control) == ("qnerf", None)
    assert given.contenders == ["nerf", "nerf_matched", "qnerf_theorem"]


@pytest.mark.parametrize(("encoding", "missing"), [("phi", True), ("base2", False), (None, False)])
def test_a_missing_bandwidth_control_is_named_if_the_encoding_differs(whole: Records, encoding, missing: bool) -> None:
    own = {"nerf": {"encoding": "base2"}, "qnerf": {"encoding": encoding} if encoding else {"planes": 3}}
    train = {**whole.run.settings["train"], "own": own}
    methods = {name: METHODS[name] for name in ("nerf", "qnerf")}
    run = replace(whole.run, methods=methods, settings={**whole.run.settings, "train": train})
    cells = [cell for cell in whole.cells if cell.method in methods]
    sentences = headline(replace(whole, run=run, cells=cells)).sentences
    assert any("No method with the bandwidth of qnerf was run" in sentence for sentence in sentences) is missing


ROW = Comparison("all", "qnerf", "nerf", "psnr", "steps", 0.15, None, OPEN, None, 24, 0, None, 6, None, None)


def test_a_robust_estimate_is_stated_if_it_disagrees() -> None:
    agreeing = (None, Robust(-0.3, (-0.7, 0.15)), Robust(-0.04, None))
    outside, apart = Robust(0.2, (0.16, 0.5)), Robust(0.36, None)  # apart: by more than 0.2 dB
    for robust in (*agreeing, outside, apart):
        row = replace(ROW, robust=robust)
        differs = robust not in agreeing
        assert robust_differs(row) == bool(robust_in_words(row)) == bool(list(doubts(row))) == differs, robust
        assert not robust_differs(replace(row, difference=None))


def test_one_bad_cell_and_the_robust_estimate_are_stated() -> None:
    flagged = [Flagged("chair", 1, -2.7, 0.31)]
    row = replace(ROW, difference=-0.1, robust=Robust(0.3, (0.21, 0.4)), flagged=flagged)
    assert list(doubts(row)) == [
        "The mean of qnerf − nerf at equal steps, −0.10 dB, is not that of most cells: robust: +0.30 [+0.21, +0.40].",
        "Off all others of qnerf − nerf at equal steps, whose median is +0.31: chair, seed 1 (−2.70).",
    ]
    assert list(doubts(None)) == []


def test_a_change_is_stated_with_its_interval_and_its_scenes() -> None:
    moved = np.array([-0.3, -0.4, -0.5, 0.1])
    tables = [{str(k): np.full(3, value) for k, value in enumerate(side)} for side in (np.zeros(4), moved)]
    change = change_of("qnerf", "nerf", *tables, paired=True)
    assert change_in_words(change) == (
        "qnerf − nerf changes by −0.28 dB [−0.69, +0.14], on 3 of 4 scenes in that direction: sign and size open"
    )


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
    bare = shown(with_run(whole, claims=[]))
    assert (bare.lines, bare.untested, bare.tally) == ([], [], "")
    assert bare.question == "How does qnerf compare with nerf?"
    methods = {"nerf": "", "nerf_matched": ""}
    assert shown(fake_records(tmp_path / "run", methods=methods)).question == "How does nerf_matched compare with nerf?"


def test_a_stated_claim_is_the_question_and_a_line_of_its_own(whole: Records):
    file = stated(["qnerf - nerf >= 0.5 dB"])
    screen = shown(with_run(whole, claims=[file, PAPER]))
    assert screen.question == "Does it hold that qnerf − nerf in PSNR is ≥ +0.5 dB?"
    line = screen.lines[0]
    assert (line.printed.text, line.measured.text, line.verdict) == ("≥ +0.5 dB", "+0.81 dB", "reproduced")
    assert screen.claimed == "", "the heading states it"
    lost = with_comparisons(with_run(whole, claims=[file]), drums=LOST)
    assert shown(lost).lines[0].verdict == "inconclusive", "a lost scene answers no claim about all scenes"
    alone = shown(with_run(whole, claims=[stated(["qnerf - nerf >= 2 dB"])]))
    assert [line.verdict for line in alone.lines] == ["not reproduced"]


@pytest.mark.parametrize(
    ("lines", "question", "title"),
    [
        (["qnerf - nerf >= 0.5 dB"], "Does it hold that qnerf − nerf in PSNR is ≥ +0.5 dB?",
         f"Yes: qnerf − nerf in PSNR is +0.81 dB [+0.76, +0.86]; claimed: ≥ +0.5 dB{RISING}"),
        (["nerf_matched - nerf >= 2 dB"], "Does it hold that nerf_matched − nerf in PSNR is ≥ +2.0 dB?",
         f"No: nerf_matched − nerf in PSNR is +0.91 dB [+0.86, +0.96]; claimed: ≥ +2.0 dB{RISING}"),
        (["qnerf - silu >= 2 dB"], "Does it hold that qnerf − silu in PSNR is ≥ +2.0 dB?",
         f"Not tested: this would need a run of qnerf and silu; claimed: ≥ +2.0 dB{RISING}"),
        (["qnerf - nerf >= 0.5 dB", "nerf_matched - nerf >= 2 dB"], "Do the 2 stated claims hold?",
         "Of 2 stated claims, 1 is reproduced and 1 is not reproduced"),
    ],
)  # fmt: skip
def test_the_headline_answers_the_stated_claims(whole: Records, lines: list[str], question: str, title: str) -> None:
    asked = with_run(whole, claims=[stated(lines), PAPER])
    found = headline(asked)
    assert (shown(asked).question, found.title) == (question, title)
    assert found.sentences[0] == f"{headline(whole).title}."
    assert found.sentences[1:] == headline(whole).sentences


@pytest.mark.parametrize("line", ["qnerf - nerf >= 0.1 ssim", "qnerf - nerf >= 1 dB on chair", "nerf >= 20 dB"])
def test_how_sure_says_nothing_of_other_differences_than_the_claims(whole: Records, line: str) -> None:
    sure = shown(with_run(whole, claims=[stated([line])])).sure
    assert not any("interval is" in sentence or "dB after equal steps" in sentence for sentence in sure)


def test_a_saving_is_by_a_percentage(whole: Records) -> None:
    asked = with_run(whole, claims=[stated(["qnerf - nerf >= 18 % steps"])])
    assert shown(asked).question.endswith(" by ≥ 18\u202f%?")


def test_how_sure_a_stated_claim_is(whole: Records) -> None:
    sure = shown(with_run(whole, claims=[stated(["nerf_matched - nerf >= 2 dB"])])).sure
    assert sure[0].startswith("nerf_matched − nerf = +0.91 dB after equal steps (95")
    assert sure[0].endswith("The interval is on scenes like these; the claim is judged on only these scenes.")
    assert sure[1].startswith("On only these scenes, the interval is +0.86 to +0.96 dB")


def test_how_sure_it_is(records: Records, whole: Records, tmp_path):
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


def test_checks_of_the_calibration_that_do_not_hold_are_stated():
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
        for words in ("as printed?", "<h1>", "PSNR gain, average: claimed +1.5 dB, not seen at this scale.",
                      ">How sure<", "+0.69 to +0.93", ">Scale<", "not that of Q-NeRF",
                      ">Not tested<", 'href="#not-tested"', "Is it as claimed?", "claims need",
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


NERF = {"encoding": "base2", "skip": "half", "density_scale": 10.0, "start": 3.0}
MATCHED = {**NERF, "encoding": "base2_matched", "density_scale": 3.0, "start": None}


@pytest.mark.parametrize(
    ("own", "control"),
    [
        ({"nerf": NERF, "nerf_matched": MATCHED, "qnerf": {**NERF, "encoding": "phi"}}, "nerf_matched"),
        ({"nerf": NERF, "nerf_matched": {**MATCHED, "skip": "phi"}, "qnerf": {**NERF, "encoding": "phi"}}, None),
        ({"nerf": NERF, "nerf_matched": MATCHED, "qnerf": {"cells": [16, 32]}}, None),
        ({"nerf": {"nodes": [32]}, "nerf_matched": MATCHED, "qnerf": {**NERF, "encoding": "phi"}}, None),
        ({}, "nerf_matched"),
    ],
)
def test_a_control_of_bandwidth_is_one_only_for_methods_like_it(whole: Records, own: dict, control: str | None) -> None:
    run = with_run(whole, settings={"train": {"own": own}})
    assert control_of(run, "qnerf") == control
    said = "with its encoding cut down" in " ".join(headline(run).sentences)
    assert said == (control is not None)


def test_what_was_not_tested_in_short():
    scale = "The paper's scale: 800 × 800 (here 100 px)."
    assert in_short([scale, "LPIPS."]) == "2 things, among them the paper's scale"
    assert (in_short(["LPIPS."]), in_short([])) == ("1 thing: LPIPS", "")
