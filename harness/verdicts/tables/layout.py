"""Grids → rows of results: which columns and rows are scenes, methods and seeds, which metric the numbers are, and what
is left out. A grid that could be read in two ways is refused.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from harness.records.metric_table import PRIMARY
from harness.verdicts.tables.grids import Grid, grids_of
from harness.verdicts.tables.headers import (
    METHOD,
    SCENE,
    SPREAD,
    VALUE,
    arrow_of,
    bare,
    beside_metric,
    column_name,
    is_aside,
    is_average,
    metric_of,
    quantity_in,
    role_of,
    seed_of,
    share_of_scenes,
    without_seed,
    words_of,
)
from harness.verdicts.tables.numbers import has_spread, is_failed, is_missing, number
from harness.verdicts.tables.rows import Rows, rows_of
from harness.verdicts.tables.tidying import tidied
from scenes.files.errors import InputError

PSNR_RANGE = (8.0, 70.0)
"""The range in which all numbers of a table without a name of a metric must lie to be read as PSNR."""
INDEX = ("", "#", "no", "nr", "index", "idx", "id", "rank")
"""The names of a column that counts rows."""
SPREADS = "Spreads behind ± or in brackets are left out: the judgement has its own."
FILLED = "A blank name repeats the one above it."
GUESSED = "No metric is named: the numbers are taken as PSNR, as all lie between 8 and 70 (--metric)."
_Cells = dict[tuple[Any, ...], tuple[int, dict[str, object]]]
"""Names of a cell → its first line and its values by column."""


def read_text(path: Path, text: str, metric: str | None) -> Rows:
    """Return the rows of all tables of a text; `metric` names the numbers of a table that does not. Raises `InputError`
    for a text without a table, and for a table that could be read in two ways.
    """
    grids = grids_of(path, text)
    several, refused = list[Rows](), dict[int, str]()
    for grid in grids:
        try:
            several.append(rows_in(path, grid, metric))
        except InputError as error:
            if len(grids) == 1:
                raise
            refused[grid.lines[0]] = str(error).removeprefix(f"{path}: ").removeprefix(f"{path}, ")
    if not several:
        why = "; ".join(f"that of line {line}: {why}" for line, why in refused.items())
        raise InputError(f"{path}: holds no table of results ({why})")
    rows = several[0] if len(several) == 1 else _merged(path, several)
    notes = [f"Table of line {line} left out: {why}." for line, why in refused.items()]
    return replace(rows, notes=[*rows.notes, *notes])


def rows_in(path: Path, grid: Grid, metric: str | None) -> Rows:
    """Return the rows of a grid. Raises `InputError` for one that holds no scores, or could be read in two ways."""
    table = _table(path, tidied(grid))
    if not {"scene", "method"} <= set(table.roles):
        return _wide(path, table, metric)
    if "metric" in table.roles:
        return _melted(path, table)
    return _long(path, table)


def rows_of_columns(
    path: Path, names: Sequence[object], columns: list[list[object]], metric: str | None = None
) -> Rows:
    """Return the rows of a table in memory or of a data format, long or wide."""
    heads = [str(name).strip() for name in names]
    kept = [k for k, name in enumerate(heads) if not _counts_rows(name, [str(value) for value in columns[k]])]
    heads, columns = [heads[k] for k in kept], [columns[k] for k in kept]
    roles = {role_of(name) for name in heads}
    if ({"scene", "method"} <= roles and "metric" not in roles) or not heads or not columns[0]:
        return rows_of(path, heads, columns)
    body = [["" if value is None else str(value) for value in row] for row in zip(*columns, strict=True)]
    rows = rows_in(path, Grid([heads, *body], [*range(len(body) + 1)]), metric)
    return replace(rows, places=[(path, "row", number) for _, _, number in rows.places])


@dataclass
class _Table:
    """A grid whose headers and columns of names are known."""

    heads: list[list[str]]
    """The rows of headers, from top to bottom."""
    body: list[list[str]]
    lines: list[int]
    names: list[int]
    """The columns of names, by place."""
    roles: dict[str, int]
    """scene, method, seed, metric → its column."""
    values: list[int]
    """The columns of numbers."""
    around: tuple[str, ...]
    notes: list[str] = field(default_factory=list)

    def head(self, column: int) -> str:
        """Return the lowest header of a column."""
        return next((row[column] for row in reversed(self.heads) if row[column]), "")


def _table(path: Path, grid: Grid) -> _Table:
    first = next((k for k, row in enumerate(grid.rows) if k and _is_data(row, grid.rows[0])), len(grid.rows))
    if {"scene", "method"} <= {role_of(cell) for cell in grid.rows[0]}:
        first = 1
    heads, body, lines = [list(row) for row in grid.rows[:first]], grid.rows[first:], grid.lines[first:]
    # pandas prints the name of the rows' index in a row of its own
    if len(heads) > 1 and all(role_of(cell) for cell in heads[-1] if cell) and not all(heads[-1]):
        named = heads.pop()
        heads[-1] = [below or above for below, above in zip(named, heads[-1], strict=True)]
    titles = [f"Rows without results, taken as titles: {', '.join(grid.titles)}."] if grid.titles else []
    table = _Table(heads, body, lines, [], {}, [], grid.around, titles)
    columns = range(len(heads[0]))
    is_index = {k for k in columns if _counts_rows(table.head(k), [row[k] for row in body])}
    numeric = {k for k in columns if _is_numeric([row[k] for row in body]) and not _is_role(table, k)}
    if len(numeric | is_index) == len(heads[0]) and body:
        _require_results(path, table.head(0))
        raise InputError(f"{path}: has no column of names; give a column of methods or of scenes")
    table.names = [k for k in columns if k not in numeric | is_index] or [0]
    table.values = [k for k in columns if k not in table.names and k not in is_index]
    for role in ("scene", "method", "metric", "seed"):
        places = [k for k in table.names if role_of(table.head(k)) == role]
        order = {name: place for place, name in enumerate((*SCENE, *METHOD))}
        if places:
            table.roles[role] = min(places, key=lambda k: order.get(bare(table.head(k)), len(order)))
    _roles_by_content(table)
    _fill_headers(table)
    return table


def _roles_by_content(table: _Table) -> None:
    """Find metrics and scenes among columns of names whose headers do not say so."""
    for k in table.names if len(table.names) > 1 else []:
        values = {row[k] for row in table.body if row[k]}
        if k in table.roles.values() or not values:
            continue
        if "metric" not in table.roles and all(metric_of(value) and not beside_metric(value) for value in values):
            table.roles["metric"] = k
        elif "scene" not in table.roles and share_of_scenes(values) > 0.5:
            table.roles["scene"] = k
    scenes = [row[table.roles["scene"]] for row in table.body] if "scene" in table.roles else []
    others = [k for k in table.names if k not in table.roles.values() and not role_of(table.head(k))]
    # where each scene has one row, columns are methods
    if len({*scenes}) < len(scenes) and "method" not in table.roles and others and not is_aside(table.head(others[-1])):
        table.roles["method"] = others[-1]


def _is_role(table: _Table, column: int) -> bool:
    """Return whether a column of numbers is one of names or seeds: scores are no seeds."""
    role = role_of(table.head(column))
    values = [number(row[column]) for row in table.body]
    return bool(role) and (role != "seed" or all(value is None or value.is_integer() for value in values))


def _is_data(row: Sequence[str], first: Sequence[str]) -> bool:
    """Return whether a row holds results, rather than a second row of headers, such as the numbers of scans."""
    if any(number(cell) is not None or (cell and is_missing(cell)) for cell in row[1:]):
        return not role_of(row[0])
    is_header = not row[0] or role_of(row[0]) or row[0] == first[0] or any(metric_of(cell) for cell in row[1:])
    return not is_header


def _counts_rows(name: str, values: list[str]) -> bool:
    """Return whether a column counts rows, as the index of a data frame or a rank."""
    if (bare(name) not in INDEX and not bare(name).startswith("unnamed")) or not values:
        return False
    return [number(value) for value in values] in ([*range(len(values))], [*range(1, len(values) + 1)])


def _is_numeric(values: list[str]) -> bool:
    """Return whether at least half of a column's results are numbers; others are refused later, with their line."""
    known = [value for value in values if not is_missing(value)]
    return 2 * sum(number(value) is not None for value in known) >= len(known) and bool(values)


