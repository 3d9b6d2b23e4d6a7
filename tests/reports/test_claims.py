"""The ledger put to the test on a run: every entry gets a verdict, and none passes silently."""

from dataclasses import replace

import pytest

from harness.paper import LEDGER
from reports.claims import KINDS, RULES, claims, tally
from reports.claims_table import chapters, claims_grid, tally_grid
from reports.ledger import OWN_FIGURES, UNTESTED, VERDICTS
from reports.load import Records, read_records
from reports.scale import has_paper_settings, in_a_line, is_paper_scale, on_other_pictures
from reports.selection import Selection
from tests.reports.fake_run import EIGHT, PAPER, write_fake_run


def by_id(records: Records):
    return {claim.id: claim for claim in claims(records)}


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


def test_every_printed_number_has_a_verdict_a_scale_and_says_how(whole: Records):
    found = claims(whole)
    assert [claim.id for claim in found] == [one.id for one in LEDGER]
    assert all(claim.scale and claim.how and claim.source and claim.statement for claim in found)
    assert {claim.verdict for claim in found} <= set(VERDICTS)
    assert all(claim.measured is not None or claim.interval for claim in found if claim.verdict == "holds")
    assert (
        by_id(whole)["table2-chair"].scale == "profile reduced, 32 × 32 px, 1\u202f600 steps, 3 seeds, 6 × 64 network"
    )


def test_every_rule_is_used_and_every_entry_has_one():
    assert {one.rule for one in LEDGER} == set(RULES)
    assert {kind for kind, _ in RULES.values()} == set(KINDS)


def test_a_rule_of_a_later_version_is_not_passed_over(whole: Records):
    ledger = [{**PAPER["ledger"][0], "rule": "by divination"}]
    (claim,) = claims(replace(whole, run=replace(whole.run, paper={"ledger": ledger})))
    assert claim.verdict == UNTESTED
    assert "by divination" in claim.note


def test_a_ledger_that_cannot_be_read_is_an_error(whole: Records):
    broken = replace(whole, run=replace(whole.run, paper={"ledger": [{"id": "x"}]}))
    with pytest.raises(ValueError, match="ledger"):
        claims(broken)


def test_table_2_names_what_is_left_against_the_control(whole: Records):
    found = by_id(whole)
    chair = found["table2-chair"]
    assert (chair.printed, chair.measured, chair.verdict) == (1.4, 0.858, "does not hold")
    assert chair.note == "against nerf_matched: −0.19 [−0.49, +0.11] (inconclusive)"
    assert found["table2-lego"].verdict == UNTESTED
    assert found["table2-average"].note.startswith("without ficus, hotdog")


def test_the_verdict_is_taken_from_the_interval_that_knows_of_the_others(whole: Records):
    """Alone it ends below 1.35, together with the other scenes' it does not."""
    one = {"difference": 1.2, "interval": (1.1, 1.3), "simultaneous": (1.0, 1.4)}
    chair = by_id(with_comparisons(whole, chair=one))["table2-chair"]
    assert (chair.interval, chair.verdict) == ((1.0, 1.4), "inconclusive")


def test_a_claim_that_runs_judged_knows_them_and_no_other_does(whole: Records):
    behind = {name: claim.runs for name, claim in by_id(whole).items() if claim.runs}
    assert behind["table2-chair"] == Selection("chair", "qnerf", "nerf", "psnr", "steps")
    assert behind["table2-average"] == behind["abstract-psnr-range"] == Selection("", "qnerf", "nerf", "psnr", "steps")
    judged = {claim.id: claim for claim in claims(whole) if claim.verdict != UNTESTED}
    assert set(behind) < set(judged)
    arithmetic = [claim for claim in judged.values() if claim.kind in ("figures", "others")]
    assert arithmetic
    assert [claim.id for claim in arithmetic if claim.runs] == []


def test_the_measured_number_opens_its_runs_and_no_filter_hides_a_verdict(whole: Records):
    found = claims(whole)
    for claim, row in zip(found, claims_grid(found, "").rows, strict=True):
        assert [entry.runs for entry in row] == [None, None, claim.runs, None, None]
    assert not claims_grid(found, "").filtered


