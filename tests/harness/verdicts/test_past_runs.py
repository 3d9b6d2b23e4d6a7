"""The file of past runs: appended to, read again, and a truncated line spoils only itself."""

from pathlib import Path

import pytest

from harness.command.gate_command import remember
from harness.command.main import main
from harness.execution.progress import Quiet
from harness.records.study import read_studies
from harness.verdicts.history.past_runs import append, read_history
from scenes.files.errors import InputError
from tests.harness.shell import refused
from tests.reports.fake_history import past_runs
from tests.reports.fake_studies import fake_studies, write_fake_studies


def test_runs_come_back_in_their_order(tmp_path: Path) -> None:
    file = tmp_path / "new" / "h.jsonl"
    for run in past_runs()[:5]:
        append(file, run)
    assert read_history(file) == (past_runs()[:5], [])


def test_a_line_that_was_cut_off_is_named_and_spoils_no_other(tmp_path: Path) -> None:
    file = tmp_path / "h.jsonl"
    first, second, third = past_runs()[:3]
    append(file, first)
    append(file, second)
    file.write_bytes(file.read_bytes()[:-9])
    append(file, third)
    runs, damaged = read_history(file)
    assert runs == [first, third]
    assert len(damaged) == 1
    assert damaged[0].startswith(f"{file}, line 2 is left out: ")


@pytest.mark.parametrize("content", [b"", b"no\n", b"{}\n", b"\xff\xfe"])
def test_a_file_without_a_run_is_refused(tmp_path: Path, content: bytes, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "h.jsonl"
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"h\.jsonl"):
        read_history(file)
    assert "h.jsonl" in refused(capsys, file, "--out", tmp_path / "page", command="history")
    assert not (tmp_path / "page").exists()
    assert "no such file" in refused(capsys, tmp_path / "none", command="history")


def test_figures_of_a_record_are_appended_beside_it_and_shown(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    record = write_fake_studies(tmp_path / "speed", "speed") / "speed.json"
    for _ in range(2):
        remember(None, record, "avx2", Quiet())
    runs, _ = read_history(tmp_path / "history.jsonl")
    checks = [check for _, check in fake_studies("speed").checks()]
    figures = {check.id: check.value for check in checks if check.id and check.value is not None}
    assert [run.values for run in runs] == [figures] * 2
    assert runs[0].machine == "avx2, AMD EPYC 9R14, 2 threads"
    assert main(["history", str(tmp_path / "history.jsonl"), "--out", str(tmp_path / "page")]) == 0
    assert "2 runs from" in capfd.readouterr().out
    assert len(read_studies(tmp_path / "page" / "history.json").studies) == 1
    assert "avx2, AMD EPYC 9R14, 2 threads" in (tmp_path / "page" / "history.html").read_text(encoding="utf-8")


def test_a_history_that_cannot_be_written_loses_nothing_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from harness.execution.progress import Lines

    record = write_fake_studies(tmp_path / "speed", "speed") / "speed.json"
    (tmp_path / "file").write_text("")
    remember(tmp_path / "file" / "h.jsonl", record, "avx2", Lines())
    assert "--history" in capsys.readouterr().out
