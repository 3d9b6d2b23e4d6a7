"""Tables as data, compared with literals."""

import pytest

from harness.records.cells import Comparison, LeftOut
from harness.records.verdict import OPEN, Verdict
from reports.claims.estimands import difference_in_words, failures_of, rates_grid, senses_grid
from reports.claims.psnr_table import difference_entry, differences_grids, score_entry, scores_grid
from reports.data.load import Records
from reports.data.table import Spread, average_of, cells_frame, shared_scenes, spread_of
from reports.page.grid import Entry
from reports.run.metrics_table import (
    costs_grid,
    failures_grid,
    left_out_grid,
    metrics_grid,
    properties_grid,
    waiting,
    warnings_grid,
)
from tests.replacing import replace
from tests.reports.claims.test_claims import with_comparisons

ABOVE = Verdict("above 0", "open")
ROW = Comparison("all", "qnerf", "nerf", "psnr", "steps", 0.5, (0.3, 0.7), ABOVE, 0.4, 6, 0, None, 1, None, None)


def with_cells(records: Records, change) -> Records:
    return replace(records, cells=[change(cell) for cell in records.cells])


def labels(grid) -> list[str]:
    return [column.label for column in grid.columns]


def test_spread_is_over_finished_seeds_and_averages_over_scenes_that_every_method_finished(records: Records):
    frame = cells_frame(records)
    complete, partial = spread_of(frame, "chair", "nerf", "psnr"), spread_of(frame, "drums", "qnerf", "psnr")
    assert complete.mean == pytest.approx((22.886 + 22.85 + 22.874) / 3, abs=0.05)
    assert [(spread.done, spread.seeds) for spread in (complete, partial)] == [(3, 3), (2, 3)]
    frame = cells_frame(replace(records, cells=[cell for cell in records.cells if cell.seed == 2]))
    assert shared_scenes(frame, "psnr") == ["chair"]
    assert average_of(frame, "qnerf", "psnr", ["chair"]).sd is None, "of one seed"
    alone = replace(records, cells=[cell for cell in records.cells if (cell.scene, cell.seed) == ("drums", 2)])
    assert scores_grid(alone).rows[-1][4] == Entry("1 of 1 diverged", tone="failed")


def test_differences_are_those_of_the_comparisons(records: Records):
    row = {"difference": 0.125, "interval": (0.01, 0.3), "simultaneous": (0.05, 0.2), "verdict": ABOVE, "unpaired": 0}
    (grid,) = differences_grids(with_comparisons(records, chair=row))
    assert labels(grid) == ["scene", *("− nerf", "− nerf_matched") * 2, "Δ"]
    assert grid.rows[0][1] == Entry("+0.12", "[+0.05, +0.20]\nabove 0, size open", "above gain")
    assert grid.rows[0][5] == Entry("+1.4", tone="muted")
    assert grid.totals[0][0].text == "all scenes"
    assert "1 pair not judged" in grid.totals[0][1].small


@pytest.mark.parametrize(
    ("changes", "entry"),
    [
        ({}, ("+0.50", "[+0.30, +0.70]\nabove 0, size open", "above gain")),
        # a family has its simultaneous interval; colours follow the sign and the metric's direction
        ({"scene": "lego", "simultaneous": (-0.3, 1.3), "family": 8, "verdict": OPEN},
         ("+0.50", "[−0.30, +1.30]\nsign and size open", "open")),
        ({"metric": "flip"}, ("+0.5000", "[+0.3000, +0.7000]\nabove 0, size open", "above loss")),
        ({"difference": None, "interval": None, "verdict": OPEN, "pairs": 0, "unpaired": 3},
         ("–", "sign and size open\n3 pairs not judged", "open")),
    ],
)  # fmt: skip
def test_a_difference_has_its_interval_verdict_and_colour(changes, entry):
    shown = difference_entry(replace(ROW, **changes))
    assert (shown.text, shown.small, shown.tone) == entry


def test_diverged_cells_show_in_every_table_of_scores(records: Records):
    metrics = metrics_grid(records)
    assert [row[1] for row in metrics.rows if row[1].tone == "failed"] == [Entry("qnerf", "1 of 3 diverged", "failed")]
    reason = Entry("not finite at step 412: density_head.weight")
    assert failures_grid(records).rows == [[Entry("drums · qnerf · seed 2"), Entry("diverged", tone="failed"), reason]]


def test_a_score_that_no_cell_has_is_no_column(records: Records):
    without = with_cells(records, lambda cell: replace(cell, scores={**cell.scores, "depth_rmse": None}))
    assert set(labels(metrics_grid(records))) - set(labels(metrics_grid(without))) == {"depth RMSE ↓"}


def test_properties_show_mean_and_range(whole: Records):
    def other_chunks(cell):
        value = 0.01 * (1 + cell.seed) if cell.method == "qnerf" else 0.0
        return replace(cell, properties={"chunk_max_difference": value, "note": "per call", "nothing": None})

    first, note = properties_grid(with_cells(whole, other_chunks)).rows
    assert first[0].text == "largest change of a pixel when a view is rendered in small chunks"
    assert first[1:] == [Entry("0"), Entry("0"), Entry("0.0200", "0.0100 – 0.0300")]
    assert (note[0].text, note[1]) == ("note", Entry("per call"))


def left_out(records: Records, *by_scene: list[LeftOut]):
    scenes = [replace(scene, left_out=some) for scene, some in zip(records.run.scenes, by_scene, strict=True)]
    return left_out_grid(replace(records, run=replace(records.run, scenes=scenes)))


