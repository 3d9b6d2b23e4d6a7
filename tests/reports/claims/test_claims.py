"""The ledger on a run: every entry gets a verdict, and none passes silently."""

import pytest

from harness.records.cells import Estimate
from harness.records.claims import QUANTITIES
from harness.records.study import Studies
from harness.records.verdict import OPEN
from reports.claims.claim_list import KINDS, RULES, claims, tally
from reports.claims.ledger import OWN_FIGURES, Claim
from reports.claims.scores import NEEDS_PAPER
from reports.claims.table import chapters, claims_grid, folds, in_a_sentence
from reports.data.load import Records
from reports.data.scale import in_a_line, is_at_scale, scenes_at_scale, standing
from reports.data.selection import Selection
from reports.data.studies_load import ShelfRecords
from reports.data.wording import UNTESTED, VERDICTS
from tests.replacing import replace
from tests.reports.fake_run import EIGHT, PAPER, fake_records

RANGE, AVERAGE = "abstract-psnr-range", "table2-average"
LEDGER = PAPER.claims
GAINS = {scene: row["delta"] for scene, row in PAPER.psnr.items()}
MISSED = "not seen at this scale"
LOST = {"difference": None, "on_these_scenes": None, "pairs": 0}


def claimed(records: Records, evidence: Studies | None = None, serving: Studies | None = None) -> dict[str, Claim]:
    """Map the id of a claim → the claim as judged on `records` with these studies."""
    return {claim.id: claim for claim in claims(records, ShelfRecords(evidence=evidence, serving=serving))}


def measured(difference: float, half: float, effect: float | None = 4.0, **changes) -> dict:
    """Return the fields of a comparison with an interval of ± `half` on these scenes."""
    pair = (difference - half, difference + half)
    return {"difference": difference, "on_these_scenes": Estimate(pair, pair, 1, OPEN, None, effect), **changes}


def with_comparisons(records: Records, **changes) -> Records:
    """Change the comparisons of qnerf with nerf at equal steps, scene → changes."""
    changed = [
        replace(row, **changes[row.scene])
        if row.scene in changes and (row.method, row.against, row.budget) == ("qnerf", "nerf", "steps")
        else row
        for row in records.comparisons
    ]
    return replace(records, comparisons=changed)


def with_run(records: Records, **changes) -> Records:
    return replace(records, run=replace(records.run, **changes))


@pytest.fixture(scope="module")
def eight(tmp_path_factory) -> Records:
    return fake_records(tmp_path_factory.mktemp("eight") / "run", scenes=EIGHT)


@pytest.fixture(scope="module")
def printed(eight: Records) -> Records:
    """Return a run at the paper's scale with the gains of Table 2, each scene with ± 0.15 dB."""
    papers = {"network": {"depth": 8, "width": 256}, "rays": 1024, "learning_rate": 5e-4}
    train = {**eight.run.settings["train"], **papers}
    shape = {"width": 800, "height": 800, "rendered": {}, "views": {"train": 100, "val": 0, "test": 200}}
    scenes = [replace(scene, **shape) for scene in eight.run.scenes]
    scaled = with_run(eight, scenes=scenes, settings={**eight.run.settings, "train": train})
    scaled = replace(scaled, cells=[replace(cell, steps=200_000) for cell in eight.cells])
    exactly = {scene: measured(GAINS[scene], 0.15) for scene in EIGHT}
    return with_comparisons(scaled, all=measured(1.475, 0.1), **exactly)


def test_every_statement_has_a_verdict_a_scale_and_says_how(whole: Records):
    judged = claims(whole)
    assert [claim.id for claim in judged] == [entry.id for entry in LEDGER]
    assert all(claim.scale and claim.how and claim.source and claim.statement for claim in judged)
    assert {claim.verdict for claim in judged} <= set(VERDICTS)
    assert all(claim.note for claim in judged if claim.verdict == UNTESTED), "what it needs"
    assert claimed(whole)[AVERAGE].scale == "profile reduced, 32 × 32 px, 1\u202f600 steps, 3 seeds, 6 × 64 network"
    assert {entry.quantity for entry in LEDGER} == set(RULES) == set(QUANTITIES)
    assert {kind for kind, _ in RULES.values()} == set(KINDS)


def test_claims_of_another_version_are_untested(whole: Records):
    first, second = replace(LEDGER[0], quantity="by divination"), replace(LEDGER[0], of={})
    judged = claims(with_run(whole, claims=[replace(PAPER, claims=(first, second))]))
    assert [claim.verdict for claim in judged] == [UNTESTED] * 2
    assert "by divination" in judged[0].note
    assert claims(with_run(whole, claims=[])) == []


