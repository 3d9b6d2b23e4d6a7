"""How a difference and a saving came about, in the panel beside the page: as they were compared, in a real browser."""

from dataclasses import replace

import pytest

from harness.comparisons import compare
from harness.records import CellRecord, cell_path, write_comparisons
from harness.survival import reach, targets
from harness.targets_record import write_targets
from reports.load import Records, of_whole_groups, read_records
from reports.page import write_page
from tests.reports.browsing import opened
from tests.reports.fake_run import write_fake_run

pytestmark = pytest.mark.slow

APART, ASIDE = "not compared: the group is not whole", "not judged"


def changed(cell: CellRecord) -> CellRecord:
    """On chair one NeRF failed, and one Q-NeRF took four times as long; on drums one Q-NeRF diverged."""
    if (cell.scene, cell.method, cell.seed) == ("chair", "nerf", 1):
        return replace(cell, status="error", reason="no space left on device")
    if (cell.scene, cell.method, cell.seed) == ("chair", "qnerf", 2):
        curve = [replace(point, seconds=4 * point.seconds) for point in cell.curve]
        return replace(cell, curve=curve, train_seconds=4 * cell.train_seconds)
    return cell


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> tuple[Records, str]:
    """A stopped run, compared as far as its groups are whole: of drums, seed 0, one method is missing."""
    out = write_fake_run(tmp_path_factory.mktemp("runs") / "run", pictures=False, change_cell=changed)
    cell_path(out, "drums", "nerf_matched", 0).unlink()
    records = read_records(out)
    whole = of_whole_groups(records.cells, records.methods)
    write_comparisons(out, compare(whole, records.methods))
    write_targets(out, targets(whole, records.methods))
    records = read_records(out)
    write_page(records, out / "report.html")
    return records, (out / "report.html").as_uri()


def panel_of(browser, run, metric: str, budget: str) -> tuple[dict[tuple[str, int], list[str]], str]:
    """(scene, seed) → the rest of the row of that pair; and what is said below."""
    address = f"{run[1]}#method=qnerf&runs.against=nerf&runs.metric={metric}&runs.budget={budget}&runs.open=1"
    view, noise = opened(browser, address)
    table = view.locator("#runs .content > .scroll table").first
    table.wait_for()
    rows = [row.locator("th, td").all_inner_texts() for row in table.locator("tbody tr").all()]
    notes = view.locator("#runs .content > .scroll + .note").first.inner_text()
    assert [one for one in noise if not one.startswith("file:")] == []
    view.context.close()
    return {(scene, int(seed)): rest for scene, seed, *rest in rows}, notes


@pytest.mark.parametrize("budget", ["steps", "seconds"])
def test_pairs_that_were_not_compared_say_so_and_are_not_in_the_mean(browser, run, budget):
    rows, note = panel_of(browser, run, "psnr", budget)
    one = run[0].comparison("all", "qnerf", "nerf", budget=budget)
    assert {pair: row[-1] for pair, row in rows.items() if not row[-1][1:2].isdigit()} == {
        ("chair", 1): ASIDE, ("drums", 0): APART, ("drums", 2): ASIDE,
    }  # fmt: skip
    assert f": {one.difference:+.3f} dB, from {one.pairs} of 5 pairs.".replace("-", "−") in note


@pytest.mark.parametrize("axis", ["steps", "seconds"])
def test_a_saving_shows_the_times_that_it_was_taken_from(browser, run, axis):
    records = run[0]
    assert records.targets is not None
    rows, note = panel_of(browser, run, "target", axis)
    one = records.targets.comparison("all", "qnerf", "nerf", axis)
    assert f": {one.saving:+.1f}\u202f%, from {one.pairs} of 5 pairs.".replace("-", "−") in note
    assert rows["chair", 1][1:] == ["failed", ASIDE]
    assert "counted" not in rows["chair", 1][0]
    assert rows["drums", 0] == ["–", "–", APART]
    assert len(rows) == 6
    counted = [text for *times, said in rows.values() if said not in (APART, ASIDE) for text in times]
    assert sum("not within" in text for text in counted) == sum(one.never)

    def text(value: float) -> str:
        return f"{value:.{int(value < 10)}f}\u202fs" if axis == "seconds" else f"{value:,.0f}".replace(",", "\u202f")

    horizons = {scene: records.targets.comparison(scene, "qnerf", "nerf", axis).horizon for scene in ("chair", "drums")}
    (lost,) = (cell for cell in records.cells if cell.status == "diverged")
    found = reach(lost, axis, records.targets.target)
    assert rows["drums", 2][0] == f"not within {text(found.time)}, counted as not within {text(horizons['drums'])}"
    (slow,) = (cell for cell in records.cells if (cell.scene, cell.method, cell.seed) == ("chair", "qnerf", 2))
    late = reach(slow, axis, records.targets.target)
    beyond = f", counted as not within {text(horizons['chair'])}" if late.time > horizons["chair"] else ""
    assert late.known == "reached"
    assert rows["chair", 2][0] == f"{text(late.time)}{beyond}"
