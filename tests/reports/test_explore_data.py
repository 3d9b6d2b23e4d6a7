"""The data of the page's script: values for sorting, runs behind a cell, and the numbers of a drawing."""

import json
import math
import re

import pytest
from markupsafe import Markup

from harness.records.study import StudyInfo, StudyRecord, check
from reports.claims.psnr_table import scores_grid
from reports.data.selection import Selection
from reports.data.shelf_records import NO_SHELVES
from reports.drawing.figure import svg
from reports.drawing.traces import Panel, Trace, rounded
from reports.page.grid import Entry
from reports.page.shell import entry_data, row_data
from reports.run.metrics_table import comparisons_grid, metrics_grid
from reports.run.runs_data import density_data, runs_data
from reports.run.saving.export import tables
from reports.studies.check_words import checks_grid
from tests.replacing import replace

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
    assert grid.rows[0][2].runs == Selection("chair", "nerf", metric="psnr")
    mean = sum(cell.scores["psnr"] for cell in records.cells_of("chair", "nerf")) / 3
    assert grid.rows[0][2].value == pytest.approx(mean)
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
