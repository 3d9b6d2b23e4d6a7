"""A run leaves whole records; a resumed one keeps the facts of its earlier part, and trains only what is missing."""

import json
import os
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from harness.command.main import main
from harness.command.plan_options import planned
from harness.execution.group_loop import Event
from harness.execution.progress import Progress
from harness.execution.run import _Run
from harness.plan.group_task import GroupTask
from harness.plan.run_plan import Machine
from harness.records.cells import (
    CellRecord,
    LeftOut,
    cell_path,
    read_cell,
    read_cells,
    read_comparisons,
    read_run,
    write_cell,
    write_run,
)
from harness.records.json_record import load_record, write_record
from harness.run_folder.earlier_run import with_measured
from harness.run_folder.phases import Phases
from scenes.files.errors import DamagedRecord
from tests.harness.trained_runs import in_this_process
from tests.replacing import replace

TYPED = "run --profile smoke --resolution 8 --methods nerf qnerf --seeds 1 --budget-steps 2 --workers 1"
Locally = Callable[[list[GroupTask], int], Iterator[Event]]


def run_command(out: Path, ball_folder: Path, *more: str, locally: Locally = in_this_process) -> int:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("harness.execution.run.run_locally", locally)
        patch.setattr("harness.machine.device.available_cores", lambda: 1)
        return main([*TYPED.split(), "--view-set", str(ball_folder), "--out", str(out), *more])


