"""Two outputs of the same plan, cell by cell: how far another processor, or another try, moves scores and verdicts."""

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.records.cells import CellRecord, Comparison, RunRecord, read_cells, read_run
from harness.verdicts.comparisons import compare
from scenes.files.errors import InputError

OF_THE_MACHINE = ("precision", "device", "threads")
"""The settings that a plan leaves to the machine."""
PLACE = ("processor", "instruction_set", "threads", "device", "commit")
"""The parts of the origin of cells that are shown side by side."""
Key = tuple[str, str, int]


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
    """The differences between the machines."""
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
    runs, cells = [_run(out) for out in (first, second)], [_cells(out) for out in (first, second)]
    _refuse_other_plans(runs, cells, (first, second))
    pairs = [(cells[0][key], cells[1][key]) for key in sorted(cells[0])]
    scored = [(one, other) for one, other in pairs if None not in (one.scores.get("psnr"), other.scores.get("psnr"))]
    rows = [compare(list(found.values()), list(runs[0].methods)) for found in cells]
    methods, scenes = (list(dict.fromkeys(getattr(one, name) for one, _ in scored)) for name in ("method", "scene"))
    return TwoRuns(
        {name: sides for name in PLACE if (sides := _origins(cells, name))[0] != sides[1]},
        sum(one.scores == other.scores for one, other in pairs),
        [f"{_named(one)}: {one.status}, then {other.status}" for one, other in pairs if (one, other) not in scored],
        [_apart(name, [pair for pair in scored if pair[0].method == name]) for name in methods],
        [_apart(name, [pair for pair in scored if pair[0].scene == name]) for name in scenes],
        _apart("all", scored) if scored else None,
        [_changed(rows[0], rows[1], sense) for sense in ("on_these_scenes", "scenes_like_these")],
        list(_headline(rows[0], rows[1])),
    )


def _run(out: Path) -> RunRecord:
    if not (out / "records" / "run.json").is_file():
        raise InputError(f"{out}: no run in it; name the output folder of a run, for instance out/latest")
    return read_run(out)


def _cells(out: Path) -> dict[Key, CellRecord]:
    return {(one.scene, one.method, one.seed): one for one in read_cells(out)}


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


def _origins(cells: list[dict[Key, CellRecord]], name: str) -> tuple[list[str], list[str]]:
    first, second = (
        sorted({str(one.provenance.get(name, "not recorded")) for one in found.values()}) for found in cells
    )
    return first, second


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


def _changed(first: list[Comparison], second: list[Comparison], sense: str) -> Changed:
    pairs = [
        (row, one.verdict, other.verdict)
        for row, again in zip(first, second, strict=True)
        if (one := getattr(row, sense)) is not None and (other := getattr(again, sense)) is not None
    ]
    changed = [pair for pair in pairs if pair[1] != pair[2]]
    return Changed(
        sense,
        len(pairs),
        len(changed),
        sum({before, after} == {"better", "worse"} for _, before, after in changed),
        [
            f"{row.method} − {row.against}, {row.metric} at equal {row.budget}, {row.scene}: {before} → {after}"
            for row, before, after in changed
        ],
    )


def _headline(first: list[Comparison], second: list[Comparison]) -> Iterable[str]:
    """Return the comparison of PSNR over all scenes at equal steps."""
    for one, other in zip(first, second, strict=True):
        if (one.scene, one.metric, one.budget) == ("all", "psnr", "steps") and None not in (
            one.difference,
            other.difference,
        ):
            yield (
                f"{one.method} − {one.against}: {one.difference:+.2f} dB ({one.verdict}) → "
                f"{other.difference:+.2f} dB ({other.verdict})"
            )


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
