"""Rows of results as columns, with the place of each row in its file."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from harness.verdicts.tables.headers import (
    HIGHER,
    LOWER,
    METHOD,
    SCENE,
    SEED,
    arrow_of,
    column_name,
    metric_of,
    metrics_of_seeds,
)
from scenes.files.errors import InputError

SYNONYMS = {"train_seconds": "seconds", "train_core_seconds": "core_seconds", "total_train_time": "seconds"}
"""The names of `seconds` and `core_seconds` in nerfbaselines and in the summary of a run."""
GIVEN = Path("the given table")
"""The name of a table in memory in messages."""


@dataclass(frozen=True)
class Rows:
    """The rows of one or several files, as columns of equal length."""

    source: Path
    """The first file."""
    columns: dict[str, list[object]]
    places: list[tuple[Path, str, int]]
    """The file of each row, `line` or `row`, and its number there."""
    arrows: frozenset[tuple[str, str]] = frozenset()
    """(metric, `↑` or `↓`): the way that a file itself says a metric is better."""
    notes: list[str] = field(default_factory=list)
    """What a reader assumed or left out, one sentence each."""
    averages: tuple[str, ...] = ()
    """What a reader left out as means of the others."""

    def __len__(self) -> int:
        return len(self.places)

    def where(self, row: int) -> str:
        path, unit, number = self.places[row]
        return f"{path}, {unit} {number}"


def rows_of(
    path: Path,
    names: Iterable[object],
    columns: list[list[object]],
    lines: Sequence[int] | None = None,
    *,
    arrows: Iterable[tuple[str, str]] = (),
    notes: Sequence[str] = (),
    averages: Sequence[str] = (),
) -> Rows:
    """Return rows with lower-case column names, synonyms replaced; without `lines` of a text they are counted. Raises
    `InputError` if two names are equal, and for an arrow that a known metric cannot have.
    """
    given = [str(name).strip() for name in names]
    short = [column_name(name) for name in given]
    # a name is shortened unless that makes two columns one
    known = [new if short.count(new) == 1 else old.lower() for new, old in zip(short, given, strict=True)]
    told = {(name, arrow) for name, arrow in (*arrows, *zip(known, map(arrow_of, given), strict=True)) if arrow}
    for name, arrow in sorted(told):
        if (name in LOWER and arrow == "↑") or (name in HIGHER and arrow == "↓"):
            raise InputError(f"{path}: marks {name} as {arrow}, the wrong way; rename it or correct the arrow")
    known = [SYNONYMS.get(name, name) if SYNONYMS.get(name) not in known else name for name in known]
    for name, synonyms in (("scene", SCENE), ("method", METHOD), ("seed", SEED)):
        if name not in known and (other := next((other for other in synonyms if other in known), None)):
            known[known.index(other)] = name
    twice = next((name for name in known if known.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"{path}: two columns are called {twice!r}; rename one")
    unit, numbers = ("row", range(1, len(columns[0]) + 1 if columns else 1)) if lines is None else ("line", lines)
    places = [(path, unit, number) for number in numbers]
    by_name = dict(zip(known, columns, strict=True))
    return Rows(path, by_name, places, frozenset(told), list(notes), tuple(averages))


def joined(parts: Sequence[Rows]) -> Rows:
    """Return the rows of several files; raises `InputError` for one without scenes, methods or rows."""
    for part in parts:
        if lacking := [name for name in ("scene", "method") if name not in part.columns]:
            known = ", ".join(part.columns) or "none"
            raise InputError(f"{part.source}: has no column {' and no column '.join(lacking)} (columns: {known})")
        if not len(part):
            raise InputError(f"{part.source}: has a header and no rows")
    parts = [_over_seeds(part) for part in parts]
    names = dict.fromkeys(name for part in parts for name in part.columns)
    columns: dict[str, list[object]] = {
        name: [value for part in parts for value in part.columns.get(name) or [None] * len(part)] for name in names
    }
    columns["scene"] = _with_datasets(columns)
    places = [place for part in parts for place in part.places]
    notes = list(dict.fromkeys(note for part in parts for note in part.notes))
    averages = dict.fromkeys(name for part in parts for name in part.averages)
    arrows = frozenset(arrow for part in parts for arrow in part.arrows)
    return Rows(parts[0].source, columns, places, arrows, notes, tuple(averages))


def _over_seeds(rows: Rows) -> Rows:
    """Return columns such as `psnr_seed0` and `psnr_seed1` as one column, with a row per seed; columns next to one of
    seeds, or of that metric, as they are.
    """
    seeded = {name: (column_name(metric), seed) for name, (metric, seed) in metrics_of_seeds(rows.columns).items()}
    cells = {cell: rows.columns[name] for name, cell in seeded.items()}
    metrics, seeds = (list(dict.fromkeys(part)) for part in zip(*cells, strict=True)) if cells else ([], [])
    if len(seeds) < 2 or len(cells) < len(seeded) or {"seed", *metrics} & rows.columns.keys():
        return rows
    empty: list[object] = [None] * len(rows)
    columns = {
        # one result is not one of each seed
        name: values + (empty if metric_of(name) else values) * (len(seeds) - 1)
        for name, values in rows.columns.items()
        if name not in seeded
    }
    columns["seed"] = [seed for seed in seeds for _ in rows.places]
    columns |= {metric: [v for seed in seeds for v in cells.get((metric, seed), empty)] for metric in metrics}
    note = f"A column is read as a seed of a metric: {', '.join(seeded)}."
    arrows = frozenset((seeded.get(name, (name, ""))[0], arrow) for name, arrow in rows.arrows)
    return replace(rows, columns=columns, places=rows.places * len(seeds), arrows=arrows, notes=[*rows.notes, note])


def _with_datasets(columns: dict[str, list[object]]) -> list[object]:
    """Return the scenes, with the name of their data set before them if two data sets share the name of a scene."""
    scenes = columns["scene"]
    pairs = list(zip(columns.get("dataset") or [None] * len(scenes), scenes, strict=True))
    named = {(dataset, scene) for dataset, scene in pairs if dataset is not None}
    if len(named) == len({scene for _, scene in named}):
        return scenes
    return [scene if dataset is None else f"{dataset}/{scene}" for dataset, scene in pairs]