def _fill_headers(table: _Table) -> None:
    """Repeat a header over the columns that it spans, if rows of headers follow it."""
    for above, below in zip(table.heads, table.heads[1:], strict=False):
        for left, right in zip(table.values, table.values[1:], strict=False):
            if not above[right] and below[right] and right == left + 1:
                above[right] = above[left]


def _long(path: Path, table: _Table) -> Rows:
    """Return the rows of a table with a row per result; every other column is passed on."""
    heads = [table.head(k) for k in range(len(table.heads[0]))]
    named = quantity_in([*table.around, path.stem])[0]
    if named and not any(metric_of(heads[k]) for k in table.values):
        heads = [named if k in table.values and bare(name) in VALUE else name for k, name in enumerate(heads)]
    for role, k in table.roles.items():
        heads[k] = heads[k] or role
    kept = sorted([*table.names, *table.values])
    _fill_down(table, min(table.roles["scene"], table.roles["method"]))
    notes = [*table.notes, *_notes_on([row[k] for row in table.body for k in table.values])]
    columns: list[list[object]] = [[row[k] for row in table.body] for k in kept]
    return rows_of(path, [heads[k] for k in kept], columns, table.lines, notes=notes)


def _melted(path: Path, table: _Table) -> Rows:
    """Return the rows of a table with a row per result and metric: columns metric and value; the others tell which."""
    of_metric, heads = table.roles["metric"], [table.head(k) for k in range(len(table.heads[0]))]
    scores = [k for k in table.values if bare(heads[k]) in VALUE]
    scores = scores or [k for k in table.values if not is_aside(heads[k])]
    if len(scores) != 1:
        known = ", ".join(bare(heads[k]) for k in scores) or "none"
        raise InputError(f"{path}: has a column of metrics and {len(scores)} columns of numbers ({known}); keep one")
    others = [k for k in sorted([*table.names, *table.values]) if k not in (of_metric, scores[0])]
    for k in table.names[:-1]:
        _fill_down(table, k)
    cells: _Cells = {}
    for row, line in zip(table.body, table.lines, strict=True):
        name, key = column_name(row[of_metric]), tuple(row[k] for k in others)
        _, of_row = cells.setdefault(key, (line, {}))
        if name in of_row:
            raise InputError(f"{path}, line {line}: a second {name} of {' '.join(key)}; rename or delete one")
        of_row[name] = row[scores[0]]
    arrows = {(column_name(row[of_metric]), arrow_of(row[of_metric])) for row in table.body}
    return _of_cells(path, [heads[k] for k in others], cells, arrows, table.notes)


