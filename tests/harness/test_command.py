"""`python -m harness`: what is wrong is said in one line, and what was finished is never lost."""

import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from harness.__main__ import main
from harness.group import GroupTask, run_group
from harness.local_executor import Event
from harness.output_folder import claim
from harness.plan import planned
from harness.progress import Quiet
from harness.records import CellRecord, read_cells, read_comparisons, read_run
from harness.runner import Machine, run
from tests.harness.bad_view_sets import SPOILT

ROOT = Path(__file__).parents[2]
TINY = shlex.split("--profile smoke --resolution 24 --methods nerf qnerf --seeds 2 --budget-steps 34 --workers 1")
CELLS = [("nerf", 0), ("nerf", 1), ("qnerf", 0), ("qnerf", 1)]


def command(*arguments: str | Path) -> list[str]:
    return [sys.executable, "-m", "harness", "run", *map(str, arguments)]


def on_one_core() -> None:
    """One thread: equal bits wherever the tests run, and threads that wait for each other do not burn a busy core."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


def shell(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command(*arguments), cwd=ROOT, capture_output=True, text=True, preexec_fn=on_one_core)


@pytest.fixture(scope="module")
def finished(ball_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The output of an undisturbed run; not to be changed."""
    out = tmp_path_factory.mktemp("finished") / "run"
    ran = shell(*TINY, "--view-set", ball_folder, "--out", out)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert "4 done" in ran.stdout
    return out


def outcome_of(out: Path) -> dict[tuple[str, int], Any]:
    """All that must be equal to the bit between two runs of one plan: everything but the clock."""
    return {
        (cell.method, cell.seed): (
            cell.status,
            cell.scores,
            cell.views,
            [replace(point, seconds=0.0) for point in cell.curve],
            cell.trace,
            cell.properties,
        )
        for cell in read_cells(out)
    }


