"""Files and folders of results in any form, read as rows."""

import codecs
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from harness.records.json_record import LARGEST_FILE
from harness.verdicts.tables.by_view import over_views
from harness.verdicts.tables.json_forms import HoldsNoRows, read_json_rows
from harness.verdicts.tables.layout import read_text, rows_of_columns
from harness.verdicts.tables.places import ResultPlace, places_below
from harness.verdicts.tables.rows import GIVEN, Rows, joined
from scenes.files.errors import InputError


def read_rows(paths: Sequence[Path], metric: str | None = None) -> Rows:
    """Read the rows of files, and of all JSON files below folders; `metric` names the numbers of a table that does not.
    Raises `InputError` for a file without a table, and for a folder without any.
    """
    parts: list[Rows] = []
    for path in paths:
        if not path.is_dir():
            parts.append(_read(_file(path), metric, ResultPlace()))
            continue
        read, refused = list[Rows](), list[InputError]()
        for file, place in places_below(path, len(paths) > 1).items():
            try:
                read.append(_read(file, metric, place))
            except HoldsNoRows as error:  # trainers keep other files next to their results
                refused.append(error)
        if not read:
            raise refused[0] if refused else InputError(f"{path}: holds no .json file; give a table or results")
        parts += read
    return over_views(joined(parts))


def rows_given(rows: Sequence[Mapping[str, object]]) -> Rows:
    """Return rows in memory, where None is a missing value, with the errors of `read_rows`."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    return over_views(joined([rows_of_columns(GIVEN, names, [[row.get(name) for row in rows] for name in names])]))


def _read(file: Path, metric: str | None, place: ResultPlace) -> Rows:
    if file.suffix.lower() == ".parquet":
        return _from_parquet(file, metric)
    text, notes = _text_of(file)
    # a pipe of the shell, `<(…)`, has no suffix
    if file.suffix.lower() in (".json", ".jsonl", ".ndjson") or (file.is_fifo() and text.lstrip()[:1] in ("{", "[")):
        rows = read_json_rows(file, text, place, metric)
    else:
        rows = read_text(file, text, metric)
    return replace(rows, notes=[*rows.notes, *notes])


def _text_of(file: Path) -> tuple[str, list[str]]:
    """Return a text in UTF-8, or in UTF-16 or Windows-1252 as spreadsheets write it, with a note on the latter."""
    content = file.read_bytes()
    is_wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    if b"\0" in content and not is_wide:
        raise InputError(f"{file}: is not text (it holds zero bytes); save the table as CSV in UTF-8")
    notes: list[str] = []
    try:
        text = content.decode("utf-16" if is_wide else "utf-8-sig")
    except UnicodeDecodeError:
        try:
            text, notes = content.decode("cp1252"), [f"{file.name} is not UTF-8: read as Windows-1252."]
        except UnicodeDecodeError as error:
            raise InputError(f"{file}: is not text in UTF-8 ({error}); save it in UTF-8") from error
    return text.replace("\r\n", "\n"), notes


def _file(path: Path) -> Path:
    if not (path.is_file() or path.is_fifo()):
        raise InputError(f"{path}: no such file; give a table as CSV, Markdown, LaTeX, Parquet or JSON")
    if (size := path.stat().st_size) > LARGEST_FILE:
        raise InputError(f"{path}: has {size} bytes, more than the {LARGEST_FILE} that are read; leave columns out")
    return path


def _from_parquet(path: Path, metric: str | None) -> Rows:
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
    return rows_of_columns(path, table.column_names, [list(values) for values in table.to_pydict().values()], metric)
