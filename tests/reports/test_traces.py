"""Plots are plain data: traces against literals."""

import re

import pytest
from msgspec.structs import replace

from harness.records.cells import Checkpoint
from reports.data.load import Records, read_records
from reports.drawing.figure import svg
from reports.drawing.palette import KNOWN
from reports.drawing.traces import Panel, Trace
from reports.run.convergence import convergence, difference_panels
from reports.run.density import density_histograms
from tests.reports.fake_run import write_fake_run

BLUE, ORANGE = KNOWN["nerf"].light, KNOWN["qnerf"].light


def two_points(cell):
    """A curve of two round points, higher by one for each seed."""
    curve = [
        Checkpoint(10, 1.0 + cell.seed, 1000, 10.0 + cell.seed, 0.2, 0.5),
        Checkpoint(20, 2.0 + cell.seed, 2000, 20.0 + cell.seed, 0.1, 0.6),
    ]
    return replace(cell, curve=curve[:1] if cell.status == "diverged" else curve)


def simple(tmp_path, **options) -> Records:
    options = {"scenes": ("chair",), "methods": {"nerf": "", "qnerf": ""}, "seeds": 2, **options}
    return read_records(write_fake_run(tmp_path / "run", pictures=False, change_cell=two_points, **options))


def test_convergence_against_steps(tmp_path):
    (panel,) = convergence(simple(tmp_path), "step")
    assert panel.title == "chair"
    assert panel.traces[:5] == (
        Trace("nerf seed 0", BLUE, "thin", (10.0, 20.0), (10.0, 20.0)),
        Trace("nerf seed 1", BLUE, "thin", (10.0, 20.0), (11.0, 21.0)),
        Trace("qnerf seed 0", ORANGE, "thin", (10.0, 20.0), (10.0, 20.0)),
        Trace("qnerf seed 1", ORANGE, "thin", (10.0,), (11.0,)),
        Trace("nerf mean", BLUE, "line", (10.0, 20.0), (10.5, 20.5)),
    )
    assert panel.traces[5:7] == (
        Trace("qnerf mean", ORANGE, "line", (10.0, 20.0), (10.0, 20.0)),
        Trace("qnerf seed 1 diverged", ORANGE, "cross", (10.0,), (11.0,)),
    )
    assert panel.alt == (
        "chair: test PSNR (dB) against training step. At the end: nerf 20.5, qnerf 20, qnerf seed 1 diverged."
    )


def test_convergence_against_seconds_takes_the_mean_clock(tmp_path):
    (panel,) = convergence(simple(tmp_path, with_diverged=False), "seconds")
    means = [trace for trace in panel.traces if trace.kind == "line"]
    assert means[0] == Trace("nerf mean", BLUE, "line", (1.5, 2.5), (10.5, 20.5))


def test_all_scenes_come_first_where_there_are_several(records: Records):
    assert [panel.title for panel in convergence(records, "step")] == ["all scenes (mean)", "chair", "drums"]


def test_a_cell_that_diverged_at_once_draws_nothing_and_breaks_nothing(tmp_path):
    out = write_fake_run(
        tmp_path / "run",
        ("chair",),
        seeds=1,
        pictures=False,
        change_cell=lambda cell: replace(cell, curve=[]) if cell.status == "diverged" else cell,
    )
    (panel,) = convergence(read_records(out), "step")
    assert {trace.label.split()[0] for trace in panel.traces} == {"nerf", "nerf_matched"}


def test_a_mean_histogram_is_of_finished_runs_at_one_step(tmp_path):
    """The last checkpoint of the diverged run is an early one; the first seed has one more than the second."""

    def told_apart(cell):
        share = 0.1 * (cell.seed + 1)
        curve = [
            replace(point, density={"edges": [0.0, 0.5, 1.0], "before": [share, 1 - share], "after": [1.0, 0.0]})
            for point in cell.curve[: 6 - cell.seed]
        ]
        return replace(cell, curve=curve if cell.method == "qnerf" else [])

    (panel,) = density_histograms(read_records(write_fake_run(
        tmp_path / "run", ("chair",), pictures=False, change_cell=told_apart)))  # fmt: skip
    assert panel.title == "chair: step 800, 2 seeds"
    assert panel.traces[0].y == pytest.approx((0.15, 0.85))
    assert panel.alt.startswith("chair: step 800, 2 seeds: share of points")


def test_a_mean_histogram_of_unfinished_runs_says_so(tmp_path):
    out = write_fake_run(tmp_path / "run", ("chair",), seeds=1, pictures=False)
    (panel,) = density_histograms(read_records(out))
    assert panel.title == "chair: step 400, 1 unfinished seed"


def test_differences_with_intervals_and_printed_values(whole: Records):
    first, *others = difference_panels(whole)
    assert first.title == "qnerf − nerf at equal steps"
    assert first.rows == ("chair", "drums", "all")
    dots = next(trace for trace in first.traces if trace.kind == "dots")
    printed = next(trace for trace in first.traces if trace.kind == "mark")
    assert dots.x == tuple(whole.comparison(scene, "qnerf", "nerf").difference for scene in first.rows)
    assert [round(value, 1) for value in printed.x] == [1.4, 1.2, 1.3]
    assert len(others) == 3


def test_svg_is_fit_for_a_page_with_others():
    trace = Trace("a", BLUE, "line", (1.0, 2.0), (0.001, 0.002))
    panel = Panel("t", "x", "<\"&'>", (trace,), 'says "<b>"', rows=())
    text = str(svg(panel, "one-1"))
    assert text.startswith('<svg class="plot" viewBox=')
    assert 'aria-label="says &#34;&lt;b&gt;&#34;"' in text
    assert "&lt;" in text
    assert BLUE not in text
    assert "var(--nerf)" in text
    assert "0.001" in text, "numbers in text must not be shortened as coordinates are"
    assert "<style" not in text
    assert "xlink" not in text
    assert "http" not in text
    ids = re.findall(r' id="([^"]+)"', text)
    assert ids
    assert all(one.startswith("one-1-") for one in ids)
    assert len(ids) == len(set(ids))
