"""Jobs by submitit's local executor, which acts like Slurm without a queue."""

import os
import pickle
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from harness.execution import submitit_executor
from harness.execution.group_loop import Attempt, End, Event
from harness.execution.submitit_executor import FOLDER, SlurmJob, ask_node, job_parameters, run_by_submitit
from harness.machine.provenance import versions
from harness.records.cells import CellRecord, empty_cell, read_cells, write_cell
from scenes.files.errors import InputError
from tests.harness.execution.on_two_executors import COMMIT, SLOW_SCORES, Told, require_the_bits_of_workers, tasks
from tests.harness.tiny import SCORE
from tests.replacing import replace

pytestmark = pytest.mark.timeout(900)


@pytest.fixture
def no_slurm(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Hide a Slurm that the machine may have."""
    pytest.importorskip("submitit", reason="the extra `submitit` is not installed")
    with monkeypatch.context() as patch:
        patch.setattr("submitit.SlurmExecutor.affinity", lambda: -1)
        yield


@pytest.fixture
def slurm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of a Slurm that counts its jobs and notes what it cancels; each job has ended at once."""
    core = pytest.importorskip("submitit.slurm.slurm", reason="the extra `submitit` is not installed")
    monkeypatch.setattr(core.SlurmJob, "watcher", core.SlurmInfoWatcher())
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:/usr/bin:/bin")
    (tmp_path / "bin").mkdir()
    scripts = {
        "srun": "exit 1",
        "sbatch": f"echo x >> {tmp_path}/jobs; echo Submitted batch job $(wc -l < {tmp_path}/jobs)",
        "sacct": "echo 'JobID|State|NodeList'; for id; do echo \"$id|COMPLETED|node\"; done",
        "scancel": f'echo "$@" >> {tmp_path}/cancelled',
    }
    for name, script in scripts.items():
        (tmp_path / "bin" / name).write_text(f"#!/bin/sh\n{script}\n", encoding="ascii")
        (tmp_path / "bin" / name).chmod(0o755)
    return tmp_path / "bin"


def test_numbers_are_numbers_and_words_are_words() -> None:
    given = job_parameters(["timeout_min=600", "mem_gb=1.5", "slurm_partition=gpu", "name=a=b"])
    assert given == {"timeout_min": 600, "mem_gb": 1.5, "slurm_partition": "gpu", "name": "a=b"}


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ("timeout_min", "must read NAME=VALUE"),
        ("=3", "must read NAME=VALUE"),
        ("timeout_min=soon", "expected type"),
        ("no_such=1", "no_such"),
        ("gpus_per_node=8", "--threads and --device"),
    ],
)
def test_wrong_parameters_are_named(no_slurm: None, tmp_path: Path, given: str, says: str) -> None:
    with pytest.raises(InputError, match=f"^--job {given}") as error:
        submitit_executor.executor(tmp_path, 1, "cpu", [given])
    assert says in str(error.value)


@pytest.mark.parametrize(
    ("sbatch", "says"),
    [
        ("echo sbatch: error: invalid partition specified: x >&2; exit 1", "error: invalid partition specified: x"),
        ("echo queued", "queued"),
        (None, "sbatch"),
    ],
)
def test_a_job_that_is_refused_names_the_reason_and_the_remedy(slurm: Path, sbatch: str | None, says: str) -> None:
    if sbatch is None:
        (slurm / "sbatch").unlink()
    else:
        (slurm / "sbatch").write_text(f"#!/bin/sh\n{sbatch}\n", encoding="ascii")
    with pytest.raises(InputError, match=r"^--executor submitit: no job can be submitted \(.*--job slurm_") as error:
        ask_node(slurm.parent / "out", 1, "cpu", [])
    assert says in str(error.value)


