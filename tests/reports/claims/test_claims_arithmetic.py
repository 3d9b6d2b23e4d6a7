"""The paper's own figures: what they give, and that a wrong figure would be found."""

import pytest

from reports.claims import arithmetic
from reports.claims.claim_list import claims
from reports.claims.ledger import OWN_FIGURES, Bench, Printed, entries
from reports.data.load import Records
from reports.data.wording import UNTESTED
from tests.replacing import replace
from tests.reports.fake_run import PAPER


def bench(whole: Records, **tables) -> Bench:
    records = replace(whole, run=replace(whole.run, paper={**PAPER, **tables}))
    return Bench(records, None, None)


def entry(name: str, **changes) -> Printed:
    return replace(next(one for one in entries(PAPER) if one.id == name), **changes)


def changed(table: str, row: str, **values) -> dict:
    return {table: {**PAPER[table], row: {**PAPER[table][row], **values}}}


@pytest.mark.parametrize(
    ("name", "verdict", "measured"),
    [
        ("eq3-last-band", "not reproduced", 9),
        ("table1-skip", "reproduced", 6),
        ("table1-sum", "reproduced", 1_367_257),
        ("table2-differences", "reproduced", 9),
        ("table2-means", "reproduced", 3),
        ("setup-scenes", "reproduced", 8),
        ("table2-source", "inconclusive", 8),
        ("table3-speedup-iterations", "reproduced", 18.0),
        ("table3-speedup-hours", "inconclusive", 100 * (1 - 3.4 / 4.2)),
        ("table3-final", "reproduced", 2),
        ("table4-lego", "reproduced", 2),
        ("footnote1-table", "not reproduced", 4),
    ],
)
def test_what_the_papers_figures_give(whole: Records, name, verdict, measured):
    claim = next(one for one in claims(whole) if one.id == name)
    assert claim.verdict == verdict
    assert claim.measured == pytest.approx(measured)
    assert claim.scale == OWN_FIGURES


def test_hours_leave_room_for_the_printed_speedup_by_rounding_alone(whole: Records):
    found = arithmetic.ratio_of_times(bench(whole), entry("table3-speedup-hours"))
    assert found.interval is None, "what rounding leaves open is no interval of 95 %"
    assert "leaves 16.9 to 21.2 % open" in found.note
    assert "as a ratio of speeds 24 %" in found.note
    slow = changed("table3", "hours_to_30_db", qnerf=3.7)
    assert arithmetic.ratio_of_times(bench(whole, **slow), entry("table3-speedup-hours")).verdict == "not reproduced"


@pytest.mark.parametrize(
    ("judge", "name", "table", "row", "values"),
    [
        (arithmetic.differences_of_rows, "table2-differences", "table2", "mic", {"delta": 1.6}),
        (arithmetic.means_of_rows, "table2-means", "table2", "mic", {"qnerf": 35.5}),
        (arithmetic.range_of_rows, "table2-range", "table2", "drums", {"delta": 1.1}),
        (arithmetic.final_is_average, "table3-final", "table2", "average", {"qnerf": 32.4}),
        (arithmetic.row_of_table2, "table4-lego", "table2", "lego", {"nerf": 32.6}),
    ],
)
def test_a_wrong_figure_is_found(whole: Records, judge, name, table, row, values):
    assert judge(bench(whole), entry(name)).verdict == "reproduced"
    assert judge(bench(whole, **changed(table, row, **values)), entry(name)).verdict == "not reproduced"


def test_a_wrong_sum_and_a_wrong_layer_are_found(whole: Records):
    assert arithmetic.sum_of_weights(bench(whole), entry("table1-sum", printed=1_400_000)).verdict == "reproduced"
    assert arithmetic.sum_of_weights(bench(whole), entry("table1-sum", printed=1_510_000)).verdict == "not reproduced"
    assert arithmetic.skip_layer(bench(whole), entry("table1-skip", printed=5)).verdict == "not reproduced"
    assert arithmetic.listing_1(bench(whole), entry("eq3-last-band", printed=9)).verdict == "reproduced"


def test_the_wrong_row_is_named(whole: Records):
    found = arithmetic.differences_of_rows(
        bench(whole, **changed("table2", "mic", delta=1.6)), entry("table2-differences")
    )
    assert (found.measured, found.note) == (8, "not mic")


def test_a_baseline_of_its_own_is_counted(whole: Records):
    found = arithmetic.source_of_baseline(bench(whole, **changed("table2", "mic", nerf=33.1)), entry("table2-source"))
    assert found.measured == 7
    assert "equal in 7 of 8 scenes" in found.note


def test_a_scene_without_an_original_score_is_named_and_counts_for_neither_side(whole: Records):
    original = {scene: score for scene, score in PAPER["original_nerf"].items() if scene != "mic"}
    found = arithmetic.source_of_baseline(bench(whole, original_nerf=original), entry("table2-source"))
    assert found.measured == 7
    assert "equal in 7 of 7 scenes (without mic, of which no original score is recorded)" in found.note
    assert arithmetic.source_of_baseline(
        bench(whole, original_nerf={"fern": 25.2}), entry("table2-source")
    ).verdict == (UNTESTED)


def test_a_record_without_the_tables_tests_nothing(whole: Records):
    records = replace(whole, run=replace(whole.run, paper={"ledger": PAPER["ledger"]}))
    bare = {one.id: one for one in claims(records)}
    assert bare["table1-sum"].verdict == UNTESTED
    untested = {one.verdict for name, one in bare.items() if name.startswith(("table2-means", "table3-sp", "table3-f"))}
    assert untested == {UNTESTED}
