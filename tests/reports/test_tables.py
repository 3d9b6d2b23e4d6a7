"""Tables, compared with literals, and the data of the page's script: values, runs, and the numbers of a drawing."""

import json
import math
import re

import pytest
from markupsafe import Markup

from harness.records.cells import Comparison, LeftOut
from harness.records.study import StudyInfo, StudyRecord, check
from harness.records.verdict import OPEN, Verdict
from reports.claims.estimands import difference_in_words, failures_of, rates_grid, senses_grid
from reports.claims.psnr_table import difference_entry, differences_grids, score_entry, scores_grid
from reports.data.load import Records
from reports.data.selection import Selection
from reports.data.studies_load import NO_SHELVES
from reports.data.table import Spread, average_of, cells_frame, shared_scenes, spread_of
from reports.drawing.figure import svg
from reports.drawing.traces import Panel, Trace, rounded
from reports.page.grid import Entry
from reports.page.shell import entry_data, row_data
from reports.run.metrics_table import (
    comparisons_grid,
    costs_grid,
    failures_grid,
    left_out_grid,
    metrics_grid,
    properties_grid,
    waiting,
    warnings_grid,
)
from reports.run.runs_data import density_data, runs_data
from reports.run.saving.export import tables
from reports.studies.check_words import checks_grid
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
    finished = [score for cell in records.cells_of("drums", "qnerf") if (score := cell.scores["psnr"]) is not None]
    assert (len(finished), partial.mean) == (2, pytest.approx(sum(finished) / 2))
    frame = cells_frame(replace(records, cells=[cell for cell in records.cells if cell.seed == 2]))
    assert shared_scenes(frame, "psnr") == ["chair"]
    one = average_of(frame, "qnerf", "psnr", ["chair"])
    assert one.sd is None
    assert "±" not in score_entry(one, one, [], None).text, "of one seed"
    alone = replace(records, cells=[cell for cell in records.cells if (cell.scene, cell.seed) == ("drums", 2)])
    assert scores_grid(alone).rows[-1][2] == Entry("1 of 1 diverged", tone="failed")


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
    entry = score_entry(Spread(mean, 0.1), Spread(None, None), [], ceiling)
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


HOSTILE = '"><img src=x onerror=alert(1)>'


def test_every_number_of_a_table_carries_its_value(records):
    for grid in tables(records, NO_SHELVES):
        for row in [*grid.rows, *grid.totals]:
            for column, entry in zip(grid.columns, row, strict=True):
                if column.numeric and re.fullmatch(r"[+−]?\d[\d.\u202f]*( ?\D{0,8})?", entry.text):
                    assert isinstance(entry.value, int | float), (grid.caption, column.label, entry.text)


@pytest.mark.parametrize(("unit", "value"), [("s", 12.0), ("ms", 0.012), ("GB", 12e9), ("million samples/s", 12.0)])
def test_figures_of_several_units_are_sorted_in_seconds_and_bytes(unit, value):
    study = StudyRecord(StudyInfo("1", "One"), findings=[check("time", 12.0, unit=unit)])
    (row,) = checks_grid("Checks", [(study, study.checks[0])]).rows
    assert row[-1].value == pytest.approx(value)


def test_a_cell_carries_its_value_its_further_numbers_and_its_runs():
    entry = Entry("27.31 ± 0.12", value=27.3123456789, parts={"sd": 0.12, "low": None}, runs=Selection("lego", seed=0))
    assert entry_data(entry) == Markup(
        ' data-value="27.31235" data-parts="{&#34;sd&#34;:0.12}"'
        ' data-runs="{&#34;scene&#34;:&#34;lego&#34;,&#34;seed&#34;:0}"'
    )
    assert entry_data(Entry("", value="lego")) == ' data-said="lego"'
    assert entry_data(Entry("lego")) == ""
    assert entry_data(Entry("–", value=math.nan, parts={"sd": math.inf})) == "", "not finite is no value"


def test_hostile_names_stay_within_their_attribute():
    entry = Entry(HOSTILE, value=HOSTILE, runs=Selection(HOSTILE, "'"))
    for text in (entry_data(entry), row_data([entry])):
        assert re.findall(r"<|>", text) == []
        assert len(re.findall(r'"', text)) % 2 == 0


def test_a_row_belongs_to_a_scene_only_where_all_of_it_does():
    lego, ship = (Entry("1", runs=Selection(scene, "nerf")) for scene in ("lego", "ship"))
    assert row_data([Entry("x"), lego]) == ' data-scene="lego" data-method="nerf"'
    assert row_data([lego, ship]) == ' data-method="nerf"'
    assert row_data([Entry("x")]) == ""


def test_cells_of_the_score_tables_know_their_runs(records):
    grid = scores_grid(records)
    assert labels(grid)[:6] == ["scene", "nerf", "qnerf", "nerf_matched", "floor", "ceiling"], "the compared first"
    assert grid.rows[0][1].runs == Selection("chair", "nerf", metric="psnr")
    mean = sum(cell.scores["psnr"] for cell in records.cells_of("chair", "nerf")) / 3
    assert grid.rows[0][1].value == pytest.approx(mean)
    blank = metrics_grid(records).rows[1]
    assert (blank[0].text, blank[0].value) == ("", "chair")
    row, entry = records.comparisons[0], comparisons_grid(records).rows[0][4]
    assert entry.runs == Selection(row.scene, row.method, row.against, row.metric, row.budget)
    assert entry.parts == {"low": row.interval[0], "high": row.interval[1]}


