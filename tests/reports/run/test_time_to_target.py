"""When runs reached a score: the page shows the record, including every run that did not reach it."""

from harness.records.targets import Reach, ReachCurve, TargetComparison, TargetsRecord
from harness.records.verdict import OPEN
from harness.verdicts.survival import targets
from reports.data.load import Records
from reports.drawing.palette import KNOWN
from reports.run.run_page import page
from reports.run.time_to_target import at_risk_grid, is_lost, notes, reach_panels, savings_grid, share_at, target_title
from tests.replacing import replace

CURVE = ReachCurve("nerf", "all", "steps", [100.0, 200.0, 800.0], [0.25, 0.5, 0.5], [4, 3, 2])
SAVING = TargetComparison(
    "all", "qnerf", "nerf", "steps", 800.0, 18.0, (3.0, 31.0), (-1.0, 33.0), 8, OPEN, 20.4, -80.0,
    (-90.0, -70.0), 6, (0, 1), (2, 0), 1, 3.0, None, None, None,
)  # fmt: skip
REACHES = [
    Reach("chair", "nerf", 0, "steps", 100.0, "earlier"),
    Reach("chair", "nerf", 1, "steps", 200.0, "reached"),
    Reach("drums", "nerf", 0, "steps", 800.0, "never", "ended at 22.10 dB"),
    Reach("drums", "nerf", 1, "steps", 150.0, "never", "diverged"),
]
RECORD = TargetsRecord(24.0, False, "nerf", "24 dB, because.", REACHES, [CURVE], [SAVING])


def test_the_curve_begins_at_0_and_marks_runs_that_never_reached_the_target(records: Records):
    assert [share_at(CURVE, time) for time in (50.0, 100.0, 199.0, 200.0, 9e9)] == [0.0, 0.25, 0.25, 0.5, 0.5]
    (panel,) = reach_panels(replace(records, targets=RECORD), ["all"])
    curve, below, lost = panel.traces
    assert (curve.kind, curve.colour) == ("outline", KNOWN["nerf"].light)
    assert curve.x == (62.5, 100.0, 200.0, 800.0)
    assert curve.y == (0.0, 0.25, 0.5, 0.5)
    assert (below.kind, below.x, below.y) == ("mark", (800.0,), (0.5,))
    assert (lost.kind, lost.x, lost.y) == ("cross", (150.0,), (0.25,))
    assert panel.alt == "all scenes: share of runs at 24 dB against training step. nerf 50% by 800."


def test_lost_runs_are_distinguished_from_runs_that_ended_below(records: Records):
    assert [is_lost(reach) for reach in REACHES] == [False, False, False, True]
    assert notes(RECORD) == [
        "nerf: of 4 runs, 1 ended below it, 1 diverged or failed, 1 had it by the first checkpoint."
    ]
    made = targets(records.cells, records.methods)
    statuses = {(cell.scene, cell.method, cell.seed): cell.status for cell in records.cells}
    assert sum(map(is_lost, made.reaches)) == 3, "one run, on three axes"
    for reach in made.reaches:
        assert is_lost(reach) == (statuses[reach.scene, reach.method, reach.seed] != "done")


def test_savings_have_interval_verdict_and_the_number_of_censored_runs():
    grid = savings_grid(RECORD, ["all"])
    ((method, steps, seconds),) = grid.rows
    assert (method.text, method.small) == ("qnerf", "against nerf")
    assert (steps.text, steps.tone) == ("+18.0\u202f%", "open")
    assert steps.small.splitlines() == [
        "[−1.0, +33.0]", "sign and size open", "detectable 20\u202f%", "not within the time watched:",
        "1 of 6 runs of nerf", "there at once:", "2 of 6 runs of qnerf", "to the target itself +3.0\u202f% or more",
        "horizon 800 steps", "1 pair not judged",
    ]  # fmt: skip
    assert seconds.text == "–"
    assert dict(steps.parts)["detectable"] == 20.4
    counted = replace(RECORD, comparisons=[*RECORD.comparisons, replace(SAVING, axis="core_seconds")])
    grid = savings_grid(counted, ["all"])
    assert [column.label for column in grid.columns[1:]] == ["fewer steps", "less training time", "fewer core seconds"]
    assert grid.rows[0][3].small.splitlines()[-2] == "horizon 800 core s"


def test_a_pair_without_a_saving_is_a_row():
    lost = {"saving": None, "interval": None, "smallest_detectable": None}
    unpaired = replace(SAVING, **lost, pairs=0, never=(0, 0), earlier=(0, 0))
    grid = savings_grid(replace(RECORD, comparisons=[unpaired]), ["all"])
    assert (grid.rows[0][1].text, grid.rows[0][1].small) == ("–", "sign and size open\n1 pair not judged")
    assert savings_grid(replace(RECORD, comparisons=[]), ["all"]) is None


def test_without_a_target_the_section_says_why(records: Records, whole_page: str):
    bare = replace(records, targets=TargetsRecord(None, False, "nerf", "No target: nothing has a score.", [], [], []))
    assert target_title(bare.targets) == "Time to a target"
    assert "No target: nothing has a score." in page(bare)
    assert reach_panels(bare, ["all", *bare.scenes]) == []
    assert '<section id="reaching">' not in whole_page, "it has no record of targets"


def test_numbers_at_risk_are_those_still_watched_and_below() -> None:
    later = ReachCurve("qnerf", "all", "steps", [400.0], [0.5], [2])
    grid = at_risk_grid(replace(RECORD, curves=[CURVE, later, replace(CURVE, scene="chair")]))
    assert [[entry.text for entry in row] for row in grid.rows] == [
        ["nerf", "4", "3", "2", "2", "2"],
        ["qnerf", "2", "2", "2", "0", "0"],
    ]
    assert grid.rows[0][0].small == "0, 200, 400, 600, 800 steps"
    assert at_risk_grid(replace(RECORD, curves=[replace(CURVE, scene="chair")])) is None
