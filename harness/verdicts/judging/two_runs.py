"""Two outputs of the same plan, cell by cell: how far another processor or another try moves scores and differences."""

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from harness.records.cells import Budget, CellRecord, Estimate, Roles, RunRecord, read_cells, read_run
from harness.records.json_record import flat, plain
from harness.records.verdict import Verdict
from harness.verdicts.changes import Condition, changes
from harness.verdicts.comparisons import Key, budgets_of, compare
from harness.verdicts.headline_family import headline_budgets
from scenes.files.errors import InputError

OF_THE_MACHINE = ("precision", "device", "threads")
"""The settings that a plan leaves to the machine."""
PLACE = ("processor", "instruction_set", "threads", "waiting", "device", "commit")
"""The parts of the provenance of cells that are compared."""


@dataclass(frozen=True)
class Apart:
    """The differences of test PSNR between cells of the same scene, method and seed."""

    where: str
    """The method or scene, or `all`."""
    cells: int
    rms: float
    """The root mean square of the differences, dB."""
    mean: float
    """The mean of second − first, dB."""
    largest: float
    largest_of: str


@dataclass(frozen=True)
class Moved:
    """The change of the difference of two methods from the first output to the second, PSNR at an equal budget."""

    method: str
    against: str
    budget: Budget
    difference: float
    """The mean change over scenes, dB."""
    on_these_scenes: Estimate | None
    scenes_like_these: Estimate | None


@dataclass(frozen=True)
class OverAll:
    """PSNR at equal steps over all scenes, in both outputs."""

    method: str
    against: str
    differences: tuple[float, float]
    verdicts: tuple[Verdict, Verdict]


@dataclass(frozen=True)
class TwoRuns:
    origins: dict[str, tuple[list[str], list[str]]]
    identical: int
    """The number of cells with bit-identical scores."""
    lost: list[str]
    """The cells that have a score in only one output."""
    timed: list[str]
    """The methods with a budget of time: they took different numbers of steps, so they are not compared."""
    by_method: list[Apart]
    by_scene: list[Apart]
    all: Apart | None
    over_all: list[OverAll]
    moved: list[Moved]


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
    timed = {a.method for a, b in pairs if a.status == b.status == "done" and a.steps != b.steps}
    pairs = [pair for pair in pairs if pair[0].method not in timed]
    scored = [pair for pair in pairs if all(cell.scores.get("psnr") is not None for cell in pair)]
    methods = [name for name in runs[0].main_methods if any(name == pair[0].method for pair in pairs)]
    sides = [[pair[side] for pair in pairs if pair[0].method in methods] for side in (0, 1)]
    origins = {}
    for name in PLACE:
        before, after = ({str(cell.provenance.get(name, "not recorded")) for cell in side.values()} for side in cells)
        if before != after:
            origins[name] = (sorted(before), sorted(after))
    before, after = ({str(dict(flat(run.settings)).get("train.precision", "not recorded"))} for run in runs)
    if before != after:
        origins["precision"] = (sorted(before), sorted(after))

    def apart_by(kind: str) -> list[Apart]:
        names = dict.fromkeys(getattr(cell, kind) for cell, _ in scored)
        return [_apart(name, [pair for pair in scored if getattr(pair[0], kind) == name]) for name in names]

    return TwoRuns(
        origins=origins,
        identical=sum(before.scores == after.scores for before, after in pairs),
        lost=[f"{_named(pair[0])}: {pair[0].status}, then {pair[1].status}" for pair in pairs if pair not in scored],
        timed=sorted(timed),
        by_method=apart_by("method"),
        by_scene=apart_by("scene"),
        all=_apart("all", scored) if scored else None,
        over_all=_over_all(methods, runs[0].roles, *sides),
        moved=_moved(runs[0].roles.pairs(methods), *sides),
    )


def _over_all(methods: list[str], roles: Roles, first: list[CellRecord], second: list[CellRecord]) -> list[OverAll]:
    rows = [
        {
            (row.method, row.against): row
            for row in compare(side, methods, roles)
            if (row.scene, row.metric, row.budget) == ("all", "psnr", "steps") and row.difference is not None
        }
        for side in (first, second)
    ]
    both = {pair: (before, rows[1][pair]) for pair, before in rows[0].items() if pair in rows[1]}
    return [
        OverAll(*pair, (before.difference or 0.0, after.difference or 0.0), (before.verdict, after.verdict))
        for pair, (before, after) in both.items()
    ]


