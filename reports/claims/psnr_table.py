"""PSNR scene by scene: every method with its spread, ceiling and floor, and the differences with their verdicts."""

from collections import Counter

from harness.records.cells import CellRecord, Comparison
from harness.records.metric_table import metric_of
from reports.claims.headline import BUDGETS, roles
from reports.data.load import Records
from reports.data.selection import Selection, behind_difference
from reports.data.table import Spread, average_of, cells_frame, shared_scenes, spread_of
from reports.data.wording import NOTHING, counted, interval, number, signed
from reports.page.grid import EMPTY, Column, Entry, Grid

LIMITED_DB = 1.0
"""The distance to its ceiling below which a score says more about the ground truth than about the method."""
TOGETHER = (
    "Where several are looked at together, the verdict is taken from the wider interval of them all: all of these hold "
    "the truth in 95 %."
)
FAILURES = {"diverged": "diverged", "error": "failed", "not_available": "not available"}


def scores_grid(records: Records) -> Grid:
    """Tabulate mean test PSNR ± standard deviation over seeds; train PSNR below it; the paper's values beside."""
    frame, printed = cells_frame(records), _printed(records)
    columns = [Column("scene", numeric=False), Column("floor", small="copy the nearest view")]
    columns += [Column(method, method) for method in records.methods]
    columns.append(Column("ceiling", small="noise of the truth"))
    columns += [Column(name, small="paper") for name in ("NeRF", "Q-NeRF")] if printed else []
    rows = []
    for scene in records.scenes:
        about = records.scene(scene)
        ceiling = about.psnr_ceiling if about else None
        row = [Entry(scene), _level([about.psnr_floor if about else None])]
        for method in records.methods:
            test, train = (spread_of(frame, scene, method, score) for score in ("psnr", "psnr_train"))
            behind = Selection(scene, method, metric="psnr")
            row.append(score_entry(test, train, records.cells_of(scene, method), ceiling, behind))
        row.append(Entry(number(ceiling, 1), tone="muted"))
        rows.append(row + [_level([value]) for value in printed.get(scene.lower(), (None, None))] * bool(printed))
    note = (
        "Test PSNR in dB, per image and then averaged; ± is the sample standard deviation over the finished seeds. "
        "The smaller line is PSNR on training views: a wide gap means that views were memorised. "
        "Reference-limited: within 1 dB of the ceiling that the noise of the ground truth sets."
    )
    scenes = shared_scenes(frame, "psnr")
    totals = [_average(records, scenes, printed)] if len(scenes) > 1 else []
    return Grid("Test PSNR", columns, rows, totals, note)


def _average(records: Records, scenes: list[str], printed: dict[str, tuple[float, float]]) -> list[Entry]:
    frame, about = cells_frame(records), [records.scene(scene) for scene in scenes]
    every = len(scenes) == len(records.scenes)
    row = [Entry("mean" if every else f"mean of {len(scenes)} of {len(records.scenes)} scenes")]
    row.append(_level([one.psnr_floor if one else None for one in about]))
    for method in records.methods:
        test, train = (average_of(frame, method, score, scenes) for score in ("psnr", "psnr_train"))
        row.append(score_entry(test, train, [], behind=Selection(method=method, metric="psnr")))
    row.append(_level([one.psnr_ceiling if one else None for one in about]))
    if printed:
        pairs = [printed.get(scene, (None, None)) for scene in scenes]
        row += [_level([pair[place] for pair in pairs]) for place in (0, 1)]
    return row


def _level(values: list[float | None]) -> Entry:
    """Return the mean, if none is missing."""
    there = [value for value in values if value is not None]
    return Entry(number(sum(there) / len(there), 1), tone="muted") if there and len(there) == len(values) else EMPTY


def score_entry(
    test: Spread, train: Spread, cells: list[CellRecord], ceiling: float | None = None, behind: Selection | None = None
) -> Entry:
    """Return the mean of the finished seeds; unfinished ones are named in the same cell, and so is a score that the
    noise of the ground truth limits.
    """
    lost = losses(cells)
    if test.mean is None:
        return Entry(lost or "–", reason_of(cells), tone_of(cells) or "muted", runs=behind)
    text = number(test.mean) + (f" ± {number(test.sd)}" if test.sd is not None else "")
    parts = [f"train {number(train.mean)}"] if train.mean is not None else []
    parts += ["reference-limited"] if ceiling is not None and test.mean > ceiling - LIMITED_DB else []
    parts += [lost] if lost else []
    further = {"sd": test.sd, "train": train.mean}
    return Entry(text, lines(*parts), tone_of(cells), test.mean, further, behind)


