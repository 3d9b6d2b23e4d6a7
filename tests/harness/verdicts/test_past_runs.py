"""The file of past runs, of which a truncated line spoils only itself; and the figures that changed over them."""

from pathlib import Path

import pytest

from harness.command.gate_command import remember
from harness.command.main import main
from harness.execution.progress import Progress
from harness.records.study import Series, read_studies
from harness.verdicts.history.figures_over_runs import figures_over_runs
from harness.verdicts.history.past_runs import append, read_history
from scenes.files.errors import InputError
from tests.reports.fake_history import SLOWER_FROM, fake_history, past_runs
from tests.reports.fake_studies import fake_studies, write_fake_studies


def test_runs_come_back_in_their_order_and_a_line_that_was_cut_off_is_named(tmp_path: Path) -> None:
    file = tmp_path / "new" / "h.jsonl"
    first, second, third, fourth = past_runs()[:4]
    append(file, first)
    append(file, second)
    file.write_bytes(file.read_bytes()[:-9])
    append(file, third)
    append(file, fourth)
    runs, damaged = read_history(file)
    assert runs == [first, third, fourth]
    assert len(damaged) == 1
    assert damaged[0].startswith(f"{file}, line 2 is left out: ")


@pytest.mark.parametrize("content", [b"", b"no\n", b"{}\n", b"\xff\xfe"])
def test_a_file_without_a_run_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "h.jsonl").write_bytes(content)
    with pytest.raises(InputError, match=r"h\.jsonl"):
        read_history(tmp_path / "h.jsonl")


def test_figures_of_a_record_are_kept_beside_it_and_shown(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    record = write_fake_studies(tmp_path / "speed", "speed") / "speed.json"
    for _ in range(2):
        remember(None, record, "avx2", Progress())
    runs, _ = read_history(tmp_path / "history.jsonl")
    checks = [check for _, check in fake_studies("speed").checks()]
    figures = {check.id: check.value for check in checks if check.id and check.value is not None}
    assert [run.values for run in runs] == [figures] * 2
    assert runs[0].machine == "avx2, AMD EPYC 9R14, 2 threads"
    assert main(["history", str(tmp_path / "history.jsonl"), "--out", str(tmp_path / "page")]) == 0
    assert "2 runs from" in capfd.readouterr().out
    assert len(read_studies(tmp_path / "page" / "history.json").studies) == 1
    assert "avx2, AMD EPYC 9R14, 2 threads" in (tmp_path / "page" / "history.html").read_text(encoding="utf-8")


def test_a_history_that_cannot_be_written_loses_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from harness.execution.progress import Lines

    record = write_fake_studies(tmp_path / "speed", "speed") / "speed.json"
    (tmp_path / "file").write_text("")
    remember(tmp_path / "file" / "h.jsonl", record, "avx2", Lines())
    assert "--history" in capsys.readouterr().out


# figures over runs


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
    assert [(one.panel, one.name) for one in lines] == [("speed (×)", "speed.train.nerf"), ("speed (×)", "speed.score")]
    assert lines[0].x == [float(number) for number in range(1, 21)]


def test_few_runs_show_no_change() -> None:
    (study,) = figures_over_runs(past_runs()[:1], [], {}, {}).studies
    assert study.answers == ["No figure has the 12 runs in which a change can be distinguished from chance."]
