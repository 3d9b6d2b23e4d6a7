"""PSNR by scene: every method with its spread, ceiling and floor, and the differences with their verdicts."""

from collections import Counter
from statistics import fmean

from harness.records.cells import Budget, CellRecord, Comparison
from harness.records.metric_table import metric_of
from harness.records.verdict import phrase_with
from harness.verdicts.estimates.multiplicity import benjamini_hochberg
from harness.verdicts.failures import COLLAPSED, is_lost, state_of
from harness.verdicts.last_doubling import LastDoubling, last_doublings
from reports.data.load import Records
from reports.data.outcome import robust_in_words
from reports.data.selection import Selection, behind_difference
from reports.data.table import Spread, average_of, cells_frame, shared_scenes, spread_of
from reports.data.wording import BUDGETS, DISCOVERIES, NOTHING, counted, interval, number, signed, tone_of_sign
from reports.page.grid import EMPTY, Column, Entry, Grid

TOGETHER = (
    "Where several are looked at together, the verdict is taken from wider intervals (Bonferroni): all of these hold "
    "the truth in 95 %."
)
SPENT = (
    "Gain of the last doubling: PSNR at the end less that at half of the steps, while the learning rate still falls; "
    "the mean over scenes with its 95 % interval. Core seconds are processor time of all threads, only in training (on "
    "a GPU the host's), below them wall time."
)
FAILURES = {
    "diverged": "diverged",
    COLLAPSED: "ended in empty collapse",
    "error": "failed",
    "not_available": "not available",
}


def scores_grid(records: Records) -> Grid:
    """Tabulate mean test PSNR ± standard deviation over seeds; train PSNR below it; what is printed of the methods."""
    frame, printed = cells_frame(records), printed_methods(records)
    # the compared methods first: on a phone they are visible without scrolling
    methods = list(dict.fromkeys([records.baseline, *records.contenders[:1], *records.methods]))
    columns = [Column("scene", numeric=False), *(Column(method, method) for method in methods)]
    columns += [Column("floor", small="copy the nearest view"), Column("ceiling", small="noise of the truth")]
    columns += [Column(name, small="printed") for _, name in printed]

    def row(title: str, scenes: list[str], scene: str = "") -> list[Entry]:
        about = [records.scene(name) for name in scenes]
        floors, ceilings = ([getattr(each, name, None) for each in about] for name in ("psnr_floor", "psnr_ceiling"))
        entries = [Entry(title)]
        for method in methods:
            test, train = (
                spread_of(frame, scene, method, score) if scene else average_of(frame, method, score, scenes)
                for score in ("psnr", "psnr_train")
            )
            cells = records.cells_of(scene, method) if scene else []
            behind = Selection(scene, method, metric="psnr")
            entries.append(score_entry(test, train, cells, ceilings[0] if scene else None, behind))
        entries += [_level(floors), _level(ceilings)]
        of_scenes = [_printed(records, name) for name in scenes]
        return entries + [_level([row.get(method) for row in of_scenes]) for method, _ in printed]

    note = (
        "Test PSNR in dB, per image and then averaged; ± is the sample standard deviation over the finished seeds. "
        "The smaller line is PSNR on training views: a wide gap means that views were memorised. "
        "Reference-limited: within 1 dB of the ceiling that the noise of the ground truth sets."
    )
    note += f" {SPENT}"
    shared, every = shared_scenes(frame, "psnr"), len(records.scenes)
    title = "mean" if len(shared) == every else f"mean of {len(shared)} of {every} scenes"
    totals = [row(title, shared)] if len(shared) > 1 else []
    gains = map(gain_entry, last_doublings(records.cells, methods))
    spent = [
        spent_entry([cell for cell in records.cells if (cell.method, cell.status) == (method, "done")])
        for method in methods
    ]
    for words, entries in (("gain of the last doubling, dB", gains), ("training of a cell", spent)):
        totals.append([Entry(words), *entries, *[Entry("")] * (2 + len(printed))])
    return Grid("Test PSNR", columns, [row(scene, [scene], scene) for scene in records.scenes], totals, note)


def gain_entry(row: LastDoubling) -> Entry:
    behind = Selection("", row.method, metric="psnr")
    return Entry(signed(row.gain), interval(row.interval), "", row.gain, ends_of(row.interval), behind)


def ends_of(pair: tuple[float, float] | None) -> dict[str, float | None]:
    low, high = pair or (None, None)
    return {"low": low, "high": high}


def spent_entry(cells: list[CellRecord]) -> Entry:
    """Return the mean core seconds of training, below them wall seconds; only wall seconds if a cell has no others."""
    if not any(cell.steps for cell in cells):
        return EMPTY
    wall = fmean(cell.train_seconds for cell in cells)
    known = [cell.train_core_seconds for cell in cells if cell.train_core_seconds is not None]
    if len(known) < len(cells):
        return Entry(f"{number(wall, 1)} s", value=wall)
    return Entry(f"{number(fmean(known), 1)} core s", f"{number(wall, 1)} s", value=fmean(known), parts={"wall": wall})


def _level(values: list[float | None]) -> Entry:
    known = [value for value in values if value is not None]
    if not known or len(known) < len(values):
        return EMPTY
    mean = fmean(known)
    return Entry(number(mean, 1), tone="muted", value=mean)


