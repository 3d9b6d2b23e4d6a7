"""The claims of Tables 1 to 4 and of §8: the paper's own figures, times, the parts of Table 4, cache and attention."""

import json
from pathlib import Path

import pytest

from harness.records.cells import Comparison, Estimate
from harness.records.study import Check, Effect, Studies, check
from harness.records.targets import TargetComparison, TargetsRecord, write_targets
from harness.records.verdict import OPEN
from reports.claims.claim_list import claims
from reports.claims.ledger import OWN_FIGURES, Bench, Claim, Finding, not_tested
from reports.claims.scores import NEEDS_STUDY
from reports.claims.table import claims_grid
from reports.claims.time import NEEDS_MACHINE, NEEDS_SCENES, bound, saving, time_to_target
from reports.data.load import Records, read_records
from reports.data.selection import TARGET, Selection
from reports.data.studies_load import ShelfRecords
from reports.data.wording import UNTESTED
from reports.run.saving.publish import write_summary
from tests.replacing import replace
from tests.reports.claims.test_claims import MISSED, claimed
from tests.reports.fake_run import PAPER
from tests.reports.fake_studies import earlier, effect, fake_serving, hit, phi, stale, study

LEDGER = {entry.id: entry for entry in PAPER.claims}


def figured(whole: Records, name: str, printed: float | None = None, **tables: dict) -> Claim:
    """Judge a single claim, with another printed number or other rows of tables."""
    entry = LEDGER[name] if printed is None else replace(LEDGER[name], printed=printed)
    psnr = {"psnr": tables.pop("psnr")} if "psnr" in tables else {}
    paper = replace(PAPER, **psnr, tables={**PAPER.tables, **tables}, claims=(entry,))
    (claim,) = claims(replace(whole, run=replace(whole.run, claims=[paper])))
    return claim


def changed(table: str, row: str, **values: float) -> dict:
    rows = PAPER.psnr if table == "psnr" else PAPER.tables[table]
    return {table: {**rows, row: {**rows[row], **values}}}


SLOWER = changed("times", "hours_to_30_db", qnerf=3.7)


@pytest.mark.parametrize(
    ("name", "verdict", "measured", "tables"),
    [
        ("eq3-last-band", "not reproduced", 9, {}),
        ("eq3-last-band", "reproduced", 9, {"printed": 9}),
        ("table1-skip", "reproduced", 6, {}),
        ("table1-skip", "not reproduced", 6, {"printed": 5}),
        ("table1-sum", "reproduced", 1_367_257, {}),
        ("table1-sum", "reproduced", 1_367_257, {"printed": 1_400_000}),
        ("table1-sum", "not reproduced", 1_367_257, {"printed": 1_510_000}),
        ("table2-differences", "reproduced", 9, {}),
        ("table2-differences", "reproduced", 9, changed("psnr", "mic", delta=1.6)),
        ("table2-differences", "not reproduced", 8, changed("psnr", "mic", delta=1.7)),
        ("table2-means", "reproduced", 3, {}),
        ("table2-means", "not reproduced", 2, changed("psnr", "mic", qnerf=35.5)),
        ("table2-range", "reproduced", (1.2, 1.8), {}),
        ("table2-range", "not reproduced", (1.1, 1.8), changed("psnr", "drums", delta=1.1)),
        ("setup-scenes", "reproduced", 8, {}),
        ("table2-source", "inconclusive", 8, {}),
        ("table2-source", "inconclusive", 7, changed("psnr", "mic", nerf=33.1)),
        ("table2-source", UNTESTED, None, {"original": {"fern": 25.2}}),
        ("table3-speedup-iterations", "reproduced", 18.0, {}),
        ("table3-speedup-hours", "inconclusive", 100 * (1 - 3.4 / 4.2), {}),
        ("table3-speedup-hours", "not reproduced", 100 * (1 - 3.7 / 4.2), SLOWER),
        ("table3-final", "reproduced", 2, {}),
        ("table3-final", "not reproduced", 1, changed("psnr", "average", qnerf=32.4)),
        ("table4-lego", "reproduced", 2, {}),
        ("table4-lego", "not reproduced", 1, changed("psnr", "lego", nerf=32.6)),
        ("footnote1-table", "not reproduced", 4, {}),
    ],
)
def test_what_the_papers_figures_give(whole: Records, name, verdict, measured, tables):
    claim = figured(whole, name, **tables)
    assert (claim.verdict, claim.scale) == (verdict, OWN_FIGURES)
    assert claim.measured == (pytest.approx(measured) if measured is not None else None)
    assert claim.interval is None, "what rounding leaves open is no interval of 95 %"


