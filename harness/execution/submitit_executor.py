"""Executes groups of cells as Slurm jobs, by submitit, which write into the output folder that all nodes share.

A job reports its news in a journal, a file with one JSON value per line.
"""

import json
import platform
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from time import monotonic, sleep
from typing import Any
from uuid import uuid4

from harness.execution.group import missing_methods, run_group
from harness.execution.group_loop import Attempt, End, Event, News, run_at
from harness.machine.cores import own_cores
from harness.machine.device import available_cores, chosen_device, multiplies_bfloat16
from harness.machine.provenance import differences, processor, versions
from harness.plan.group_task import GroupTask
from harness.records.cells import cell_path, read_cell
from scenes.files.errors import InputError

HOW_TO_INSTALL = (
    "--executor submitit: submitit is not installed; `python -m pip install submitit==1.5.4` (or the extra `submitit` "
    "of pyproject.toml) puts it into this environment"
)
FOLDER = "jobs"
"""The folder of OUT with the scripts, logs and journals of jobs, which is removed if no job was lost."""
ALIVE = "alive"
"""The prefix of the name of a file in it that a driver touches, so that a job without a driver ends."""
MOST_ATTEMPTS = 3
"""The maximum number of jobs for a group; Slurm's requeues, after the time limit or for another job, do not count."""
POLL_SECONDS, TOLD_SECONDS, END_SECONDS, ORPHAN_SECONDS = 1.0, 5.0, 20.0, 600.0
LATE_SECONDS = 60.0
"""The time after which a file server shows what a node wrote."""
MOST_IDS = 500
"""The maximum number of jobs that one command cancels."""
USUAL = {"timeout_min": 240, "name": "radiance-verdict"}
"""The default parameters of submitit, which `--job` overrides."""


@dataclass(frozen=True)
class SlurmJob:
    """The picklable work of a job; submitit calls `checkpoint` before Slurm ends it."""

    task: GroupTask
    journal: Path
    alive: Path
    """The file that the driver touches."""
    versions: dict[str, str]
    """The driver's versions."""
    commit: str

    def __call__(self) -> str | None:
        """Train the group; return why the node refuses it, or None. Raises `OSError` if files cannot be written."""
        if wrong := _wrong_node(self.versions):
            return wrong
        last = 0.0

        def on_progress(share: float) -> None:
            nonlocal last
            if monotonic() - last >= TOLD_SECONDS:
                last = monotonic()
                self._tell(share)
                if self._is_orphan():
                    raise SystemExit(1)

        machine = available_cores()
        with own_cores(self.task.threads) as cores:
            placed = {"commit": self.commit, "node": platform.node(), "cores": machine, "own_cores": cores}
            run_group(
                replace(self.task, methods=missing_methods(self.task)),
                on_progress,
                lambda cell: self._tell([cell.scene, cell.method, cell.seed]),
                placed,
                self._tell,
            )
        return None

    def checkpoint(self) -> Any:
        """Return the job that Slurm queues again: it resumes from the snapshots in the output folder."""
        from submitit.core.utils import DelayedSubmission

        return DelayedSubmission(self)

    def _tell(self, news: float | str | list[object]) -> None:
        with self.journal.open("a", encoding="utf-8") as journal:
            journal.write(json.dumps(news) + "\n")

    def _is_orphan(self) -> bool:
        # both times come from the file server
        return not self.alive.exists() or self.journal.stat().st_mtime - self.alive.stat().st_mtime > ORPHAN_SECONDS


def job_parameters(given: list[str]) -> dict[str, object]:
    """Return the parameters of submitit from `NAME=VALUE`, where a value may be a number; raises `InputError`."""
    parameters: dict[str, object] = dict(USUAL)
    for text in given:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise InputError(f"--job {text}: must read NAME=VALUE, for example slurm_partition=gpu or timeout_min=600")
        try:
            parameters[name] = json.loads(value)
        except ValueError:
            parameters[name] = value
    return parameters


