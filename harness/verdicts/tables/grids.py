"""Printed tables: CSV, Markdown and LaTeX as grids of cells, with a row per result or with a column per scene."""

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.records.metric_table import METRICS, PRIMARY
from harness.verdicts.tables.numbers import ARROWS, has_spread, is_missing, number, plain
from harness.verdicts.tables.rows import METHOD, SCENE, Rows, rows_of
from scenes.files.errors import InputError

LOWER = {name for name, metric in METRICS.items() if not metric.higher_is_better}
LOWER |= {"rmse", "mse", "mae", "fid", "kid", "dists", "chamfer"}
"""The metrics that are better when lower, also as part of a name, as in `lpips_vgg`."""
HIGHER = {"psnr", "ssim", "iou", "msssim", "accuracy", "f1"}
KNOWN = {*METRICS, *LOWER, *HIGHER, "ms-ssim"}
ASIDE = (
    "year", "venue", "publication", "params", "#params", "fps", "time", "training time", "train time", "memory", "size",
    "mem", "steps", "iterations", "rank", "gpu",
)  # fmt: skip
"""The columns of a wide table that are not scenes."""
PSNR_RANGE = (8.0, 70.0)
"""The range in which all numbers of a table without a name of a metric must lie to be read as PSNR."""


@dataclass(frozen=True)
class Grid:
    """A table as text: rows of cells of equal number, the line of each, and the text around that may name a metric."""

    rows: list[list[str]]
    lines: list[int]
    around: str = ""


def read_text(path: Path, text: str, metric: str | None) -> Rows:
    """Return the rows of all tables of a text; `metric` names the numbers of a table that does not. Raises `InputError`
    for a text without a table, and for a table that could be read in two ways.
    """
    name = path.suffix.lower()
    if name == ".tex" or "\\begin{tabular" in text:
        grids = _latex(text)
    elif name in (".md", ".markdown") or re.search(r"^\s*\|?[\s:|-]*-{2,}[\s:|-]*\|[\s:|-]*$", text, re.MULTILINE):
        grids = _markdown(text)
    else:
        return _from_csv(path, text, metric)
    if not grids:
        raise InputError(f"{path}: holds no table; give one as CSV, Markdown or LaTeX")
    several = [_rows(path, grid, metric) for grid in grids]
    return several[0] if len(several) == 1 else _merged(path, several)


def _from_csv(path: Path, text: str, metric: str | None) -> Rows:
    mark = max(",;\t", key=text.partition("\n")[0].count)
    try:
        names, *rows = list(csv.reader(io.StringIO(text, newline=""), delimiter=mark)) or [[]]
    except csv.Error as error:
        raise InputError(f"{path}: is not a CSV file ({error})") from error
    for place, row in enumerate(rows):
        if row and len(row) != len(names):
            raise InputError(f"{path}, line {place + 2}: has {len(row)} fields, the header has {len(names)}")
    while rows and not rows[-1]:
        rows.pop()
    if not all(rows):
        raise InputError(f"{path}, line {rows.index([]) + 2}: is empty; delete it")
    return _rows(path, Grid([names, *rows], list(range(1, len(rows) + 2))), metric)


def _markdown(text: str) -> list[Grid]:
    """Return the tables with pipes; a line of dashes divides header and rows."""
    grids: list[Grid] = []
    around, rows, numbers = "", list[list[str]](), list[int]()
    for line_number, line in enumerate([*text.splitlines(), ""], 1):
        if "|" in line:
            cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line.strip().removeprefix("|").removesuffix("|"))]
            if not all(re.fullmatch(r":?-+:?", cell) for cell in cells):
                rows.append(list(map(plain, cells)))
                numbers.append(line_number)
            continue
        if len(rows) > 1:
            grids.append(_even(rows, numbers, around))
        if rows:
            around, rows, numbers = "", [], []
        around += f" {line}"
    return grids