@pytest.mark.parametrize(("gain", "verdict"), [(1.475, "seen"), (2.4, MISSED), (0.0, MISSED)])
def test_a_toy_run_certifies_and_refutes_nothing_despite_the_names_of_its_scenes(eight: Records, gain, verdict):
    toy = claimed(with_comparisons(eight, **{scene: measured(gain, 0.15) for scene in ("all", *EIGHT)}))
    assert (toy[AVERAGE].verdict, toy[RANGE].verdict) == (verdict, UNTESTED)
    judged = [claim for claim in toy.values() if claim.kind in ("gains", "levels")]
    assert not [claim for claim in judged if claim.verdict in ("reproduced", "not reproduced")]


@pytest.mark.parametrize(
    ("changes", "average", "each", "note"),
    [
        ({}, "reproduced", "reproduced", f"reproduced: {', '.join(EIGHT[:-1])} and ship"),
        ({"ship": measured(0.9, 0.1)}, "reproduced", "not reproduced", "not reproduced: ship"),
        ({"ship": measured(1.5, 0.62, effect=1.5 / 0.248)}, "reproduced", "inconclusive", "ship; about 18 seeds would"),
        ({"ship": measured(0.0, 0.01, pairs=2)}, "reproduced", "inconclusive", "inconclusive: ship"),
        ({"ship": {**LOST, "unpaired": 3}}, "seen", "inconclusive", "; 7 of 8 rows"),
    ],
)
def test_at_the_papers_scale_rows_and_average_are_judged(printed: Records, changes, average, each, note):
    judged = claimed(with_comparisons(printed, **changes))
    assert (judged[AVERAGE].verdict, judged[RANGE].verdict) == (average, each)
    assert note in judged[RANGE].note
    assert judged[AVERAGE].measured == 1.475


def test_an_open_average_has_the_number_of_seeds_that_would_settle_it(printed: Records):
    claim = claimed(with_comparisons(printed, all=measured(1.3, 0.3, effect=1.3 / 0.5)))[AVERAGE]
    assert (claim.verdict, claim.note.split(";")[0]) == ("inconclusive", "about 9 seeds per scene would settle it")


@pytest.mark.parametrize(
    "changes",
    [{"width": 400}, {"rendered": {"spp": 256}}, {"views": {"train": 100, "val": 0, "test": 25}}, {"name": "bathroom"}],
)
def test_the_papers_scale_needs_its_pictures(printed: Records, changes):
    first, *others = printed.run.scenes
    other = with_run(printed, scenes=[replace(first, **changes), *others])
    assert not is_at_scale(other, PAPER)
    assert claimed(other)[AVERAGE].verdict == "seen"
    assert standing(other, PAPER) != standing(printed, PAPER)
    rendered = with_run(printed, scenes=[replace(scene, rendered={"spp": 1}) for scene in printed.run.scenes])
    assert "not its pictures" in standing(rendered, PAPER)


def test_the_papers_scale_needs_its_settings_and_its_steps(printed: Records):
    settings = printed.run.settings
    for changed in ({"rays": 2048}, {"learning_rate": 1e-3}, {"network": {"depth": 6, "width": 256}}):
        assert not is_at_scale(with_run(printed, settings={**settings, "train": settings["train"] | changed}), PAPER)
    for changed in ({"steps": 100_000}, {"status": "diverged"}):
        assert not is_at_scale(replace(printed, cells=[replace(cell, **changed) for cell in printed.cells]), PAPER)


def test_some_of_the_papers_scenes_reproduce_rows_and_no_average(printed: Records):
    cells = [cell for cell in printed.cells if cell.scene in ("chair", "drums")]
    records = replace(with_run(printed, scenes=printed.run.scenes[:2]), cells=cells)
    judged = claimed(records)
    assert scenes_at_scale(records, PAPER, PAPER.scale) == ["chair", "drums"]
    assert (judged[AVERAGE].verdict, judged[RANGE].verdict) == ("seen", "inconclusive")
    assert judged[RANGE].note == "reproduced: chair and drums; 2 of 8 rows"
    assert claimed(with_comparisons(records, drums=measured(0.2, 0.1)))[RANGE].verdict == "not reproduced"


@pytest.mark.parametrize(("score", "verdict"), [(33.05, "reproduced"), (31.0, "not reproduced")])
def test_levels_are_judged_only_at_the_papers_scale(printed: Records, eight: Records, score, verdict):
    def scored(records: Records) -> Records:
        cells = [replace(cell, scores={**cell.scores, "psnr": score + 0.01 * cell.seed}) for cell in records.cells]
        table2 = {name: {"nerf": 33.0, "qnerf": 33.0} for name in (*EIGHT, "average")}
        ledger = tuple(replace(each, printed=33.0) if each.quantity == "score" else each for each in LEDGER)
        return replace(with_run(records, claims=[replace(PAPER, psnr=table2, claims=ledger)]), cells=cells)

    names = ("table2-average-nerf", "table2-scenes-nerf")
    assert [claimed(scored(printed))[name].verdict for name in names] == [verdict, verdict]
    average, rows = (claimed(scored(eight))[name] for name in names)
    assert (average.verdict, average.note, rows.verdict) == (UNTESTED, NEEDS_PAPER, UNTESTED)
    assert average.measured == pytest.approx(score + 0.01)


