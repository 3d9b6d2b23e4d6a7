"""Learning curves and work–precision diagrams: seeds, means, bands, and runs that ended early."""

import math
from collections.abc import Iterable

import numpy as np
import pandas as pd
import pytest
from msgspec.structs import replace

from harness.records.cells import Checkpoint
from reports.data.load import Records
from reports.drawing.palette import INK, KNOWN
from reports.drawing.traces import Trace
from reports.run.curves import Diagram, convergence, diagrams, hull, middle_of, noise_floors, over_scenes, traces_of
from reports.run.density import density_histograms
from reports.run.figures import difference_panels
from tests.reports.fake_run import fake_records

BLUE, ORANGE = KNOWN["nerf"].light, KNOWN["qnerf"].light
NEUTRAL = {"flops_per_evaluation": 50.0, "rays_per_step": 2048.0}


def full(cell):
    """Give a cell two round checkpoints; each seed has 1 dB more PSNR and twice the errors of the seed before."""
    factor = 2.0**cell.seed
    curve = [
        Checkpoint(step, time + cell.seed, 100 * step, psnr=float(step + cell.seed), rmse_linear=size * factor,
                   ssim=1 - 2 * size * factor, flip=0.2 * factor / step, depth_rmse=factor)
        for step, time, size in ((10, 1.0, 0.04), (20, 2.0, 0.01))
    ]  # fmt: skip
    curve = curve[:1] if cell.status == "diverged" else curve
    return replace(cell, curve=curve, properties=cell.properties | NEUTRAL)


def simple(tmp_path, change=full, **options) -> Records:
    options = {"scenes": ("chair",), "methods": {"nerf": "", "qnerf": ""}, "seeds": 2, **options}
    return fake_records(tmp_path / "run", change_cell=change, **{"with_diverged": True, **options})


def diagram(records: Records, measure: str = "rmse_linear", cost: str = "seconds") -> Diagram:
    return next(made for made in diagrams(records) if made.name == f"{measure}-{cost}")


def frame(*points: tuple[str, int, int, float, float]) -> pd.DataFrame:
    """Return finished checkpoints of nerf from (scene, seed, step, x, y)."""
    return pd.DataFrame(points, columns=["scene", "seed", "step", "x", "y"]).assign(method="nerf", status="done")


def named(traces: Iterable[Trace], label: str) -> Trace:
    return next(trace for trace in traces if trace.label == label)


def test_convergence_against_steps(tmp_path):
    (panel,) = convergence(simple(tmp_path), "step")
    assert panel.title == "chair"
    assert panel.traces[:7] == (
        Trace("nerf seed 0", BLUE, "thin", (10.0, 20.0), (10.0, 20.0)),
        Trace("nerf seed 1", BLUE, "thin", (10.0, 20.0), (11.0, 21.0)),
        Trace("qnerf seed 0", ORANGE, "thin", (10.0, 20.0), (10.0, 20.0)),
        Trace("qnerf seed 1", ORANGE, "thin", (10.0,), (11.0,)),
        Trace("nerf mean", BLUE, "line", (10.0, 20.0), (10.5, 20.5)),
        Trace("qnerf mean", ORANGE, "line", (10.0, 20.0), (10.0, 20.0)),
        Trace("qnerf seed 1 diverged", ORANGE, "cross", (10.0,), (11.0,)),
    )
    assert panel.alt == (
        "chair: test PSNR (dB) against training step. At the end: nerf 20.5, qnerf 20, qnerf seed 1 diverged."
    )


def test_convergence_against_seconds_uses_the_mean_clock_and_all_scenes_come_first(tmp_path, records: Records):
    (panel,) = convergence(simple(tmp_path, with_diverged=False), "seconds")
    assert Trace("nerf mean", BLUE, "line", (1.5, 2.5), (10.5, 20.5)) in panel.traces
    assert [panel.title for panel in convergence(records, "step")] == ["all scenes (mean)", "chair", "drums"]


def test_a_cell_without_checkpoints_draws_nothing(tmp_path):
    def emptied(cell):
        return replace(cell, curve=[]) if cell.status == "diverged" else cell

    (panel,) = convergence(simple(tmp_path, emptied, seeds=1), "step")
    assert {trace.label.split()[0] for trace in panel.traces if trace.kind != "floor"} == {"nerf"}


def test_a_mean_histogram_is_of_finished_runs_at_one_step(tmp_path):
    """The first seed has one more checkpoint than the second; the diverged run has only early ones."""

    def with_densities(cell):
        share = 0.1 * (cell.seed + 1)
        density = {"edges": [0.0, 0.5, 1.0], "before": [share, 1 - share], "after": [1.0, 0.0]}
        curve = [replace(point, density=density) for point in cell.curve[: 6 - cell.seed]]
        return replace(cell, curve=curve if cell.method == "qnerf" else [])

    (panel,) = density_histograms(simple(tmp_path, with_densities, seeds=3))
    assert panel.alt.startswith(f"{panel.title}: share of points")
    assert panel.title == "chair: step 800, 2 seeds"
    assert panel.traces[0].y == pytest.approx((0.15, 0.85))
    (panel,) = density_histograms(simple(tmp_path / "unfinished", lambda cell: cell, seeds=1))
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


