"""The section of further methods on one scene: what stands in it, and what is kept out of the tables of all scenes."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from harness.records.cells import CellRecord, records_folder, write_cell
from harness.records.cells import write_comparisons as write_rows
from harness.records.json_record import load_record, write_record
from harness.verdicts.comparisons import compare
from reports.data.load import Records, read_records
from reports.run.density import further_grid, printed_form, separation
from reports.run.run_page import page

PRINTED = "qnerf_printed"
FURTHER = {"nerf_phi_encoding": 20.0, "nerf_no_shift": 24.0}


@pytest.fixture(scope="module")
def explained(whole: Records, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The fake run with three further methods on chair: two with seed 0, and the printed form with three seeds."""
    out = shutil.copytree(whole.out, tmp_path_factory.mktemp("explained") / "run")
    some = {cell.seed: cell for cell in whole.cells_of("chair", "qnerf")}
    cells = [_like(some[0], name, psnr) for name, psnr in FURTHER.items()]
    cells += [_like(one, PRINTED, 12.0 + 0.1 * seed) for seed, one in some.items()]
    for cell in cells:
        write_cell(out, cell)
    path = records_folder(out) / "run.json"
    run = load_record(path)
    run["settings"] |= {"methods": list(whole.methods)}
    run["methods"] |= {name: f"what {name} is" for name in (*FURTHER, PRINTED)}
    write_record(path, {name: value for name, value in run.items() if name != "digest"})
    write_rows(out, compare([*whole.cells, *cells], list(run["methods"])))
    return out


def _like(cell: CellRecord, method: str, psnr: float) -> CellRecord:
    return replace(cell, method=method, scores={**cell.scores, "psnr": psnr}, pictures=None, files={})


def test_further_methods_are_in_no_table_of_all_scenes(explained: Path, whole: Records) -> None:
    records = read_records(explained)
    assert records.methods == whole.methods
    assert records.cells == whole.cells
    assert {one.method for one in records.extra_cells} == {*FURTHER, PRINTED}
    assert {one.method for one in records.comparisons} <= set(whole.methods)
    assert {one.scene for one in records.extra_comparisons} == {"chair"}, "one scene says nothing of all"
    rows = {row[0].text: row for row in further_grid(records).rows}
    assert set(rows) == {*FURTHER, PRINTED}
    assert rows["nerf_no_shift"][1].text == "24.00"
    assert not further_grid(whole).rows


def test_the_printed_form_stands_apart_with_its_reason(explained: Path, whole: Records, whole_page: str) -> None:
    records = read_records(explained)
    said = printed_form(records)
    one = records.comparison("chair", PRINTED, "nerf")
    assert f"{one.difference:.2f}".replace("-", "−") in said
    assert "3 seeds" in said
    assert "arXiv 2404.02155" in said
    shown = page(records)
    assert 'id="further"' in shown
    assert "<dt>Word for word</dt>" in shown
    assert printed_form(whole) == ""
    assert 'id="further"' not in whole_page


def test_density_is_held_to_the_true_geometry() -> None:
    """It is the share of pairs of a point inside and one outside in which the former is denser; ties count half."""
    perfect = {"after_inside": [0.0, 0.0, 1.0], "after_outside": [0.5, 0.5, 0.0]}
    assert separation(perfect) == 1.0
    inside, outside = np.random.default_rng(0).integers(0, 5, (2, 200))
    pairs = (inside[:, None] > outside).mean() + 0.5 * (inside[:, None] == outside).mean()
    counts = {
        f"after_{name}": np.bincount(some, minlength=5).tolist()
        for name, some in (("inside", inside), ("outside", outside))
    }
    assert separation(counts) == pytest.approx(pairs, rel=1e-12)
    assert separation({"after": [1.0]}) is None
    assert separation({"after_inside": [0.0, 0.0], "after_outside": [0.5, 0.5]}) is None
