"""The ledger put to the test on a run: every entry gets a verdict, and none passes silently."""

import pytest

from harness.records.cells import Estimate
from harness.verdicts.paper import LEDGER
from reports.claims.claim_list import KINDS, RULES, claims, tally
from reports.claims.ledger import OWN_FIGURES
from reports.claims.scores import NEEDS_PAPER
from reports.claims.table import chapters, claims_grid, folds, in_a_sentence
from reports.data.load import Records, read_records
from reports.data.scale import in_a_line, is_paper_scale, papers_scenes, standing
from reports.data.selection import Selection
from reports.data.wording import UNTESTED, VERDICTS
from tests.replacing import replace
from tests.reports.fake_run import EIGHT, PAPER, write_fake_run

RANGE, AVERAGE = "abstract-psnr-range", "table2-average"
GAINS = {scene: row["delta"] for scene, row in PAPER["table2"].items()}


def by_id(records: Records):
    return {claim.id: claim for claim in claims(records)}


def measured(difference: float, half: float, effect: float | None = 4.0, **changes) -> dict:
    """What a comparison says of a difference with an interval of ± `half` on these scenes."""
    pair = (difference - half, difference + half)
    return {"difference": difference, "on_these_scenes": Estimate(pair, pair, 1, "better", None, effect), **changes}


def with_comparisons(records: Records, **changes) -> Records:
    """The comparisons of qnerf with nerf at equal steps replaced, scene → changes."""
    changed = [
        replace(one, **changes[one.scene])
        if one.scene in changes and (one.method, one.against, one.budget) == ("qnerf", "nerf", "steps")
        else one
        for one in records.comparisons
    ]
    return replace(records, comparisons=changed)


@pytest.fixture(scope="module")
def eight(tmp_path_factory) -> Records:
    out = tmp_path_factory.mktemp("eight") / "run"
    return read_records(write_fake_run(out, EIGHT, pictures=False, with_diverged=False))


def at_paper_scale(records: Records, **changes) -> Records:
    """Trained as §7.1 and Table 1 say, on view sets that were given and have as many views as NeRF Synthetic."""
    papers = {"network": {"depth": 8, "width": 256}, "rays": 1024, "learning_rate": 5e-4}
    train = {**records.run.settings["train"], **papers}
    shape = {"width": 800, "height": 800, "rendered": {}, "views": {"train": 100, "val": 0, "test": 200}, **changes}
    scenes = [replace(scene, **shape) for scene in records.run.scenes]
    run = replace(records.run, scenes=scenes, settings={**records.run.settings, "train": train})
    return replace(records, run=run, cells=[replace(cell, steps=200_000) for cell in records.cells])


@pytest.fixture(scope="module")
def printed(eight: Records) -> Records:
    """All of Table 2's gains as they are printed, at the paper's scale, each scene with ± 0.15 dB."""
    exactly = {scene: measured(GAINS[scene], 0.15) for scene in EIGHT}
    return with_comparisons(at_paper_scale(eight), all=measured(1.475, 0.1), **exactly)


def test_every_statement_has_a_verdict_a_scale_and_says_how(whole: Records):
    found = claims(whole)
    assert [claim.id for claim in found] == [one.id for one in LEDGER]
    assert all(claim.scale and claim.how and claim.source and claim.statement for claim in found)
    assert {claim.verdict for claim in found} <= set(VERDICTS)
    assert all(claim.note for claim in found if claim.verdict == UNTESTED), "what it needs"
    assert by_id(whole)[AVERAGE].scale == "profile reduced, 32 × 32 px, 1\u202f600 steps, 3 seeds, 6 × 64 network"


def test_every_rule_is_used_and_every_entry_has_one():
    assert {one.rule for one in LEDGER} == set(RULES)
    assert {kind for kind, _ in RULES.values()} == set(KINDS)


