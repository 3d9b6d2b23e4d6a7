"""Tables of a run other than PSNR: other scores, every comparison, properties, weights, costs, and what went wrong."""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from statistics import fmean

from harness.records.cells import CellRecord, LeftOut
from harness.records.metric_table import METRICS, Metric, metric_of
from harness.verdicts.estimates.multiplicity import benjamini_hochberg
from harness.verdicts.training_cost import CostRatio, cost_ratios
from reports.claims.arithmetic import COMPONENT_TITLES
from reports.claims.psnr_table import (
    FAILURES,
    TOGETHER,
    difference_entry,
    ends_of,
    losses,
    spent_entry,
    tone_of,
)
from reports.data.load import Records
from reports.data.selection import Selection
from reports.data.table import average_of, cells_frame, shared_scenes, spread_of
from reports.data.wording import (
    BUDGETS,
    DISCOVERIES,
    NARROW,
    count,
    duration,
    interval,
    listed,
    number,
    signed,
    significant,
)
from reports.page.grid import EMPTY, Q_COLUMN, Column, Entry, Grid, q_entry, without_empty_columns


def metrics_grid(records: Records) -> Grid:
    frame = cells_frame(records)
    shown = [metric for metric in METRICS.values() if frame[metric.name].notna().any()]
    columns = [Column("scene", numeric=False), Column("method", numeric=False)]
    columns += [
        Column(f"{metric.label} {'↑' if metric.higher_is_better else '↓'}", small=metric.unit) for metric in shown
    ]
    rows, totals = [], []
    for scene in records.scenes:
        for place, method in enumerate(records.methods):
            cells, behind = records.cells_of(scene, method), Selection(scene, method)
            if not cells:
                continue
            row = [Entry(scene if place == 0 else "", value=scene)]
            row.append(Entry(method, losses(cells), tone_of(cells), runs=behind))
            means = [spread_of(frame, scene, method, metric.name).mean for metric in shown]
            rows.append([*row, *map(score, means, shown, [behind] * len(shown))])
    for place, method in enumerate(records.methods if len(records.scenes) > 1 else []):
        row = [Entry("mean" if place == 0 else "", value="mean"), Entry(method)]
        means = [average_of(frame, method, metric.name, shared_scenes(frame, metric.name)).mean for metric in shown]
        totals.append([*row, *map(score, means, shown, [Selection("", method)] * len(shown))])
    note = "; ".join(f"{metric.label}: {metric.meaning}" for metric in shown)
    return Grid("All scores", columns, rows, totals, f"Arrows point to the better side. {note}.")


def score(mean: float | None, metric: Metric, behind: Selection) -> Entry:
    if mean is None:
        return EMPTY
    return Entry(number(mean, metric.digits), value=mean, runs=replace(behind, metric=metric.name))


def comparisons_grid(records: Records) -> Grid:
    """Tabulate every comparison of the run, with the smallest true difference whose sign it would have found."""
    names = ("scene", "method − against", "metric", "at equal")
    columns = [Column(name, numeric=False) for name in names]
    columns += [Column("difference"), Q_COLUMN]
    columns += [Column("smallest detectable"), Column("pairs")]
    rows = []
    adjusted = benjamini_hochberg([comparison.p for comparison in records.comparisons])
    for comparison, q in zip(records.comparisons, adjusted, strict=True):
        metric, least = metric_of(comparison.metric), comparison.smallest_detectable
        rows.append(
            [
                Entry("all scenes" if comparison.scene == "all" else comparison.scene),
                Entry(f"{comparison.method} − {comparison.against}"),
                Entry(metric.label),
                Entry(BUDGETS[comparison.budget].removeprefix("equal ")),
                difference_entry(comparison),
                q_entry(q),
                Entry(number(least, metric.digits_of_difference), value=least),
                Entry(str(comparison.pairs), value=comparison.pairs),
            ]
        )
    note = (
        "Smallest detectable: the true difference whose sign a comparison with just this spread finds in "
        "80 % of repetitions. Looked at together are all scenes for PSNR, all other metrics over all scenes, and these "
        f"scene by scene; PSNR over all scenes is the family of the headline. {DISCOVERIES} {TOGETHER}"
    )
    return without_empty_columns(Grid("Every comparison", columns, rows, note=note), always=5)


PROPERTY_NAMES = {
    "chunk_max_difference": "largest change of a pixel when a view is rendered in small chunks",
    "chunk_rms_difference": "RMS change of a view when rendered in small chunks",
    "largest_density": "largest density measured, per half of the box’s longest side",
    "opacity_unit_slab": "opacity of that length of it",
    "density_limit": "largest density that the method can have, per half of the box’s longest side",
    "opacity_of_a_pixel": "opacity of geometry one pixel thick at that density",
    "weight_at_ceiling": "share of the pictures’ weight from densities of 0.99 of it or more",
    "density_by_weight_50": "density up to which half of the pictures’ weight lies",
    "density_by_weight_90": "density up to which 90 % of it lies",
    "density_by_weight_99": "density up to which 99 % of it lies",
    "normal_error": "mean angle between learned and true normals, in degrees, where both are opaque",
    "occupied_share": "share of the scene's box that holds geometry",
}


