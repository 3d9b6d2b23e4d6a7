"""A published run: its records with few pictures, small enough for a repository; its page is made from them again."""

import tempfile
import zipfile
from pathlib import Path

from msgspec.structs import replace

from harness.records.cells import digests_of, records_folder, write_cell, write_comparisons, write_run
from harness.records.pictures import Truth, cell_pictures, truth_pictures, write_renders, write_truth
from harness.records.targets import write_targets
from reports.data.load import Records
from reports.data.saved_pictures import kept
from reports.run.pictures import first_view, last_render, seed_shown
from scenes.files.atomic import write_atomically

UNDATED = (1980, 1, 1, 0, 0, 0)
"""The date of every file, so that equal records give equal bytes."""


def write_archive(records: Records, path: Path) -> None:
    """Write the records to a zip: of each scene one view in display colour, of each of its cells the last picture."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        _write_trimmed(records, out)
        files = sorted(file for file in out.rglob("*") if file.is_file())
        archive = out / "archive.zip"
        with zipfile.ZipFile(archive, "w") as packed:
            for file in files:
                entry = zipfile.ZipInfo(file.relative_to(out).as_posix(), UNDATED)
                packed.writestr(entry, file.read_bytes(), zipfile.ZIP_LZMA)
        write_atomically(path, archive.read_bytes())


def unpack(path: Path, out: Path) -> None:
    """Write the records of an archive to an output folder."""
    with zipfile.ZipFile(path) as packed:
        packed.extractall(out)


def _write_trimmed(records: Records, out: Path) -> None:
    cells = []
    for scene in records.scenes:
        seed = seed_shown(records, scene)
        saved = kept(records, scene, () if seed is None else (seed,))
        view = first_view(saved)
        if view is not None and (truth := saved.truth.get(view)) is not None:
            path = records_folder(out) / truth_pictures(scene)
            write_truth(path, [Truth(view, truth.display, truth.opacity)])
        for cell in (cell for cell in records.every_cell if cell.scene == scene):
            render = None if view is None or cell.seed != seed else last_render(saved, cell, view)
            pictures = None
            if render is not None:
                pictures = cell_pictures(cell.scene, cell.method, cell.seed)
                write_renders(records_folder(out) / pictures, [render])
            cells.append(replace(cell, pictures=pictures, files={}))
    for cell in cells:
        write_cell(out, cell)
    digests = digests_of(cells)
    write_run(out, records.run)
    write_comparisons(out, [*records.comparisons, *records.extra_comparisons], digests)
    if records.targets is not None:
        write_targets(out, replace(records.targets, digests=digests))
