"""Files and folders of results in any form, read as rows."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from harness.records.json_record import LARGEST_FILE
from harness.verdicts.tables.by_view import over_views
from harness.verdicts.tables.grids import read_text
from harness.verdicts.tables.json_forms import STATISTICS, read_json_rows
from harness.verdicts.tables.rows import GIVEN, Rows, joined, rows_of
from scenes.files.errors import InputError

PER_VIEW, RESULTS = "per_view.json", "results.json"


def read_rows(paths: Sequence[Path], metric: str | None = None) -> Rows:
    """Read the rows of files, and of all JSON files below folders; `metric` names the numbers of a table that does not.
    Raises `InputError` for a file without a table.
    """
    parts = []
    for path in paths:
        for file in _files(path):
            parts.append(_read(file, metric, _label(path, file, len(paths) > 1)))
    return over_views(joined(parts))


def rows_given(rows: Sequence[Mapping[str, object]]) -> Rows:
    """Return rows in memory, where None is a missing value, with the errors of `read_rows`."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    return over_views(joined([rows_of(GIVEN, names, [[row.get(name) for row in rows] for name in names])]))


def _read(file: Path, metric: str | None, label: str) -> Rows:
    if file.suffix.lower() == ".parquet":
        return _from_parquet(file)
    try:
        text = file.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{file}: is not text in UTF-8 ({error})") from error
    # a pipe of the shell, `<(…)`, has no suffix
    if file.suffix.lower() == ".json" or (file.is_fifo() and text.lstrip()[:1] in ("{", "[")):
        return read_json_rows(file, text, label)
    return read_text(file, text, metric)


def _label(path: Path, file: Path, is_one_of_several: bool) -> str:
    """Return the folders that name the method of a file of one scene: those above the folder of the scene."""
    if not path.is_dir():
        return ""
    folders = [name for name in file.relative_to(path).parts[:-1] if name not in STATISTICS]
    return "/".join([*([path.resolve().name] if is_one_of_several and folders else []), *folders[:-1]])


def _files(path: Path) -> list[Path]:
    if path.is_dir():
        if not (files := sorted(_results_below(path))):
            raise InputError(f"{path}: holds no .json file; give a table, or a folder of files of results")
        return files
    if not (path.is_file() or path.is_fifo()):
        raise InputError(f"{path}: no such file; give a table as CSV, Markdown, LaTeX, Parquet or JSON")
    if (size := path.stat().st_size) > LARGEST_FILE:
        raise InputError(f"{path}: has {size} bytes, more than the {LARGEST_FILE} that are read; leave columns out")
    return [path]


def _results_below(folder: Path) -> list[Path]:
    """Return the JSON files below a folder; of a scene's results those of all views, not also those by view."""
    every = [
        file
        for file in folder.rglob("*.json")
        if not any(part.startswith(".") for part in file.relative_to(folder).parts)
    ]
    # 3D Gaussian Splatting keeps cameras.json and per_view.json next to it
    of_scenes = [file for file in every if file.name == RESULTS]
    return of_scenes or [file for file in every if file.name != PER_VIEW] or every


def _from_parquet(path: Path) -> Rows:
    try:
        from pyarrow import ArrowException, parquet
    except ImportError as error:
        raise InputError(
            f"{path}: the package pyarrow is not installed; install the extra parquet of pyproject.toml, or save the "
            "table as CSV"
        ) from error
    try:
        table = parquet.read_table(path)
    except (ArrowException, OSError) as error:
        raise InputError(f"{path}: is not a Parquet file ({str(error).splitlines()[0]})") from error
    return rows_of(path, table.column_names, [list(values) for values in table.to_pydict().values()])