def _latex(text: str) -> list[Grid]:
    """Return the bodies of `tabular` environments; a cell of several columns is repeated."""
    grids = []
    pattern = re.compile(r"\\begin\{tabular[x*]?\}(.*?)\\end\{tabular[x*]?\}", re.DOTALL)
    for match in pattern.finditer(text):
        body = re.sub(r"(?<!\\)%.*", "", match[1])
        # the specification of the columns, which may hold nested braces, ends before the first line that has a cell
        body = re.sub(r"^(?:\s*\[[^\]]*\])?(?:\s*\{(?:[^{}]|\{[^{}]*\})*\})+", "", body)
        line = text[: match.start(1)].count("\n") + 1
        rows, numbers = [], []
        for part in re.split(r"\\\\(?:\[[^\]]*\])?", body):
            row = re.sub(r"\\(?:(?:top|mid|bottom|h)(?:rule|line)|cmidrule|cline|specialrule)(?:\([^)]*\))?"
                         r"(?:\[[^\]]*\])?(?:\{[^{}]*\})*", "", part)  # fmt: skip
            if "&" in row:
                rows.append([spanned for cell in re.split(r"(?<!\\)&", row) for spanned in _spanned(cell)])
                numbers.append(line + part[: len(part) - len(part.lstrip())].count("\n"))
            line += part.count("\n")
        near = text[max(0, match.start() - 600) : match.start()] + text[match.end() : match.end() + 600]
        captions = re.findall(r"\\caption(?:\[[^\]]*\])?\{([^{}]*(?:\{[^{}]*\}[^{}]*)*)\}", near)
        if len(rows) > 1:
            grids.append(_even(rows, numbers, " ".join(map(plain, captions))))
    return grids


def _spanned(cell: str) -> list[str]:
    match = re.match(r"\s*\\multicolumn\{(\d+)\}\{(?:[^{}]|\{[^{}]*\})*\}\{(.*)\}\s*$", cell, re.DOTALL)
    return [plain(match[2])] * int(match[1]) if match else [plain(cell)]


def _even(rows: list[list[str]], numbers: list[int], around: str) -> Grid:
    """Return a grid with all rows padded to the longest."""
    longest = max(map(len, rows))
    return Grid([row + [""] * (longest - len(row)) for row in rows], numbers, around)


def metric_in(text: str) -> str | None:
    """Return the known metric that a text names as a word, in lower case."""
    words = re.findall(r"[a-z0-9_\-]+", text.lower())
    words += [part for word in words for part in word.split("_")]
    return next((word for word in words if word in KNOWN), None)


def _bare(name: str) -> str:
    """Return a header in lower case, without arrows and units."""
    return re.sub(r"\s*[(\[](?:db|s|↑|↓)[)\]]", "", name.strip(f" {ARROWS}").lower()).strip(f" {ARROWS}")


def _rows(path: Path, grid: Grid, metric: str | None) -> Rows:
    head, *body = grid.rows
    names = [_bare(name) for name in head]
    lower = frozenset(bare for bare, name in zip(names, head, strict=True) if "↓" in name or "⬇" in name)
    if set(names) & set(SCENE) and set(names) & set(METHOD):
        notes = [SPREAD] if any(has_spread(value) for row in body for value in row) else []
        columns = [list(values) for values in zip(*body, strict=True)] or [[] for _ in names]
        return rows_of(path, names, columns, "line", grid.lines[1:], lower, notes)
    return _wide(path, grid, metric)


SPREAD = "Spreads behind ± or in brackets are left out: the judgement has its own."