def test_what_decides_is_named(whole: Records):
    hours = figured(whole, "table3-speedup-hours").note
    assert "leaves 16.9 to 21.2 % open" in hours
    assert "as a ratio of speeds 24 %" in hours
    assert figured(whole, "table2-differences", **changed("psnr", "mic", delta=1.7)).note == "not mic"
    assert "equal in 7 of 8 scenes" in figured(whole, "table2-source", **changed("psnr", "mic", nerf=33.1)).note
    original = {scene: score for scene, score in PAPER.tables["original"].items() if scene != "mic"}
    lacking = figured(whole, "table2-source", original=original)
    assert lacking.measured == 7
    assert "equal in 7 of 7 scenes (without mic, of which no original score is recorded)" in lacking.note


def test_a_record_without_the_tables_tests_nothing(whole: Records):
    bare = claims(replace(whole, run=replace(whole.run, claims=[replace(PAPER, tables={}, psnr={})])))
    of_tables = ("table1-sum", "table2-means", "table3-sp", "table3-f")
    assert {claim.verdict for claim in bare if claim.id.startswith(of_tables)} == {UNTESTED}


ONE = TargetComparison(
    scene="all", method="qnerf", against="nerf", axis="steps", horizon=1600.0, saving=18.0, interval=(-9.0, 41.0),
    simultaneous=(-9.0, 41.0), family=1, verdict=OPEN, smallest_detectable=5.0, difference=-100.0,
    difference_interval=(-130.0, -70.0), pairs=6, never=(0, 0), earlier=(0, 0), unpaired=0,
    at_least=None, at_most=None, on_these_scenes=None, scenes_like_these=None,
)  # fmt: skip


def on_them(pair: tuple[float, float] | None, **changes) -> TargetComparison:
    """Return a row with an interval on these scenes, which decides."""
    return replace(ONE, on_these_scenes=Estimate(pair, pair, 1, OPEN, None, None), **changes)


SAVED = on_them((14.0, 22.0))


def record(row: TargetComparison = SAVED, target: float = 30.0) -> TargetsRecord:
    return TargetsRecord(target, target == 30.0, "nerf", "chosen", [], [], [row, replace(row, axis="seconds")])


def judged(whole: Records, row: TargetComparison, at_scale: bool = True, target: float = 30.0) -> Finding:
    class Here(Bench):
        def at_scale(self, scene: str) -> bool:
            return at_scale

    return saving(Here(whole, PAPER, None, record(row, target)), LEDGER["abstract-faster"])


@pytest.mark.parametrize(
    ("pair", "changes", "at_scale", "elsewhere"),
    [
        ((14.0, 22.0), {}, "reproduced", "seen"),
        ((4.0, 12.0), {}, "not reproduced", MISSED),
        ((24.0, 30.0), {}, "not reproduced", MISSED),
        (None, {}, "inconclusive", "inconclusive"),
        # no verdict that the censored runs could change
        ((4.0, 12.0), {"never": (0, 1)}, "inconclusive", "seen"),
        ((4.0, 12.0), {"earlier": (1, 0)}, "inconclusive", "seen"),
        ((4.0, 12.0), {"never": (1, 0)}, "not reproduced", MISSED),
        ((24.0, 30.0), {"never": (1, 0)}, "inconclusive", "inconclusive"),
        ((24.0, 30.0), {"never": (0, 1)}, "not reproduced", MISSED),
        ((14.0, 22.0), {"never": (1, 0)}, "inconclusive", "inconclusive"),
        ((14.0, 22.0), {"earlier": (1, 0)}, "inconclusive", "seen"),
        ((14.0, 22.0), {"pairs": 2}, "inconclusive", "inconclusive"),
        ((14.0, 22.0), {"unpaired": 1}, "reproduced", "seen"),
    ],
)
def test_a_saving_is_judged_as_a_gain_is(whole: Records, pair, changes, at_scale, elsewhere):
    row = on_them(pair, **changes)
    assert judged(whole, row).verdict == at_scale
    assert judged(whole, row, at_scale=False).verdict == elsewhere
    assert judged(whole, row, target=24.0).verdict == elsewhere, "at another target it is another saving"


def test_the_note_states_how_many_runs_reached_the_target(whole: Records):
    finding = judged(whole, replace(SAVED, never=(2, 0), unpaired=1), False, 24.0)
    assert (finding.measured, finding.interval) == (18.0, (14.0, 22.0))
    assert finding.note == (
        "24.0 dB was reached by 6 of 6 NeRF runs and 4 of 6 Q-NeRF runs in the training steps watched; the true saving "
        "is smaller; 1 pair could not be judged"
    )


def test_iterations_and_hours_use_their_own_axis(whole: Records):
    targets = replace(record(), comparisons=[SAVED, replace(on_them((1.0, 5.0)), axis="seconds", saving=3.0)])
    steps, hours = (
        saving(Bench(whole, PAPER, None, targets), LEDGER[name]) for name in ("abstract-faster", "table3-hours")
    )
    assert (steps.measured, steps.verdict, hours.measured, hours.verdict) == (18.0, "seen", 3.0, MISSED)
    assert (steps.runs, hours.runs) == tuple(
        Selection("", "qnerf", "nerf", TARGET, axis) for axis in ("steps", "seconds")
    )


