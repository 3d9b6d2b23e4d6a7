"""speed.html: targets first, whole, self-contained, escaped, and silent about what is not there."""

import re

import pytest

from harness.records.json_record import DamagedRecord
from harness.records.study import Check, Finding, Series, Studies, StudyInfo, StudyRecord, Table, check
from reports.data.studies_load import find_studies
from reports.drawing.figure import svg
from reports.drawing.palette import pens_of
from reports.drawing.series_charts import panel
from reports.drawing.traces import Panel
from reports.studies.speed_page import speed_page
from tests.reports.fake_speed import fake_speed, hostile, write_fake_speed
from tests.reports.run.test_page import HOSTILE, Outline, foreign_scripts, without_code

EMPTY = Studies("speed", {}, {})


@pytest.fixture(scope="module")
def text() -> str:
    return speed_page(fake_speed())


def one(value: float | None, unit: str = "×", goal: float | None = 10.0, **more) -> Check:
    return check("title", value, goal, unit=unit, owner="machine", id="a.b", **more)


def studies(*findings: Finding) -> list[StudyRecord]:
    return [StudyRecord(StudyInfo("9", "Question 9"), findings=list(findings))]


def test_text_from_data_is_escaped_everywhere():
    text = speed_page(hostile(fake_speed(), HOSTILE))
    assert foreign_scripts(text) == []
    assert text.count("&lt;script&gt;") > 50
    Outline(text)


def test_an_empty_record_is_a_page_too():
    text = speed_page(EMPTY)
    outline = Outline(text)
    assert "Measured on an unnamed processor. No figure was recorded." in text
    assert not any(name.startswith("question") or name == "provenance" for name in outline.ids)
    assert "<svg" not in without_code(text)


def test_a_quick_run_says_so(text):
    assert "A quick run" not in text
    assert "A quick run" in speed_page(fake_speed(settings={"quick": True}))


def test_the_report_beside_it_is_linked():
    assert "report.html" in Outline(speed_page(fake_speed(), beside_report=True)).links


def test_a_single_point_is_drawn_and_a_band_where_the_spread_is_known():
    group = [line for study in fake_speed().studies for line in study.series if line.panel == "Rays a step"]
    made = panel("Rays a step", group, pens_of(series.name for series in group))
    assert [trace.kind for trace in made.traces] == ["band", "band", "line", "mark", "mark"]
    assert (made.x_scale, made.y_scale) == ("log", "log")
    assert "plain 2.20 at 1\u202f024" in made.alt
    assert "<svg" in svg(made, "one")


@pytest.mark.parametrize(("x", "y"), [([0.0], [0.0]), ([0.0, 1.0], [-1.0, 2.0]), ([3.0, 3.0], [1.0, 1.0])])
def test_values_that_no_logarithm_has_are_still_shown(x, y):
    drawn = panel("p", [Series("p", 9, "a", "x", "y", x, y)], pens_of(["a"]))
    assert isinstance(drawn, Panel)
    assert drawn.x_scale == ("log" if min(x) > 0 else "linear")
    assert [trace.x for trace in drawn.traces][-1] == tuple(x)
    assert "<svg" in svg(drawn, "p")


def test_lines_never_run_back():
    made = panel("p", [Series("p", 9, "a", "x", "y", [3.0, 1.0], [6.0, 2.0])], pens_of(["a"]))
    assert (made.traces[0].x, made.traces[0].y) == ((1.0, 3.0), (2.0, 6.0))


def test_a_table_of_numbers_is_set_to_the_right_and_a_gap_is_a_dash():
    record = fake_speed(
        studies=studies(Table("t", 2, "T", ["part", "ms", "note"], [["a", 1.234, None], ["b", 2, "x"]]))
    )
    text = speed_page(record)
    assert '<td class="" data-value="1.234">1.23</td>' in text
    assert '<td class="muted words">–</td>' in text


@pytest.mark.parametrize(
    ("finding", "said"),
    [
        (Series("p", 9, "a", "x", "y", [1.0], []), "series 'a' has 1 x but 0 y"),
        (Series("p", 9, "a", "x", "y", [1.0], [1.0], [], [1.0]), "1 x but 0 low"),
        (Table("t", 2, "T", ["a"], [["x", 1.0]]), "table 't' has 1 columns but a row of 2"),
    ],
)
def test_a_record_that_is_not_what_it_should_be_is_named(tmp_path, finding, said):
    out = write_fake_speed(tmp_path, studies=studies(finding))
    with pytest.raises(DamagedRecord, match=re.escape(said)) as caught:
        find_studies(out, "speed")
    assert str(caught.value).startswith(str(out / "speed.json"))
    assert "nox -s speed" in str(caught.value)