def score_entry(
    test: Spread, train: Spread, cells: list[CellRecord], ceiling: float | None = None, behind: Selection | None = None
) -> Entry:
    """Return the mean of the finished seeds; below it the lost seeds, and whether the noise of the truth limits it."""
    lost = losses(cells)
    if test.mean is None:
        return Entry(lost or NOTHING, reason_of(cells), tone_of(cells) or "muted", runs=behind)
    text = number(test.mean) + (f" ± {number(test.sd)}" if test.sd is not None else "")
    parts = [f"train {number(train.mean)}"] if train.mean is not None else []
    parts += ["reference-limited"] if ceiling is not None and test.mean > ceiling - 1.0 else []
    parts += [lost] if lost else []
    further = {"sd": test.sd, "train": train.mean}
    return Entry(text, lines(*parts), tone_of(cells), test.mean, further, behind)


def tone_of(cells: list[CellRecord]) -> str:
    """Return `failed` if a cell failed; a method that was not available did not fail."""
    if any(is_lost(cell) for cell in cells):
        return "failed"
    return "muted" if any(cell.status == "not_available" for cell in cells) else ""


def reason_of(cells: list[CellRecord]) -> str:
    reasons = {cell.reason or "" for cell in cells if cell.status == "not_available"}
    return reasons.pop() if len(reasons) == 1 else ""


def losses(cells: list[CellRecord]) -> str:
    """Format `1 of 3 diverged`, or nothing."""
    many = Counter(map(state_of, cells))
    return ", ".join(f"{many[status]} of {len(cells)} {name}" for status, name in FAILURES.items() if many[status])


def differences_grids(records: Records) -> list[Grid]:
    """Tabulate each contender's difference from baseline and control, at equal steps and equal time."""
    grids = []
    for method in records.contenders:
        pairs = [
            (rival, budget)
            for budget in records.budgets
            for rival in records.rivals
            if any(records.comparison(scene, method, rival, budget=budget) for scene in [*records.scenes, "all"])
        ]
        if pairs:
            grids.append(_differences(records, method, pairs, records.control))
    return grids


def _differences(records: Records, method: str, pairs: list[tuple[str, Budget]], control: str | None) -> Grid:
    printed = printed_gains(records, records.scenes, method, pairs[0][0])
    columns = [Column("scene", numeric=False)]
    columns += [Column(f"− {rival}", rival, f"at {BUDGETS[budget]}") for rival, budget in pairs]
    columns += [Column("Δ", small="printed")] if printed else []
    compared = {
        (scene, rival, budget): records.comparison(scene, method, rival, budget=budget)
        for scene in records.scenes
        for rival, budget in pairs
    }
    q = dict(zip(compared, benjamini_hochberg([row.p if row else None for row in compared.values()]), strict=True))
    rows = []
    for scene in [*records.scenes, "all"]:
        row = [Entry("all scenes" if scene == "all" else scene)]
        row += [
            difference_entry(records.comparison(scene, method, rival, budget=budget), q.get((scene, rival, budget)))
            for rival, budget in pairs
        ]
        gain = printed.get(scene)
        rows.append(row + [Entry(signed(gain, 1), tone="muted", value=gain)] * bool(printed))
    note = "Difference in test PSNR (dB), the 95 % interval that the verdict is taken from, and its sign and size. "
    note += "A scene's interval is over seeds, that of all scenes on scenes like these."
    note += f" {DISCOVERIES}" if any(each is not None for each in q.values()) else ""
    note += f" {TOGETHER}" if any(row.family > 1 and row.simultaneous for row in records.comparisons) else ""
    note += f" The column − {control} removes the effect of bandwidth." if control and method != control else ""
    return Grid(f"{method}: difference in PSNR", columns, rows[:-1], rows[-1:], note)


def difference_entry(row: Comparison | None, q: float | None = None) -> Entry:
    """Format `+0.82`, below it interval, verdict and q-value, and how many cells could not be paired."""
    if row is None:
        return EMPTY
    lost = f"{counted(row.unpaired, 'pair')} not judged" if row.unpaired else ""
    behind = behind_difference(row)
    if row.difference is None:
        return Entry(NOTHING, lines(row.verdict.phrase, lost), "open", runs=behind)
    metric = metric_of(row.metric)
    digits, tone = metric.digits_of_difference, tone_of_sign(row.verdict.sign, metric.higher_is_better)
    pair = row.simultaneous or row.interval
    adjusted = "" if q is None else f"q = {number(q, 3)}"
    small = lines(interval(pair, digits), phrase_with(row.verdict, pair), adjusted, robust_in_words(row), lost)
    return Entry(signed(row.difference, digits), small, tone, row.difference, ends_of(pair), behind)


def lines(*parts: str) -> str:
    return "\n".join(filter(None, parts))


def printed_methods(records: Records) -> list[tuple[str, str]]:
    """Return the methods of the run whose PSNR a source prints on a scene of the run, with their names there."""
    files, every = records.run.claims or [], [_printed(records, scene) for scene in records.scenes]
    names = {method: name for file in files for method, name in file.names.items()}
    return [(method, names.get(method, method)) for method in records.methods if any(method in row for row in every)]


def _printed(records: Records, scene: str) -> dict[str, float]:
    """Map method → its printed PSNR on a scene of the run, whose name may differ in case."""
    rows = [
        row for file in records.run.claims or [] for name, row in file.scenes.items() if name.lower() == scene.lower()
    ]
    return {method: value for row in reversed(rows) for method, value in row.items()}


def printed_gains(records: Records, scenes: list[str], method: str, against: str) -> dict[str, float]:
    """Map scene → the printed difference of two methods, and `all` → its mean if it is printed for each scene."""
    rows = {scene: row for scene in scenes if {method, against} <= (row := _printed(records, scene)).keys()}
    # decimals are not binary fractions
    gains = {scene: round(row[method] - row[against], 9) for scene, row in rows.items()}
    return gains | ({"all": sum(gains.values()) / len(gains)} if gains and len(gains) == len(scenes) else {})
