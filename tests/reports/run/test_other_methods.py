"""Guests of another family, further methods on one scene, and methods whose library is missing."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from harness.records.cells import CellRecord, RunRecord, write_cell, write_comparisons
from harness.verdicts.comparisons import compare
from reports.__main__ import main
from reports.claims.first_screen import guests
from reports.claims.headline import headline
from reports.claims.psnr_table import scores_grid
from reports.data.load import Records, read_records
from reports.run.curves import convergence
from reports.run.density import further_grid, printed_form, separation
from reports.run.metrics_table import costs_grid, metrics_grid
from reports.run.run_page import page
from reports.run.saving.publish import summary
from tests.reports.fake_run import METHODS, fake_records

GUEST, PRINTED = "splats", "qnerf_printed"
FURTHER = {"nerf_phi_encoding": 20.0, "nerf_no_shift": 24.0}


def with_cores(cell: CellRecord) -> CellRecord:
    curve = [replace(point, core_seconds=point.seconds) for point in cell.curve]
    return replace(cell, curve=curve, train_core_seconds=20.0)


def with_others(run: RunRecord) -> RunRecord:
    more = {name: f"what {name} is" for name in (*FURTHER, PRINTED, GUEST)}
    settings = {**run.settings, "methods": list(run.methods)}
    return replace(run, methods={**run.methods, **more}, guests=[GUEST], settings=settings)


@pytest.fixture(scope="module")
def others(tmp_path_factory: pytest.TempPathFactory) -> Records:
    """The fake run with a guest, and three further methods on chair: two with seed 0, the printed form with three."""
    own = fake_records(tmp_path_factory.mktemp("others") / "run", change=with_others, change_cell=with_cores)
    by_seed = {cell.seed: cell for cell in own.cells_of("chair", "qnerf")}
    cells = [_like(by_seed[0], name, psnr) for name, psnr in FURTHER.items()]
    cells += [_like(cell, PRINTED, 12.0 + 0.1 * seed) for seed, cell in by_seed.items()]
    rows = compare([*own.cells, *cells], [*own.methods, *FURTHER, PRINTED])
    write_comparisons(own.out, [*own.comparisons, *(row for row in rows if row.method not in own.methods)])
    for place, scene in enumerate(own.scenes):
        (cell,) = [cell for cell in own.cells_of(scene, "nerf") if cell.seed == 0]
        curve = [replace(point, step=point.step + place) for point in cell.curve]  # scenes end at different steps
        cells.append(replace(_like(cell, GUEST, 30.0 + place), curve=curve))
    for cell in cells:
        write_cell(own.out, cell)
    return read_records(own.out)


def _like(cell: CellRecord, method: str, psnr: float) -> CellRecord:
    return replace(cell, method=method, scores={**cell.scores, "psnr": psnr}, pictures=None, files={})


def keys(cells: list[CellRecord]) -> list[tuple[str, str, int]]:
    return [(cell.scene, cell.method, cell.seed) for cell in cells]


def test_they_are_in_no_table_and_no_comparison_over_all_scenes(others: Records, whole: Records) -> None:
    assert (others.methods, keys(others.cells)) == (whole.methods, keys(whole.cells))
    assert others.comparisons == whole.comparisons
    assert keys(others.guest_cells) == [(scene, GUEST, 0) for scene in others.scenes]
    assert sum(cell["method"] == GUEST for cell in summary(others)["cells"]) == 2
    assert {cell.method for cell in others.extra_cells} == {*FURTHER, PRINTED}
    assert {row.scene for row in others.extra_comparisons} == {"chair"}, "no comparison over all scenes"
    rows = {row[0].text: row for row in further_grid(others).rows}
    assert set(rows) == {*FURTHER, PRINTED}
    assert rows["nerf_no_shift"][1].text == "24.00"
    assert not further_grid(whole).rows


@pytest.mark.slow
def test_the_page_says_what_a_guest_reaches_and_shows_the_printed_form(others: Records, whole: Records, whole_page):
    ours = [cell.scores["psnr"] or 0.0 for cell in others.cells if (cell.method, cell.seed) == ("nerf", 0)]
    assert guests(others) == (
        f"splats reaches 30.50 dB with the same core seconds as nerf, which reaches {sum(ours) / 2:.2f} dB (2 scenes, "
        "20 core seconds per cell; one seed, not judged)"
    )
    row = others.comparison("chair", PRINTED, "nerf")
    for words in (f"{row.difference:.2f}".replace("-", "−"), "3 seeds", "arXiv 2404.02155"):
        assert words in printed_form(others)
    assert (guests(whole), printed_form(whole)) == ("", "")
    shown = page(others)
    assert "reaches 30.50 dB with the same core seconds as" in shown[: shown.index("<nav")]
    for words in ("splats</", 'id="further"', "<dt>Word for word</dt>", "<dt>Other methods</dt>"):
        assert words in shown
        assert words not in whole_page


def test_the_curve_of_a_guest_stands_over_core_seconds(others: Records) -> None:
    together, *single = convergence(others, "core_seconds")
    lines = {trace.label: trace for trace in together.traces if trace.kind == "line"}
    assert set(lines) == {*(f"{name} mean" for name in others.methods), "splats mean"}
    assert not math.isnan(lines["splats mean"].y[-1])
    assert lines["splats mean"].runs == ()
    assert len(single) == 2
    assert all(trace.label.partition(" ")[0] != GUEST for trace in convergence(others, "step")[0].traces)


def test_a_guest_has_its_costs_and_no_ratio_as_it_is_given_the_time_of_nerf(others: Records, whole: Records) -> None:
    grid, without = costs_grid(others), costs_grid(whole)
    assert [row[0].text for row in grid.rows] == [*(row[0].text for row in without.rows), GUEST]
    assert [entry.text for entry in grid.rows[-1][:3]] == [GUEST, "20.0 core s", "–"]
    assert grid.rows[-1][0].runs is None


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


REASON = "no shared library of LLVM 16 or newer"


def absent(cell):
    if cell.method != "voxels_drjit":
        return cell
    return replace(cell, status="not_available", reason=REASON, steps=0, train_seconds=0.0,
                   scores=dict.fromkeys(cell.scores), curve=[], views=[], trace={}, pictures=None)  # fmt: skip


@pytest.fixture(scope="module")
def lacking(tmp_path_factory) -> Records:
    methods = {**METHODS, "voxels_drjit": "explicit voxels"}
    return fake_records(tmp_path_factory.mktemp("lacking") / "run", methods=methods, change_cell=absent)


def test_a_missing_library_is_no_failure_and_the_page_says_it_once_on_the_first_screen(lacking, capsys):
    assert lacking.failed == []
    assert lacking.not_available == {"voxels_drjit": {REASON: 6}}
    assert main([str(lacking.out)]) == 0
    assert f"voxels_drjit: not available ({REASON})" in capsys.readouterr().out.splitlines()
    text = (lacking.out / "report.html").read_text(encoding="utf-8")
    top = text[: text.index("<nav")]
    assert "voxels_drjit was not available</b> in 6 of 24 cells, which is not a failure: " + REASON in top
    assert "did not finish" not in top


def test_tables_state_why_a_method_is_not_available_without_alarm(lacking):
    grid = scores_grid(lacking)
    entry = grid.rows[0][[column.method for column in grid.columns].index("voxels_drjit")]
    assert (entry.text, entry.small, entry.tone) == ("3 of 3 not available", REASON, "muted")
    named = next(row[1] for row in metrics_grid(lacking).rows if row[1].text == "voxels_drjit")
    assert (named.small, named.tone) == ("3 of 3 not available", "muted")


def test_the_other_methods_keep_their_averages(lacking, whole):
    assert scores_grid(lacking).totals[0][1:4] == scores_grid(whole).totals[0][1:4]
    said = headline(lacking).sentences[0]
    assert said == headline(whole).sentences[0]
    assert "voxels_drjit" not in said