def _fill_down(table: _Table, column: int) -> None:
    """Repeat a name over the rows that it spans, if another name changes meanwhile."""
    others = [k for k in table.names if k != column]
    before = ""
    for place, row in enumerate(table.body):
        if not row[column] and before and any(row[k] for k in others):
            table.body[place] = row = [*row[:column], before, *row[column + 1 :]]
            if FILLED not in table.notes:
                table.notes.append(FILLED)
        before = row[column]


@dataclass(frozen=True)
class _Column:
    place: int
    metric: str = ""
    name: str = ""
    """The scene, or the method in a turned table."""
    seed: str | None = None
    is_left_out: bool = False
    arrow: str = ""
    """The way that its metric is better, if a caption says so."""


def _columns(path: Path, table: _Table) -> list[_Column]:
    """Say what each column of numbers holds, by the row of headers that names metrics and the rows that name scenes."""
    if len(table.heads) == 1:
        return _of_one_row(table)
    named = [sum(bool(metric_of(row[k])) for k in table.values) for row in table.heads]
    level = named.index(max(named)) if max(named) else None
    columns = []
    for k in table.values:
        parts = list(dict.fromkeys(row[k] for place, row in enumerate(table.heads) if row[k] and place != level))
        score = table.heads[level][k] if level is not None else ""
        seeds = [seed for part in parts if (seed := seed_of(part)) is not None]
        names = [name for part in parts if (name := without_seed(part)) and not role_of(part)]
        is_out = is_aside(score) or any(is_average(part) or is_aside(part) for part in (*parts, score))
        metric = ("" if beside_metric(score) else metric_of(score)) or column_name(score)
        columns.append(_Column(k, metric, " ".join(names), seeds[0] if seeds else None, is_out))
    return columns if level is not None else _below_groups(path, table, columns)


