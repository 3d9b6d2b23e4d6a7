"""Both questions about a difference are answered side by side; failures have rates."""

from reports.claims.estimands import difference_in_words, failures_of, rates_grid, senses_grid
from reports.data.load import Records
from reports.run.saving.publish import summary
from tests.replacing import replace


def test_both_senses_are_in_one_row(whole: Records):
    grid = senses_grid(whole)
    assert len(grid.rows) == 6, "three pairs of methods, two budgets"
    texts = [entry.text for entry in grid.rows[0]]
    assert texts == ["qnerf", "at equal steps", "+0.81 dB", "+0.76 to +0.86", "+0.69 to +0.93"]
    assert grid.rows[0][3].small == "above 0, matters\nd = +3.2"
    row = whole.comparison("chair", "qnerf", "nerf", budget="seconds")
    assert f"+{row.difference:.2f} dB at equal training time" in difference_in_words(row, ["chair"], [0, 1, 2])


def test_failures_have_rates_and_are_compared(records: Records, whole: Records):
    assert rates_grid(whole).rows == []
    rows = {row[0].text: [entry.text for entry in row[1:]] for row in rates_grid(records).rows}
    assert rows["nerf"][:4] == ["6", "0", "0", "0\u202f%"]
    assert rows["qnerf"][:4] == ["6", "1", "0", "17\u202f%"]
    assert rows["qnerf"][4].splitlines()[0] == "nerf: not distinguished (1 : 0 of 6 pairs, p = 1.000)"
    cells = [replace(cell, warnings=["empty collapse: 0.001"] * (cell.method == "qnerf")) for cell in whole.cells]
    rate = failures_of(replace(whole, cells=cells)).rates[2]
    assert (rate.method, rate.collapsed, rate.rate) == ("qnerf", 6, 1.0)


def test_the_summary_holds_failures_and_both_senses(records: Records):
    data = summary(records)
    assert data["failures"]["rates"][2]["diverged"] == 1
    row = next(row for row in data["comparisons"] if row["scene"] == "all")
    assert row["on_these_scenes"]["interval"] != row["scenes_like_these"]["interval"]