def test_survivors_settle_nothing(records: Records):
    drums = by_id(records)["table2-drums"]
    assert drums.verdict == "inconclusive"
    assert "1 pair lost" in drums.note


def test_the_range_is_refuted_by_the_mean_and_holds_only_on_every_scene(eight: Records):
    name = "abstract-psnr-range"
    assert by_id(eight)[name].verdict == "does not hold"
    high = {"difference": 1.6, "interval": (1.5, 1.7), "simultaneous": (1.5, 1.7)}
    every = {scene: high for scene in ("all", *EIGHT)}
    assert by_id(with_comparisons(eight, **every))[name].verdict == "holds"
    one_low = every | {"ship": {"difference": 0.9, "interval": (0.8, 1.0), "simultaneous": (0.7, 1.1)}}
    refuted = by_id(with_comparisons(eight, **one_low))[name]
    assert (refuted.verdict, refuted.measured, refuted.interval) == ("does not hold", (0.9, 1.6), None)
    assert "below it on ship" in refuted.note
    assert "mean +1.60 [+1.50, +1.70]" in refuted.note
    open_one = every | {"ship": {"difference": 0.9, "interval": (0.8, 1.0), "simultaneous": (0.6, 1.2)}}
    assert by_id(with_comparisons(eight, **open_one))[name].verdict == "inconclusive"
    lost = every | {"ship": {"difference": None, "interval": None, "simultaneous": None, "pairs": 0, "unpaired": 3}}
    assert by_id(with_comparisons(eight, **lost))[name].verdict == "inconclusive"


def test_the_range_does_not_hold_silently_on_fewer_scenes(whole: Records):
    high = {"difference": 1.6, "interval": (1.5, 1.7), "simultaneous": (1.5, 1.7)}
    found = by_id(with_comparisons(whole, all=high, chair=high, drums=high))
    assert found["abstract-psnr-range"].verdict == "inconclusive"


def test_the_range_of_the_papers_scenes_opens_no_runs_of_others(eight: Records, tmp_path):
    more = read_records(write_fake_run(tmp_path / "run", (*EIGHT, "fern"), pictures=False, with_diverged=False))
    assert by_id(eight)["abstract-psnr-range"].runs == Selection("", "qnerf", "nerf", "psnr", "steps")
    found = by_id(more)["abstract-psnr-range"]
    assert (found.runs, found.measured) == (None, by_id(eight)["abstract-psnr-range"].measured)


def test_absolute_scores_stand_beside_and_are_not_judged(eight: Records):
    found = by_id(eight)
    nerf = found["table2-chair-nerf"]
    assert (nerf.verdict, nerf.printed) == (UNTESTED, 33.0)
    assert nerf.measured == pytest.approx(sum(cell.scores["psnr"] for cell in eight.cells_of("chair", "nerf")) / 3)
    assert nerf.interval[0] < nerf.measured < nerf.interval[1]
    average = found["table2-average-nerf"]
    assert average.measured == pytest.approx(sum(found[f"table2-{scene}-nerf"].measured for scene in EIGHT) / 8)


@pytest.mark.parametrize(("score", "verdict"), [(33.05, "holds"), (31.0, "does not hold")])
def test_absolute_scores_are_judged_at_the_papers_scale_on_given_pictures(tmp_path, score, verdict):
    def at_paper_scale(run):
        train = {**run.settings["train"], "network": {"depth": 8, "width": 256}, "rays": 1024}
        settings = {**run.settings, "train": train}
        scenes = [replace(scene, width=800, height=800, rendered={}) for scene in run.scenes]
        return replace(run, scenes=scenes, settings=settings)

    def long(cell):
        return replace(cell, steps=200_000, scores={**cell.scores, "psnr": score + 0.01 * cell.seed})

    options = {"pictures": False, "with_diverged": False, "change": at_paper_scale, "change_cell": long}
    out = write_fake_run(tmp_path / "run", ("chair",), **options)
    chair = by_id(read_records(out))["table2-chair-nerf"]
    assert chair.verdict == verdict
    assert "cannot tell" in chair.note
    rendered = read_records(out)
    scenes = [replace(scene, rendered={"spp": 64}) for scene in rendered.run.scenes]
    other = by_id(replace(rendered, run=replace(rendered.run, scenes=scenes)))["table2-chair-nerf"]
    assert (other.verdict, other.note) == (UNTESTED, "other pictures than the paper’s")