def properties_grid(records: Records) -> Grid:
    """Tabulate each property by method: the mean over its cells and, if they differ, the range."""
    columns = [Column("property", numeric=False), *(Column(method, method) for method in records.methods)]
    rows = []
    for name in dict.fromkeys(name for cell in records.cells for name in cell.properties):
        row = [Entry(PROPERTY_NAMES.get(name, name.replace("_", " ")), name if name in PROPERTY_NAMES else "")]
        for method in records.methods:
            values = [cell.properties.get(name) for cell in records.cells if cell.method == method]
            row.append(_property_entry(values, Selection(method=method)))
        rows.append(row)
    return Grid("Measured properties", columns, [row for row in rows if any(entry != EMPTY for entry in row[1:])])


def _property_entry(values: list[float | str | None], behind: Selection) -> Entry:
    words = dict.fromkeys(value for value in values if isinstance(value, str))
    if words:
        return Entry(", ".join(words), runs=behind)
    numbers = [float(value) for value in values if value is not None]
    if not numbers:
        return EMPTY
    low, high, mean = min(numbers), max(numbers), sum(numbers) / len(numbers)
    small = "" if significant(low) == significant(high) else f"{significant(low)} – {significant(high)}"
    return Entry(significant(mean), small, value=mean, parts={"low": low, "high": high}, runs=behind)


def parameters_grid(records: Records) -> Grid:
    """Tabulate the weights of the trained networks, Table 1 as printed, and the counts of the network it describes."""
    printed: dict[str, int] = {}
    measured: dict[str, int] = {}
    for file in records.run.claims or []:
        printed |= file.tables.get("weights", {})
        measured |= file.measured.get("weights", {})
    trained = {cell.method: cell.parameters for cell in records.cells if cell.parameters}
    sources = [(Column(method, method, "this run"), trained[method]) for method in records.methods if method in trained]
    sources += [(Column("printed"), printed)] if printed else []
    sources += [(Column("counted", small="at the printed size"), measured)] if measured else []
    columns = [Column("component", numeric=False), *(column for column, _ in sources)]
    names = dict.fromkeys(name for weights in (*trained.values(), printed, measured) for name in weights)
    order = list(COMPONENT_TITLES)
    rows = [
        [Entry(COMPONENT_TITLES.get(name, name.replace("_", " "))), *(_weights(own.get(name)) for _, own in sources)]
        for name in sorted(names, key=lambda name: order.index(name) if name in order else -1)
    ]
    totals = [row for row in rows if row[0].text == "total"]
    return Grid("Weights", columns, [row for row in rows if row not in totals], totals)


def _weights(value: object) -> Entry:
    return Entry(count(round(value)), value=value) if isinstance(value, int | float) else EMPTY


BYTES = ((1e9, "GB"), (1e6, "MB"), (1e3, "kB"))


def costs_grid(records: Records) -> Grid:
    """Tabulate the costs of training, drawing and storing a model of each method: means over its finished cells."""
    against = records.baseline
    columns = [Column("method", numeric=False), Column("training", small="per cell")]
    columns += [Column("multiple", small=f"of {against}’s"), Column("drawing", small="per test view")]
    columns += [Column("weights"), Column("file"), Column("memory"), Column("of the GPU")]
    every = records.pictured_cells
    multiples = {row.method: _multiple(row, against) for row in cost_ratios(records.cells, records.methods, against)}
    rows = []
    for method in records.pictured:
        cells = [cell for cell in every if (cell.method, cell.status) == (method, "done")]
        if not cells:
            continue
        view = _cost(fmean, cells, "view_seconds")
        weights = [cell.parameters["total"] for cell in cells if "total" in cell.parameters]
        rows.append(
            [
                Entry(method, runs=Selection("", method) if method in records.methods else None),
                spent_entry(cells),
                multiples.get(method, EMPTY),  # a guest's budget is the core seconds of nerf
                EMPTY if view is None else Entry(f"{significant(1000 * view)}{NARROW}ms", value=1000 * view),
                _weights(fmean(weights) if weights else None),
                _bytes(_cost(fmean, cells, "weights_bytes")),
                _bytes(_cost(max, cells, "memory_bytes")),
                _bytes(_cost(max, cells, "gpu_memory_bytes")),
            ]
        )
    note = (
        f"Training: core seconds, below them wall time, without scoring; as a multiple of {against}’s on the "
        "same scene and seed, for the same number of steps (geometric mean, 95 % interval). Drawing: wall time of a "
        "view at the end. Memory: the peak of the process, libraries included, which trains all methods of a scene and "
        "seed."
    )
    return without_empty_columns(Grid("What a method costs", columns, rows, note=note), always=3)


def _cost(over: Callable[[list[float]], float], cells: list[CellRecord], name: str) -> float | None:
    known = [cell.costs[name] for cell in cells if name in cell.costs]
    return over(known) if known else None


