"""The pictures that a run saved, as a report reads them: a missing or damaged file is a reason, never an error."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from harness.records.cells import CellRecord
from harness.records.pictures import Render, Truth, read_renders, read_truth, truth_pictures
from reports.data.load import Records, if_valid
from scenes.files.errors import DamagedRecord

NOT_KEPT = "no picture was kept"


@dataclass(frozen=True)
class Kept:
    truth: dict[str, Truth]
    renders: dict[tuple[str, int], list[Render]] = field(default_factory=dict)
    missing: dict[tuple[str, int], str] = field(default_factory=dict)


def kept(records: Records, scene: str, seeds: tuple[int, ...] | None = None) -> Kept:
    """Read the files of the scene's cells, of the named seeds or of all."""
    cells = [cell for cell in records.pictured_cells if cell.scene == scene and (seeds is None or cell.seed in seeds)]
    pictures = Kept({})
    path = inside(records.folder, truth_pictures(scene))
    if path is not None and any(cell.pictures for cell in cells):
        with suppress(DamagedRecord):
            pictures.truth.update({truth.view: truth for truth in read_truth(path)})
    for cell in cells:
        renders = _renders(records.folder, cell)
        if isinstance(renders, str):
            pictures.missing[cell.method, cell.seed] = renders
        else:
            pictures.renders[cell.method, cell.seed] = renders
    return pictures


def damaged(records: Records) -> list[str]:
    """Return a line for every file of pictures that cannot be shown, with the reason."""
    lines: list[str] = []
    for scene in records.scenes:
        paths = [cell.pictures for cell in records.pictured_cells if cell.scene == scene and cell.pictures]
        files: list[tuple[str, Callable[[Path], object]]] = [(truth_pictures(scene), read_truth)] if paths else []
        for relative, read in [*files, *((path, read_renders) for path in paths)]:
            path = inside(records.folder, relative)
            if path is None:
                lines.append(f"{relative}: leads out of the records")
            else:
                if_valid(partial(read, path), None, lines)
    return lines


def inside(folder: Path, relative: str) -> Path | None:
    """Return the file, or None if its path leads out of the folder."""
    path = (folder / relative).resolve()
    return path if path.is_relative_to(folder.resolve()) else None


def _renders(folder: Path, cell: CellRecord) -> list[Render] | str:
    if cell.status == "not_available":
        return f"not available: {cell.reason or 'no reason recorded'}"
    if cell.pictures is None:
        return cell.reason or cell.status if cell.status != "done" else NOT_KEPT
    path = inside(folder, cell.pictures)
    if path is None:
        return f"{cell.pictures}: leads out of the records"
    if not path.is_file():
        return f"{path}: missing"
    try:
        return read_renders(path) or NOT_KEPT
    except DamagedRecord as error:
        return str(error)
