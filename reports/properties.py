"""What a method is rather than how it scores: measured properties, weights, warnings, failures, what was left out."""

from collections import Counter

from harness.records import LeftOut
from reports.claims_code import COMPONENTS
from reports.grid import EMPTY, Column, Entry, Grid
from reports.load import Records
from reports.selection import Selection
from reports.wording import count, duration, interval, listed, signed, significant

PROPERTY_NAMES = {
    "chunk_max_difference": "largest change of a pixel when a view is rendered in small chunks",
    "chunk_rms_difference": "RMS change of a view when rendered in small chunks",
    "largest_density": "largest density found, per half of the box’s longest side",
    "opacity_unit_slab": "opacity of that length of it",
    "occupied_share": "share of the scene's box that holds matter",
}


def properties_grid(records: Records) -> Grid:
    """A row a property, a column a method: the mean over its cells and, where they differ, the range."""
    names = list(dict.fromkeys(name for cell in records.cells for name in cell.properties))
    columns = [Column("property", numeric=False), *(Column(method, method) for method in records.methods)]
    rows = []
    for name in names:
        row = [Entry(PROPERTY_NAMES.get(name, name.replace("_", " ")), name if name in PROPERTY_NAMES else "")]
        for method in records.methods:
            found = [cell.properties.get(name) for cell in records.cells if cell.method == method]
            row.append(_property_entry([value for value in found if value is not None], Selection(method=method)))
        rows.append(row)
    return Grid("Measured properties", columns, [row for row in rows if any(entry != EMPTY for entry in row[1:])])


def _property_entry(values: list[float | str], behind: Selection) -> Entry:
    numbers = [float(value) for value in values if not isinstance(value, str)]
    words = list(dict.fromkeys(value for value in values if isinstance(value, str)))
    if words:
        return Entry(", ".join(words), runs=behind)
    if not numbers:
        return EMPTY
    low, high = min(numbers), max(numbers)
    small = "" if significant(low) == significant(high) else f"{significant(low)} – {significant(high)}"
    mean = sum(numbers) / len(numbers)
    return Entry(significant(mean), small, value=mean, parts={"low": low, "high": high}, runs=behind)


def parameters_grid(records: Records) -> Grid:
    """Weights of the networks that were trained, and Table 1 beside what its description really has."""
    printed = records.run.paper.get("table1") or {}
    measured = records.run.paper.get("parameters_measured") or {}
    trained = {cell.method: cell.parameters for cell in records.cells if cell.parameters}
    methods = [method for method in records.methods if method in trained]
    found = dict.fromkeys([name for weights in trained.values() for name in weights] + [*printed, *measured])
    names = sorted(found, key=lambda name: list(COMPONENTS).index(name) if name in COMPONENTS else -1)
    columns = [Column("component", numeric=False), *(Column(method, method, "this run") for method in methods)]
    columns += [Column("printed", small="Table 1")] if printed else []
    columns += [Column("counted", small="paper’s network")] if measured else []
    rows = []
    for name in names:
        row = [Entry(COMPONENTS.get(name, name.replace("_", " ")))]
        row += [_weights(trained[method].get(name)) for method in methods]
        row += [_weights(printed.get(name))] if printed else []
        row += [_weights(measured.get(name))] if measured else []
        rows.append(row)
    return Grid(
        "Weights", columns, [row for row in rows if row[0].text != "total"], rows[-1:] if "total" in names else []
    )


def _weights(value: object) -> Entry:
    return Entry(count(round(value))) if isinstance(value, int | float) else EMPTY


def failures_grid(records: Records) -> Grid:
    """Cells without a score, each with its reason."""
    columns = [Column(name, numeric=False) for name in ("cell", "state", "why")]
    words = {"diverged": "diverged", "error": "failed", "not_available": "not available"}
    rows = [
        [
            Entry(
                f"{cell.scene} · {cell.method} · seed {cell.seed}",
                runs=Selection(cell.scene, cell.method, seed=cell.seed),
            ),
            Entry(words[cell.status], tone="muted" if cell.status == "not_available" else "failed"),
            Entry(cell.reason or "no reason recorded"),
        ]
        for cell in records.cells
        if cell.status in words
    ]
    return Grid("Cells that did not finish", columns, rows)


def warnings_grid(records: Records) -> Grid:
    """Warnings, those of the same words on the same scene and method in one row."""
    columns = [Column(name, numeric=False) for name in ("scene", "method", "seeds", "warning")]
    found: dict[tuple[str, str, str], list[int]] = {}
    for cell in records.cells:
        for warning in cell.warnings:
            found.setdefault((cell.scene, cell.method, warning), []).append(cell.seed)
    rows = [
        [
            Entry(scene),
            Entry(method),
            Entry(listed([str(seed) for seed in seeds])),
            Entry(warning, runs=Selection(scene, method, seed=seeds[0] if len(seeds) == 1 else None)),
        ]
        for (scene, method, warning), seeds in found.items()
    ]
    return Grid("Warnings", columns, rows)


def warning_kinds(records: Records) -> list[tuple[str, int]]:
    """What kinds of warnings there are (the words before the colon) and how many cells carry each."""
    found = Counter(kind for cell in records.cells for kind in {text.split(":")[0] for text in cell.warnings})
    return found.most_common()


def left_out_grid(records: Records) -> Grid:
    """What a scene does not need and was not done for it; where that was verified, what it saved and changed."""
    columns = [Column(name, numeric=False) for name in ("scene", "left out", "because")]
    columns += [Column("time saved"), Column("change in error"), Column("may cost"), Column("verdict", numeric=False)]
    rows = [
        [
            Entry(scene.name, runs=Selection(scene.name)),
            Entry(one.what, one.concerns),
            Entry(one.reason),
            Entry(duration(one.seconds_saved), one.clock, value=one.seconds_saved)
            if one.seconds_saved is not None
            else EMPTY,
            _change(one),
            Entry(f"{significant(one.bound)} {one.unit}") if one.bound else EMPTY,
            Entry(one.verdict, tone=VERDICT_TONES.get(one.verdict, "")) if one.verdict else EMPTY,
        ]
        for scene in records.run.scenes
        for one in scene.left_out
    ]
    told = [place for place in range(len(columns)) if place < 3 or any(row[place] != EMPTY for row in rows)]
    return Grid("Left out", [columns[place] for place in told], [[row[place] for place in told] for row in rows])


VERDICT_TONES = {"within its bound": "equivalent", "costs more": "failed", "inconclusive": "inconclusive"}


def _change(one: LeftOut) -> Entry:
    if one.difference is None:
        return EMPTY
    if one.unit == "colour":
        between = "" if one.interval is None else f"[{significant(one.interval[0])}, {significant(one.interval[1])}]"
        return Entry(f"{significant(one.difference)} of a colour", between, value=one.difference)
    said = f"{signed(one.difference, 3)}{one.unit and ' ' + one.unit}"
    return Entry(said, interval(one.interval, 3), value=one.difference)
