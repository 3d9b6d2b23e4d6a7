"""Outcomes → cells: the gravest wins, ours stands first, what occurs once stands beside; and the words for all that."""

import math

import pytest

from harness.records.json_record import DamagedRecord
from harness.records.study import SHELVES, Check, check
from reports.data.studies_load import find_studies
from reports.studies.stability_matrix import cell, groups, headline, sentences, strain, tone_of, verdict
from tests.replacing import replace
from tests.reports.fake_stability import case, fake_stability, write_fake_stability


def one(status="pass", whose="ours", figure=1e-7, bar=1e-6, subject="a", what="", **more) -> Check:
    return Check(what, figure, **{"high": bar, **more}, subject=subject, owner=whose, status=status)


@pytest.mark.parametrize(
    ("given", "tone", "said"),
    [
        (one(), "passes", "passes"),
        (one("fail"), "fails", "fails"),
        (one("fail", "paper"), "property", "fails: a property of the paper’s form as printed"),
        (one("fail", "usual"), "property", "fails: a property of the field’s usual form"),
        (one("pass", "paper"), "passes", "passes"),
        (one("inconclusive"), "unsettled", "inconclusive"),
        (one("not_available", figure=None), "absent", "not available"),
        (one("not_applicable", "paper", None), "spared", "not applicable"),
    ],
)
def test_what_became_of_an_outcome(given, tone, said):
    assert tone_of(given) == tone
    assert verdict(given) == said


def test_of_several_outcomes_the_gravest_is_shown_and_all_are_told():
    found = [one(figure=9e-7), one("fail", figure=2e-6), one("fail", figure=5e-6, what="colour"), one(figure=1e-9)]
    made = cell(found)
    assert (made.tone, made.text, made.small) == ("fails", "5.0·10⁻⁶", "2 of 4")
    assert len(made.title.splitlines()) == 4
    assert cell(found[:1] + found[3:]).text == "9.0·10⁻⁷"
    assert cell(found[:1] + found[3:]).small == "worst of 2"
    assert cell(found[:1]).small == ""


def test_a_failure_of_ours_outweighs_a_property_however_large():
    assert cell([one("fail", "paper", 1e30), one("fail", "ours", 2e-6)]).tone == "fails"


def test_a_figure_that_is_not_finite_is_the_worst_and_says_so():
    lost = check("error", math.nan, high=1.0, subject="a", owner="usual")
    made = cell([one("fail", "usual", 5.0), lost])
    assert (made.tone, made.text) == ("property", "not finite")
    assert strain(lost) == math.inf


def test_no_outcome_is_lost_in_the_matrix():
    record = fake_stability()
    for case_of, row in zip(record.studies, [row for group in groups(record) for row in group.rows], strict=True):
        told_of = [found.title for found in [*row.cells, *row.others] if found]
        assert sum(len(title.split("\n")) for title in told_of) == len(case_of.checks)
        assert row.failed == (case_of.info.id == "A2")


def test_the_headline_counts_ours_alone():
    assert headline(fake_stability()) == "1 of 30 stability checks of this harness fails"
    assert headline(fake_stability(with_failure=False)) == "All 30 stability checks of this harness pass"
    only = fake_stability(studies=[case("Q1", "t", "b", one("fail", "paper"))])
    assert headline(only) == "Numerical stability: nothing of this harness was tried"
    assert "Nothing of ours was put to the test." in sentences(only)
    assert headline(fake_stability(studies=[case("Q1", "t", "b", one())])).startswith("The one stability check")
    two = fake_stability(studies=[case("Q1", "t", "b", *[one("fail", subject=str(n)) for n in range(6)])])
    assert headline(two) == "6 of 6 stability checks of this harness fail"
    assert "Q1 0, Q1 1, Q1 2, Q1 3 and 2 more" in sentences(two)[1]


def test_what_is_inconclusive_is_neither_passed_nor_untried():
    record = fake_stability(studies=[case("Q1", "t", "b", one(), one("inconclusive", subject="b"))])
    said = sentences(record)
    assert "1 check." in said[1]
    assert said[2] == "Inconclusive: 1 check; each says why."
    assert not any(line.startswith("Not tried") for line in said)


def test_what_is_not_available_is_no_check_passed():
    record = fake_stability(studies=[case("Q1", "t", "b", one(), one("not_available", subject="b", figure=None))])
    assert "1 check." in sentences(record)[1]
    assert "1 not available here" in sentences(record)[-1]


def test_a_record_comes_back_as_it_was_written_but_for_what_is_not_finite(tmp_path):
    record = fake_stability()
    found = find_studies(write_fake_stability(tmp_path, record), "stability")
    assert found is not None
    assert [one for _, one in found.checks()] == [one for _, one in record.checks()]
    lost = [line for case_of in found.studies for line in case_of.series if None in line.y]
    assert [(line.name, line.y[:2]) for line in lost] == [("log_space", [None, None])]
    assert found.studies[1].tables[0].rows[2][4] == "not finite (nan)"
    assert find_studies(tmp_path / "stability", "stability") is None


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda c: [*c, c[0]], "'Q1' is there twice"),
        (lambda c: [replace(c[0], findings=[replace(c[0].series[0], y=[1.0])])], "has 17 x but 1 y"),
    ],
)
def test_a_record_that_no_run_writes_is_refused_and_names_the_remedy(tmp_path, change, said):
    out = write_fake_stability(tmp_path, fake_stability(studies=change(fake_stability().studies)))
    with pytest.raises(DamagedRecord, match="nox -s stability") as caught:
        find_studies(out, "stability")
    assert said in str(caught.value)
    assert str(caught.value).startswith(str(out / SHELVES["stability"]))
