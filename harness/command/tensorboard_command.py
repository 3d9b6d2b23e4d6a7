"""`run --tensorboard` and `python -m harness tensorboard OUT`: their options, and what they do."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from harness.execution.progress import Progress
    from harness.records.cells import CellRecord


def add_tensorboard_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("run", type=Path, metavar="OUT", help="output folder of a run, finished or not")


def run_tensorboard(options: argparse.Namespace, show: "Progress") -> int:
    """Write every cell that has a record; raises `InputError` if there is none, or no tensorboard."""
    from harness.records.cells import read_cells
    from harness.run_folder.board import require_tensorboard, write_board
    from scenes.files.errors import InputError

    require_tensorboard("tensorboard")
    count = 0
    for cell in read_cells(options.run):
        write_board(options.run, cell)
        count += 1
    if not count:
        raise InputError(
            f"{options.run}: holds no cell of a run; give the output folder of one, for instance out/latest"
        )
    show.line(f"{count} cells written; look at them with: tensorboard --logdir {options.run / 'tensorboard'}")
    return 0


def checked(options: argparse.Namespace) -> None:
    """Raise `InputError` if `--tensorboard` is given and cannot be done."""
    if options.tensorboard:
        from harness.run_folder.board import require_tensorboard

        require_tensorboard("--tensorboard")


def also_written(options: argparse.Namespace, out: Path, show: "Progress") -> "Progress":
    """Return `show`, which also writes each cell if `--tensorboard` is given; those from before a resume first."""
    if not options.tensorboard:
        return show
    from harness.records.cells import read_cells
    from harness.run_folder.board import board_folder, write_board

    for cell in read_cells(out):
        if not board_folder(out, cell).is_dir():
            write_board(out, cell)
    return _Written(out, show)


class _Written:
    """A progress that writes each cell and passes everything on to the one inside it."""

    def __init__(self, out: Path, show: "Progress") -> None:
        self._out, self._show = out, show

    def __getattr__(self, name: str) -> Any:
        return getattr(self._show, name)

    def cell(self, cell: "CellRecord") -> None:
        from harness.run_folder.board import write_board

        write_board(self._out, cell)
        self._show.cell(cell)