def executor(folder: Path, threads: int, device: str, given: list[str]) -> Any:
    """Return submitit's executor of Slurm, or without `sbatch` of processes; raises `InputError` without submitit and
    for an unknown parameter.
    """
    try:
        import submitit
    except ImportError as error:
        raise InputError(HOW_TO_INSTALL) from error
    jobs, parameters = submitit.AutoExecutor(folder), job_parameters(given)
    needs = {"nodes": 1, "tasks_per_node": 1, "cpus_per_task": threads, "gpus_per_node": int(device == "cuda")}
    for name in needs.keys() & parameters.keys():
        raise InputError(
            f"--job {name}={parameters[name]}: a job is one process; --threads and --device say what it has"
        )
    try:
        jobs.update_parameters(**parameters, **needs)
    except (NameError, AssertionError, TypeError, ValueError) as error:
        raise InputError(f"--job {' '.join(given)}: {' '.join(str(error).split())[:300]}") from error
    return jobs


def ask_node(parent: Path, threads: int, device: str, given: list[str]) -> tuple[str, bool, str]:
    """Ask a job for its device, whether that multiplies bfloat16, and a line on both; its files go to `parent` for the
    time. Raises `InputError` if the node has other packages, or if no job runs.
    """
    parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".jobs.", dir=parent, ignore_cleanup_errors=True) as folder:
        jobs = executor(Path(folder), threads, device, given)
        answer = _result(_submitted(jobs, _this_node, versions(), device), "no job runs")
    if isinstance(answer, str):
        raise InputError(f"--executor submitit: {answer}")
    chosen, bfloat16, processor = answer
    cluster = "Slurm" if jobs.cluster == "slurm" else "no sbatch here: processes of this machine"
    return chosen, bfloat16, f"submitit: {cluster}; a job trains on {chosen} ({processor})"


def _submitted(jobs: Any, *work: Any) -> Any:
    """Submit a call; raises `InputError` with the words of `sbatch` if that refuses it."""
    from submitit.core.utils import FailedJobError, FailedSubmissionError

    try:
        return jobs.submit(*work)
    except (FailedJobError, FailedSubmissionError, FileNotFoundError) as error:
        raise InputError(
            f"--executor submitit: no job can be submitted ({' '.join(str(error).split())[:300]}); give what your "
            "cluster asks for, such as --job slurm_partition=gpu or --job slurm_account=NAME; finished cells are kept"
        ) from error


def _this_node(driver: dict[str, str], device: str) -> tuple[str, bool, str] | str:
    if wrong := _wrong_node(driver):
        return wrong
    try:
        chosen = chosen_device(device)
    except InputError as error:
        return str(error)
    return chosen.type, multiplies_bfloat16(chosen), processor()


def _wrong_node(driver: dict[str, str]) -> str | None:
    wrong = differences(driver, versions())
    node = platform.node()
    return f"node {node} has {wrong}; every node needs the driver's environment" if wrong else None


def run_by_submitit(tasks: list[GroupTask], commit: str, at_once: int, given: list[str]) -> Iterator[Event]:
    """Run all tasks as jobs, at most `at_once` of them in the queue. A job that reaches its time limit is queued again
    and resumes; one that dies is retried, with bit-identical results. Raises `InputError` if a node has other packages
    or a disk that cannot be written.
    """
    return run_at(_Queue(tasks[0], commit, at_once, given), tasks) if tasks else iter(())


