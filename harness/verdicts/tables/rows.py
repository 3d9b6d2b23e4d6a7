"""Rows of results as columns, with the place of each row in its file."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
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
    seed_of,
    without_seed,
)
from scenes.files.errors import InputError

SYNONYMS = {"train_seconds": "seconds", "train_core_seconds": "core_seconds", "total_train_time": "seconds"}
"""The names of `seconds` and `core_seconds` in nerfbaselines and in the summary of a run."""
GIVEN = Path("the given table")
"""The name of a table in memory in messages."""


@dataclass(frozen=True)
class Rows:
    """The rows of one or several files, as columns of equal length."""

    columns: dict[str, list[object]]
    stretches: list[tuple[Path, str, Sequence[int]]]
    """The path of each file, `line` or `row`, and the number of each of its rows."""
    arrows: frozenset[tuple[str, str]] = frozenset()
    """(metric, `↑` or `↓`): the way that a file itself says a metric is better."""
    notes: list[str] = field(default_factory=list)
    """What a reader assumed or left out, one sentence each."""
    averages: tuple[str, ...] = ()
    """What a reader left out as means of the others."""

    def __len__(self) -> int:
        return sum(len(numbers) for _, _, numbers in self.stretches)

    def where(self, row: int) -> str:
        for path, unit, numbers in self.stretches:
            if row < len(numbers):
                return f"{path}, {unit} {numbers[row]}"
            row -= len(numbers)
        raise IndexError(row)

    def files(self) -> list[Path]:
        """Return the file of each row."""
        return [path for path, _, numbers in self.stretches for _ in numbers]


def rows_of(
    path: Path,
    names: Iterable[object],
    columns: list[list[object]],
    unit: str = "row",
    numbers: Sequence[int] | None = None,
    *,
    arrows: Iterable[tuple[str, str]] = (),
    notes: Sequence[str] = (),
    averages: Sequence[str] = (),
) -> Rows:
    """Return rows with lower-case column names, synonyms replaced. Raises `InputError` if two names are equal, and for
    an arrow that a known metric cannot have.
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
    many = len(columns[0]) if columns else 0
    places = range(1, many + 1) if numbers is None else numbers
    return Rows(
        dict(zip(known, columns, strict=True)), [(path, unit, places)], frozenset(told), list(notes), tuple(averages)
    )


def with_seeds(
    names: list[str], columns: list[list[object]], lines: list[int]
) -> tuple[list[str], list[list[object]], list[int]]:
    """Return columns such as `psnr_seed0` and `psnr_seed1` as one, with a column of seeds."""
    seeds = {place: seed for place, name in enumerate(names) if metric_of(name) and (seed := seed_of(name)) is not None}
    common = [place for place in range(len(names)) if place not in seeds]
    metrics = list(dict.fromkeys(without_seed(names[place]) for place in seeds))
    made: dict[str, list[object]] = {name: [] for name in [*(names[place] for place in common), "seed", *metrics]}
    every = list(dict.fromkeys(seeds.values()))
    for seed in every:
        of_seed = {without_seed(names[place]): columns[place] for place, known in seeds.items() if known == seed}
        for place in common:
            made[names[place]] += columns[place]
        made["seed"] += [seed] * len(lines)
        for metric in metrics:
            made[metric] += of_seed.get(metric, [None] * len(lines))
    return list(made), list(made.values()), lines * len(every)


def joined(parts: Sequence[Rows]) -> Rows:
    """Return the rows of several files; raises `InputError` for one without scenes, methods or rows."""
    for part in parts:
        source = part.stretches[0][0]
        if lacking := [name for name in ("scene", "method") if name not in part.columns]:
            known = ", ".join(part.columns) or "none"
            raise InputError(f"{source}: has no column {' and no column '.join(lacking)} (columns: {known})")
        if not len(part):
            raise InputError(f"{source}: has a header and no rows")
    names = dict.fromkeys(name for part in parts for name in part.columns)
    columns: dict[str, list[object]] = {
        name: [value for part in parts for value in part.columns.get(name) or [None] * len(part)] for name in names
    }
    columns["scene"] = _with_datasets(columns)
    stretches = [stretch for part in parts for stretch in part.stretches]
    notes = list(dict.fromkeys(note for part in parts for note in part.notes))
    averages = dict.fromkeys(name for part in parts for name in part.averages)
    arrows = frozenset(arrow for part in parts for arrow in part.arrows)
    return Rows(columns, stretches, arrows, notes, tuple(averages))


def _with_datasets(columns: dict[str, list[object]]) -> list[object]:
    """Return the scenes, with the name of their data set before them if two data sets share the name of a scene."""
    scenes = columns["scene"]
    pairs = list(zip(columns.get("dataset") or [None] * len(scenes), scenes, strict=True))
    named = {(dataset, scene) for dataset, scene in pairs if dataset is not None}
    if len(named) == len({scene for _, scene in named}):
        return scenes
    return [scene if dataset is None else f"{dataset}/{scene}" for dataset, scene in pairs]
