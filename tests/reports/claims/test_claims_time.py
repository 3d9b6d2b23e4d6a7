"""Table 3 from the record of when a score was reached: censored runs change no verdict."""

from pathlib import Path

import pytest

from harness.records.cells import Estimate
from harness.records.targets import TargetComparison, TargetsRecord, write_targets
from harness.records.verdict import OPEN
from reports.claims.ledger import Bench, Finding
from reports.claims.time import NEEDS_MACHINE, NEEDS_SCENES, bound, saving, time_to_target
from reports.data.load import Records, read_records
from reports.data.selection import TARGET, Selection
from reports.data.wording import UNTESTED
from scenes.files.errors import DamagedRecord
from tests.replacing import replace
from tests.reports.claims.claimed import claimed
from tests.reports.fake_run import PAPER

ONE = TargetComparison(
    scene="all", method="qnerf", against="nerf", axis="steps", horizon=1600.0, saving=18.0, interval=(-9.0, 41.0),
    simultaneous=(-9.0, 41.0), family=1, verdict=OPEN, smallest_detectable=5.0, difference=-100.0,
    difference_interval=(-130.0, -70.0), pairs=6, never=(0, 0), earlier=(0, 0), unpaired=0,
    at_least=None, at_most=None, on_these_scenes=None, scenes_like_these=None,
)  # fmt: skip


def on_them(pair: tuple[float, float] | None, **changes) -> TargetComparison:
    """Return a row with an interval on these scenes, which decides; the interval on scenes like these is wide."""
    return replace(ONE, on_these_scenes=Estimate(pair, pair, 1, OPEN, None, None), **changes)


SAVED = on_them((14.0, 22.0))
LEDGER = {entry.id: entry for entry in PAPER.claims}
MISSED = "not seen at this scale"


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
        ((10.0, 22.0), {}, "inconclusive", "seen"),
        ((-2.0, 22.0), {}, "inconclusive", "inconclusive"),
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
    (out / "records" / "targets.json").write_text('{"schema": 1}', encoding="utf-8")
    with pytest.raises(DamagedRecord, match=r"targets\.json"):
        read_records(out)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, ""),
        ({"never": (1, 0)}, "the true saving is smaller"),
        ({"earlier": (0, 1)}, "the true saving is smaller"),
        ({"never": (0, 1)}, "the true saving is larger"),
        ({"earlier": (1, 0)}, "the true saving is larger"),
        ({"never": (1, 1)}, "the saving covers only the time watched"),
    ],
)
def test_censored_runs_make_the_saving_a_bound(changes, words):
    assert bound(replace(ONE, **changes)) == words


def test_without_any_pair_the_saving_is_inconclusive(whole: Records):
    lost = replace(ONE, saving=None, pairs=0, unpaired=6)
    finding = judged(whole, lost)
    assert (finding.verdict, finding.measured, finding.note) == ("inconclusive", None, "6 pairs could not be judged")
    cells = [replace(cell, status="not_available") if cell.method == "qnerf" else cell for cell in whole.cells]
    assert judged(replace(whole, cells=cells), lost).verdict == UNTESTED