def test_weights_are_counted(whole: Records):
    found = by_id(whole)
    assert (found["table1-density_net"].measured, found["table1-density_net"].verdict) == (493_056, "does not hold")
    assert found["table1-density_head"].verdict == "holds"
    assert found["table1-total"].scale == "the paper’s network"


def test_settings_and_their_code_never_pass(whole: Records):
    found = by_id(whole)
    assert (found["table1-depth"].measured, found["table1-depth"].verdict) == (6, UNTESTED)
    assert (found["abstract-sloc"].measured, found["abstract-sloc"].verdict) == (690, UNTESTED)
    assert "encoding 90 and amplifier 600" in found["abstract-sloc"].note
    assert {claim.verdict for claim in found.values() if claim.kind == "others"} == {UNTESTED}


def test_runs_from_before_the_ledger_are_judged_by_their_tables(whole: Records):
    paper = {name: value for name, value in PAPER.items() if name not in ("ledger", "original_nerf")}
    old = by_id(replace(whole, run=replace(whole.run, paper=paper)))
    new = by_id(whole)
    assert set(old) < set(new) | {"table3-iterations"}
    for name in ("table1-total", "table2-chair", "table2-average"):
        assert (old[name].printed, old[name].measured, old[name].verdict) == (
            new[name].printed,
            new[name].measured,
            new[name].verdict,
        )


def test_without_printed_numbers_there_is_nothing_to_judge(whole: Records):
    assert claims(replace(whole, run=replace(whole.run, paper={}))) == []


def test_the_tally_counts_every_claim_once(whole: Records):
    found = claims(whole)
    assert sum(many for _, many in tally(found)) == len(LEDGER)
    grid = tally_grid(found)
    totals = [int(entry.text) for entry in grid.totals[0][1:]]
    assert totals == [sum(claim.verdict == verdict for claim in found) for verdict in VERDICTS]
    columns = zip(*([int(e.text) if e.text != "·" else 0 for e in row[1:]] for row in grid.rows), strict=True)
    assert [sum(column) for column in columns] == totals


def test_claims_as_a_table(whole: Records):
    here = in_a_line(whole)
    rows = {row[0].text: [entry.text for entry in row] for row in claims_grid(claims(whole), here).rows}
    assert rows["Q-NeRF gains over NeRF on chair"][1:4] == ["+1.4 dB", "+0.86 dB", "✕ does not hold"]
    assert rows["NeRF reaches this PSNR on chair"][1:4] == ["33.0 dB", "22.87 dB", f"– {UNTESTED}"]
    assert rows["Weights, total"][1:4] == ["1\u202f370\u202f000", "546\u202f566", "✕ does not hold"]
    assert rows["The range of the gains is that of column Δ"][1:3] == ["1.2 to 1.8 dB", "1.2 to 1.8 dB"]
    assert rows["Baseline NeRF reaches this SSIM on lego"][1] == "0.961"
    assert sum(len(one.grid.rows) for one in chapters(claims(whole), here)) == len(LEDGER)
    scales = {row[0].text: row[3].small for row in claims_grid(claims(whole), here).rows}
    assert scales["Q-NeRF gains over NeRF on chair"] == "", "the run's scale stands above the table"
    assert scales["The φ skip follows layer ⌊φ·8/2⌋"] == OWN_FIGURES


HIGH = {"difference": 1.6, "interval": (1.5, 1.7), "simultaneous": (1.5, 1.7)}


def test_an_average_holds_on_no_other_scenes_than_the_papers(whole: Records, eight: Records):
    name = "table2-average"
    assert by_id(with_comparisons(eight, all=HIGH))[name].verdict == "holds"
    some = by_id(with_comparisons(whole, all=HIGH))[name]
    assert (some.verdict, some.note[:21]) == ("inconclusive", "without ficus, hotdog")
    mixed = with_comparisons(eight, all=HIGH)
    scenes = [*mixed.run.scenes, replace(mixed.run.scenes[0], name="bathroom")]
    found = by_id(replace(mixed, run=replace(mixed.run, scenes=scenes)))[name]
    assert (found.verdict, "with bathroom" in found.note) == ("inconclusive", True)