@pytest.mark.parametrize(
    ("measure", "cost", "x", "y"),
    [
        ("rmse_linear", "seconds", (1.0, 2.0), (0.04, 0.01)),
        ("ssim", "rays", (20480.0, 40960.0), (0.08, 0.02)),
        ("flip", "evaluations", (1000.0, 2000.0), (0.02, 0.01)),
        ("depth_rmse", "flops", (150_000.0, 300_000.0), (1.0, 1.0)),
    ],
)
def test_a_seed_is_drawn_as_it_is(tmp_path, measure, cost, x, y):
    (panel,) = diagram(simple(tmp_path), measure, cost).panels
    assert (panel.x_scale, panel.y_scale) == ("log", "log")
    trace = named(panel.traces, "nerf seed 0")
    assert (trace.kind, trace.x) == ("thin", x)
    assert trace.y == pytest.approx(y)


def test_means_and_bands_are_geometric(tmp_path):
    (panel,) = diagram(simple(tmp_path, with_diverged=False)).panels
    mean, band = (named(panel.traces, f"nerf {what}") for what in ("mean", "spread"))
    assert mean.y == pytest.approx((0.04 * 2**0.5, 0.01 * 2**0.5))
    assert mean.x == pytest.approx((2**0.5, 6**0.5))
    logs = np.log([[1.0, 2.0], [0.04, 0.08]])
    sd = logs.std(axis=1, ddof=1)
    assert min(band.x) == pytest.approx(math.exp(logs[0].mean() - sd[0]))
    assert max(band.y) == pytest.approx(math.exp(logs[1].mean() + sd[1]))


def test_a_diverged_run_is_shown_and_not_in_the_mean(tmp_path):
    made = diagram(simple(tmp_path))
    (panel,) = made.panels
    (cross,) = [trace for trace in panel.traces if trace.kind == "cross"]
    assert (cross.label, cross.x, cross.y) == ("qnerf seed 1 diverged", (2.0,), (0.08,))
    assert named(panel.traces, "qnerf mean").y == pytest.approx((0.04, 0.01)), "of the seed that finished"
    assert made.notes == [["✕ qnerf: 1 of 2 runs did not finish; the mean is of the others"]]
    assert "qnerf seed 1 diverged" in panel.alt


def test_over_all_scenes_a_seed_ends_where_its_first_scene_ended(tmp_path):
    records = simple(tmp_path, scenes=("chair", "drums"))
    first = diagram(records).panels[0]
    assert first.title == "all scenes"
    assert named(first.traces, "qnerf seed 1 diverged").x == named(first.traces, "qnerf seed 1").x == (2.0,)
    assert len(named(first.traces, "qnerf mean").x) == 2


def test_means_are_geometric_over_checkpoints_of_all_scenes_and_of_all_seeds(whole: Records):
    points = frame(("chair", 0, 1, 1.0, 0.1), ("drums", 0, 1, 4.0, 0.4), ("chair", 0, 2, 9.0, 0.1))
    (mean,) = over_scenes(points, whole, log=True).to_dict("records")
    assert (mean["step"], mean["status"]) == (1, "done")
    assert (mean["x"], mean["y"]) == (pytest.approx(2.0), pytest.approx(0.2))
    runs = frame(*(("chair", seed, step, 1.0, 0.1) for seed, last in ((0, 4), (1, 3)) for step in range(1, last)))
    assert list(middle_of(runs, log=True)["step"]) == [1, 2]
    assert middle_of(runs[:0], log=True).empty
    traces = traces_of(runs[runs.seed == 0], {"nerf": KNOWN["nerf"]}, "chair", "ssim", log=True)
    assert [trace.kind for trace in traces] == ["thin", "line"], "one seed has no band"


def test_an_error_of_0_is_not_drawn_on_a_logarithmic_axis(tmp_path):
    def perfect(cell):
        return replace(cell, curve=[replace(point, ssim=1.0, rmse_linear=0.0) for point in cell.curve])

    assert diagrams(simple(tmp_path, perfect)) == []


def test_the_noise_floor_follows_from_the_ceiling(records: Records):
    floors = noise_floors(records)
    assert abs(floors["chair"] - 1.3 * 10 ** (-38.0 / 20)) < 1e-6
    everywhere, chair, _ = diagram(records).panels
    floor = chair.traces[-1]
    assert (floor.kind, floor.colour, floor.y[0]) == ("floor", INK.light, floors["chair"])
    assert everywhere.traces[-1].y[0] == pytest.approx(math.sqrt(floors["chair"] * floors["drums"]))
    assert not any(trace.kind == "floor" for trace in diagram(records, "ssim", "seconds").panels[1].traces)


def test_hulls_against_slow_reference():
    """A corner is the farthest point in some direction."""
    points = [tuple(map(float, point)) for point in np.random.default_rng(7).normal(size=(20, 2))]
    angles = np.linspace(0, 2 * math.pi, 20_000)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    corners = {points[place] for place in np.argmax(np.array(points) @ directions.T, axis=0)}
    made = hull(points)
    assert set(made) == corners
    area = sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(made, made[1:] + made[:1], strict=True)) / 2
    assert area > 0, "anticlockwise"
    assert hull([(0.0, 0.0)] * 4) == [(0.0, 0.0)]
