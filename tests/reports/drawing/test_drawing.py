"""Lines of a record in charts, in a page with other drawings: nothing is dropped silently, no two lines look alike."""

import math
import re
from itertools import pairwise

import pytest

from harness.records.study import Series
from reports.drawing.figure import draw, spread, svg
from reports.drawing.palette import COLOURS, KNOWN, pens_of
from reports.drawing.series_charts import MOST_BANDS, charts, panels_of, points
from reports.drawing.traces import Panel, Trace


def line(y, x=None, name="a", **more) -> Series:
    return Series("p", 1, name, "x", "y", x or [10.0**k for k in range(len(y))], y, **more)


def drawn(*lines: Series) -> Panel:
    return panels_of(list(lines))[0][0]


def of_kind(made: Panel, kind: str) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    return [(trace.x, trace.y) for trace in made.traces if trace.kind == kind]


def test_a_zero_on_a_logarithmic_axis_stands_at_its_foot_and_its_tick_says_zero():
    made = drawn(line([1e-3, 0.0, 1e-7]))
    assert made.y_scale == "log"
    assert made.zero_at == pytest.approx(1e-8)
    assert of_kind(made, "zero") == [((10.0,), (made.zero_at,))]
    assert of_kind(made, "mark") == [((1.0, 100.0), (1e-3, 1e-7))]
    assert of_kind(made, "line") == [((1.0, 10.0, 100.0), (1e-3, made.zero_at, 1e-7))]
    axes = draw(made).axes[0]
    labels = {at: axes.yaxis.get_major_formatter()(at) for at in axes.yaxis.get_majorticklocs()}
    assert labels[made.zero_at] == "0"
    assert list(labels.values()).count("0") == 1
    assert min(labels) == made.zero_at
    assert charts([line([1e-3, 0.0])], "t")[0].notes == ["▽ exactly 0, drawn at the foot of the axis"]


@pytest.mark.parametrize("values", [[5e-324, 1.0, 3.0], [1e-320, 1e308], [-1.7e308, 0.0, 1.7e308], [1.7e308]])
def test_any_number_that_a_file_can_hold_is_drawn(values):
    made = drawn(line(values))
    assert all(map(math.isfinite, made.y_limits))
    assert "<svg" in svg(made, "extreme")


@pytest.mark.parametrize("lost", [None, math.nan, math.inf])
def test_what_is_not_finite_breaks_the_line_and_is_marked_at_the_upper_edge(lost):
    made = drawn(line([1.0, 2.0, lost, 4.0, 5.0]))
    assert [y for _, y in of_kind(made, "line")] == [(1.0, 2.0), (4.0, 5.0)]
    assert of_kind(made, "cross") == [((100.0,), (made.y_limits[1],))]
    assert made.y_limits[1] > 5.0
    assert "1 of 5 not finite" in made.alt
    assert charts([line([1.0, lost])], "t")[0].notes == ["✕ not a finite number"]


def test_a_line_of_nothing_finite_is_still_a_chart():
    made = drawn(line([None, None]))
    assert len(of_kind(made, "cross")[0][0]) == 2
    assert "no finite figure at 1" in made.alt
    assert "<svg" in svg(made, "n")


def test_negative_values_and_all_zero_need_no_logarithm():
    assert drawn(line([-1.0, 2.0])).y_scale == "linear"
    assert drawn(line([0.0, 0.0])).y_scale == "linear"
    assert of_kind(drawn(line([0.0, 0.0])), "zero") == []


def test_a_band_is_drawn_where_both_edges_are_known():
    made = drawn(line([1.0, 2.0, 3.0], low=[0.5, None, 0.0], high=[2.0, 3.0, 4.0]))
    band = next(trace for trace in made.traces if trace.kind == "band")
    assert band.x == (1.0, 100.0)
    assert band.y == (0.5, made.zero_at)
    assert band.y_high == (2.0, 4.0)


