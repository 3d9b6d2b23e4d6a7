"""A file of results → columns: CSV, Parquet, JSON, and nerfbaselines' result files as they are.

nerfbaselines writes one JSON file per method and scene (`metrics`, with both names in `nb_info`, `info` or
`render_dataset_metadata`), and one for a whole data set (`methods`, each with its `scenes`). A `summary.json` of ours
has `cells`.
"""

import csv
import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from harness.json_record import LARGEST_FILE, load_json
from scenes.errors import InputError

SYNONYMS = {"train_seconds": "seconds", "total_train_time": "seconds"}
"""What nerfbaselines and our own summary call the column `seconds`."""
FORMS = (
    "JSON must be a list of rows {scene, method, psnr, …}, {cells: such rows}, {method, scenes: {scene: {metric: "
    "value}}} or a result file of nerfbaselines"
)


@dataclass(frozen=True)
class Rows:
    """One file's results, a list of equal length for each column."""

    source: Path
    columns: dict[str, list[Any]]
    first: int = 1
    """What the first row is called: line 2 of a file with a head."""
    lower: frozenset[str] = field(default_factory=frozenset)
    """Metrics that the file itself declares to be better when lower."""

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), []))

    def where(self, row: int) -> str:
        return f"{self.source}, {'line' if self.first > 1 else 'row'} {row + self.first}"


def read_rows(path: Path) -> list[Rows]:
    """The rows of a file, or of all JSON files below a folder; raises `InputError` for what is no table."""
    if path.is_dir():
        files = sorted(path.rglob("*.json"))
        if not files:
            raise InputError(f"{path}: holds no .json file; give a table, or a folder of nerfbaselines' result files")
        return [_from_json(file) for file in files]
    if not path.is_file():
        raise InputError(f"{path}: no such file; give a table as CSV, Parquet or JSON")
    if (size := path.stat().st_size) > LARGEST_FILE:
        raise InputError(f"{path}: has {size} bytes, more than the {LARGEST_FILE} that are read; leave columns out")
    readers: dict[str, Callable[[Path], Rows]] = {".json": _from_json, ".parquet": _from_parquet}
    return [readers.get(path.suffix.lower(), _from_csv)(path)]


def _from_csv(path: Path) -> Rows:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            head = file.readline()
            mark = max(",;\t", key=head.count)
            lines = list(csv.reader([head], delimiter=mark)) + list(csv.reader(file, delimiter=mark))
    except (csv.Error, UnicodeDecodeError) as error:
        raise InputError(f"{path}: is no CSV file in UTF-8 ({error})") from error
    names, *rows = lines or [[]]
    for place, row in enumerate(rows):
        if row and len(row) != len(names):
            raise InputError(f"{path}, line {place + 2}: has {len(row)} fields, the head has {len(names)}")
    while rows and not rows[-1]:
        rows.pop()
    if not all(rows):
        raise InputError(f"{path}, line {rows.index([]) + 2}: is empty; delete it")
    named = _named(path, names)
    columns = [list(values) for values in zip(*rows, strict=True)] or [[] for _ in named]
    return Rows(path, dict(zip(named, columns, strict=True)), 2)


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
        raise InputError(f"{path}: is no Parquet file ({str(error).splitlines()[0]})") from error
    return Rows(path, dict(zip(_named(path, table.column_names), map(list, table.to_pydict().values()), strict=True)))


def _named(path: Path, names: Iterable[Any]) -> list[str]:
    """Names of columns in lower case, by one name each; raises `InputError` where two are the same."""
    known = [str(name).strip().lower() for name in names]
    known = [SYNONYMS.get(name, name) if SYNONYMS.get(name) not in known else name for name in known]
    twice = next((name for name in known if known.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"{path}: two columns are called {twice!r}; rename one")
    return known


def _from_json(path: Path) -> Rows:
    try:
        data = load_json(path)
    except (OSError, ValueError) as error:
        why = f"is no JSON ({error})" if isinstance(error, json.JSONDecodeError) else str(error)
        raise InputError(f"{path}: {why}; where there is no result, write null") from error
    lower: frozenset[str] = frozenset()
    if isinstance(data, dict) and "metrics" in data and isinstance(data["metrics"], list):
        lower = frozenset(
            str(one.get("id")) for one in data["metrics"] if isinstance(one, dict) and one.get("ascending") is False
        )
    rows = _json_rows(data, path)
    if not rows or not all(isinstance(row, dict) for row in rows):
        raise InputError(f"{path}: holds no rows; {FORMS}")
    names = list(dict.fromkeys(name for row in rows for name, value in row.items() if _is_plain(value)))
    columns = [[row.get(name) if _is_plain(row.get(name)) else None for row in rows] for name in names]
    return Rows(path, dict(zip(_named(path, names), columns, strict=True)), lower=lower)


def _is_plain(value: Any) -> bool:
    return value is None or isinstance(value, str | int | float)


def _json_rows(data: Any, path: Path) -> list[Any]:
    """The rows of each form that is known; none of any other."""
    if isinstance(data, list):
        nested = data and all(isinstance(one, dict) and isinstance(one.get("scenes"), dict) for one in data)
        return [row for one in data for row in _of_method(one)] if nested else data
    if not isinstance(data, dict):
        return []
    if isinstance(data.get("metrics"), dict):
        return [_of_scene_file(data, path)]
    if isinstance(data.get("scenes"), dict):
        return _of_method(data)
    for name in ("methods", "cells"):
        # our own summary has the names of its methods beside its cells
        if isinstance(data.get(name), list) and all(isinstance(one, dict) for one in data[name]):
            return _json_rows(data[name], path)
    return []


def _of_method(one: dict[str, Any]) -> list[dict[str, Any]]:
    name = one.get("id", one.get("method", one.get("name")))
    scenes = one["scenes"].items()
    return [{**scores, "scene": scene, "method": name} for scene, scores in scenes if isinstance(scores, dict)]


def _of_scene_file(data: dict[str, Any], path: Path) -> dict[str, Any]:
    """A result file of one method on one scene; older ones name their method by the folder alone."""
    info: dict[str, Any] = next((data[name] for name in ("nb_info", "info") if isinstance(data.get(name), dict)), {})
    places = [data.get("render_dataset_metadata"), info.get("dataset_metadata")]
    scenes = [place.get("scene") for place in places if isinstance(place, dict)]
    scene = next(filter(None, [*scenes, info.get("dataset_scene")]), path.stem)
    method = info.get("method") or path.parent.parent.name
    seconds = {"seconds": info["total_train_time"]} if "total_train_time" in info else {}
    return {**data["metrics"], **seconds, "scene": scene, "method": method}
