"""The section of further methods on one scene: its content, and their absence from the tables of all scenes."""

import shutil

import numpy as np
import pytest
from msgspec.structs import replace

from harness.records.cells import CellRecord, records_folder, write_cell, write_comparisons
from harness.records.json_record import load_record, write_record
from harness.verdicts.comparisons import compare
from reports.data.load import Records, read_records
from reports.run.density import further_grid, printed_form, separation
from reports.run.run_page import page

PRINTED = "qnerf_printed"
FURTHER = {"nerf_phi_encoding": 20.0, "nerf_no_shift": 24.0}


@pytest.fixture(scope="module")
def explained(whole: Records, tmp_path_factory: pytest.TempPathFactory) -> Records:
    """The fake run with three further methods on chair: two with seed 0, and the printed form with three seeds."""
    out = shutil.copytree(whole.out, tmp_path_factory.mktemp("explained") / "run")
    by_seed = {cell.seed: cell for cell in whole.cells_of("chair", "qnerf")}
    cells = [_like(by_seed[0], name, psnr) for name, psnr in FURTHER.items()]
    cells += [_like(cell, PRINTED, 12.0 + 0.1 * seed) for seed, cell in by_seed.items()]
    for cell in cells:
        write_cell(out, cell)
    path = records_folder(out) / "run.json"
    run = load_record(path)
    run["settings"] |= {"methods": list(whole.methods)}
    run["methods"] |= {name: f"what {name} is" for name in (*FURTHER, PRINTED)}
    write_record(path, {name: value for name, value in run.items() if name != "digest"})
    write_comparisons(out, compare([*whole.cells, *cells], list(run["methods"])))
    return read_records(out)


def _like(cell: CellRecord, method: str, psnr: float) -> CellRecord:
    return replace(cell, method=method, scores={**cell.scores, "psnr": psnr}, pictures=None, files={})


def test_further_methods_are_in_no_table_of_all_scenes(explained: Records, whole: Records) -> None:
    assert explained.methods == whole.methods
    assert explained.cells == whole.cells
    assert {cell.method for cell in explained.extra_cells} == {*FURTHER, PRINTED}
    assert {row.method for row in explained.comparisons} <= set(whole.methods)
    assert {row.scene for row in explained.extra_comparisons} == {"chair"}, "no comparison over all scenes"
    rows = {row[0].text: row for row in further_grid(explained).rows}
    assert set(rows) == {*FURTHER, PRINTED}
    assert rows["nerf_no_shift"][1].text == "24.00"
    assert not further_grid(whole).rows


def test_the_printed_form_is_shown_with_its_reason(explained: Records, whole: Records, whole_page: str) -> None:
    row = explained.comparison("chair", PRINTED, "nerf")
    for words in (f"{row.difference:.2f}".replace("-", "−"), "3 seeds", "arXiv 2404.02155"):
        assert words in printed_form(explained)
    shown = page(explained)
    assert 'id="further"' in shown
    assert "<dt>Word for word</dt>" in shown
    assert printed_form(whole) == ""
    assert 'id="further"' not in whole_page


def test_separation_is_the_share_of_pairs_in_which_the_point_inside_is_denser() -> None:
    perfect = {"after_inside": [0.0, 0.0, 1.0], "after_outside": [0.5, 0.5, 0.0]}
    assert separation(perfect) == 1.0
    inside, outside = np.random.default_rng(0).integers(0, 5, (2, 200))
    pairs = (inside[:, None] > outside).mean() + 0.5 * (inside[:, None] == outside).mean()
    counts = {
        f"after_{name}": np.bincount(bins, minlength=5).tolist()
        for name, bins in (("inside", inside), ("outside", outside))
    }
    assert separation(counts) == pytest.approx(pairs, rel=1e-12)
    assert separation({"after": [1.0]}) is None
    assert separation({"after_inside": [0.0, 0.0], "after_outside": [0.5, 0.5]}) is None