def test_a_rule_of_another_version_is_not_passed_over(whole: Records):
    ledger = [{**PAPER["ledger"][0], "rule": "by divination"}]
    (claim,) = claims(replace(whole, run=replace(whole.run, paper={"ledger": ledger})))
    assert claim.verdict == UNTESTED
    assert "by divination" in claim.note


def test_a_ledger_that_cannot_be_read_is_an_error(whole: Records):
    with pytest.raises(ValueError, match="ledger"):
        claims(replace(whole, run=replace(whole.run, paper={"ledger": [{"id": "x"}]})))
    assert claims(replace(whole, run=replace(whole.run, paper={}))) == []


@pytest.mark.parametrize(
    ("gain", "verdict"), [(1.475, "seen"), (2.4, "not seen at this scale"), (0.0, "not seen at this scale")]
)
def test_a_toy_run_certifies_and_refutes_nothing_whatever_its_scenes_are_called(eight: Records, gain, verdict):
    toy = with_comparisons(eight, **{scene: measured(gain, 0.15) for scene in ("all", *EIGHT)})
    found = by_id(toy)
    assert found[AVERAGE].verdict == verdict
    assert found[RANGE].verdict == UNTESTED
    judged = [claim for claim in found.values() if claim.kind in ("gains", "levels")]
    assert not [claim for claim in judged if claim.verdict in ("reproduced", "not reproduced")]


def test_what_is_printed_is_reproduced_at_the_papers_scale(printed: Records):
    found = by_id(printed)
    assert (found[AVERAGE].verdict, found[AVERAGE].measured) == ("reproduced", 1.475)
    assert (found[RANGE].verdict, found[RANGE].measured) == ("reproduced", (1.2, 1.8))
    assert found[RANGE].note == f"reproduced: {', '.join(EIGHT[:-1])} and ship"


def test_one_scene_refutes_what_is_said_of_each_and_leaves_the_average(printed: Records):
    low = by_id(with_comparisons(printed, ship=measured(0.9, 0.1)))
    assert (low[RANGE].verdict, low[AVERAGE].verdict) == ("not reproduced", "reproduced")
    assert low[RANGE].note.endswith("not reproduced: ship")


def test_where_seeds_are_too_few_the_number_that_would_settle_it_is_said(printed: Records):
    wide = measured(1.5, 0.62, effect=1.5 / 0.248)
    found = by_id(with_comparisons(printed, ship=wide))[RANGE]
    assert found.verdict == "inconclusive"
    assert found.note.endswith("inconclusive: ship; about 18 seeds would settle the open ones")
    toy = by_id(with_comparisons(printed, all=measured(1.3, 0.3, effect=1.3 / 0.5)))[AVERAGE]
    assert (toy.verdict, toy.note.split(";")[0]) == ("inconclusive", "about 9 seeds a scene would settle it")


def test_two_seeds_give_no_verdict(printed: Records):
    few = by_id(with_comparisons(printed, ship=measured(0.0, 0.01, pairs=2)))[RANGE]
    assert "inconclusive: ship" in few.note


@pytest.mark.parametrize(
    "changes",
    [
        {"width": 400, "height": 400},
        {"rendered": {"spp": 256}},
        {"views": {"train": 100, "val": 0, "test": 25}},
        {"name": "bathroom"},
    ],
)
def test_the_papers_scale_needs_its_pictures(printed: Records, changes):
    first = replace(printed.run.scenes[0], **changes)
    other = replace(printed, run=replace(printed.run, scenes=[first, *printed.run.scenes[1:]]))
    assert not is_paper_scale(other)
    assert by_id(other)[AVERAGE].verdict == "seen"
    assert standing(other) != standing(printed)


def test_the_papers_scale_needs_its_training(printed: Records):
    train = printed.run.settings["train"]
    for changed in ({"rays": 2048}, {"learning_rate": 1e-3}, {"network": {"depth": 6, "width": 256}}):
        run = replace(printed.run, settings={**printed.run.settings, "train": {**train, **changed}})
        assert by_id(replace(printed, run=run))[AVERAGE].verdict == "seen"
    for changed in ({"steps": 100_000}, {"status": "diverged"}):
        assert not is_paper_scale(replace(printed, cells=[replace(cell, **changed) for cell in printed.cells]))
    assert "not its pictures" in standing(at_paper_scale(printed, rendered={"spp": 1}))