def _multiple(row: CostRatio, against: str) -> Entry:
    if row.method == against:
        return Entry("1", value=1.0)
    if row.ratio is None:
        return EMPTY
    small = f"[{', '.join(map(number, row.interval))}]" if row.interval else ""
    return Entry(f"× {number(row.ratio)}", small, "", row.ratio, ends_of(row.interval), Selection("", row.method))


def _bytes(amount: float | None) -> Entry:
    if amount is None:
        return EMPTY
    size, unit = next((known for known in BYTES if amount >= known[0]), BYTES[-1])
    return Entry(f"{number(amount / size, 1)}{NARROW}{unit}", value=amount)


def waiting(records: Records) -> str:
    """State how many cells waited for a processor; empty if none did."""
    slow = [cell for cell in records.cells if cell.waited]
    if not slow:
        return ""
    most, spun = max(cell.wall_per_core_second or 0.0 for cell in slow), sum(cell.spun for cell in slow)
    sentence = (
        f"{len(slow)} of {len(records.cells)} cells shared their processor: up to {number(most, 1)} seconds of the "
        "wall per core second. Other programs ran: scores are unaffected, wall times are too long."
    )
    if spun:
        sentence += f" Core seconds of {spun} of them are too long as well: several threads waited actively."
    return sentence


def failures_grid(records: Records) -> Grid:
    columns = [Column(name, numeric=False) for name in ("cell", "state", "why")]
    rows = []
    for cell in records.cells:
        if cell.status in FAILURES:
            behind = Selection(cell.scene, cell.method, seed=cell.seed)
            name = Entry(f"{cell.scene} · {cell.method} · seed {cell.seed}", runs=behind)
            state = Entry(FAILURES[cell.status], tone="muted" if cell.status == "not_available" else "failed")
            rows.append([name, state, Entry(cell.reason or "no reason recorded")])
    return Grid("Cells that did not finish", columns, rows)


def warnings_grid(records: Records) -> Grid:
    columns = [Column(name, numeric=False) for name in ("scene", "method", "seeds", "warning")]
    seeds_of: dict[tuple[str, str, str], list[int]] = {}
    for cell in records.cells:
        for warning in cell.all_warnings:
            seeds_of.setdefault((cell.scene, cell.method, warning), []).append(cell.seed)
    rows = [
        [
            Entry(scene),
            Entry(method),
            Entry(listed([str(seed) for seed in seeds])),
            Entry(warning, runs=Selection(scene, method, seed=seeds[0] if len(seeds) == 1 else None)),
        ]
        for (scene, method, warning), seeds in seeds_of.items()
    ]
    return Grid("Warnings", columns, rows)


def warning_kinds(records: Records) -> list[tuple[str, int]]:
    """Return the kinds of warnings (the words before the colon) and how many cells have each."""
    kinds = Counter(kind for cell in records.cells for kind in {text.split(":")[0] for text in cell.all_warnings})
    return kinds.most_common()


VERDICT_TONES = {"costs more": "failed", "inconclusive": "muted"}


def left_out_grid(records: Records) -> Grid:
    """Tabulate the omissions that scenes allow; scenes with the same omission for the same reason share a row."""
    alike: dict[LeftOut, list[str]] = {}
    for scene in records.run.scenes:
        for omission in scene.left_out:
            alike.setdefault(omission, []).append(scene.name)
    order = list(dict.fromkeys(omission.what for omission in alike))
    every = len(records.run.scenes)
    columns = [Column(name, numeric=False) for name in ("left out", "scene", "because")]
    columns += [Column("time saved"), Column("change in error"), Column("may cost"), Column("verdict", numeric=False)]
    rows = []
    for omission, names in sorted(alike.items(), key=lambda row: order.index(row[0].what)):
        scenes = Entry(f"all {every} scenes" if len(names) == every else ", ".join(names))
        if len(names) == 1:
            scenes = Entry(names[0], runs=Selection(names[0]))
        saved = bound = verdict = EMPTY
        if omission.seconds_saved is not None:
            saved = Entry(duration(omission.seconds_saved), omission.clock, "", omission.seconds_saved)
        if omission.bound:
            bound = Entry(f"{significant(omission.bound)} {omission.unit}", value=omission.bound)
        if omission.verdict:
            verdict = Entry(omission.verdict, omission.study, VERDICT_TONES.get(omission.verdict, ""))
        what, because = Entry(omission.what, omission.concerns), Entry(omission.reason)
        rows.append([what, scenes, because, saved, _change(omission), bound, verdict])
    return without_empty_columns(Grid("Left out", columns, rows), always=3)


def _change(omission: LeftOut) -> Entry:
    if omission.difference is None:
        return EMPTY
    if omission.unit == "colour":
        between = f"[{', '.join(map(significant, omission.interval))}]" if omission.interval else ""
        return Entry(f"{significant(omission.difference)} of a colour", between, value=omission.difference)
    change = f"{signed(omission.difference, 3)}{omission.unit and ' ' + omission.unit}"
    return Entry(change, interval(omission.interval, 3), value=omission.difference)
