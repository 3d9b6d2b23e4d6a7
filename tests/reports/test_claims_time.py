"""Table 3 from the record of when a score was reached: what is censored turns no verdict."""

from dataclasses import replace

import pytest

from harness.json_record import DamagedRecord
from harness.targets_record import Reach, TargetComparison, TargetsRecord, write_targets
from reports.claims import claims
from reports.claims_time import bound, saving, time_to_target, verdict_of
from reports.ledger import UNTESTED, Bench, entries
from reports.load import Records, read_records
from reports.selection import TARGET, Selection
from tests.reports.fake_run import PAPER

ONE = TargetComparison(
    scene="all", method="qnerf", against="nerf", axis="steps", horizon=1600.0, saving=12.0, interval=(9.0, 15.0),
    simultaneous=(8.0, 16.0), family=1, verdict="better", smallest_detectable=5.0, difference=-100.0,
    difference_interval=(-130.0, -70.0), pairs=6, never=(0, 0), earlier=(0, 0), unpaired=0,
)  # fmt: skip
LEDGER = {one.id: one for one in entries(PAPER)}


def record(one: TargetComparison = ONE, target: float = 30.0, printed: bool = True) -> TargetsRecord:
    reaches = [
        Reach("chair", method, seed, axis, time, "reached")
        for method, time in (("nerf", 1000.0), ("qnerf", 900.0))
        for axis in ("steps", "seconds")
        for seed in (0, 1, 2)
    ]
    return TargetsRecord(target, printed, "nerf", "chosen", reaches, [], [one, replace(one, axis="seconds")])


def bench(whole: Records, targets: TargetsRecord | None) -> Bench:
    return Bench(whole, None, targets, "here", False)


@pytest.mark.parametrize(
    ("pair", "verdict"),
    [((8.0, 16.0), "does not hold"), ((8.0, 20.0), "inconclusive"), ((17.6, 25.0), "holds"), (None, "inconclusive")],
)
def test_at_the_printed_target_the_interval_judges(pair, verdict):
    assert verdict_of(18, 0.5, replace(ONE, simultaneous=pair, interval=pair), True) == verdict


@pytest.mark.parametrize("pair", [(8.0, 16.0), (17.6, 25.0)])
def test_at_a_lower_target_it_is_not_tested(pair):
    assert verdict_of(18, 0.5, replace(ONE, simultaneous=pair), False) == UNTESTED


def test_who_never_gets_where_everybody_else_gets_is_not_faster():
    assert verdict_of(18, 0.5, replace(ONE, never=(6, 0)), True) == "does not hold"


@pytest.mark.parametrize(
    "changes", [{"never": (6, 0)}, {"never": (5, 0)}, {"never": (6, 1)}, {"pairs": 1, "never": (1, 0)}]
)
def test_a_lower_target_settles_nothing(changes):
    assert verdict_of(18, 0.5, replace(ONE, **changes), False) == UNTESTED


@pytest.mark.parametrize(
    ("pair", "changes", "verdict"),
    [
        ((8.0, 16.0), {"never": (0, 1)}, "inconclusive"),
        ((8.0, 16.0), {"earlier": (1, 0)}, "inconclusive"),
        ((8.0, 16.0), {"never": (1, 0)}, "does not hold"),
        ((8.0, 16.0), {"earlier": (0, 1)}, "does not hold"),
        ((19.0, 25.0), {"never": (1, 0)}, "inconclusive"),
        ((19.0, 25.0), {"earlier": (0, 1)}, "inconclusive"),
        ((19.0, 25.0), {"never": (0, 1)}, "holds"),
        ((19.0, 25.0), {"earlier": (1, 0)}, "holds"),
        ((8.0, 16.0), {"unpaired": 1}, "inconclusive"),
        ((19.0, 25.0), {"unpaired": 1}, "inconclusive"),
        ((19.0, 25.0), {"unpaired": 1, "never": (6, 0)}, "inconclusive"),
    ],
)
def test_a_verdict_that_the_censored_runs_could_turn_is_none(pair, changes, verdict):
    assert verdict_of(18, 0.5, replace(ONE, simultaneous=pair, **changes), True) == verdict


def test_a_saving_at_a_lower_target_stands_beside(whole: Records):
    found = saving(bench(whole, record(replace(ONE, never=(2, 0)), 24.0, False)), LEDGER["abstract-faster"])
    assert (found.verdict, found.measured, found.interval) == (UNTESTED, 12.0, (8.0, 16.0))
    assert found.note.startswith(
        "at 24.0 dB instead of 30 dB; within the training steps that both were watched, 4 of 6 runs of Q-NeRF and 6 of "
        "6 of NeRF reached it; the true saving is smaller; without ficus"
    )