def test_some_of_the_papers_scenes_reproduce_rows_and_no_average(printed: Records):
    kept = printed.run.scenes[:2]
    records = replace(
        printed,
        run=replace(printed.run, scenes=kept),
        cells=[cell for cell in printed.cells if cell.scene in ("chair", "drums")],
    )
    found = by_id(records)
    assert papers_scenes(records) == ["chair", "drums"]
    assert (found[AVERAGE].verdict, found[RANGE].verdict) == ("seen", "inconclusive")
    assert found[RANGE].note == "reproduced: chair and drums; 2 of 8 rows"
    refuted = by_id(with_comparisons(records, drums=measured(0.2, 0.1)))[RANGE]
    assert refuted.verdict == "not reproduced"


def test_a_scene_without_any_pair_is_missed_by_the_average(printed: Records):
    lost = {"difference": None, "on_these_scenes": None, "pairs": 0, "unpaired": 3}
    assert by_id(with_comparisons(printed, ship=lost))[AVERAGE].verdict == "seen"


@pytest.mark.parametrize(("score", "verdict"), [(33.05, "reproduced"), (31.0, "not reproduced")])
def test_levels_are_judged_at_the_papers_scale_alone(printed: Records, eight: Records, score, verdict):
    def scored(records: Records) -> Records:
        cells = [replace(cell, scores={**cell.scores, "psnr": score + 0.01 * cell.seed}) for cell in records.cells]
        rows = {name: {"nerf": 33.0, "qnerf": 33.0} for name in EIGHT}
        paper = {**records.run.paper, "table2": rows | {"average": {"nerf": 33.0, "qnerf": 33.0}}}
        ledger = [{**one, "printed": 33.0} if one["rule"] == "score" else one for one in paper["ledger"]]
        return replace(records, cells=cells, run=replace(records.run, paper={**paper, "ledger": ledger}))

    found = by_id(scored(printed))
    assert (found["table2-average-nerf"].verdict, found["table2-scenes-nerf"].verdict) == (verdict, verdict)
    toy = by_id(scored(eight))
    average, rows = toy["table2-average-nerf"], toy["table2-scenes-nerf"]
    assert (average.verdict, average.note, rows.verdict) == (UNTESTED, NEEDS_PAPER, UNTESTED)
    assert average.measured == pytest.approx(score + 0.01)


def test_what_stands_beside_a_gain(whole: Records):
    note = by_id(whole)[AVERAGE].note
    assert note == "qnerf − nerf_matched: −0.10 [−0.15, −0.05]"
    chair = next(one for one in whole.comparisons if one.scene == "chair")
    form = replace(chair, method="qnerf_printed", against="nerf", **measured(-5.6, 0.2))
    beside = by_id(replace(whole, comparisons=[*whole.comparisons, form]))[AVERAGE].note
    assert beside.startswith("qnerf_printed − nerf on chair: −5.60 [−5.80, −5.40]: not seen at this scale; qnerf − ")


def test_lost_pairs_are_counted_and_turn_no_verdict(records: Records, whole: Records):
    found = by_id(records)[AVERAGE]
    assert (found.verdict, "1 pair could not be judged" in found.note) == ("not seen at this scale", True)
    lost = {"difference": None, "on_these_scenes": None, "pairs": 0, "unpaired": 6}
    nothing = with_comparisons(whole, all=lost)
    assert (by_id(nothing)[AVERAGE].verdict, by_id(nothing)[AVERAGE].measured) == ("inconclusive", None)
    cells = [replace(cell, status="not_available") if cell.method == "qnerf" else cell for cell in whole.cells]
    assert by_id(replace(nothing, cells=cells))[AVERAGE].verdict == UNTESTED