def test_jobs_are_cancelled_by_few_commands(slurm: Path, ball_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(submitit_executor, "MOST_IDS", 2)
    every = tasks(ball_folder, slurm.parent / "out", 3, SCORE)
    queue = submitit_executor._Queue(every[0], COMMIT, 3, [])
    attempts = [Attempt(task) for task in every]
    for attempt in attempts:
        queue.submit(attempt, attempt.task)
    queue.cancel(attempts)
    assert (slurm.parent / "cancelled").read_text(encoding="ascii") == "1 2\n3\n"


def test_what_a_file_server_shows_late_is_waited_for(
    slurm: Path, ball_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(submitit_executor, "POLL_SECONDS", 0.0)
    (task,) = tasks(ball_folder, slurm.parent / "out", 1, SCORE)
    queue, attempt = submitit_executor._Queue(task, COMMIT, 1, []), Attempt(task)
    queue.submit(attempt, task)
    queue._journal(attempt).write_text('0.5\n["ball", "nerf", 0]\n', encoding="ascii")
    assert list(queue.poll([attempt])) == [(attempt, 0.5)]
    write_cell(task.out, empty_cell("ball", "nerf", 0, "error", "late"))
    ((_, cell),) = queue.poll([attempt])
    assert isinstance(cell, CellRecord)
    assert not list(queue.poll([attempt])), "its result is missing"
    attempt.handle.paths.result_pickle.write_bytes(pickle.dumps(("success", None)))
    assert list(queue.poll([attempt])) == [(attempt, End())]


@pytest.fixture
def job(ball_folder: Path, tmp_path: Path) -> SlurmJob:
    (task,) = tasks(ball_folder, tmp_path, 1, SCORE)
    return SlurmJob(task, tmp_path / "journal", tmp_path / "alive", versions(), COMMIT)


def test_a_node_with_other_packages_trains_nothing(job: SlurmJob, tmp_path: Path) -> None:
    refusal = replace(job, versions={**versions(), "torch": "0.1"})()
    assert "torch" in refusal
    assert "instead of 0.1" in refusal
    assert not list(read_cells(tmp_path))


def test_a_job_without_its_driver_ends(job: SlurmJob, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(submitit_executor, "TOLD_SECONDS", 0.0)
    with pytest.raises(SystemExit):
        job()
    job.alive.touch()
    os.utime(job.alive, (0.0, 0.0))
    with pytest.raises(SystemExit):
        job()
    job.alive.touch()
    assert job() is None
    assert len(list(read_cells(tmp_path))) == 2


@pytest.mark.slow
@pytest.mark.thorough
def test_a_killed_job_costs_time_and_changes_no_bit(
    no_slurm: None, ball_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(submitit_executor, "POLL_SECONDS", 0.05)
    monkeypatch.setattr(submitit_executor, "LATE_SECONDS", 0.0)
    events: list[Event] = []
    killed = False
    for event in run_by_submitit(tasks(ball_folder, tmp_path / "jobs", 1, SLOW_SCORES), COMMIT, 1, []):
        events.append(event)
        if event.cell is not None and not killed:
            killed = True
            _kill_job_in(tmp_path / "jobs" / FOLDER)
    told = Told(events)
    (notice,) = told.notices
    assert notice.startswith("ball seed 0: job ")
    assert notice.endswith("; 1 cells are trained again")
    assert told.cells == [("nerf", 0), ("qnerf", 0)], "each cell once"
    assert told.shares[0][-1] == 1.0
    assert (tmp_path / "jobs" / FOLDER).is_dir(), "the logs of a lost job stay"
    require_the_bits_of_workers(ball_folder, tmp_path / "jobs", tmp_path / "here", 1)


def _kill_job_in(folder: Path) -> None:
    """Kill the processes of the only job in the folder, the children of its controller."""
    (submitted,) = folder.glob("*_submitted.pkl")
    controller = submitted.name.partition("_")[0]
    children = Path(f"/proc/{controller}/task/{controller}/children").read_text(encoding="ascii").split()
    assert children
    for child in children:
        os.kill(int(child), signal.SIGKILL)


@pytest.mark.slow
def test_a_node_is_asked_before_a_run_and_leaves_nothing(no_slurm: None, tmp_path: Path) -> None:
    device, _, words = ask_node(tmp_path / "out", 1, "cpu", [])
    assert device == "cpu"
    assert words.startswith("submitit: no sbatch here: processes of this machine; a job trains on cpu (")
    assert not list((tmp_path / "out").iterdir())


@pytest.mark.slow
def test_a_run_that_is_stopped_cancels_its_jobs(no_slurm: None, ball_folder: Path, tmp_path: Path) -> None:
    going = run_by_submitit(tasks(ball_folder, tmp_path, 2, SLOW_SCORES), COMMIT, 1, [])
    for event in going:
        if event.cell is not None:
            break
    going.close()
    assert {cell.seed for cell in read_cells(tmp_path)} == {0}, "the second job never began"
    assert not list((tmp_path / FOLDER).glob(f"{submitit_executor.ALIVE}*"))
