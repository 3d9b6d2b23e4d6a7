"""Printed numbers against measured ones: never a silent pass."""

from dataclasses import replace

import pytest

from harness.records import Comparison
from reports.claims import UNTESTED, claims, half_unit, judge_comparison, judge_difference
from reports.claims_table import claims_grid
from reports.load import Records, read_records
from tests.reports.fake_run import write_fake_run


@pytest.mark.parametrize(
    ("printed", "half"), [(1.4, 0.05), (0.006, 0.0005), (257, 0.5), (67_000, 500), (1_370_000, 5000), (18.0, 0.5)]
)
def test_rounding_of_printed_numbers(printed, half):
    assert half_unit(printed) == pytest.approx(half)


@pytest.mark.parametrize(
    ("measured", "verdict"),
    [
        ((0.2, 1.0), "does not hold"),
        ((0.2, 1.34), "does not hold"),
        ((0.2, 1.36), "inconclusive"),
        ((0.2, 3.0), "inconclusive"),
        ((1.36, 1.5), "holds"),
        ((2.0, 3.0), "holds"),
        (None, UNTESTED),
    ],
)
def test_a_printed_difference_against_an_interval(measured, verdict):
    assert judge_difference(1.4, 0.05, measured) == verdict


def test_lost_cells_settle_no_claim():
    one = Comparison("all", "qnerf", "nerf", "psnr", "steps", 0.1, (0.0, 0.2), "inconclusive", 0.1, 5, 1)
    assert judge_comparison(1.5, 0.05, one) == "inconclusive"
    assert judge_comparison(1.5, 0.05, replace(one, left_aside=0)) == "does not hold"
    assert judge_comparison(1.5, 0.05, replace(one, difference=None, interval=None)) == UNTESTED
    assert judge_comparison(1.5, 0.05, None) == UNTESTED


def by_id(records: Records):
    return {claim.id: claim for claim in claims(records)}


def test_every_claim_has_a_verdict_and_a_scale(whole: Records):
    found = by_id(whole)
    assert set(found) == {
        "abstract-psnr-range",
        *(f"table1-{part}" for part in ("density_net", "density_head", "colour_net", "total")),
        *(f"table2-{s}" for s in ("chair", "drums", "ficus", "hotdog", "lego", "materials", "mic", "ship", "average")),
        "table3-iterations",
        "table3-hours",
        *(f"table4-{method}-{metric}" for method in ("nerf_phi", "qnerf") for metric in ("psnr", "ssim")),
        "abstract-sloc",
        "section8.1-retrieval",
    }
    assert all(claim.scale for claim in found.values())
    assert found["table2-chair"].scale == "profile reduced, 32 × 32 px, 1\u202f600 steps, 3 seeds, 6 × 64 network"


def test_table_1_is_counted(whole: Records):
    found = by_id(whole)
    assert (found["table1-density_net"].measured, found["table1-density_net"].verdict) == (493_056, "does not hold")
    assert found["table1-density_head"].verdict == "holds"


def test_table_2_names_what_is_left_against_the_control(whole: Records):
    chair = by_id(whole)["table2-chair"]
    assert (chair.printed, chair.measured, chair.verdict) == (1.4, 0.858, "does not hold")
    assert chair.note == "against nerf_matched: −0.19 [−0.49, +0.11] (inconclusive)"
    assert by_id(whole)["table2-lego"].verdict == UNTESTED
    assert by_id(whole)["table2-average"].note.startswith("without ficus, hotdog")


def test_table_3_is_not_tested_below_30_db(whole: Records):
    claim = by_id(whole)["table3-iterations"]
    assert (claim.printed, claim.verdict, claim.note) == (18.0, UNTESTED, "not both methods reach 30 dB")


def test_table_3_counts_steps_and_seconds_to_30_db(tmp_path):
    def above_thirty(cell):
        lift = {"nerf": 8.0, "nerf_matched": 8.0, "qnerf": 8.0}[cell.method]
        return replace(cell, curve=[replace(point, psnr=point.psnr + lift) for point in cell.curve])

    out = write_fake_run(tmp_path / "run", pictures=False, with_diverged=False, change_cell=above_thirty)
    found = by_id(read_records(out))
    iterations, hours = found["table3-iterations"], found["table3-hours"]
    assert 35 < iterations.measured < 75, "qnerf is 0.8 dB higher at each step, so it is there much sooner"
    assert iterations.interval[0] <= iterations.measured <= iterations.interval[1]
    assert iterations.verdict == "holds"
    assert hours.measured < iterations.measured, "its steps take longer"


def test_table_3_with_one_seed_is_inconclusive(tmp_path):
    def above_thirty(cell):
        return replace(cell, curve=[replace(point, psnr=point.psnr + 8) for point in cell.curve])

    out = write_fake_run(tmp_path / "run", seeds=1, pictures=False, with_diverged=False, change_cell=above_thirty)
    assert by_id(read_records(out))["table3-iterations"].verdict == "inconclusive"


def test_the_ablation_is_judged_where_it_was_run(tmp_path):
    records = read_records(write_fake_run(tmp_path / "run", ("lego",), pictures=False, with_diverged=False))
    found = by_id(records)
    assert found["table4-qnerf-psnr"].printed == 1.5
    assert found["table4-qnerf-psnr"].verdict == "does not hold"
    assert found["table4-nerf_phi-psnr"].verdict == UNTESTED


def test_without_printed_numbers_there_is_little_to_judge(whole: Records):
    bare = replace(whole, run=replace(whole.run, paper={}))
    assert {claim.verdict for claim in claims(bare)} == {UNTESTED}


def test_claims_as_a_table(whole: Records):
    rows = {row[1].text: [entry.text for entry in row] for row in claims_grid(whole).rows}
    assert rows["Q-NeRF gains over NeRF on chair"][2:] == ["+1.4 dB", "+0.86 dB", "does not hold"]
    assert rows["Weights, total"][2:] == ["1\u202f370\u202f000", "546\u202f566", "does not hold"]
    assert rows["Q-NeRF needs this much fewer iterations to reach 30 dB"][2:] == ["18 %", "–", UNTESTED]
