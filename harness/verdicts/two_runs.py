"""Two outputs of the same plan, cell by cell: how far another processor, or another try, moves scores and verdicts."""

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.records.cells import CellRecord, Comparison, RunRecord, read_cells, read_run
from harness.verdicts.comparisons import Key, compare
from scenes.files.errors import InputError

OF_THE_MACHINE = ("precision", "device", "threads")
"""The settings that a plan leaves to the machine."""
PLACE = ("processor", "instruction_set", "threads", "device", "commit")
"""The parts of the origin of cells that are shown side by side."""


@dataclass(frozen=True)
class Apart:
    """The differences of test PSNR between cells of the same scene, method and seed."""

    where: str
    """The method or scene, or `all`."""
    cells: int
    rms: float
    """The root mean square of the differences, dB."""
    mean: float
    """The mean of second less first, dB."""
    largest: float
    largest_of: str


@dataclass(frozen=True)
class Changed:
    """The verdicts of one of the two senses that are not the same in both outputs."""

    sense: str
    compared: int
    verdicts: int
    signs: int
    """The number of these that go from better to worse or the other way round."""
    rows: list[str]


@dataclass(frozen=True)
class TwoRuns:
    origins: dict[str, tuple[list[str], list[str]]]
    identical: int
    """The number of cells of the same scores to the last bit."""
    lost: list[str]
    """The cells that have a score in one output alone."""
    by_method: list[Apart]
    by_scene: list[Apart]
    all: Apart | None
    changed: list[Changed]
    headline: list[str]


def two_runs(first: Path, second: Path) -> TwoRuns:
    """Compare two outputs; raises `InputError` for outputs of different plans, and `DamagedRecord`."""
    outs = (first, second)
    for out in outs:
        if not (out / "records" / "run.json").is_file():
            raise InputError(f"{out}: no run in it; name the output folder of a run, for instance out/latest")
    runs = [read_run(out) for out in outs]
    cells = [{(cell.scene, cell.method, cell.seed): cell for cell in read_cells(out)} for out in outs]
    _refuse_other_plans(runs, cells, outs)
    pairs = [(cells[0][key], cells[1][key]) for key in sorted(cells[0])]
    scored = [(one, other) for one, other in pairs if None not in (one.scores.get("psnr"), other.scores.get("psnr"))]
    rows = [compare(list(found.values()), list(runs[0].methods)) for found in cells]
    again = list(zip(*rows, strict=True))
    groups: dict[str, dict[str, list[tuple[CellRecord, CellRecord]]]] = {"method": {}, "scene": {}}
    for pair in scored:
        for kind, group in groups.items():
            group.setdefault(getattr(pair[0], kind), []).append(pair)
    origins = {}
    for name in PLACE:
        ours, theirs = (
            sorted({str(cell.provenance.get(name, "not recorded")) for cell in found.values()}) for found in cells
        )
        if ours != theirs:
            origins[name] = (ours, theirs)
    return TwoRuns(
        origins=origins,
        identical=sum(one.scores == other.scores for one, other in pairs),
        lost=[
            f"{_named(one)}: {one.status}, then {other.status}" for one, other in pairs if (one, other) not in scored
        ],
        by_method=[_apart(name, some) for name, some in groups["method"].items()],
        by_scene=[_apart(name, some) for name, some in groups["scene"].items()],
        all=_apart("all", scored) if scored else None,
        changed=[_changed(again, sense) for sense in ("on_these_scenes", "scenes_like_these")],
        headline=[
            f"{one.method} − {one.against}: {one.difference:+.2f} dB ({one.verdict}) → "
            f"{other.difference:+.2f} dB ({other.verdict})"
            for one, other in again
            if (one.scene, one.metric, one.budget) == ("all", "psnr", "steps")
            and one.difference is not None
            and other.difference is not None
        ],
    )


