"""The paper's own figures: their verdicts, and the verdicts of changed figures."""

import pytest

from reports.claims.claim_list import claims
from reports.claims.ledger import OWN_FIGURES, Claim
from reports.data.load import Records
from reports.data.wording import UNTESTED
from tests.replacing import replace
from tests.reports.fake_run import PAPER


def judged(whole: Records, name: str, printed: float | None = None, **tables: dict) -> Claim:
    """Judge a single claim, with another printed number or other rows of tables."""
    (entry,) = (entry for entry in PAPER.claims if entry.id == name)
    entry = entry if printed is None else replace(entry, printed=printed)
    psnr = {"psnr": tables.pop("psnr")} if "psnr" in tables else {}
    paper = replace(PAPER, **psnr, tables={**PAPER.tables, **tables}, claims=(entry,))
    (claim,) = claims(replace(whole, run=replace(whole.run, claims=[paper])))
    return claim


def changed(table: str, row: str, **values: float) -> dict:
    rows = PAPER.psnr if table == "psnr" else PAPER.tables[table]
    return {table: {**rows, row: {**rows[row], **values}}}


@pytest.mark.parametrize(
    ("name", "verdict", "measured", "tables"),
    [
        ("eq3-last-band", "not reproduced", 9, {}),
        ("eq3-last-band", "reproduced", 9, {"printed": 9}),
        ("table1-skip", "reproduced", 6, {}),
        ("table1-skip", "not reproduced", 6, {"printed": 5}),
        ("table1-sum", "reproduced", 1_367_257, {}),
        ("table1-sum", "reproduced", 1_367_257, {"printed": 1_400_000}),
        ("table1-sum", "not reproduced", 1_367_257, {"printed": 1_510_000}),
        ("table2-differences", "reproduced", 9, {}),
        ("table2-differences", "not reproduced", 8, changed("psnr", "mic", delta=1.6)),
        ("table2-means", "reproduced", 3, {}),
        ("table2-means", "not reproduced", 2, changed("psnr", "mic", qnerf=35.5)),
        ("table2-range", "reproduced", (1.2, 1.8), {}),
        ("table2-range", "not reproduced", (1.1, 1.8), changed("psnr", "drums", delta=1.1)),
        ("setup-scenes", "reproduced", 8, {}),
        ("table2-source", "inconclusive", 8, {}),
        ("table2-source", "inconclusive", 7, changed("psnr", "mic", nerf=33.1)),
        ("table2-source", UNTESTED, None, {"original": {"fern": 25.2}}),
        ("table3-speedup-iterations", "reproduced", 18.0, {}),
        ("table3-speedup-hours", "inconclusive", 100 * (1 - 3.4 / 4.2), {}),
        (
            "table3-speedup-hours",
            "not reproduced",
            100 * (1 - 3.7 / 4.2),
            changed("times", "hours_to_30_db", qnerf=3.7),
        ),
        ("table3-final", "reproduced", 2, {}),
        ("table3-final", "not reproduced", 1, changed("psnr", "average", qnerf=32.4)),
        ("table4-lego", "reproduced", 2, {}),
        ("table4-lego", "not reproduced", 1, changed("psnr", "lego", nerf=32.6)),
        ("footnote1-table", "not reproduced", 4, {}),
    ],
)
def test_what_the_papers_figures_give(whole: Records, name, verdict, measured, tables):
    claim = judged(whole, name, **tables)
    assert (claim.verdict, claim.scale) == (verdict, OWN_FIGURES)
    assert claim.measured == (pytest.approx(measured) if measured is not None else None)
    assert claim.interval is None, "what rounding leaves open is no interval of 95 %"


def test_what_decides_is_named(whole: Records):
    hours = judged(whole, "table3-speedup-hours").note
    assert "leaves 16.9 to 21.2 % open" in hours
    assert "as a ratio of speeds 24 %" in hours
    assert judged(whole, "table2-differences", **changed("psnr", "mic", delta=1.6)).note == "not mic"
    assert "equal in 7 of 8 scenes" in judged(whole, "table2-source", **changed("psnr", "mic", nerf=33.1)).note
    original = {scene: score for scene, score in PAPER.tables["original"].items() if scene != "mic"}
    lacking = judged(whole, "table2-source", original=original)
    assert lacking.measured == 7
    assert "equal in 7 of 7 scenes (without mic, of which no original score is recorded)" in lacking.note


def test_a_record_without_the_tables_tests_nothing(whole: Records):
    bare = claims(replace(whole, run=replace(whole.run, claims=[replace(PAPER, tables={}, psnr={})])))
    of_tables = ("table1-sum", "table2-means", "table3-sp", "table3-f")
    assert {claim.verdict for claim in bare if claim.id.startswith(of_tables)} == {UNTESTED}
