"""Worker processes: results do not depend on their number, and a dead worker costs no finished cell."""

import multiprocessing
import os
import signal
from pathlib import Path
from typing import Any

import pytest

from harness.execution import local_executor
from harness.execution.group import run_group
from harness.execution.local_executor import run_locally
from harness.machine.provenance import versions
from harness.plan.group_task import GroupTask
from harness.plan.schedule import Budget
from harness.records.cells import CellRecord, cell_path, read_cell, read_cells
from harness.training.trainer import Trainer
from tests.harness import dying_workers
from tests.harness.cells import without_time
from tests.harness.execution.on_two_executors import Told
from tests.harness.execution.on_two_executors import tasks as of_seeds
from tests.harness.patching import preceded
from tests.harness.shell import CELLS
from tests.harness.tiny import BUDGET, SCORE
from tests.replacing import replace


def tasks(ball_folder: Path, out: Path, budget: Budget = BUDGET) -> list[GroupTask]:
    return of_seeds(ball_folder, out, 2, SCORE, budget=budget)


@pytest.mark.thorough
@pytest.mark.slow
def test_one_worker_and_two_workers_leave_the_same_records(ball_folder: Path, tmp_path: Path) -> None:
    left = []
    for workers in (1, 2):
        out = tmp_path / str(workers)
        events = list(run_locally(tasks(ball_folder, out), workers))
        reported = [event.cell for event in events if event.cell is not None]
        stored = list(read_cells(out))
        by_name = sorted(reported, key=lambda cell: (cell.method, cell.seed))
        assert [replace(cell, settings={}) for cell in by_name] == [replace(cell, settings={}) for cell in stored]
        assert [(cell.method, cell.seed) for cell in stored if cell.status == "done"] == CELLS
        for shares in Told(events).shares.values():
            assert shares == sorted(shares)
            assert shares[-1] == 1.0
        left.append([without_time(cell) for cell in stored])
    assert left[0] == left[1]
    assert multiprocessing.active_children() == []


@pytest.mark.slow
def test_what_a_killed_worker_was_at_is_trained_again_one_method_at_a_time(ball_folder: Path, tmp_path: Path) -> None:
    events = run_locally(tasks(ball_folder, tmp_path, Budget(60, None)), 1)
    seen = [next(events)]
    assert seen[0].share < 0.5
    victims = multiprocessing.active_children()
    assert len(victims) == 1
    os.kill(victims[0].pid, signal.SIGKILL)
    seen += list(events)
    cells = {(cell.method, cell.seed): cell for cell in read_cells(tmp_path)}
    assert {key: cell.status for key, cell in cells.items()} == dict.fromkeys(CELLS, "done")
    assert [cells["nerf", seed].provenance["in_lockstep"] for seed in range(2)] == [["nerf"], ["nerf", "qnerf"]]
    (notice,) = Told(seen).notices
    assert "ball, seed 0" in notice
    assert "SIGKILL" in notice
    assert Told(seen).cells == CELLS
    assert {event.task.seed for event in seen if event.share == 1.0} == {0, 1}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"view_set": Path("/nowhere")}, "/nowhere: no such folder"),
        ({"content": "0" * 64}, "/ball: changed since the run began; put it back as it was"),
    ],
)
def test_a_group_that_cannot_be_trained_ends_in_error_records(
    ball_folder: Path, tmp_path: Path, changes: dict[str, Any], said: str
) -> None:
    told: list[CellRecord] = []
    run_group(replace(tasks(ball_folder, tmp_path)[0], **changes), lambda share: None, told.append)
    assert [(cell.method, cell.status) for cell in told] == [("nerf", "error"), ("qnerf", "error")]
    assert said in (told[0].reason or "")
    assert list(read_cells(tmp_path)) == told


@pytest.mark.slow
def test_an_error_of_ours_is_named_and_leaves_finished_cells_alone(
    ball_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(trainer: Trainer, *_: Any) -> None:
        if trainer.method == "qnerf" and trainer.step == 2:
            raise RuntimeError("a bug")

    preceded(monkeypatch, Trainer, "train_on", broken)
    run_group(tasks(ball_folder, tmp_path, Budget(2, None))[0], lambda share: None, lambda cell: None)
    run_group(tasks(ball_folder, tmp_path, Budget(4, None))[1], lambda share: None, lambda cell: None)
    lost = [(cell.method, cell.seed, cell.status) for cell in read_cells(tmp_path) if cell.status != "done"]
    assert (len(list(read_cells(tmp_path))), lost) == (4, [("qnerf", 1, "error")])
    assert read_cell(cell_path(tmp_path, "ball", "qnerf", 1)).reason == "RuntimeError at step 2: a bug"


def test_a_disk_that_takes_nothing_ends_the_run(ball_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(FileExistsError):
        list(run_locally(tasks(ball_folder, tmp_path / "file", Budget(2, None))[:1], 1))
    assert multiprocessing.active_children() == []


def test_closing_ends_the_workers(ball_folder: Path, tmp_path: Path) -> None:
    events = run_locally(tasks(ball_folder, tmp_path, Budget(1000, None)), 1)
    next(events)
    events.close()  # type: ignore[attr-defined]
    assert multiprocessing.active_children() == []
    assert list(read_cells(tmp_path)) == []


def test_a_worker_that_dies_after_its_last_word_costs_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(local_executor, "_work", dying_workers.after_its_last_word)
    ended = []
    for event in run_locally(tasks(tmp_path, tmp_path), 1):
        if event.task.seed == 0 and event.share == 0.5:
            multiprocessing.active_children()[0].join()
        assert event.cell is None
        ended += [event.task.seed] if event.share == 1.0 else []
    assert ended == [0, 1]


def test_a_method_that_ends_its_worker_again_is_an_error_and_costs_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(local_executor, "_work", dying_workers.at_qnerf_in_the_middle_of_a_message)
    events = list(run_locally(tasks(tmp_path, tmp_path)[:1], 1))
    ended = [event.task.methods for event in events if event.share == 1.0]
    assert ended == [("nerf",), ("qnerf",)]
    (notice,) = Told(events).notices
    died = "the worker process ended with signal 9 (SIGKILL); out of memory, perhaps"
    assert notice == f"ball, seed 0: {died}; its methods are trained one at a time"
    assert [(event.cell.method, event.cell.reason) for event in events if event.cell is not None] == [("qnerf", died)]


def test_a_worker_of_other_code_is_refused(ball_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(local_executor, "versions", lambda: {**versions(), "this program": "before"})
    events = list(run_locally(tasks(ball_folder, tmp_path), 2))
    assert Told(events).cells == CELLS
    changed = f"the sources changed during the run (this program {versions()['this program']} instead of before)"
    assert {(event.cell.status, event.cell.reason) for event in events if event.cell is not None} == {
        ("error", f"{changed}; start it again with --resume")
    }
    assert multiprocessing.active_children() == []


def test_cells_are_labelled_with_the_code_that_the_run_was_started_with(
    ball_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("harness.machine.provenance.commit", lambda: "of the start")
    list(run_locally(tasks(ball_folder, tmp_path, Budget(2, None))[:1], 1))
    assert {cell.provenance["commit"] for cell in read_cells(tmp_path)} == {"of the start"}
    assert {cell.provenance["sources"] for cell in read_cells(tmp_path)} == {versions()["this program"]}


def test_sources_that_change_while_they_are_imported_are_other_sources(monkeypatch: pytest.MonkeyPatch) -> None:
    found = ["", "this program"]
    monkeypatch.setattr(local_executor, "changed_since", lambda versions: found.pop(0))
    assert local_executor._other_code({}) == "this program"