def _refuse_other_plans(runs: list[RunRecord], cells: list[dict[Key, CellRecord]], outs: tuple[Path, Path]) -> None:
    where = f"{outs[0]} and {outs[1]} are not outputs of the same plan"
    remedy = "run the second with the command of the first"
    for place, name in enumerate(("scenes", "methods", "seeds")):
        sides = [sorted({str(key[place]) for key in found}) for found in cells]
        if sides[0] != sides[1]:
            raise InputError(f"{where}: {name} {', '.join(sides[0])} against {', '.join(sides[1])}; {remedy}")
    if alone := sorted(cells[0].keys() ^ cells[1].keys()):
        raise InputError(f"{where}: {' '.join(map(str, alone[0]))} is in one alone; finish both with --resume")
    settings = [dict(_flat(run.settings)) for run in runs]
    for name in sorted(settings[0].keys() | settings[1].keys()):
        values = [found.get(name) for found in settings]
        if values[0] != values[1] and not any(word in name for word in OF_THE_MACHINE):
            raise InputError(f"{where}: {name} is {values[0]} against {values[1]}; {remedy}")


def _flat(value: Any, name: str = "") -> Iterable[tuple[str, Any]]:
    if not isinstance(value, dict):
        yield name, value
        return
    for key, inner in value.items():
        yield from _flat(inner, f"{name}.{key}".strip("."))


def _named(cell: CellRecord) -> str:
    return f"{cell.scene} {cell.method} seed {cell.seed}"


def _apart(where: str, pairs: list[tuple[CellRecord, CellRecord]]) -> Apart:
    differences = np.array([(other.scores["psnr"] or 0.0) - (one.scores["psnr"] or 0.0) for one, other in pairs])
    worst = int(np.abs(differences).argmax())
    return Apart(
        where,
        len(pairs),
        math.sqrt(float((differences**2).mean())),
        float(differences.mean()),
        float(differences[worst]),
        _named(pairs[worst][0]),
    )


def _changed(again: list[tuple[Comparison, Comparison]], sense: str) -> Changed:
    """Compare the verdicts of rows in one of the two senses, if both have it."""
    judged = [(row, getattr(row, sense), getattr(other, sense)) for row, other in again]
    verdicts = [
        (row, one.verdict, other.verdict) for row, one, other in judged if one is not None and other is not None
    ]
    changed = [(row, before, after) for row, before, after in verdicts if before != after]
    signs = sum({before, after} == {"better", "worse"} for _, before, after in changed)
    rows = [
        f"{row.method} − {row.against}, {row.metric} at equal {row.budget}, {row.scene}: {before} → {after}"
        for row, before, after in changed
    ]
    return Changed(sense, len(verdicts), len(changed), signs, rows)


def as_json(found: TwoRuns) -> dict[str, Any]:
    return {"schema": 1, **asdict(found)}


def lines_of(found: TwoRuns) -> list[str]:
    """Return the lines of a table for the terminal."""
    lines = [f"{name}: {', '.join(one)} | {', '.join(other)}" for name, (one, other) in found.origins.items()]
    total = found.all.cells if found.all else 0
    lines += [f"{found.identical} of {total + len(found.lost)} cells are the same to the last bit", *found.lost, ""]
    lines += [f"{'test PSNR':<24}{'cells':>6}{'RMS dB':>9}{'mean dB':>9}{'largest':>9}"]
    for one in [*found.by_method, *found.by_scene, *([found.all] if found.all else [])]:
        figures = f"{one.rms:>9.3f}{one.mean:>+9.3f}{one.largest:>+9.3f}"
        lines.append(f"{one.where:<24}{one.cells:>6}{figures}  {one.largest_of}")
    for change in found.changed:
        words = change.sense.replace("_", " ")
        lines += ["", f"verdicts {'on ' if words[0] == 's' else ''}{words}: {change.verdicts} of {change.compared} "
                  f"changed, {change.signs} in sign", *(f"  {row}" for row in change.rows)]  # fmt: skip
    return [*lines, "", "over all scenes, PSNR at equal steps:", *(f"  {row}" for row in found.headline)]