def _refuse_other_plans(runs: list[RunRecord], cells: list[dict[Key, CellRecord]], outs: tuple[Path, Path]) -> None:
    where = f"{outs[0]} and {outs[1]} are not outputs of the same plan"
    remedy = "run the second with the command of the first"
    for place, name in enumerate(("scenes", "methods", "seeds")):
        sides = [sorted({str(key[place]) for key in side}) for side in cells]
        if sides[0] != sides[1]:
            raise InputError(f"{where}: {name} {', '.join(sides[0])} against {', '.join(sides[1])}; {remedy}")
    if alone := sorted(cells[0].keys() ^ cells[1].keys()):
        raise InputError(f"{where}: {' '.join(map(str, alone[0]))} is in only one of them; finish both with --resume")
    settings = [dict(flat(run.settings)) for run in runs]
    for name in sorted(settings[0].keys() | settings[1].keys()):
        values = [side.get(name) for side in settings]
        if values[0] != values[1] and not any(word in name for word in OF_THE_MACHINE):
            raise InputError(f"{where}: {name} is {values[0]} against {values[1]}; {remedy}")


def _named(cell: CellRecord) -> str:
    return f"{cell.scene} {cell.method} seed {cell.seed}"


def _apart(where: str, pairs: list[tuple[CellRecord, CellRecord]]) -> Apart:
    before, after = (np.array([pair[side].scores["psnr"] for pair in pairs], dtype=np.float64) for side in (0, 1))
    differences = after - before
    worst = int(np.abs(differences).argmax())
    rms, mean, largest = math.sqrt(float((differences**2).mean())), float(differences.mean()), float(differences[worst])
    return Apart(where, len(pairs), rms, mean, largest, _named(pairs[worst][0]))


def _moved(pairs: list[tuple[str, str]], first: list[CellRecord], second: list[CellRecord]) -> list[Moved]:
    budgets = headline_budgets([budget for budget in budgets_of(first) if budget in budgets_of(second)])
    moved = []
    for budget in budgets:
        for change in changes(pairs, Condition(first, budget), Condition(second, budget)):
            judgement = change.judgement
            estimates = judgement.on_these_scenes, judgement.scenes_like_these
            moved.append(Moved(change.method, change.against, budget, judgement.difference or 0.0, *estimates))
    return moved


def as_json(runs: TwoRuns) -> dict[str, object]:
    data: dict[str, object] = plain({"schema": 1, **asdict(runs)})
    return data


def lines_of(runs: TwoRuns) -> list[str]:
    lines = [f"{name}: {', '.join(before)} | {', '.join(after)}" for name, (before, after) in runs.origins.items()]
    total = runs.all.cells if runs.all else 0
    lines += [f"{runs.identical} of {total + len(runs.lost)} cells are bit-identical", *runs.lost]
    lines += [f"{name}: its budget is time, so its steps differ; not compared" for name in runs.timed]
    rows = [*runs.by_method, *runs.by_scene, *([runs.all] if runs.all else [])]
    width = max(map(len, ["test PSNR", *(apart.where for apart in rows)]))
    lines += ["", f"{'test PSNR':<{width}}{'cells':>7}{'RMS dB':>9}{'mean dB':>9}{'largest':>9}"]
    for apart in rows:
        figures = f"{apart.rms:>9.3f}{apart.mean:>+9.3f}{apart.largest:>+9.3f}"
        lines.append(f"{apart.where:<{width}}{apart.cells:>7}{figures}  {apart.largest_of}")
    return [*lines, *_lines_of_changes(runs)]


def _lines_of_changes(runs: TwoRuns) -> Iterable[str]:
    over_all = {(row.method, row.against): row for row in runs.over_all}
    yield "\nhow much differences of test PSNR changed, second − first (95 %, of all pairs together):"
    for moved in runs.moved:
        both = over_all.get((moved.method, moved.against)) if moved.budget == "steps" else None
        values = f" ({both.differences[0]:+.2f} → {both.differences[1]:+.2f} dB)" if both else ""
        yield f"  {moved.method} − {moved.against} at equal {moved.budget.replace('_', ' ')}{values}"
        for sense, estimate in (
            ("on these scenes", moved.on_these_scenes),
            ("scenes like these", moved.scenes_like_these),
        ):
            if estimate is not None and estimate.simultaneous is not None:
                low, high = estimate.simultaneous
                yield f"    {sense:<17} {moved.difference:+.3f} dB [{low:+.3f}, {high:+.3f}] {estimate.verdict.phrase}"
            elif estimate is not None:
                yield f"    {sense:<17} {moved.difference:+.3f} dB, without an interval"
