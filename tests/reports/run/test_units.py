"""The section about the unit of density: what stands in it, and what is kept out of the tables of all scenes."""

from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from harness.records.cells import CellRecord, records_folder, write_cell
from harness.records.cells import write_comparisons as write_rows
from harness.records.json_record import load_record, write_record
from harness.verdicts.comparisons import compare
from reports.data.load import Records, read_records
from reports.run.density import PRINTED, ladder_panel, printed_form, rungs_of, separation, unit_grids, unit_sentences
from reports.run.run_page import page

RUNGS = {"nerf_unit_1": 20.0, "nerf_unit_100": 24.0, "qnerf_unit_1": 15.0, "qnerf_unit_100": 25.0}


@pytest.fixture(scope="module")
def explained(whole: Records, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The fake run with five further methods on chair: a ladder with seed 0, and the printed form with three."""
    import shutil

    out = shutil.copytree(whole.out, tmp_path_factory.mktemp("explained") / "run")
    some = {cell.seed: cell for cell in whole.cells_of("chair", "qnerf")}
    cells = [_like(some[0], name, psnr) for name, psnr in RUNGS.items()]
    cells += [_like(one, PRINTED, 12.0 + 0.1 * seed) for seed, one in some.items()]
    for cell in cells:
        write_cell(out, cell)
    path = records_folder(out) / "run.json"
    run = load_record(path)
    scales = {name: float(name.rpartition("_")[2]) for name in RUNGS} | {"nerf": 25.0, "qnerf": 25.0, PRINTED: 1.0}
    run["settings"] |= {
        "methods": list(whole.methods),
        "density_units": {name: {"scale": scale, "per": "box"} for name, scale in scales.items()},
    }
    run["methods"] |= {name: f"what {name} is" for name in (*RUNGS, PRINTED)}
    write_record(path, {name: value for name, value in run.items() if name != "digest"})
    write_rows(out, compare([*whole.cells, *cells], list(run["methods"])))
    return out


def _like(cell: CellRecord, method: str, psnr: float) -> CellRecord:
    return replace(cell, method=method, scores={**cell.scores, "psnr": psnr}, pictures=None, files={})


def test_further_methods_are_in_no_table_of_all_scenes(explained: Path, whole: Records) -> None:
    records = read_records(explained)
    assert records.methods == whole.methods
    assert records.cells == whole.cells
    assert {one.method for one in records.extra_cells} == {*RUNGS, PRINTED}
    assert {one.method for one in records.comparisons} <= set(whole.methods)
    assert {one.scene for one in records.extra_comparisons} == {"chair"}, "one scene says nothing of all"


def test_the_ladder_holds_the_two_methods_among_their_rungs(explained: Path) -> None:
    records = read_records(explained)
    rungs = rungs_of(records)
    assert [(rung.method, rung.scale) for rung in rungs if rung.base == "nerf"] == [
        ("nerf_unit_1", 1.0),
        ("nerf", 25.0),
        ("nerf_unit_100", 100.0),
    ]
    (drawn,) = ladder_panel(records)
    line = next(trace for trace in drawn.traces if (trace.label, trace.kind) == ("qnerf", "line"))
    assert (line.y[0], line.y[-1]) == (15.0, 25.0)
    assert {trace.kind for trace in drawn.traces} >= {"line", "mark", "cross"}
    grid, _ = unit_grids(records)
    assert [row[1].text for row in grid.rows][::2] == ["20.00", "24.00"]


def test_the_printed_form_stands_apart_with_its_reason(explained: Path) -> None:
    records = read_records(explained)
    said = printed_form(records)
    one = records.comparison("chair", PRINTED, "nerf")
    assert one is not None
    assert one.difference is not None
    assert f"{one.difference:.2f}".replace("-", "−") in said
    assert "3 seeds" in said
    assert "arXiv 2404.02155" in said
    shown = page(records)
    assert 'id="units"' in shown
    assert "<dt>Word for word</dt>" in shown


def test_a_run_without_further_methods_has_no_such_section(whole: Records) -> None:
    assert unit_sentences(whole) == []
    assert not any(grid.rows for grid in unit_grids(whole))
    assert printed_form(whole) == ""
    assert 'id="units"' not in page(whole)


def test_density_is_held_to_the_true_geometry() -> None:
    perfect = {"after_inside": [0.0, 0.0, 1.0], "after_outside": [0.5, 0.5, 0.0]}
    assert separation(perfect) == 1.0
    assert separation({"after_inside": [0.5, 0.5, 0.0], "after_outside": [0.0, 0.0, 1.0]}) == 0.0
    assert separation({"after_inside": [0.2, 0.8], "after_outside": [0.2, 0.8]}) == pytest.approx(0.5)
    inside, outside = np.random.default_rng(0).integers(0, 5, (2, 200))
    pairs = (inside[:, None] > outside).mean() + 0.5 * (inside[:, None] == outside).mean()
    counts = {
        f"after_{name}": np.bincount(some, minlength=5).tolist()
        for name, some in (("inside", inside), ("outside", outside))
    }
    assert separation(counts) == pytest.approx(pairs, rel=1e-12)
    assert separation({"after": [1.0]}) is None
    assert separation({"after_inside": [0.0, 0.0], "after_outside": [0.5, 0.5]}) is None