def test_a_gain_has_the_other_reading_and_the_gain_over_the_control_in_its_note(whole: Records):
    assert claimed(whole)[AVERAGE].note == "qnerf − nerf_matched: −0.10 [−0.15, −0.05]"
    chair = next(row for row in whole.comparisons if row.scene == "chair")
    form = replace(chair, method="qnerf_printed", against="nerf", **measured(-5.6, 0.2))
    beside = claimed(replace(whole, comparisons=[*whole.comparisons, form]))[AVERAGE].note
    assert beside.startswith("qnerf_printed − nerf on chair: −5.60 [−5.80, −5.40]: not seen at this scale; qnerf − ")


def test_lost_pairs_are_counted_and_change_no_verdict(records: Records, whole: Records):
    claim = claimed(records)[AVERAGE]
    assert (claim.verdict, "1 pair could not be judged" in claim.note) == ("not seen at this scale", True)
    lost = with_comparisons(whole, all={**LOST, "unpaired": 6})
    assert (claimed(lost)[AVERAGE].verdict, claimed(lost)[AVERAGE].measured) == ("inconclusive", None)
    cells = [replace(cell, status="not_available") if cell.method == "qnerf" else cell for cell in whole.cells]
    assert claimed(replace(lost, cells=cells))[AVERAGE].verdict == UNTESTED


def test_only_a_claim_that_was_judged_by_runs_selects_them(whole: Records):
    judged = claims(whole)
    selected = {claim.id: claim.runs for claim in judged if claim.runs}
    assert selected == {AVERAGE: Selection("", "qnerf", "nerf", "psnr", "steps")}
    grid = claims_grid(judged, "")
    for claim, row in zip(judged, grid.rows, strict=True):
        assert [entry.runs for entry in row] == [None, None, claim.runs, None, None]
    assert not grid.filtered, "no filter hides a verdict"


def test_weights_are_counted_and_settings_and_their_code_never_pass(whole: Records):
    judged = claimed(whole)
    weights = judged["table1-total"]
    assert (weights.printed, weights.measured, weights.verdict) == (1_370_000, 546_566, "not reproduced")
    assert weights.scale == "the paper’s network"
    assert weights.note.replace("\u202f", " ") == "density MLP 493 056 for 1 300 000 and colour MLP 53 251 for 67 000"
    right = with_run(whole, claims=[replace(PAPER, measured={"weights": PAPER.tables["weights"]})])
    assert claimed(right)["table1-total"].verdict == "reproduced"
    assert (judged["table1-depth"].measured, judged["abstract-sloc"].measured) == (6, 690)
    assert "encoding 90 and amplifier 600" in judged["abstract-sloc"].how
    assert {claim.verdict for claim in judged.values() if claim.kind == "others"} == {UNTESTED}


def test_claims_as_tables(whole: Records):
    judged, here = claims(whole), in_a_line(whole)
    shown, lines = chapters(judged, here), dict(folds(judged))
    assert sum(many for _, many in tally(judged)) == len(LEDGER)
    assert sum(len(grid.rows) for _, grid in shown) + sum(map(len, lines.values())) == len(LEDGER)
    start = f"Of {len(LEDGER)} statements in the ledger: 9 reproduced, 3 not reproduced, 1 not seen at "
    assert in_a_sentence(judged).startswith(start)
    rows = {row[0].text: row for _, grid in shown for row in grid.rows}
    gain, weights = rows["Q-NeRF gains over NeRF on average"], rows["The network has this many weights"]
    assert [entry.text for entry in gain[1:4]] == ["+1.5 dB", "+0.81 dB", "✕ not seen at this scale"]
    assert [entry.text for entry in weights[1:4]] == ["1\u202f370\u202f000", "546\u202f566", "✕ not reproduced"]
    assert rows["The φ skip follows layer ⌊φ·8/2⌋"][3].small == OWN_FIGURES
    assert shown[-1][0].startswith("Our readings"), "apart from what is printed"
    assert here not in {row[3].small for row in rows.values()}, "the run's scale stands above the table"
    assert "6 claims need the ablation study: `nox -s evidence -- --out out/latest`." in lines
    settings = lines["15 claims are settings, taken over or named under Deviations, not results."]
    assert "Layers of the density MLP (Table 1): 8, here 6" in settings


def test_a_step_between_rounded_totals_has_the_range_that_rounding_leaves(printed: Records):
    step = next(row for row in printed.comparisons if (row.scene, row.method) == ("lego", "qnerf"))
    row = replace(step, against="nerf_phi_encoding_amplifier", **measured(0.2, 0.1))
    claim = claimed(replace(printed, comparisons=[*printed.comparisons, row]))["table4-qnerf-psnr"]
    assert (claim.verdict, claim.interval) == ("reproduced", pytest.approx((0.1, 0.3)))
    assert claim.note == "what is printed are rounded totals: this step is between +0.1 and +0.3 dB"