def test_no_two_lines_of_a_chart_look_alike():
    pens = pens_of([str(n) for n in range(30)])
    assert len({(pen.colour, pen.marker, pen.hollow, pen.dash) for pen in pens.values()}) == 30
    eight = pens_of(list("abcdefgh"))
    assert len({pen.colour for pen in eight.values()}) == len(COLOURS)
    assert len({(pen.marker, pen.hollow) for pen in list(eight.values())[:7]}) == 7


def test_points_come_by_x_with_their_edges():
    known = points(line([3.0, 1.0], [2.0, 1.0], low=[2.5, 0.5], high=[3.5, None]))
    assert [(p.x, p.y, p.low, p.high) for p in known] == [(1.0, 1.0, 0.5, None), (2.0, 3.0, 2.5, 3.5)]


def test_svg_is_fit_for_a_page_with_others():
    blue = KNOWN["nerf"].light
    trace = Trace("a", blue, "line", (1.0, 2.0), (0.001, 0.002))
    panel = Panel("t", "x", "<\"&'>", (trace,), 'says "<b>"', rows=())
    text = str(svg(panel, "one-1"))
    assert text.startswith('<svg class="plot" viewBox=')
    assert 'aria-label="says &#34;&lt;b&gt;&#34;"' in text
    assert "&lt;" in text
    assert "var(--nerf)" in text
    assert "0.001" in text, "numbers in text must not be shortened as coordinates are"
    for stray in (blue, "<style", "xlink", "http"):
        assert stray not in text, stray
    ids = re.findall(r' id="([^"]+)"', text)
    assert ids
    assert all(name.startswith("one-1-") for name in ids)
    assert len(ids) == len(set(ids))


def test_a_name_in_letters_that_the_font_lacks_warns_nobody(recwarn):
    assert "光场" in str(svg(drawn(line([1.0, 2.0], name="光场")), "one-2"))
    assert not recwarn.list


def test_many_lines_have_bars_and_names_at_their_ends_in_place_of_bands():
    few, many = ([line([1.0, 2.0 + 3 * k], name=f"m{k}", low=[0.5, 1.0], high=[2.0, 3.0]) for k in range(number)]
                 for number in (MOST_BANDS, MOST_BANDS + 1))  # fmt: skip
    kinds = [{trace.kind for trace in drawn(*some).traces} & {"band", "bar"} for some in (few, many)]
    assert kinds == [{"band"}, {"bar"}]
    assert drawn(*few).ends == ()
    assert [(name, x, y) for name, _, x, y in drawn(*many).ends] == [(f"m{k}", 10.0, 2.0 + 3 * k) for k in range(4)]
    texts = re.findall(r'data-end="(m\d)"> <text[^>]* y="([\d.]+)"', charts(many, "t")[0].svg)
    heights = sorted(float(y) for _, y in texts)
    assert len(heights) == 4
    assert all(below - above > 9 for above, below in pairwise(heights)), "no name on another"


@pytest.mark.parametrize(
    ("places", "moved"),
    [([0.0, 20.0], [0.0, 20.0]), ([0.0, 0.0], [-5.0, 5.0]), ([0.0, 9.0, 11.0], [-10 / 3, 20 / 3, 50 / 3]), ([], [])],
)
def test_names_move_apart_about_their_middle(places, moved):
    assert spread(places, 10.0) == pytest.approx(moved)


def test_panels_of_one_family_are_small_share_axes_and_one_key():
    lines = [Series(f"Error, {scene}", 1, "a", "x", "y", [1.0, 2.0], [k, k + 1.0])
             for k, scene in enumerate(("all scenes", "chair", "lego"), 1)]  # fmt: skip
    (chart,) = charts([*lines], "t")
    assert (chart.title, [small.title for small in chart.multiples]) == ("Error, all scenes", ["chair", "lego"])
    assert [small.keys for small in chart.multiples] == [[], []]
    ends = [re.search(r'"y":\{[^}]*"low":([\d.]+),"high":([\d.]+)', small.svg).groups() for small in chart.multiples]
    assert ends[0] == ends[1]
    assert len(charts(lines[:2], "t")) == 2, "two are no family"