def _below_groups(path: Path, table: _Table, columns: list[_Column]) -> list[_Column]:
    """Return columns with the lowest header, if the rows above it name groups of scenes, such as data sets."""
    lowest = [without_seed(table.head(column.place)) for column in columns]
    if any(column.seed for column in columns):
        return columns
    if len({*lowest}) < len(lowest):
        repeated = next(name for name in lowest if lowest.count(name) > 1)
        raise InputError(
            f"{path}: has {repeated!r} below several headers, and no metric in them; give a column for each scene"
        )
    return [replace(column, name=name) for column, name in zip(columns, lowest, strict=True)]


def _of_one_row(table: _Table) -> list[_Column]:
    columns, heads = [], [table.head(k) for k in table.values]
    for k, part in zip(table.values, heads, strict=True):
        found, is_out = metric_of(part), is_average(part) or is_aside(part) or _is_spread_of(part, heads)
        rest = beside_metric(part) if found else part
        columns.append(_Column(k, found, without_seed(rest), seed_of(part), is_out))
    kept = [column for column in columns if not column.is_left_out]
    if not all(column.metric for column in kept):  # then `Ours w/ SSIM loss` names a method
        columns = [
            replace(each, metric="", name=without_seed(table.head(each.place))) if each.name else each
            for each in columns
        ]
    # next to other scenes, `train` is one; by itself it is a split
    if all(column.name.lower() in ("", "train") for column in kept if column.metric):
        columns = [replace(each, is_left_out=each.is_left_out or bool(each.name and each.metric)) for each in columns]
    return columns


def _is_spread_of(name: str, heads: list[str]) -> bool:
    """Return whether a header is that of another column with the word for a spread: `garden_std` next to `garden`."""
    words = words_of(name)
    rest = [word for word in words if word not in SPREAD]
    return len(rest) < len(words) and any(words_of(head) == rest for head in heads)


def _wide(path: Path, table: _Table, metric: str | None) -> Rows:
    """Return the rows of a table with a column per scene, or per method, or per pair with a metric or a seed."""
    if not table.body or not table.values:
        known = ", ".join(name.strip().lower() for name in table.heads[0]) or "none"
        raise InputError(f"{path}: has no column scene and no column method (columns: {known})")
    columns = _columns(path, table)
    kept = [column for column in columns if not column.is_left_out]
    if any(column.name for column in kept):  # without the mean of another metric, such as SSIM behind PSNR by scene
        kept = [column for column in kept if column.name]
    else:
        _refuse_without_scenes(path, table, kept)
    _require_results(path, table.head(_column_of_labels(table)))
    if not all(column.metric for column in kept) and "metric" not in table.roles:
        chosen, arrow = _metric_around(path, table, kept, metric)
        kept = [replace(column, metric=column.metric or chosen, arrow=arrow) for column in kept]
    return _gathered(path, table, kept, columns)