def drawn(text: str) -> dict:
    return json.loads(re.search(r'class="drawn">(.*?)</script>', text, re.DOTALL)[1])


def test_a_drawing_brings_its_numbers_and_where_its_axes_lie():
    runs = (Selection("lego", "nerf"),)
    panel = Panel(
        "t", "x", "y",
        (Trace("a", "#0072b2", "line", (1.0, 10.0), (0.123456789, math.nan), runs=runs, steps=(5, 6)),
         Trace("b", "#123456", "dots", (1.0, 10.0), (1.0, 2.0)),
         Trace("c", "#0072b2", "area", (1.0,), (1.0,))),
        "alt", "log", x_limits=(1.0, 100.0), y_limits=(0.0, 2.0),
    )  # fmt: skip
    data = drawn(svg(panel, "one"))
    assert data["traces"] == [
        {"label": "a", "kind": "line", "colour": "--nerf", "x": [1, 10], "y": [0.123457, None], "runs": [0],
         "steps": [5, 6]},
        {"label": "b", "kind": "dots", "colour": "--ink", "x": 0, "y": [1, 2]},
    ]  # fmt: skip
    assert data["runs"] == [{"scene": "lego", "method": "nerf"}]
    assert data["x"] == {"label": "x", "scale": "log", "low": 1, "high": 100}
    assert data["box"] == rounded((0.62 * 72, 0.12 * 72, (3.7 - 0.74) * 72, (2.6 - 0.62) * 72))


def test_a_drawing_of_hostile_words_cannot_end_its_data():
    hostile = "</script><script>alert(1)</script>"
    text = svg(Panel(hostile, hostile, "", (Trace(hostile, "#0072b2", "line", (0.0, 1.0), (0.0, 1.0)),), ""), "one")
    assert text.count("<script") == text.count("</script>") == 1
    assert drawn(text)["title"] == hostile


def test_every_run_is_there_with_what_sets_it_apart(records):
    assert rounded([1234567.0, 0.1234567, math.nan, math.inf, 2.0]) == [1234570, 0.123457, None, None, 2], "six digits"
    data = runs_data(records)
    assert len(data["cells"]) == len(records.cells)
    (lost,) = [cell for cell in data["cells"] if cell["status"] == "diverged"]
    assert (lost["scene"], lost["method"], lost["seed"], lost["scores"]) == ("drums", "qnerf", 2, {})
    assert lost["reason"] == "not finite at step 412: density_head.weight"
    first, cell = data["cells"][0], records.cells[0]
    assert first["scores"]["psnr"] == pytest.approx(cell.scores["psnr"], rel=1e-5)
    assert first["curve"]["step"] == [point.step for point in cell.curve]
    assert first["curve"]["core_seconds"] == pytest.approx([point.core_seconds for point in cell.curve], rel=1e-5)
    assert first["core_seconds"] == pytest.approx(cell.train_core_seconds, rel=1e-5)
    assert "alpha" not in first["curve"]
    assert (first["differing"], first["file"]) == ({}, "records/cells/chair.nerf.0.json")
    json.dumps(data, allow_nan=False)


def test_runs_of_an_incomplete_group_are_marked(records):
    def apart(records):
        cells = runs_data(records)["cells"]
        return [(cell["scene"], cell["method"], cell["seed"]) for cell in cells if not cell.get("whole", True)]

    assert apart(records) == []
    lacking = [cell for cell in records.cells if (cell.scene, cell.method, cell.seed) != ("chair", "nerf", 1)]
    assert apart(replace(records, cells=lacking)) == [("chair", "nerf_matched", 1), ("chair", "qnerf", 1)]
    planned = {"methods": {**records.run.methods, "extra": "on one scene"}, "settings": {"methods": records.methods}}
    assert apart(replace(records, run=replace(records.run, **planned))) == [], "methods of single scenes do not count"


def test_histograms_leave_out_what_is_the_same_and_carry_the_true_occupancy(records):
    def split(cell):
        sides = {"before_inside": [1.0, 0.0], "after_inside": [1.0, 0.0], "before_outside": [0.0, 1.0],
                 "after_outside": [0.5, 0.5], "before": [0.5, 0.5], "after": [0.5, 0.5], "edges": [0.0, 0.5, 1.0],
                 "points": [3.0, 5.0]}  # fmt: skip
        return replace(cell, curve=[replace(cell.curve[0], density=sides)])

    data = density_data(replace(records, cells=[split(records.cells[0])]))[0]
    assert data["edges"] == [0, 0.5, 1]
    assert data["at"] == [{"before": [0.5, 0.5], "before_inside": [1, 0], "before_outside": [0, 1],
                          "after_outside": [0.5, 0.5], "points": [3.0, 5.0]}]  # fmt: skip
