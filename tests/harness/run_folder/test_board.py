"""TensorBoard reads back the numbers of the records."""

import argparse
from pathlib import Path
from typing import Any

import pytest

from harness.command.main import main
from harness.command.run_command import also_written
from harness.execution.progress import Progress
from harness.records.cells import CellRecord, write_cell
from harness.run_folder import board
from harness.run_folder.board import board_folder, require_tensorboard, write_board
from scenes.files.errors import InputError
from tests.harness import cells
from tests.harness.cells import checkpoint
from tests.harness.shell import refused

DENSITY = {"edges": [0.0, 0.25, 0.5, 1.0], "before": [0.5, 0.25, 0.25], "after": [0.0, 0.5, 0.5]}
CURVE = [
    checkpoint(20, 2.0, 20.5, density=DENSITY, rmse_linear=0.1),
    checkpoint(40, 4.5, 22.25, density=DENSITY, depth_rmse=0.4),
]
TRACE = {
    "step": [1.0, 20.0, 30.0], "loss": [0.5, 0.25, None], "gradient_norm": [2.0, 1.0, 0.5], "alpha": [0.61, 0.62, 0.63],
}  # fmt: skip


def cell(method: str = "qnerf") -> CellRecord:
    return cells.cell("ball", method, 0, CURVE, scores={"psnr": 22.25, "depth_rmse": None}, trace=TRACE)


@pytest.fixture(autouse=True)
def _tensorboard() -> None:
    pytest.importorskip("torch.utils.tensorboard")


def read_back(folder: Path) -> Any:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    everything = {"scalars": 0, "images": 0, "histograms": 0, "tensors": 0}
    events = EventAccumulator(str(folder), size_guidance=everything)
    events.Reload()
    return events


def test_scalars_are_those_of_the_record_on_the_cells_own_clock(tmp_path: Path) -> None:
    board = read_back(write_board(tmp_path, cell()))

    def series(tag: str) -> list[tuple[int, float, float]]:
        return [(event.step, event.wall_time, pytest.approx(event.value)) for event in board.Scalars(tag)]

    assert series("test/psnr") == [(20, 2.0, 20.5), (40, 4.5, 22.25)]
    assert series("test/rmse_linear") == [(20, 2.0, 0.1)], "what is None is left out"
    assert series("test/depth_rmse") == [(40, 4.5, 0.4)]
    assert series("train/loss") == [(1, pytest.approx(0.1), 0.5), (20, 2.0, 0.25)]
    assert series("train/gradient_norm")[2][:2] == (30, 3.25), "halfway between two checkpoints"
    assert [value for *_, value in series("train/alpha")] == [0.61, 0.62, 0.63]
    assert series("end/psnr") == [(40, 4.5, 22.25)]
    assert not {"train/beta", "end/depth_rmse"} & set(board.Tags()["scalars"])


def test_writing_again_replaces(tmp_path: Path) -> None:
    for _ in range(2):
        folder = write_board(tmp_path, cell())
    assert len(list(folder.iterdir())) == 1
    assert [entry.name for entry in folder.parent.iterdir()] == ["0"], "no incomplete folder is left"


def test_a_cell_that_diverged_before_its_first_checkpoint_has_a_reason(tmp_path: Path) -> None:
    board = read_back(write_board(tmp_path, cells.diverged("ball", "nerf", 0)))
    assert not [tag for tag in board.Tags()["scalars"] if not tag.startswith("train/")]
    (text,) = board.Tensors("cell/status/text_summary")[0].tensor_proto.string_val
    assert text == b"diverged: not finite at step 7: loss"


def test_the_command_writes_every_cell_of_a_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for method in ("nerf", "qnerf"):
        write_cell(tmp_path, cell(method))
    assert main(["tensorboard", str(tmp_path)]) == 0
    assert capsys.readouterr().out.startswith("2 cells written")
    assert len(read_back(board_folder(tmp_path, cell("nerf"))).Scalars("test/psnr")) == 2


def test_a_run_writes_each_cell_as_it_ends_and_those_from_before(tmp_path: Path) -> None:
    write_cell(tmp_path, cell("nerf"))
    shown: list[CellRecord] = []
    show = Progress()
    show.cell = shown.append  # type: ignore[method-assign]
    wrapped = also_written(argparse.Namespace(tensorboard=True), tmp_path, show)
    assert board_folder(tmp_path, cell("nerf")).is_dir()
    wrapped.cell(cell("qnerf"))
    wrapped.line("all else goes through")
    assert shown == [cell("qnerf")]
    assert board_folder(tmp_path, cell("qnerf")).is_dir()
    assert also_written(argparse.Namespace(tensorboard=False), tmp_path, show) is show


def test_a_missing_package_is_reported_before_anything_is_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(board.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match="not installed"):
        require_tensorboard("--tensorboard")
    out = tmp_path / "out"
    said = refused(capsys, "--profile", "smoke", "--tensorboard", "--out", out)
    assert said.startswith("error: --tensorboard: the package tensorboard is not installed")
    assert not out.exists()