def _metric_around(path: Path, table: _Table, kept: list[_Column], metric: str | None) -> tuple[str, str]:
    """Return the metric of a table whose headers name none, and the arrow next to it: from its corner, its caption or
    heading, `--metric`, its file, or else PSNR if all its numbers can be it.
    """
    texts = [" ".join(row[table.names[0]] for row in table.heads), *table.around]
    named, of_time = quantity_in(texts)
    if named:
        return named, next(filter(None, (arrow_of(text) for text in texts if named in text.lower())), "")
    if metric is not None:
        return metric.lower(), ""
    if not of_time and is_aside(path.stem.replace("_", " ")) and not metric_of(path.stem):
        of_time = path.name
    if of_time:
        raise InputError(
            f"{path}: holds a time or a size, and no scores ({of_time}); --metric NAME judges them all the same"
        )
    return metric_of(path.stem) or _guessed(path, table, kept), ""


def _require_results(path: Path, of_rows: str) -> None:
    if {*words_of(bare(of_rows))} & {"step", "steps", "iteration", "epoch"}:
        raise InputError(f"{path}: has a row per {of_rows}, not per method or scene; give the results at the end")


def _refuse_without_scenes(path: Path, table: _Table, columns: list[_Column]) -> None:
    named = ", ".join(dict.fromkeys(bare(table.head(column.place)) for column in columns)) or "none"
    if "scene" in table.roles:
        known = ", ".join(bare(name) for name in table.heads[-1])
        raise InputError(f"{path}: has no column method (columns: {known})")
    raise InputError(
        f"{path}: has the columns {named} and no scenes: judge compares methods over scenes; give a table with a "
        "result of each scene"
    )


def _what_rows_are(table: _Table, columns: list[str]) -> str:
    """Return `scene` or `method`: by the name of the column of names, else by the scenes that everybody knows."""
    for role in ("scene", "method"):
        if role in table.roles:
            return role
    labels = [row[_column_of_labels(table)] for row in table.body]
    if share_of_scenes(labels) > 0.5 > share_of_scenes(columns):
        return "scene"
    return "method"


def _column_of_labels(table: _Table) -> int:
    """Return the column of names that is neither a metric nor a seed: the one with a role, else the first without
    repetitions, else the last.
    """
    named = [table.roles[role] for role in ("method", "scene") if role in table.roles]
    others = [k for k in table.names if k not in table.roles.values()] or table.names
    values = {k: [row[k] for row in table.body] for k in others}
    distinct = [k for k in others if len({*values[k]}) == len(values[k]) and all(values[k])]
    return (named or distinct or others[-1:])[0]


def _gathered(path: Path, table: _Table, kept: list[_Column], columns: list[_Column]) -> Rows:
    """Return the scores by scene, method and seed, and notes on all that is left out."""
    rows_are = _what_rows_are(table, [column.name for column in kept])
    label, of_metric, of_seed = _column_of_labels(table), table.roles.get("metric"), table.roles.get("seed")
    for k in table.names[:-1]:
        _fill_down(table, k)
    cells: _Cells = {}
    means, others = list[str](), list[str]()
    for row, line in zip(table.body, table.lines, strict=True):
        name = row[label].strip()
        if not name:
            raise InputError(f"{path}, line {line}: has numbers and no name; give it one")
        if is_average(name) or is_aside(name):
            (means if is_average(name) else others).append(name)
            continue
        for column in kept:
            parts = (name, column.name) if rows_are == "scene" else (column.name, without_seed(name))
            metric = column_name(row[of_metric]) if of_metric is not None else column.metric
            seed = column.seed or (seed_of(name) if rows_are == "method" else None)
            if of_seed is not None:
                seed = row[of_seed]
            _, scores = cells.setdefault((*parts, seed), (line, {}))
            if metric in scores:
                raise InputError(
                    f"{path}, line {line}: a second {metric} of {parts[1]} on {parts[0]}; rename or delete one"
                )
            scores[metric] = row[column.place]
    names = ["scene", "method", *(["seed"] if any(seed is not None for *_, seed in cells) else [])]
    arrows = {(c.metric, arrow) for c in kept for arrow in (c.arrow, *(arrow_of(row[c.place]) for row in table.heads))}
    if of_metric is not None:
        arrows |= {(column_name(row[of_metric]), arrow_of(row[of_metric])) for row in table.body}
    out = [column.place for column in columns if column.place not in {each.place for each in kept}]
    unused = [k for k in table.names if k not in (label, of_metric, of_seed) and any(row[k] for row in table.body)]
    means = [*(table.head(k) for k in out if any(is_average(row[k]) for row in table.heads)), *means]
    heads = [table.head(k) or "(without a name)" for k in sorted([*out, *unused])]
    if others := [*dict.fromkeys(name for name in (*heads, *others) if name not in means)]:
        table.notes.append(f"Left out, as neither results nor their means: {', '.join(others)}.")
    notes = [*table.notes, *_notes_on([row[column.place] for row in table.body for column in kept])]
    return _of_cells(path, names, cells, arrows, notes, means)