class _Queue:
    """The queued and running jobs; each has a journal in the folder of jobs."""

    def __init__(self, first: GroupTask, commit: str, at_once: int, given: list[str]) -> None:
        self.expecting = False
        self.room, self.refusal = at_once, ""
        self._commit, self._lost_any = commit, False
        self._folder = first.out / FOLDER
        self._folder.mkdir(parents=True, exist_ok=True)
        self._alive = self._folder / f"{ALIVE}.{uuid4().hex[:12]}"
        self._alive.touch()
        self._jobs = executor(self._folder, first.threads, first.device, given)
        self._read: dict[Attempt, int] = {}
        """The number of bytes read of an attempt's journal."""
        self._ended: dict[Attempt, float] = {}
        """When an attempt's job was first seen to have ended."""

    def _journal(self, attempt: Attempt) -> Path:
        return self._folder / f"{attempt.task.scene}.{attempt.task.seed}.{attempt.number}.jsonl"

    def submit(self, attempt: Attempt, task: GroupTask) -> None:
        journal = self._journal(attempt)
        journal.write_text("", encoding="utf-8")
        work = SlurmJob(attempt.task, journal, self._alive, versions(), self._commit)
        attempt.handle = _submitted(self._jobs, work)

    def poll(self, running: list[Attempt]) -> Iterator[tuple[Attempt, News]]:
        sleep(POLL_SECONDS)
        self._alive.touch()
        for attempt in list(running):
            ended = attempt.handle.done()
            yield from self._news(attempt)
            if ended and self._has_arrived(attempt):
                lost = _lost(attempt)
                yield from self._news(attempt)
                yield attempt, End(lost)

    def _has_arrived(self, attempt: Attempt) -> bool:
        """Return whether the result and all news of an ended job are here, or no longer waited for."""
        whole = self._journal(attempt).stat().st_size == self._read.get(attempt, 0)
        late = monotonic() - self._ended.setdefault(attempt, monotonic()) >= LATE_SECONDS
        return late or (whole and attempt.handle.paths.result_pickle.exists())

    def _news(self, attempt: Attempt) -> Iterator[tuple[Attempt, News]]:
        """Yield the news of the journal since the last call; an incomplete line waits, as does a missing cell."""
        with self._journal(attempt).open("rb") as journal:
            journal.seek(self._read.get(attempt, 0))
            lines = journal.read().splitlines(keepends=True)
        for line in lines:
            if not line.endswith(b"\n"):
                break
            news = json.loads(line)
            cell = cell_path(attempt.task.out, *news) if isinstance(news, list) else None
            if cell is not None and not cell.exists():
                break
            self._read[attempt] = self._read.get(attempt, 0) + len(line)
            yield attempt, news if cell is None else read_cell(cell)

    def again(self, attempt: Attempt, lost: str, missing: tuple[str, ...]) -> tuple[list[Attempt], str]:
        self._lost_any = True
        if attempt.number == MOST_ATTEMPTS:
            return [], f"{lost}, {attempt.number} times in a row; its logs are in {self._folder}"
        group = f"{attempt.task.scene} seed {attempt.task.seed}"
        notice = f"{group}: {lost}; {len(missing)} cells are trained again"
        return [Attempt(attempt.task, attempt.number + 1)], notice

    def cancel(self, running: list[Attempt]) -> None:
        self._alive.unlink(missing_ok=True)  # a job that cannot be cancelled ends by itself
        ids = [attempt.handle.job_id for attempt in running] if self._jobs.cluster == "slurm" else []
        for first in range(0, len(ids), MOST_IDS):
            with suppress(OSError):
                subprocess.run(["scancel", *ids[first : first + MOST_IDS]], check=False)
        for attempt in running if not ids else ():
            with suppress(Exception):
                attempt.handle.cancel()
        # another command may then own the folder into which local processes still write
        until = monotonic() + END_SECONDS
        while self._jobs.cluster == "local" and monotonic() < until and not all(job.handle.done() for job in running):
            sleep(POLL_SECONDS)
        if not running and not self._lost_any:
            shutil.rmtree(self._folder, ignore_errors=True)


def _lost(job: Attempt) -> str | None:
    """Return why a job was lost; None if it ended regularly. Raises `InputError` if no other job can run either."""
    from submitit.core.utils import UncompletedJobError

    try:
        refusal = _result(job.handle, f"a job of {job.task.scene}, seed {job.task.seed}, failed")
    except UncompletedJobError as error:
        return f"job {job.handle.job_id} died ({_last_line(error)})"
    if refusal is not None:
        raise InputError(f"--executor submitit: {refusal}; finished cells are kept: resume with --resume")
    return None


def _result(handle: Any, otherwise: str) -> Any:
    """Wait for a job's result; return its error as text, like a refusal. Raises `UncompletedJobError` if it died."""
    from submitit.core.utils import FailedJobError

    try:
        return handle.result()
    except FailedJobError as error:
        return f"{otherwise} ({_last_line(error)})"


def _last_line(error: Exception) -> str:
    """Return the line of a job's trace that names the error, which other text of submitit follows."""
    lines = [line.strip() for line in str(error).splitlines()]
    trace = [line for line in lines if re.match(r"[\w.]+(Error|Exception|Interrupt): ", line)]
    return (trace or lines)[-1][:300]