def refused(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    """The one line that a bad call ends with; anything that is raised is a traceback and fails the test."""
    assert main(["run", *map(str, arguments)]) == 2
    _, said = capsys.readouterr()
    assert said.startswith("error: ")
    assert said.count("\n") == 1
    return said


# bad input


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--profile tiny", "unknown profile 'tiny'; known profiles: smoke reduced full"),
        ("--scenes lego teapot", "unknown 'teapot'; known: "),
        ("--methods nerf gnerf", "unknown 'gnerf'; known: nerf nerf_matched qnerf"),
        ("--methods nerf nerf", "named twice"),
        ("--seeds 0", "--seeds 0: must lie between"),
        ("--seeds -1", "--seeds -1"),
        ("--budget-steps 0", "--budget-steps 0"),
        ("--budget-steps 99999999999", "--budget-steps 99999999999"),
        ("--budget-seconds -2", "--budget-seconds -2"),
        ("--budget-seconds nan", "--budget-seconds nan"),
        ("--resolution 0", "--resolution 0"),
        ("--resolution 100000", "--resolution 100000"),
        ("--workers 0", "--workers 0"),
        ("--workers 100000", "--workers 100000"),
        ("--scenes lego --view-set x", "exclude each other"),
    ],
)
def test_bad_options_are_said_in_one_line(
    options: str, said: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert said in refused(capsys, "--quiet", *options.split())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "arguments",
    ["", "walk", "run --colour red", "run --seeds many", "run --device tpu", "run --executor cloud", "run lego"],
)
def test_bad_usage_is_exit_code_2(arguments: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(arguments.split())
    assert caught.value.code == 2
    assert "error: " in capsys.readouterr().err


def test_a_gpu_that_is_not_there_is_missed_by_name(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    said = refused(capsys, "--device", "cuda", "--out", tmp_path / "run")
    assert "--device cuda" in said
    assert "sees no GPU" in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("wrong", SPOILT)
def test_a_bad_view_set_is_told_before_anything_is_done(
    wrong: str, ball_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil, expected = SPOILT[wrong]
    folder = tmp_path / "ball"
    shutil.copytree(ball_folder, folder)
    spoil(folder)
    said = refused(capsys, *TINY, "--quiet", "--view-set", folder, "--out", tmp_path / "run")
    assert expected in said
    assert str(folder) in said
    assert [file.name for file in tmp_path.iterdir()] == ["ball"], "the same command can be typed again"


def test_a_view_set_that_is_not_there_and_one_too_small(
    ball_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    nowhere = tmp_path / "nowhere"
    assert "no such folder" in refused(capsys, *TINY, "--quiet", "--view-set", nowhere, "--out", tmp_path / "run")
    said = refused(capsys, *TINY, "--quiet", "--view-set", ball_folder, "--out", tmp_path / "run", "--resolution", "48")
    assert "choose --resolution 24 or less" in said
    assert list(tmp_path.iterdir()) == []


def test_from_a_shell_there_is_no_traceback(tmp_path: Path) -> None:
    ran = shell("--profile", "smoke", "--view-set", tmp_path / "nowhere", "--out", tmp_path / "run")
    assert ran.returncode == 2
    assert ran.stderr.count("\n") == 1
    assert "Traceback" not in ran.stderr + ran.stdout


def test_an_output_folder_that_cannot_be_is_refused(
    ball_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "file"
    file.write_text("mine")
    for out, expected in (
        (file, "is a file"),
        (file / "run", "cannot be written"),
        (Path("/proc/run"), "cannot be written"),
        (tmp_path / ("long" * 100), "cannot be written"),
        (tmp_path, "in use by something else"),
    ):
        assert expected in refused(capsys, *TINY, "--quiet", "--view-set", ball_folder, "--out", out)
    assert file.read_text() == "mine"


def test_a_full_disk_is_said_and_nothing_is_lost(
    ball_folder: Path, finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    out = tmp_path / "run"
    shutil.copytree(finished, out)

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device", str(out))

    monkeypatch.setattr("harness.runner.write_run", full)
    assert "No space left" in refused(capsys, *TINY, "--quiet", "--view-set", ball_folder, "--out", out, "--resume")
    assert outcome_of(out) == outcome_of(finished)


# results are kept


def all_files(folder: Path) -> dict[Path, bytes]:
    return {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def test_a_run_leaves_whole_records(finished: Path) -> None:
    record = read_run(finished)
    assert record.finished
    assert (list(record.methods), record.seeds) == (["nerf", "qnerf"], [0, 1])
    assert (record.scenes[0].name, record.scenes[0].width, record.scenes[0].psnr_ceiling) == ("ball", 24, None)
    assert set(record.phases) == {"render", "train", "total"}
    assert sorted(outcome_of(finished)) == CELLS
    assert {row.scene for row in read_comparisons(finished)} == {"ball", "all"}
    assert not list(finished.rglob("*.part"))
    text = json.dumps(record.provenance)
    assert os.uname().nodename not in text
    assert str(Path.home()) not in text


def test_results_are_not_overwritten_without_resume(
    ball_folder: Path, finished: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = all_files(finished)
    said = refused(capsys, *TINY, "--quiet", "--view-set", ball_folder, "--out", finished)
    assert "holds results already" in said
    said = refused(
        capsys, *TINY, "--quiet", "--view-set", ball_folder, "--out", finished, "--resume", "--budget-steps", "35"
    )
    assert "another plan" in said
    assert "'steps': 34" in said
    assert "'steps': 35" in said
    assert all_files(finished) == before


def test_resuming_a_finished_run_trains_nothing(ball_folder: Path, finished: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    shutil.copytree(finished, out)
    assert main(["run", *TINY, "--quiet", "--view-set", str(ball_folder), "--out", str(out), "--resume"]) == 0
    for folder in ("records/cells", "checkpoints", "records/images"):
        before, after = ({file.name: file.read_bytes() for file in (one / folder).iterdir()} for one in (finished, out))
        assert before == after


def test_a_damaged_record_is_named_and_the_rest_is_kept(
    ball_folder: Path, finished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    shutil.copytree(finished, out)
    (out / "records" / "cells" / "ball.nerf.1.json").write_text("{")
    said = refused(capsys, *TINY, "--quiet", "--view-set", ball_folder, "--out", out, "--resume")
    assert "ball.nerf.1.json" in said
    assert "delete it" in said
    assert (out / "records" / "cells" / "ball.qnerf.1.json").exists()


def children_of(process: int) -> list[int]:
    return [int(one) for one in Path(f"/proc/{process}/task/{process}/children").read_text().split()]


def wait_for(what: Any) -> None:
    """Gives up after two minutes."""
    for _ in range(2400):
        if what():
            return
        time.sleep(0.05)
    pytest.fail("waited in vain")


def ended_midway(how: signal.Signals, ball_folder: Path, out: Path) -> tuple[int, str]:
    """Starts the run, ends it as soon as one cell is finished, waits for its workers; its exit code and complaints."""
    call = command(*TINY, "--view-set", ball_folder, "--out", out)
    process = subprocess.Popen(
        call, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, preexec_fn=on_one_core
    )
    cells = out / "records" / "cells"
    wait_for(lambda: process.poll() is not None or (cells.exists() and list(cells.glob("*.json"))))
    workers = children_of(process.pid)
    process.send_signal(how)
    said = process.communicate()[1]
    wait_for(lambda: not any(Path(f"/proc/{worker}/cmdline").exists() for worker in workers))
    return process.returncode, said


needs_proc = pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc to find worker processes")


@needs_proc
def test_a_killed_run_goes_on_where_it_was(ball_folder: Path, finished: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    assert ended_midway(signal.SIGKILL, ball_folder, out)[0] == -signal.SIGKILL
    kept = {file: (file.read_bytes(), file.stat().st_mtime_ns) for file in (out / "records/cells").glob("*.json")}
    assert 1 <= len(kept) < 4
    assert {cell.status for cell in read_cells(out)} == {"done"}, "workers that lost their parent record no error"
    assert not read_run(out).finished
    resumed = shell(*TINY, "--view-set", ball_folder, "--out", out, "--resume")
    assert (resumed.returncode, resumed.stderr) == (0, "")
    assert f"training {4 - len(kept)} cells, {len(kept)} kept from before" in resumed.stdout
    assert {file: (file.read_bytes(), file.stat().st_mtime_ns) for file in kept} == kept
    assert outcome_of(out) == outcome_of(finished)
    assert read_run(out).finished


@needs_proc
def test_an_interrupted_run_says_how_to_go_on(ball_folder: Path, tmp_path: Path) -> None:
    code, said = ended_midway(signal.SIGINT, ball_folder, tmp_path / "run")
    assert code == 130
    assert said == "interrupted: finished cells are kept; go on with --resume and --out\n"
    assert 1 <= len(list(read_cells(tmp_path / "run"))) < 4
    assert not read_run(tmp_path / "run").finished


# other surfaces


def test_a_dry_run_prints_the_plan_and_its_cost_and_writes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["run", "--profile", "smoke", "--resolution", "16", "--dry-run"]) == 0
    said, complaints = capsys.readouterr()
    assert complaints == ""
    for part in ("12 cells of 60 steps", "hotdog lego", "nerf nerf_matched qnerf", "16 px", "estimated cost"):
        assert part in said
    assert list(tmp_path.iterdir()) == []


def in_this_process(tasks: list[GroupTask], _: int) -> Iterator[Event]:
    """Workers take seconds to start."""
    for task in tasks:
        cells: list[CellRecord] = []
        run_group(task, lambda share: None, cells.append)
        yield from (Event(task, cell=cell) for cell in cells)


def test_the_same_command_can_be_typed_again(
    ball_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("harness.runner.run_locally", in_this_process)
    options = "run --profile smoke --resolution 24 --methods nerf --seeds 1 --budget-steps 2 --quiet --view-set"
    folders = []
    for _ in range(2):
        assert main([*options.split(), str(ball_folder)]) == 0
        folders.append((tmp_path / "out" / "latest").resolve())
    assert folders[0] != folders[1]
    assert all(folder.parent == tmp_path / "out" and folder.name.startswith("smoke-") for folder in folders)
    assert [len(list(read_cells(folder))) for folder in folders] == [1, 1]
    assert capsys.readouterr() == ("", ""), "--quiet"
    nowhere = [*options.split(), str(tmp_path / "nowhere")]
    assert main(nowhere) == 2
    assert (tmp_path / "out" / "latest").resolve() == folders[1], "latest stays on the last run that began"


def test_a_diverged_cell_is_exit_code_3_and_stays_visible(ball_folder: Path, tmp_path: Path) -> None:
    plan = planned("smoke", view_set=ball_folder, methods=["nerf", "qnerf"], seeds=2, budget_steps=20, resolution=24)
    plan = replace(plan, train=replace(plan.train, learning_rate=1e30, last_learning_rate=1e30, warm_up_steps=0))
    claim(tmp_path / "run", plan, resume=False)
    assert run(plan, tmp_path / "run", tmp_path, Machine("cpu", 1, 1), "none", Quiet()) == 3
    cells = list(read_cells(tmp_path / "run"))
    assert [(cell.method, cell.seed) for cell in cells] == CELLS
    diverged = [cell for cell in cells if cell.status == "diverged"]
    assert diverged
    for cell in diverged:
        assert (cell.reason or "").startswith(f"not finite at step {cell.steps}: ")
    assert {row.verdict for row in read_comparisons(tmp_path / "run")} == {"inconclusive"}
    assert sum(row.left_aside for row in read_comparisons(tmp_path / "run") if row.metric == "psnr") > 0