def _of_cells(
    path: Path,
    names: list[str],
    cells: _Cells,
    arrows: Iterable[tuple[str, str]],
    notes: list[str],
    averages: Iterable[str] = (),
) -> Rows:
    """Return a row per cell: the parts of its key as columns `names`, then its values, None for one that it lacks."""
    kinds = dict.fromkeys(kind for _, values in cells.values() for kind in values)
    columns: list[list[object]] = [[key[k] for key in cells] for k in range(len(names))]
    columns += [[values.get(kind) for _, values in cells.values()] for kind in kinds]
    lines, means = [line for line, _ in cells.values()], [*dict.fromkeys(averages)]
    return rows_of(path, [*names, *kinds], columns, lines, arrows=arrows, notes=notes, averages=means)


def _notes_on(cells: list[str]) -> list[str]:
    failed = [cell for cell in cells if is_failed(cell)]
    notes = [SPREADS] if any(has_spread(cell) for cell in cells) else []
    if failed:
        words = ", ".join(dict.fromkeys(cell.strip() for cell in failed))
        notes.append(f"{len(failed)} results are missing, as their runs gave none ({words}).")
    return notes


def _guessed(path: Path, table: _Table, kept: list[_Column]) -> str:
    """Return PSNR if all numbers of a table without a name of a metric can be it; raises `InputError` otherwise."""
    values, label = [], _column_of_labels(table)
    for row, line in zip(table.body, table.lines, strict=True):
        if is_average(row[label]) or is_aside(row[label]):
            continue
        for cell in (row[column.place] for column in kept if not is_missing(row[column.place])):
            if (value := number(cell)) is None:
                raise InputError(f"{path}, line {line}: {cell!r} is not a number; leave the field empty")
            values.append(value)
    if all(PSNR_RANGE[0] <= value <= PSNR_RANGE[1] for value in values):
        table.notes.append(GUESSED)
        return PRIMARY
    raise InputError(f"{path}: does not say which metric it holds, and its numbers are no PSNR; name it with --metric")


def _merged(path: Path, parts: list[Rows]) -> Rows:
    """Return the rows of several tables of one file, with the metrics of one cell in one row."""
    cells: _Cells = {}
    for part in parts:
        keys = [part.columns.get(name) or [None] * len(part) for name in ("scene", "method", "seed")]
        names = [name for name in part.columns if name not in ("scene", "method")]
        for row, key in enumerate(zip(*keys, strict=True)):
            same = tuple(" ".join(str(name).split()).casefold() for name in key)
            _, cell = cells.setdefault(same, (part.places[row][2], {"scene": key[0], "method": key[1]}))
            for name in names:
                if cell.get(name) not in (None, part.columns[name][row]):
                    raise InputError(f"{part.where(row)}: repeats {name} of {key[1]} on {key[0]}, of a table before it")
                cell[name] = part.columns[name][row]
    arrows = {arrow for part in parts for arrow in part.arrows}
    notes = list(dict.fromkeys(note for part in parts for note in part.notes))
    return _of_cells(path, [], cells, arrows, notes, (name for part in parts for name in part.averages))