def _wide(path: Path, grid: Grid, metric: str | None) -> Rows:
    """Return the rows of a table with a row per method and a column per scene, or turned, or with pairs of scene and
    metric in two rows of headers.
    """
    first = next((k for k, row in enumerate(grid.rows) if any(number(cell) is not None for cell in row[1:])), 0)
    heads, body, lines = grid.rows[:first], grid.rows[first:], grid.lines[first:]
    if not heads or len(heads) > 2:
        known = ", ".join(name.strip().lower() for name in grid.rows[0]) or "none"
        raise InputError(f"{path}: has no column scene and no column method (columns: {known})")
    numeric = [k for k in range(1, len(heads[0])) if any(number(row[k]) is not None for row in body)]
    columns = [k for k in numeric if _bare(heads[-1][k]) not in ASIDE]
    corner, turned = heads[-1][0] or heads[0][0], False
    named = [_bare(heads[-1][k]) for k in columns]
    metrics = [metric_in(name) or "" for name in named]
    above = [heads[0][k] for k in columns] if len(heads) == 2 else []
    if above and not any(metrics):
        metrics, above, named = [metric_in(name) or "" for name in above], [heads[-1][k] for k in columns], above
    if above and all(metrics):
        scenes = [plain(name) for name in above]
    elif all(metrics):
        if _bare(corner) in SCENE:
            raise InputError(f"{path}: has no column method (columns: {', '.join(map(_bare, heads[-1]))})")
        raise InputError(
            f"{path}: has the columns {', '.join(dict.fromkeys(named))} and no scenes: judge compares methods over "
            "scenes; give a table with a result of each scene"
        )
    else:
        scenes = [heads[-1][k].strip() for k in columns]
        chosen = metric or metric_in(f"{corner} {grid.around}") or metric_in(path.stem) or _guessed(path, body, columns)
        metrics = [chosen.lower()] * len(columns)
        turned = _bare(corner) in SCENE
    lower = frozenset(name for name, k in zip(metrics, columns, strict=True) if "↓" in heads[-1][k] + heads[0][k])
    cells: dict[tuple[str, str], dict[str, object]] = {}
    places: dict[tuple[str, str], int] = {}
    for row, line in zip(body, lines, strict=True):
        if not row[0].strip():
            raise InputError(f"{path}, line {line}: has numbers and no name; give it one")
        for k, scene, name in zip(columns, scenes, metrics, strict=True):
            cell = (row[0].strip(), scene) if turned else (scene, row[0].strip())
            scores = cells.setdefault(cell, {})
            if name in scores:
                raise InputError(
                    f"{path}, line {line}: a second {name} of {cell[1]} on {cell[0]}; rename or delete one"
                )
            scores[name] = row[k]
            places.setdefault(cell, line)
    kinds = list(dict.fromkeys(metrics))
    table: list[list[object]] = [[scene for scene, _ in cells], [method for _, method in cells]]
    table += [[row.get(name) for row in cells.values()] for name in kinds]
    notes = [SPREAD] if any(has_spread(row[k]) for row in body for k in columns) else []
    if aside := [heads[-1][k] for k in numeric if k not in columns]:
        notes.append(f"Columns left out, which are no scenes: {', '.join(aside)}.")
    return rows_of(path, ["scene", "method", *kinds], table, "line", list(places.values()), lower, notes)


def _guessed(path: Path, body: list[list[str]], columns: Sequence[int]) -> str:
    """Return PSNR if all numbers of a table without a name of a metric can be it; raises `InputError` otherwise."""
    values = [number(row[k]) for row in body for k in columns if not is_missing(row[k])]
    if all(value is not None and PSNR_RANGE[0] <= value <= PSNR_RANGE[1] for value in values):
        return PRIMARY
    raise InputError(f"{path}: does not say which metric it holds, and its numbers are no PSNR; name it with --metric")


def _merged(path: Path, parts: list[Rows]) -> Rows:
    """Return the rows of several tables of one file, with the metrics of one cell in one row."""
    cells: dict[tuple[object, ...], dict[str, object]] = {}
    places: dict[tuple[object, ...], int] = {}
    for part in parts:
        keys = [part.columns.get(name) or [None] * len(part) for name in ("scene", "method", "seed")]
        (_, _, numbers), names = part.stretches[0], [name for name in part.columns if name not in ("scene", "method")]
        for row, key in enumerate(zip(*keys, strict=True)):
            cell = cells.setdefault(key, {"scene": key[0], "method": key[1]})
            for name in names:
                if cell.get(name) not in (None, part.columns[name][row]):
                    raise InputError(f"{part.where(row)}: repeats {name} of {key[1]} on {key[0]}, of a table before it")
                cell[name] = part.columns[name][row]
            places.setdefault(key, numbers[row])
    names = list(dict.fromkeys(name for cell in cells.values() for name in cell))
    columns = [[cell.get(name) for cell in cells.values()] for name in names]
    lower = frozenset().union(*(part.lower for part in parts))
    notes = list(dict.fromkeys(note for part in parts for note in part.notes))
    return rows_of(path, names, columns, "line", list(places.values()), lower, notes)