@pytest.fixture(scope="module")
def finished(ball_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Not to be changed."""
    out = tmp_path_factory.mktemp("finished") / "run"
    assert run_command(out, ball_folder) == 0
    return out


@pytest.fixture
def out(finished: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    return Path(shutil.copytree(finished, tmp_path / "run"))


def cell(out: Path, method: str) -> CellRecord:
    return read_cell(cell_path(out, "ball", method, 0))


def files(out: Path, folder: str = ".") -> dict[Path, bytes]:
    return {file.relative_to(out): file.read_bytes() for file in (out / folder).rglob("*") if file.is_file()}


def test_a_run_leaves_whole_records(finished: Path) -> None:
    record = read_run(finished)
    assert record.finished
    assert (list(record.methods), record.seeds) == (["nerf", "qnerf"], [0])
    assert [(scene.name, scene.width, scene.psnr_ceiling) for scene in record.scenes] == [("ball", 8, None)]
    assert set(record.phases) == {"render", "train", "total"}
    assert [(one.method, one.seed) for one in read_cells(finished)] == [("nerf", 0), ("qnerf", 0)]
    assert {row.scene for row in read_comparisons(finished)} == {"ball", "all"}
    assert not list(finished.rglob("*.part"))
    text = json.dumps(record.provenance)
    assert not re.search(rf"\b{re.escape(os.uname().nodename)}\b", text)
    assert str(Path.home()) not in text


def test_a_full_disk_is_said_and_nothing_is_lost(
    ball_folder: Path, out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device", str(out))

    before = files(out, "records/cells")
    monkeypatch.setattr("harness.execution.run.write_run", full)
    assert run_command(out, ball_folder, "--quiet", "--resume") == 2
    said = capsys.readouterr().err
    assert (said.startswith("error: "), "No space left" in said, said.count("\n")) == (True, True, 1)
    assert files(out, "records/cells") == before


def test_a_run_is_gone_on_with_by_the_views_alone_that_it_was_trained_on(
    ball_folder: Path, out: Path, finished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = Path(shutil.copytree(ball_folder, tmp_path / "own" / "ball"))
    write_record(out / "records/plan.json", {**load_record(out / "records/plan.json"), "view_set": str(own)})
    cell_path(out, "ball", "nerf", 0).unlink()
    shutil.copy(own / "train/r_1.png", own / "train/r_0.png")
    before = files(out)
    assert run_command(out, own, "--quiet", "--resume") == 2
    said = capsys.readouterr().err
    assert f"{own}: not the view set that ball.qnerf.0 was trained on (content was" in said
    assert files(out) == before
    shutil.copy(ball_folder / "train/r_0.png", own / "train/r_0.png")
    assert run_command(out, own, "--quiet", "--resume") == 0
    assert files(out, "checkpoints") == files(finished, "checkpoints")
    assert cell(out, "nerf").scores == cell(finished, "nerf").scores


def test_cells_of_other_code_are_recorded(ball_folder: Path, out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    new = cell(out, "nerf").provenance["sources"]
    assert new == read_run(out).provenance["sources"]
    old = cell(out, "qnerf")
    write_cell(out, replace(old, provenance={**old.provenance, "sources": "0123456789abcdef", "commit": "0ld"}))
    cell_path(out, "ball", "nerf", 0).unlink()
    assert run_command(out, ball_folder, "--resume") == 0
    printed = capsys.readouterr().out
    assert "training 1 cells, 1 kept from before" in printed
    assert (
        "1 of 1 finished cells were made by other code or packages (ball.qnerf.0: sources 0123456789abcdef" in printed
    )
    (sentence,) = [line for line in read_run(out).not_tested if line.startswith("One code")]
    assert f"sources {new} (1 cells), 0123456789abcdef (1 cells)" in sentence
    assert cell(out, "qnerf").provenance["commit"] == "0ld", "not trained again"
    cell_path(out, "ball", "qnerf", 0).unlink()  # the remedy of the printed line
    assert run_command(out, ball_folder, "--resume") == 0
    assert "other code" not in capsys.readouterr().out
    assert not any(line.startswith("One code") for line in read_run(out).not_tested)


def test_resuming_a_finished_run_trains_and_warns_of_nothing_and_sums_the_clocks_of_all_parts(
    ball_folder: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for old in (cell(out, "nerf"), cell(out, "qnerf")):
        write_cell(out, replace(old, provenance={**old.provenance, "sources": "0123456789abcdef"}))
    first, folders = read_run(out), ("records/cells", "checkpoints", "records/pictures")
    before = [files(out, folder) for folder in folders]
    write_run(out, replace(first, phases={"render": 10.0, "train": 1000.0, "verify": 5.0, "total": 1020.0}))
    assert run_command(out, ball_folder, "--resume") == 0
    assert "other code" not in capsys.readouterr().out
    assert [files(out, folder) for folder in folders] == before
    phases = read_run(out).phases
    assert phases["verify"] == 5.0
    for name, before in (("render", 10.0), ("train", 1000.0), ("total", 1020.0)):
        assert before < phases[name] < before + 100.0


def test_a_phase_that_is_interrupted_is_counted() -> None:
    now = [0.0]
    phases = Phases({"render": 1.0, "total": 7.0}, lambda: now[0])

    def stopped_after(seconds: float) -> None:
        with phases.timed("train"):
            now[0] += seconds
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped_after(3.0)
    assert phases.seconds() == {"render": 1.0, "train": 3.0, "total": 10.0}


def test_notices_of_all_parts_are_kept_once(ball_folder: Path, out: Path) -> None:
    def tells(tasks: list[GroupTask], workers: int) -> Iterator[Event]:
        for text in ("a node died", "another"):
            yield Event(tasks[0], notice=text)
            assert text in read_run(out).provenance["notices"], "a killed run would lose it"
        yield from in_this_process(tasks, workers)

    assert "notices" not in read_run(out).provenance
    for _ in range(2):
        cell_path(out, "ball", "nerf", 0).unlink()
        assert run_command(out, ball_folder, "--resume", locally=tells) == 0
    assert read_run(out).provenance["notices"] == ["a node died", "another"]
    assert run_command(out, ball_folder, "--resume") == 0
    assert read_run(out).provenance["notices"] == ["a node died", "another"]


def test_before_its_scenes_are_read_again_a_resumed_run_has_those_that_were_recorded(
    finished: Path, out: Path, ball_folder: Path
) -> None:
    plan = planned("smoke", view_set=[ball_folder], methods=["nerf", "qnerf"], seeds=1)
    fresh = _Run(plan, out / "new", Machine("cpu", 1, 1), "run", None, Progress(), lambda: None)
    assert fresh.record.scenes == []
    resumed = _Run(plan, out, Machine("cpu", 1, 1), "run", None, Progress(), lambda: None)
    assert resumed.record.scenes == read_run(finished).scenes


MEASURED = LeftOut(
    "view-direction branch", "the same from all sides", 1.5, -1.0, (-1.2, -0.8), "view_direction", "model", 0.2, "dB",
    "training", "costs more",
)  # fmt: skip
PLAIN = replace(MEASURED, seconds_saved=None, difference=None, interval=None, clock="", verdict="")


def test_measured_costs_of_omissions_are_kept_for_the_same_view_set(finished: Path) -> None:
    run = read_run(finished)
    (scene,) = run.scenes
    before = replace(run, scenes=[replace(scene, left_out=[MEASURED])])
    assert with_measured([replace(scene, left_out=[PLAIN])], before) == before.scenes
    for other in (
        replace(scene, left_out=[PLAIN], rendered={"digest": "another"}),
        replace(scene, left_out=[PLAIN], near=0.5),
        replace(scene, left_out=[replace(PLAIN, bound=0.1)]),
        replace(scene, left_out=[replace(PLAIN, name="outside_box")]),
    ):
        assert with_measured([other], before) == [other]
    assert with_measured([scene], None) == [scene]


def test_an_omission_that_costs_more_is_exit_code_3_after_resuming_too(ball_folder: Path, tmp_path: Path) -> None:
    out, forced = tmp_path / "run", ("--no-need", "view_direction")
    assert run_command(out, ball_folder, *forced) == 0
    run = read_run(out)
    (scene,) = run.scenes
    measured = [replace(row, verdict="costs more", difference=-1.0, interval=(-1.2, -0.8)) for row in scene.left_out]
    assert "view_direction" in {row.name for row in measured}
    write_run(out, replace(run, scenes=[replace(scene, left_out=measured)]))
    for _ in range(2):
        assert run_command(out, ball_folder, *forced, "--resume") == 3
        assert read_run(out).scenes[0].left_out == measured


def test_a_damaged_record_is_written_again(ball_folder: Path, out: Path) -> None:
    (out / "records/run.json").write_text("{")
    with pytest.raises(DamagedRecord):
        read_run(out)
    assert run_command(out, ball_folder, "--resume") == 0
    assert read_run(out).finished