def test_a_claim_that_runs_judged_knows_them_and_no_other_does(whole: Records):
    found = claims(whole)
    assert {claim.id: claim.runs for claim in found if claim.runs} == {
        AVERAGE: Selection("", "qnerf", "nerf", "psnr", "steps")
    }
    grid = claims_grid(found, "")
    for claim, row in zip(found, grid.rows, strict=True):
        assert [entry.runs for entry in row] == [None, None, claim.runs, None, None]
    assert not grid.filtered, "no filter hides a verdict"


def test_weights_are_counted_in_one_row(whole: Records):
    weights = by_id(whole)["table1-total"]
    assert (weights.printed, weights.measured, weights.verdict) == (1_370_000, 546_566, "not reproduced")
    assert weights.scale == "the paper’s network"
    assert weights.note.replace("\u202f", " ") == "density MLP 493 056 for 1 300 000 and colour MLP 53 251 for 67 000"
    right = {**PAPER, "parameters_measured": {**PAPER["table1"]}}
    assert by_id(replace(whole, run=replace(whole.run, paper=right)))["table1-total"].verdict == "reproduced"


def test_settings_and_their_code_never_pass(whole: Records):
    found = by_id(whole)
    assert (found["table1-depth"].measured, found["abstract-sloc"].measured) == (6, 690)
    assert "encoding 90 and amplifier 600" in found["abstract-sloc"].how
    assert {claim.verdict for claim in found.values() if claim.kind == "others"} == {UNTESTED}


def test_the_tally_counts_every_claim_once(whole: Records):
    found = claims(whole)
    assert sum(many for _, many in tally(found)) == len(LEDGER)
    assert sum(len(one["grid"].rows) for one in chapters(found, "")) + sum(
        len(one["claims"]) for one in folds(found)
    ) == len(LEDGER)
    said = in_a_sentence(found)
    assert said.startswith(f"Of {len(LEDGER)} statements in the ledger: 9 reproduced, 3 not reproduced, 1 not seen at ")
    assert in_a_sentence([]) == ""


def test_claims_as_tables(whole: Records):
    found, here = chapters(claims(whole), in_a_line(whole)), in_a_line(whole)
    rows = {row[0].text: row for one in found for row in one["grid"].rows}
    gain, weights = rows["Q-NeRF gains over NeRF on average"], rows["The network has this many weights"]
    assert [entry.text for entry in gain[1:4]] == ["+1.5 dB", "+0.81 dB", "✕ not seen at this scale"]
    assert gain[3].small == "", "the run's scale stands above the table"
    assert [entry.text for entry in weights[1:4]] == ["1\u202f370\u202f000", "546\u202f566", "✕ not reproduced"]
    assert rows["The φ skip follows layer ⌊φ·8/2⌋"][3].small == OWN_FIGURES
    assert found[-1]["title"].startswith("Our readings"), "apart from what is printed"
    assert here not in {row[3].small for row in rows.values()}


def test_what_was_not_tested_is_a_line_a_cause(whole: Records):
    found = {one["title"]: one["claims"] for one in folds(claims(whole))}
    assert "6 claims need the ablation study: `nox -s evidence -- --out out/latest`." in found
    assert "15 claims are settings, taken over or named under Deviations, not results." in found
    assert (
        "Layers of the density MLP (Table 1): 8, here 6"
        in found["15 claims are settings, taken over or named under Deviations, not results."]
    )


def test_what_the_paper_does_not_print_says_so(printed: Records):
    step = next(one for one in printed.comparisons if (one.scene, one.method) == ("lego", "qnerf"))
    row = replace(step, against="nerf_phi_encoding_amplifier", **measured(0.2, 0.1))
    claim = by_id(replace(printed, comparisons=[*printed.comparisons, row]))["table4-qnerf-psnr"]
    assert (claim.verdict, claim.interval) == ("reproduced", pytest.approx((0.1, 0.3)))
    assert claim.note == "the paper prints rounded totals: this step is between +0.1 and +0.3 dB"