def test_times_themselves_are_never_judged(whole: Records):
    bench = Bench(whole, PAPER, None, record())
    finding = [time_to_target(bench, LEDGER[f"table3-{name}-qnerf"]) for name in ("iterations", "hours")]
    assert [(each.verdict, each.note) for each in finding] == [(UNTESTED, NEEDS_SCENES), (UNTESTED, NEEDS_MACHINE)]
    never = [scene for scene, row in PAPER.scenes.items() if row["nerf"] < 30]
    assert never == ["drums", "materials", "ship"], "the three of the sentence"


def test_without_the_record_of_targets_the_saving_is_not_tested(records: Records, out: Path):
    assert claimed(records)["abstract-faster"].verdict == UNTESTED
    write_targets(out, record())
    assert claimed(read_records(out))["abstract-faster"].measured == 18.0


def test_censored_runs_make_the_saving_a_bound():
    assert bound(ONE) == ""
    for changes in ({"never": (1, 0)}, {"earlier": (0, 1)}):
        assert bound(replace(ONE, **changes)) == "the true saving is smaller"
    for changes in ({"never": (0, 1)}, {"earlier": (1, 0)}):
        assert bound(replace(ONE, **changes)) == "the true saving is larger"
    assert bound(replace(ONE, never=(1, 1))) == "the saving covers only the time watched"


def test_without_any_pair_the_saving_is_inconclusive(whole: Records):
    lost = replace(ONE, saving=None, pairs=0, unpaired=6)
    finding = judged(whole, lost)
    assert (finding.verdict, finding.measured, finding.note) == ("inconclusive", None, "6 pairs could not be judged")
    cells = [replace(cell, status="not_available") if cell.method == "qnerf" else cell for cell in whole.cells]
    assert judged(replace(whole, cells=cells), lost).verdict == UNTESTED


LISTING_2 = ("nerf_phi_encoding_amplifier", "nerf_phi_encoding")
EQUATION_4 = ("nerf_phi_encoding_equation4", "nerf_phi_encoding")
CLAIM = "table4-nerf_phi_encoding_amplifier-psnr"
DERIVED = "what is printed are rounded totals: this step is between +0.5 and +0.7 dB"


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
def test_the_untested_claims_of_the_ablation_are_counted(whole: Records, tmp_path, left_out: int, needs: list[str]):
    steps = (("nerf_phi_encoding", "nerf"), LISTING_2, ("qnerf", "nerf_phi_encoding_amplifier"))
    every = [step(pair, 0.1, metric=metric) for pair in steps for metric in ("psnr", "ssim")]
    write_summary(whole, tmp_path / "summary.json", ShelfRecords(evidence=ablation(*every[left_out:])))
    sentences = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))["not_tested"]
    remedy = "the ablation study: `nox -s evidence -- --out out/latest`."
    assert [words for words in sentences if "ablation" in words] == [f"{start} {remedy}" for start in needs]


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
def test_unmeasured_claims_are_not_tested_and_name_the_remedy(whole: Records, serving, remedy: str):
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
        ("latency", (*MEMORY, hit("disk.warm", 40)), RETRIEVAL, MISSED),
        ("latency", (MEMORY[0], hit("memory.1", 800), DISK), RETRIEVAL, MISSED),
        ("latency", (*MEMORY, hit("disk.warm", 52)), RETRIEVAL, "inconclusive"),
        ("latency", (MEMORY[0], hit("memory.1", 980), DISK), RETRIEVAL, "inconclusive"),
        ("latency", MEMORY, RETRIEVAL, "inconclusive"),
        ("latency", (DISK,), RETRIEVAL, "inconclusive"),
        ("latency", (*MEMORY, DISK, hit("disk.cold", 30)), RETRIEVAL, MISSED),
        ("latency", (hit("disk.warm", 30),), RETRIEVAL, MISSED),
        ("latency", (), RETRIEVAL, UNTESTED),
        ("confusions", stale(2), KEY, "not reproduced"),
        ("confusions", stale(0), KEY, "reproduced"),
        ("anytime", [earlier("attended", 4, "pass")], PRIORITY, "seen"),
        ("anytime", [earlier("attended", 4, "fail")], PRIORITY, MISSED),
        ("anytime", [earlier("attended", 4, "inconclusive")], PRIORITY, "inconclusive"),
        ("priorities", [phi(0)], PHI, "not reproduced"),
        ("priorities", [phi(2)], PHI, "reproduced"),
    ],
)
def test_verdicts_of_serving(whole: Records, study: str, checks: tuple[Check, ...], name: str, verdict: str):
    assert claimed(whole, serving=fake_serving(**{study: list(checks)}))[name].verdict == verdict


def test_hits_that_miss_the_threshold_are_named(whole: Records):
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


def test_the_figures_behind_the_other_verdicts(whole: Records):
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
