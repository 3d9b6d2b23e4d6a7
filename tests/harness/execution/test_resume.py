"""Finished cells are never lost, overwritten or trained again."""

import json
import os
import re
import shutil
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from harness.command.main import main
from harness.records.cells import read_cells, read_comparisons, read_run
from harness.records.json_record import load_record, write_record
from tests.harness.shell import CELLS, ROOT, TINY, command, on_one_core, refused, shell

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def one_core(monkeypatch: pytest.MonkeyPatch) -> None:
    """Use one core as `shell` does, since a run resumes only with the same number of threads."""
    monkeypatch.setattr("harness.machine.device.available_cores", lambda: 1)


@pytest.fixture(scope="module")
def finished(ball_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the output of an undisturbed run, which tests must not change."""
    out = tmp_path_factory.mktemp("finished") / "run"
    ran = shell(*TINY, "--view-set", ball_folder, "--out", out)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert "4 done" in ran.stdout
    return out


def outcome_of(out: Path) -> dict[tuple[str, int], Any]:
    """Return all that must be bit-identical between two runs of one plan: everything except clocks."""
    return {
        (cell.method, cell.seed): (
            cell.status,
            cell.scores,
            cell.views,
            [replace(point, seconds=0.0, core_seconds=0.0) for point in cell.curve],
            cell.trace,
            cell.properties,
        )
        for cell in read_cells(out)
    }


def test_a_full_disk_is_said_and_nothing_is_lost(
    ball_folder: Path, finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    out = tmp_path / "run"
    shutil.copytree(finished, out)

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device", str(out))

    monkeypatch.setattr("harness.execution.run.write_run", full)
    assert "No space left" in refused(capsys, *TINY, "--quiet", "--view-set", ball_folder, "--out", out, "--resume")
    assert outcome_of(out) == outcome_of(finished)


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
    assert not re.search(rf"\b{re.escape(os.uname().nodename)}\b", text)
    assert str(Path.home()) not in text


def test_resuming_a_finished_run_trains_nothing(ball_folder: Path, finished: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    shutil.copytree(finished, out)
    assert main(["run", *TINY, "--quiet", "--view-set", str(ball_folder), "--out", str(out), "--resume"]) == 0
    for folder in ("records/cells", "checkpoints", "records/pictures"):
        before, after = ({file.name: file.read_bytes() for file in (one / folder).iterdir()} for one in (finished, out))
        assert before == after


@pytest.mark.thorough
def test_a_run_is_gone_on_with_by_the_views_alone_that_it_was_trained_on(
    ball_folder: Path, finished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, own = tmp_path / "run", tmp_path / "own" / "ball"
    shutil.copytree(finished, out)
    shutil.copytree(ball_folder, own)
    started_with = load_record(out / "records/plan.json")
    write_record(out / "records/plan.json", {**started_with, "view_set": str(own)})
    (out / "records/cells/ball.nerf.1.json").unlink()
    shutil.copy(own / "train/r_1.png", own / "train/r_0.png")
    before = all_files(out)
    said = refused(capsys, *TINY, "--quiet", "--view-set", own, "--out", out, "--resume")
    assert f"{own}: not the view set that ball.nerf.0 was trained on (content was" in said
    assert all_files(out) == before
    shutil.copy(ball_folder / "train/r_0.png", own / "train/r_0.png")
    assert main(["run", *TINY, "--quiet", "--view-set", str(own), "--out", str(out), "--resume"]) == 0
    assert outcome_of(out) == outcome_of(finished)


@pytest.mark.thorough
def test_a_damaged_record_is_named_and_just_its_cell_is_trained_again(
    ball_folder: Path, finished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    shutil.copytree(finished, out)
    (out / "records" / "cells" / "ball.nerf.1.json").write_text("{")
    kept = out / "records" / "cells" / "ball.qnerf.1.json"
    before = kept.read_bytes()
    assert main(["run", *TINY, "--view-set", str(ball_folder), "--out", str(out), "--resume"]) == 0
    said = capsys.readouterr().out
    assert "records/cells/ball.nerf.1.json: " in said
    assert "ball, nerf, seed 1 is trained again" in said
    assert "training 1 cells, 3 kept from before" in said
    assert kept.read_bytes() == before
    assert outcome_of(out) == outcome_of(finished)


def children_of(process: int) -> list[int]:
    return [int(one) for one in Path(f"/proc/{process}/task/{process}/children").read_text().split()]


def wait_for(what: Any) -> None:
    """Wait for at most two minutes."""
    for _ in range(2400):
        if what():
            return
        time.sleep(0.05)
    pytest.fail("waited in vain")


def in_the_foreground() -> None:
    """Use one core and accept Ctrl-C, which a suite in the background ignores."""
    on_one_core()
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def ended_midway(how: signal.Signals, ball_folder: Path, out: Path, *more: str) -> tuple[int, str]:
    """Start the run, end it after the first finished cell, wait for its workers; return its exit code and errors."""
    call = command(*TINY, *more, "--view-set", ball_folder, "--out", out)
    process = subprocess.Popen(
        call, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, preexec_fn=in_the_foreground
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
@pytest.mark.thorough
def test_a_killed_run_goes_on_where_it_was(ball_folder: Path, finished: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    assert ended_midway(signal.SIGKILL, ball_folder, out, "--keep-every", "0")[0] == -signal.SIGKILL
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
    assert not (out / "unfinished").exists()


@needs_proc
def test_an_interrupted_run_says_how_to_go_on(ball_folder: Path, tmp_path: Path) -> None:
    # many cells, as a signal on a busy machine may come late
    code, said = ended_midway(signal.SIGINT, ball_folder, tmp_path / "run", "--seeds", "10")
    assert code == 130
    kept = len(list(read_cells(tmp_path / "run")))
    assert 1 <= kept < 20
    run = tmp_path / "run"
    assert said == (
        f"interrupted: {kept} of 20 cells are kept; `python -m reports {run} --partial` reports them; "
        f"resume with --resume --out {run}\n"
    )
    if kept >= 2:
        assert read_comparisons(run)
    assert not read_run(tmp_path / "run").finished