def tone_of(cells: list[CellRecord]) -> str:
    """Return `failed` if a cell did; an unavailable one is no failure."""
    if any(cell.status in ("diverged", "error") for cell in cells):
        return "failed"
    return "muted" if any(cell.status == "not_available" for cell in cells) else ""


def reason_of(cells: list[CellRecord]) -> str:
    """Return why a method was not available, if that is the same for all cells."""
    reasons = {cell.reason or "" for cell in cells if cell.status == "not_available"}
    return reasons.pop() if len(reasons) == 1 else ""


def losses(cells: list[CellRecord]) -> str:
    """Return `1 of 3 diverged`, or nothing."""
    many = Counter[str](cell.status for cell in cells)
    return ", ".join(f"{many[status]} of {len(cells)} {name}" for status, name in FAILURES.items() if many[status])


def differences_grids(records: Records) -> list[Grid]:
    """Tabulate for each contender its difference to baseline and control, at equal steps and equal time."""
    cast = roles(records)
    found = []
    for method in cast.contenders:
        pairs = [
            (rival, *budget)
            for budget in BUDGETS
            for rival in (cast.baseline, cast.control)
            if rival
            and any(records.comparison(scene, method, rival, budget=budget[0]) for scene in [*records.scenes, "all"])
        ]
        if pairs:
            found.append(_differences(records, method, pairs, cast.control))
    return found


def _differences(records: Records, method: str, pairs: list[tuple[str, str, str]], control: str | None) -> Grid:
    printed = _printed(records) if method == "qnerf" else {}
    gains = [values[1] - values[0] if (values := printed.get(scene.lower())) else None for scene in records.scenes]
    columns = [Column("scene", numeric=False)]
    columns += [Column(f"− {rival}", rival, f"at {words}") for rival, _, words in pairs]
    columns += [Column("Δ", small="paper")] if printed else []
    known = [gain for gain in gains if gain is not None]
    mean = sum(known) / len(known) if known and len(known) == len(gains) else None
    rows = []
    for scene, gain in zip([*records.scenes, "all"], [*gains, mean], strict=True):
        row = [Entry("all scenes" if scene == "all" else scene)]
        row += [difference_entry(records.comparison(scene, method, rival, budget=name)) for rival, name, _ in pairs]
        rows.append(row + [Entry(signed(gain, 1), tone="muted")] * bool(printed))
    note = "Difference in test PSNR (dB), the 95 % interval that the verdict is taken from, and the verdict. "
    note += "A scene's interval is over seeds, that of all scenes on scenes like these."
    note += f" {TOGETHER}" if any(one.family > 1 and one.simultaneous for one in records.comparisons) else ""
    note += f" Against {control}, what bandwidth alone brings is gone." if control and method != control else ""
    return Grid(f"{method}: difference in PSNR", columns, rows[:-1], rows[-1:], note)


def difference_entry(one: Comparison | None) -> Entry:
    """Return `+0.82`, below it interval and verdict, and how many cells could not be paired."""
    if one is None:
        return EMPTY
    aside = f"{counted(one.unpaired, 'pair')} not judged" if one.unpaired else ""
    behind = behind_difference(one)
    if one.difference is None:
        return Entry(NOTHING, lines(one.verdict, aside), one.verdict, runs=behind)
    digits = metric_of(one.metric).digits_of_difference
    pair = one.simultaneous or one.interval
    small = lines(interval(pair, digits), one.verdict, aside)
    low, high = pair or (None, None)
    return Entry(signed(one.difference, digits), small, one.verdict, one.difference, {"low": low, "high": high}, behind)


def lines(*parts: str) -> str:
    return "\n".join(filter(None, parts))


def _printed(records: Records) -> dict[str, tuple[float, float]]:
    """Map scene of the run, in lower case → what the paper prints of NeRF and of Q-NeRF."""
    known = {scene.lower() for scene in records.scenes}
    table = {scene.lower(): row for scene, row in (records.run.paper.get("table2") or {}).items()}
    return {scene: (row["nerf"], row["qnerf"]) for scene, row in table.items() if scene in known}