def test_omissions_of_every_scene_are_one_row(records: Records):
    by_scene = [
        [LeftOut(what, why, None, None, None) for what, why in (("space", f"{k} cells"), ("fine pass", "smooth"))]
        for k in (1, 2)
    ]
    grid = left_out(records, *by_scene)
    assert labels(grid) == ["left out", "scene", "because"], "no scene fills the other columns"
    assert [[entry.text for entry in row] for row in grid.rows] == [
        ["space", "chair", "1 cells"],
        ["space", "drums", "2 cells"],
        ["fine pass", "all 2 scenes", "smooth"],
    ]


def test_omissions_state_their_bound_their_cost_and_the_verdict(records: Records):
    omissions = [
        LeftOut("samples in empty space", "mostly empty", 3.0, -0.5, (-0.7, -0.3), "empty_space", "sampling", 0.2, "dB",
                "training", "costs more"),
        LeftOut("samples behind", "opaque", -0.1, 6.4e-5, None, "behind_opaque", "rendering", 1e-4, "colour",
                "rendering", "within its bound"),
        LeftOut("background model", "alpha is known", None, None, None, bound=0.0),
    ]  # fmt: skip
    grid = left_out(records, omissions, [])
    assert labels(grid)[3:] == ["time saved", "change in error", "may cost", "verdict"]
    texts = [[(entry.text, entry.small, entry.tone) for entry in row[3:]] for row in grid.rows]
    assert texts[0] == [
        ("3.0 s", "training", ""), ("−0.500 dB", "[−0.700, −0.300]", ""), ("0.200 dB", "", ""),
        ("costs more", "", "failed"),
    ]  # fmt: skip
    assert texts[1][1][0] == "6.40·10⁻⁵ of a colour"
    assert texts[1][3] == ("within its bound", "", "")
    assert [text for text, _, _ in texts[2]] == ["–", "–", "–", "–"]


@pytest.mark.parametrize(("mean", "ceiling", "limited"), [(37.5, 38.0, True), (36.9, 38.0, False), (37.5, None, False)])
def test_a_score_within_one_db_of_its_ceiling_is_called_reference_limited(mean, ceiling, limited):
    nothing = Spread(None, None, None, None, 0, 3)
    entry = score_entry(Spread(mean, 0.1, mean, mean, 3, 3), nothing, [], ceiling)
    assert ("reference-limited" in entry.small) == limited


def test_the_cost_of_a_method_is_compared_with_that_of_nerf(records: Records):
    grid = costs_grid(records)
    columns = ["method", "training", "multiple", "drawing", "weights", "file", "memory"]
    assert labels(grid) == columns
    nerf, matched, qnerf = grid.rows
    costs = ["54.4 core s", "1", "42.1\u202fms", "24\u202f965", "101.4\u202fkB", "910.0\u202fMB"]
    assert [entry.text for entry in nerf[1:]] == costs
    assert (matched[2].text, matched[2].small) == ("× 0.97", "[0.97, 0.97]")
    assert qnerf[2].value == pytest.approx(1.06, rel=1e-12), "the cell that diverged did fewer steps, and is no pair"
    older = costs_grid(with_cells(records, lambda cell: replace(cell, costs={})))
    assert labels(older) == ["method", "training", "multiple", "weights"]
    apart = with_cells(records, lambda cell: replace(cell, steps=cell.steps + (cell.method == "qnerf")))
    assert [row[2].text for row in costs_grid(apart).rows] == ["1", "× 0.97", "–"], "no pair has as many steps"


def test_cells_that_waited_for_a_processor_are_counted(records: Records):
    assert waiting(records) == ""
    slow = [replace(records.cells[0], train_seconds=1.5 * 54.4), *records.cells[1:]]
    assert waiting(replace(records, cells=slow)) == (
        "1 of 18 cells shared their processor: up to 1.5 seconds of the wall per core second. Other programs ran: "
        "scores are unaffected, wall times are too long."
    )
    slow[0] = replace(slow[0], provenance={"threads": 2})
    assert waiting(replace(records, cells=slow)).endswith(
        "Core seconds of 1 of them are too long as well: several threads waited actively."
    )
    (row,) = [row for row in warnings_grid(replace(records, cells=slow)).rows if "core seconds" in row[3].text]
    assert row[3].text == "core seconds too long: 2 threads waited actively"


def test_both_senses_are_in_one_row(whole: Records):
    grid = senses_grid(whole)
    assert len(grid.rows) == 6, "three pairs of methods, two budgets"
    texts = [entry.text for entry in grid.rows[0]]
    assert texts == ["qnerf", "at equal steps", "+0.81 dB", "+0.76 to +0.86", "+0.69 to +0.93"]
    assert grid.rows[0][3].small == "above 0, matters\nd = +3.2"
    row = whole.comparison("chair", "qnerf", "nerf", budget="seconds")
    assert f"+{row.difference:.2f} dB at equal training time" in difference_in_words(row, ["chair"], [0, 1, 2])


def test_failures_have_rates_and_are_compared(records: Records, whole: Records):
    assert rates_grid(whole).rows == []
    rows = {row[0].text: [entry.text for entry in row[1:]] for row in rates_grid(records).rows}
    assert rows["nerf"][:4] == ["6", "0", "0", "0\u202f%"]
    assert rows["qnerf"][:4] == ["6", "1", "0", "17\u202f%"]
    assert rows["qnerf"][4].splitlines()[0] == "nerf: not distinguished (1 : 0 of 6 pairs, p = 1.000)"
    cells = [replace(cell, warnings=["empty collapse: 0.001"] * (cell.method == "qnerf")) for cell in whole.cells]
    rate = failures_of(replace(whole, cells=cells)).rates[2]
    assert (rate.method, rate.collapsed, rate.rate) == ("qnerf", 6, 1.0)
