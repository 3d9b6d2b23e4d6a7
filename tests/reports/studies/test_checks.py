"""Checks → texts, rows and cells: the worst outcome wins, and broken checks come first."""

import math

import pytest
from msgspec import structs

from harness.records.study import Check, check
from reports.studies.check_words import checks_grid, describe, outcome, repetitions, spread_of, tone_of
from reports.studies.matrix import groups, miniature, strain, worst_of
from tests.reports.fake_studies import fake_studies, study


def trial(status="pass", owner="ours", value=1e-7, limit=1e-6, subject="a", what="", **more) -> Check:
    return Check(what, value, **{"high": limit, **more}, subject=subject, owner=owner, status=status)


def target(value, unit="×", goal=10.0, **more) -> Check:
    return check("title", value, goal, unit=unit, owner="machine", **more)


@pytest.mark.parametrize(
    ("given", "tone", "said"),
    [
        (trial(), "passes", "✓ passes"),
        (trial("fail"), "fails", "✕ fails"),
        (trial("fail", "paper"), "property", "◆ fails: a property of that form"),
        (trial("fail", "usual"), "property", "◆ fails: a property of that form"),
        (trial("pass", "paper"), "passes", "✓ passes"),
        (trial("measured"), "measured", "• measured"),
        (trial("inconclusive"), "unsettled", "? inconclusive"),
        (trial("not_available", value=None), "absent", "○ not available"),
        (trial("not_applicable", "paper", None), "spared", "· not applicable"),
        (target(11.2), "passes", "✓ met, 12 % above"),
        (target(10.0), "passes", "✓ met"),
        (target(34.0), "passes", "✓ met, a factor of 3.4 above"),
        (target(4.0), "missed", "✕ missed by a factor of 2.5"),
        (target(58.1, "%", 65.0), "missed", "✕ missed by 6.9 points"),
        (target(-1.0), "missed", "✕ missed"),
        (target(None), "missed", "✕ not met, as it has no figure"),
        (structs.replace(target(11.2), status="inconclusive"), "unsettled", "? inconclusive"),
        (target(None, goal=None), "absent", "○ not available"),
        (check("t", 1.7, high=2.0, unit="GB", owner="machine"), "passes", "✓ met, 15 % below"),
    ],
)
def test_what_became_of_a_check(given, tone, said):
    assert tone_of(given) == tone
    assert outcome(given).replace("\u202f", " ") == said


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (check("a", 0.031, high=0.05), "a: 0.0310, wanted ≤ 0.05"),
        (check("a", 0.05004, high=0.05), "a: 0.05004, wanted ≤ 0.05"),
        (check("a", 1.5, low=0.5, high=2.5, unit="dB", why="so"), "a: 1.50 dB, wanted 0.5 … 2.5 dB (so)"),
        (check("a", None, low=80, unit="%"), "a: no figure, wanted ≥ 80 %"),
        (check("a", 3.0), "a: 3"),
        (check("", 3e-7, high=2.5e-7, subject="b"), "b: 3.00·10⁻⁷, wanted ≤ 2.5·10⁻⁷"),
        (trial(what="refused", value=None, limit=None), "a: refused"),
    ],
)
def test_a_check_in_a_line(given, said):
    assert describe(given).replace("\u202f", " ") == said


@pytest.mark.parametrize(
    ("spread", "repeats", "said", "each"),
    [
        ((9.0, 12.0), 5, "9–12×, 5 repetitions", "not in every repetition"),
        ((-1.0, 12.0), 2, "−1 to 12×, 2 repetitions", "not in every repetition"),
        ((10.5, 12.0), 5, "10.5–12×, 5 repetitions", ""),
        (None, 1, "measured once", ""),
        ((11.0, 11.0), 1, "measured once", ""),
    ],
)
def test_the_range_of_repetitions_and_whether_all_meet_a_target(spread, repeats, said, each):
    measured = target(11.0, spread=spread, repeats=repeats)
    assert (spread_of(measured), repetitions(measured)) == (said, each)
    assert repetitions(target(9.0, spread=(8.0, 11.0), repeats=3)) == "reached in the best repetition"


def test_broken_rows_come_first_and_empty_columns_are_left_out():
    case = study("Q1", "t", check("first", 1.0), check("second", 3.0, high=2.0))
    grid = checks_grid("", [(case, row) for row in case.checks])
    assert [column.label for column in grid.columns] == ["figure", "measured", "wanted", "outcome"]
    assert [row[0].text for row in grid.rows] == ["second", "first"]
    grid = checks_grid("", [(case, case.checks[0])], lambda study: study.info.title)
    assert [(row[0].text, row[0].link) for row in grid.rows] == [("t", "study-Q1")]


def test_of_several_outcomes_the_worst_is_shown_and_all_are_listed():
    checks = [trial(value=9e-7), trial("fail", value=2e-6), trial("fail", value=5e-6, what="colour"), trial(value=1e-9)]
    cell = worst_of(checks)
    assert (cell.tone, cell.text, cell.small) == ("fails", "5.0·10⁻⁶", "2 of 4")
    assert len(cell.title.splitlines()) == 4
    passing = worst_of(checks[:1] + checks[3:])
    assert (passing.text, passing.small) == ("9.0·10⁻⁷", "worst of 2")
    assert worst_of(checks[:1]).small == ""
    assert worst_of([trial("fail", "paper", 1e30), trial("fail", "ours", 2e-6)]).tone == "fails"


def test_a_figure_that_is_not_finite_is_the_worst_and_says_so():
    lost = check("error", math.nan, high=1.0, subject="a", owner="usual")
    made = worst_of([trial("fail", "usual", 5.0), lost])
    assert (made.tone, made.text) == ("property", "not finite")
    assert strain(lost) == math.inf


def test_no_outcome_is_lost_in_the_matrix_or_its_miniature():
    record = fake_studies("stability", failing=True)
    rows = [row for group in groups(record) for row in group.rows]
    for case, row in zip(record.studies, rows, strict=True):
        titles = [cell.title for cell in [*row.cells, *row.others] if cell]
        assert sum(len(title.split("\n")) for title in titles) == len(case.checks)
        assert row.failed == (case.info.id == "A2")
    (drawn,) = miniature(record)
    kinds = {(case.info.id, check.subject, check.owner) for case, check in record.checks()}
    assert sum(len(trace.x) for trace in drawn.traces) == len(kinds)
    assert len(drawn.rows) == sum(bool(case.checks) for case in record.studies)
    assert miniature(fake_studies("stability", studies=[])) == []