def test_iterations_and_hours_are_read_from_their_own_axis(whole: Records):
    targets = record()
    targets = replace(targets, comparisons=[ONE, replace(ONE, axis="seconds", saving=3.0, simultaneous=(1.0, 5.0))])
    found = [saving(bench(whole, targets), LEDGER[name]) for name in ("abstract-faster", "table3-hours")]
    assert [(one.measured, one.verdict) for one in found] == [(12.0, "does not hold"), (3.0, "does not hold")]
    behind = [Selection("", "qnerf", "nerf", TARGET, axis) for axis in ("steps", "seconds")]
    assert [one.runs for one in found] == behind


def test_times_themselves_are_never_judged(whole: Records):
    steps, hours = (
        time_to_target(bench(whole, record()), LEDGER[f"table3-{name}-qnerf"]) for name in ("iterations", "hours")
    )
    assert (steps.verdict, steps.measured) == (UNTESTED, 900.0)
    assert (hours.measured, hours.interval) == (pytest.approx(0.25), None)
    assert hours.note == "0.25 to 0.25 h over scenes and seeds"
    lower = time_to_target(bench(whole, record(target=24.0, printed=False)), LEDGER["table3-hours-qnerf"])
    assert (lower.measured, lower.verdict) == (None, UNTESTED)


def test_a_median_of_those_that_got_there_is_none_of_all(whole: Records):
    targets = record()
    lost = replace(targets.reaches[-1], known="never")
    found = time_to_target(bench(whole, replace(targets, reaches=[*targets.reaches[:-1], lost])),
                           LEDGER["table3-hours-qnerf"])  # fmt: skip
    assert (found.measured, found.note) == (None, "1 of 3 runs not seen to reach it")


def test_without_a_record_nothing_is_tested(whole: Records):
    found = {one.id: one for one in claims(whole)}["abstract-faster"]
    assert (found.verdict, found.measured) == (UNTESTED, None)


def test_the_record_beside_the_run_is_read(whole: Records):
    write_targets(whole.out, record())
    assert {one.id: one for one in claims(read_records(whole.out))}["abstract-faster"].measured == 12.0


def test_a_damaged_record_of_targets_names_the_file(whole: Records):
    path = whole.out / "records" / "targets.json"
    path.write_text('{"schema": 1}', encoding="utf-8")
    with pytest.raises(DamagedRecord, match=r"targets\.json"):
        read_records(whole.out)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, ""),
        ({"never": (1, 0)}, "the true saving is smaller"),
        ({"earlier": (0, 1)}, "the true saving is smaller"),
        ({"never": (0, 1)}, "the true saving is larger"),
        ({"earlier": (1, 0)}, "the true saving is larger"),
        ({"never": (1, 1)}, "the saving is of the time watched alone"),
    ],
)
def test_on_which_side_the_saving_is_a_bound(changes, said):
    assert bound(replace(ONE, **changes)) == said


def test_where_every_pair_is_lost_nothing_is_refuted(whole: Records):
    lost = replace(ONE, saving=None, interval=None, simultaneous=None, pairs=0, unpaired=6)
    found = saving(bench(whole, record(lost)), LEDGER["abstract-faster"])
    assert (found.verdict, found.measured) == ("inconclusive", None)
    assert "all 6 pairs lost" in found.note
    cells = [replace(cell, status="not_available") if cell.method == "qnerf" else cell for cell in whole.cells]
    assert saving(bench(replace(whole, cells=cells), record(lost)), LEDGER["abstract-faster"]).verdict == UNTESTED


def test_a_saving_on_some_scenes_does_not_hold_on_average(whole: Records):
    high = replace(ONE, simultaneous=(19.0, 25.0))
    assert saving(bench(whole, record(high)), LEDGER["abstract-faster"]).verdict == "inconclusive"


def test_derived_hours_have_the_rounding_of_both_figures(whole: Records):
    near = replace(record(), comparisons=[replace(ONE, axis="seconds", simultaneous=(14.0, 18.0))])
    assert saving(bench(whole, near), LEDGER["table3-hours"]).verdict == "inconclusive"
    below = replace(record(), comparisons=[replace(ONE, axis="seconds", simultaneous=(12.0, 16.8))])
    assert saving(bench(whole, below), LEDGER["table3-hours"]).verdict == "does not hold"
