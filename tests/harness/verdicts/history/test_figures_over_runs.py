"""Machines have separate figures, and a change is named with its commits."""

from harness.records.study import Series
from harness.verdicts.history.figures_over_runs import figures_over_runs
from tests.reports.fake_history import SLOWER_FROM, fake_history, past_runs


def test_each_machine_has_its_own_figures() -> None:
    slower, other = fake_history(("line 3 is left out.",)).studies
    assert slower.info.title == "avx2, AMD EPYC 9R14, 2 threads"
    assert other.info.title.startswith("avx512")
    assert slower.answers[-1] == "line 3 is left out."
    assert slower.answers[0].startswith("1 of 3 figures with at least 12 runs changed; ")
    assert other.answers[0].startswith("0 of 3 figures")
    assert not other.tables


def test_a_change_is_named_with_the_commits_before_and_after_it() -> None:
    slower = fake_history().studies[0]
    (row,) = slower.tables[0].rows
    first = past_runs()[2 * SLOWER_FROM]
    last = past_runs()[2 * SLOWER_FROM - 2]
    assert row[:4] == ["speed.train.nerf", "×", f"{last.commit} … {first.commit}", f"{SLOWER_FROM} of 20"]
    assert isinstance(row[6], float)
    assert 20.0 < row[6] < 30.0
    assert f"between {last.commit} and {first.commit}" in slower.answers[1]


def test_what_never_varies_is_not_drawn_and_what_changed_is_drawn_first() -> None:
    lines = [finding for finding in fake_history().studies[0].findings if isinstance(finding, Series)]
    assert [(line.panel, line.name) for line in lines] == [
        ("speed (×)", "speed.train.nerf"),
        ("speed (×)", "speed.score"),
    ]
    assert lines[0].x == [float(number) for number in range(1, 21)]


def test_few_runs_show_no_change() -> None:
    (study,) = figures_over_runs(past_runs()[:1], [], {}, {}).studies
    assert study.answers == ["No figure has the 12 runs in which a change can be distinguished from chance."]