def test_a_single_scene_does_not_refute_an_average(tmp_path):
    records = read_records(write_fake_run(tmp_path / "run", ("chair",), pictures=False, with_diverged=False))
    low = {"difference": 0.5, "interval": (0.4, 0.6), "simultaneous": (0.4, 0.6)}
    found = by_id(with_comparisons(records, all=low, chair=low))
    assert (found["table2-average"].verdict, found["table2-chair"].verdict) == ("inconclusive", "does not hold")
    assert found["abstract-psnr-range"].verdict == "does not hold", "every scene is said to gain"


def test_where_all_pairs_are_lost_the_claim_is_undecided_and_was_tried(whole: Records):
    nothing = {"difference": None, "interval": None, "pairs": 0, "unpaired": 3, "verdict": "inconclusive"}
    records = with_comparisons(whole, chair=nothing)
    chair = by_id(records)["table2-chair"]
    assert (chair.verdict, chair.measured) == ("inconclusive", None)
    assert chair.note.startswith("all 3 pairs lost")
    cells = [replace(cell, status="not_available") if cell.method == "qnerf" else cell for cell in records.cells]
    absent = by_id(replace(records, cells=cells))["table2-chair"]
    assert (absent.verdict, absent.note) == (UNTESTED, "qnerf was not compared with nerf on chair in this run")


def test_what_the_paper_does_not_print_says_so(whole: Records):
    found = by_id(whole)
    open_ones = {name: one.note for name, one in found.items() if "not printed but derived" in one.note}
    steps = {f"table4-{name}" for name in ("nerf_phi_encoding_amplifier-psnr", "qnerf-psnr")}
    steps |= {f"table4-{name}-ssim" for name in ("nerf_phi_encoding", "nerf_phi_encoding_amplifier", "qnerf")}
    assert set(open_ones) == {"table3-hours", *steps}
    assert open_ones["table3-hours"].endswith("which leave 16.9 to 21.2 % open")
    assert open_ones["table4-qnerf-ssim"].endswith("which leave +0.001 to +0.003 open")


def test_the_papers_scale_needs_its_rays_its_scenes_and_a_cell_that_finished(eight: Records):
    train = {**eight.run.settings["train"], "network": {"depth": 8, "width": 256}, "rays": 1024}
    scenes = [replace(scene, width=800, height=800) for scene in eight.run.scenes]
    run = replace(eight.run, scenes=scenes, settings={**eight.run.settings, "train": train})
    large = replace(eight, run=run, cells=[replace(cell, steps=200_000) for cell in eight.cells])
    assert is_paper_scale(large)
    assert on_other_pictures(large)
    assert not on_other_pictures(replace(large, run=replace(run, scenes=[replace(one, rendered={}) for one in scenes])))
    few = {**run.settings, "train": {**train, "rays": 2048}}
    cells = [cell for cell in large.cells if cell.scene != "ship"]
    seven = replace(large, run=replace(run, scenes=scenes[:7]), cells=cells)
    for changed in (
        replace(large, cells=[replace(cell, status="diverged") for cell in large.cells]),
        seven,
        replace(large, run=replace(run, settings=few)),
    ):
        assert not is_paper_scale(changed)
    assert has_paper_settings(seven)


def test_settings_that_the_paper_states_stand_beside_the_runs(whole: Records):
    found = by_id(whole)
    names = ("setup-iterations", "setup-learning-rate", "setup-rays", "listing2-threshold")
    assert [(found[name].printed, found[name].measured) for name in names] == [
        (200_000, 1600), (0.0005, 0.005), (1024, 2048), (0.5, None),
    ]  # fmt: skip
    rows = {row[0].text: [row[1].text, row[2].text] for row in claims_grid(claims(whole), "").rows}
    assert rows["Rays of an iteration"] == ["1\u202f024", "2\u202f048"]
    assert rows["Threshold of the boost"] == ["0.5", "–"]
    assert rows["Length of the last interval of a ray"] == ["10¹⁰", "–"]
    assert rows["Layers of the density MLP"] == ["8", "6"]
