"""A guest, a method of another family, has a sentence, a curve and a row of costs, and no other entry or verdict."""

import math

import pytest
from msgspec.structs import replace

from harness.records.cells import CellRecord, RunRecord, write_cell
from reports.claims.claim_list import claims
from reports.claims.first_screen import first_screen, guests
from reports.data.load import Records, read_records
from reports.data.shelf_records import ShelfRecords
from reports.run.curves import convergence
from reports.run.metrics_table import costs_grid
from reports.run.run_page import page
from reports.run.saving.publish import summary
from tests.reports.fake_run import fake_records


def with_cores(cell: CellRecord) -> CellRecord:
    curve = [replace(point, core_seconds=point.seconds) for point in cell.curve]
    return replace(cell, curve=curve, train_core_seconds=20.0)


def invited(run: RunRecord) -> RunRecord:
    settings = {**run.settings, "methods": list(run.methods)}
    return replace(run, methods={**run.methods, "splats": "Gaussians"}, guests=["splats"], settings=settings)


@pytest.fixture(scope="module")
def visited(tmp_path_factory: pytest.TempPathFactory) -> Records:
    own = fake_records(tmp_path_factory.mktemp("visited") / "run", change=invited, change_cell=with_cores)
    for place, scene in enumerate(own.scenes):
        (cell,) = [cell for cell in own.cells_of(scene, "nerf") if cell.seed == 0]
        curve = [replace(point, step=point.step + place) for point in cell.curve]  # scenes end at different steps
        scores = {**cell.scores, "psnr": 30.0 + place}
        write_cell(own.out, replace(cell, method="splats", scores=scores, curve=curve, files={}))
    return read_records(own.out)


def test_it_is_in_no_table_and_no_comparison(visited: Records, whole: Records) -> None:
    assert visited.methods == whole.methods
    assert visited.comparisons == whole.comparisons
    assert visited.extra_cells == []
    assert [(cell.scene, cell.method, cell.seed) for cell in visited.guest_cells] == [
        (scene, "splats", 0) for scene in visited.scenes
    ]
    assert sum(cell["method"] == "splats" for cell in summary(visited)["cells"]) == 2


def test_the_first_screen_says_what_it_reaches_in_nerfs_core_seconds(
    visited: Records, whole: Records, whole_page: str
) -> None:
    ours = [cell.scores["psnr"] or 0.0 for cell in visited.cells if (cell.method, cell.seed) == ("nerf", 0)]
    assert guests(visited) == (
        f"splats reaches 30.50 dB with the same core seconds as nerf, which reaches {sum(ours) / 2:.2f} dB (2 scenes, "
        "20 core seconds per cell; one seed, not judged)"
    )
    assert first_screen(visited, claims(visited), ShelfRecords()).guests == guests(visited)
    assert guests(whole) == ""
    assert "splats</" in page(visited)
    assert "<dt>Other methods</dt>" not in whole_page


def test_its_curve_stands_over_core_seconds(visited: Records) -> None:
    together, *single = convergence(visited, "core_seconds")
    lines = {trace.label: trace for trace in together.traces if trace.kind == "line"}
    assert set(lines) == {*(f"{name} mean" for name in visited.methods), "splats mean"}
    assert not math.isnan(lines["splats mean"].y[-1])
    assert lines["splats mean"].runs == ()
    assert len(single) == 2
    assert all(trace.label.partition(" ")[0] != "splats" for trace in convergence(visited, "step")[0].traces)


def test_its_model_has_its_costs_and_no_ratio_as_it_is_given_the_time_of_nerf(visited: Records, whole: Records) -> None:
    grid, without = costs_grid(visited), costs_grid(whole)
    assert [row[0].text for row in grid.rows] == [*(row[0].text for row in without.rows), "splats"]
    assert [entry.text for entry in grid.rows[-1][:3]] == ["splats", "20.0 core s", "–"]
    assert grid.rows[-1][0].runs is None
