"""The view cache as measured → the report's section on it, as plain data."""

from dataclasses import dataclass, replace

from markupsafe import Markup

from harness.records.serving_record import CacheRecord, Confusion, Latency, PathUse
from reports.data.serving_load import DISK, HASHED, MEMORY, judge_hit
from reports.data.wording import NARROW, bare, counted, listed, number, significant
from reports.drawing import palette
from reports.drawing.figure import Plot, plots, with_common_limits
from reports.drawing.palette import MARKERS, Pen, key
from reports.drawing.traces import Panel, Trace
from reports.page.grid import EMPTY, Column, Entry, Grid
from reports.studies.serving_said import OUTCOMES, SOURCES, TIMED, brief, bytes_said, outcome, times

ROWS = {
    "render": "rendered",
    "level 2 cold": "disk, cold",
    "level 2": "disk 2",
    "level 0 hashed": "hashed 0",
    "level 1": "memory 1",
    "level 0": "memory 0",
}
"""Short names, as there is little room beside a plot."""
LIMITS = {**dict.fromkeys(MEMORY + HASHED, "target_memory"), **dict.fromkeys(DISK, "target_disk")}
APART = 0.24
"""The share of a row between methods."""


@dataclass(frozen=True)
class Part:
    """A piece of a stacked bar: how many views came from one source."""

    tone: str
    """A class of the style sheet."""
    said: str
    many: int
    share: float
    """The share in per cent."""


@dataclass(frozen=True)
class Use:
    """A camera path with the bar of its hits."""

    path: str
    where: str
    parts: list[Part]
    counts: dict[str, int]
    """Views by where they came from, for a file."""
    rate: str
    others: str
    """The hit rates of similar paths."""
    seconds: str
    without: str
    bounds: str


@dataclass(frozen=True)
class Cache:
    answer: str
    notes: list[str]
    keys: list[tuple[str, Markup]]
    plots: list[Plot]
    latencies: Grid | None
    tones: list[tuple[str, str]]
    """The class and words of each part of a bar."""
    uses: list[Use]
    confused: str
    confusions: Grid | None


def cache(record: CacheRecord, methods: list[str]) -> Cache:
    """Return the section on the cache. `methods` are those of the run, in its order, whose colours they have
    everywhere.
    """
    pens = pens_of_methods(methods, [one.method for one in record.latencies])
    panels = latency_panels(record, pens)
    return Cache(
        answer=answer(record),
        notes=[stored(record)],
        keys=[(name, key(pens[name])) for name in pens if any(one.method == name for one in record.latencies)],
        plots=plots(panels, "latency"),
        latencies=latencies_grid(record) if record.latencies else None,
        tones=[(_tone(source), words) for source, words in SOURCES.items()],
        uses=[_use(one) for one in record.paths],
        confused=confused(record.confusions),
        confusions=confusions_grid(record.confusions) if record.confusions else None,
    )


def pens_of_methods(methods: list[str], others: list[str]) -> dict[str, Pen]:
    """Return the page's colours, a marker for each, no dashes."""
    every = list(dict.fromkeys([*methods, *others]))
    colours = palette.colours_of(every)
    return {name: Pen(colours[name], *MARKERS[place % len(MARKERS)], ()) for place, name in enumerate(every)}


def answer(record: CacheRecord) -> str:
    """Return how much faster it is, against the targets, and under which conditions."""
    said = []
    for sources, where, target in (
        (MEMORY, "in memory, of a method that is no longer trained,", record.target_memory),
        (HASHED, "in memory, where the weights are hashed at every call,", record.target_memory),
        (("level 2",), "on disk, with the file in the operating system’s memory,", record.target_disk),
        (("level 2 cold",), "on disk, with the file dropped from the operating system’s memory,", record.target_disk),
    ):
        hits = [one for one in record.latencies if one.source in sources and one.ratio is not None]
        if hits:
            found = outcome([judge_hit(one, record) for one in hits])
            ratios = times([one.ratio for one in hits if one.ratio is not None])
            said.append(f"A hit {where} is {ratios} faster than rendering (target {bare(target)}: {found}).")
    return " ".join(said) or "No hit was timed."


def stored(record: CacheRecord) -> str:
    """Return the bytes of a view."""
    return (
        f"A view of {record.width} × {record.height} px takes {bytes_said(record.memory_bytes_per_view)} in memory and "
        f"{bytes_said(record.disk_bytes_per_view)} on disk. Level 0 keeps what was asked for again, level 1 what was "
        "asked for once, level 2 is on disk; a hit moves a view up. The key is in every latency, the check of the "
        "pixels in those from disk. Cold: a file’s data was dropped from the system’s memory; its name was not, nor "
        "what the disk itself remembers."
    )


def latencies_grid(record: CacheRecord) -> Grid:
    """Return latencies scene by scene, from rendering down to the fastest level."""
    columns = [
        Column("where", numeric=False),
        Column("from", numeric=False),
        Column("median", small="5 to 95 %"),
        Column("calls"),
        Column("times faster", small="quartiles, the worse way and the better"),
        Column("target"),
        Column("", numeric=False),
    ]
    rows = []
    order = list(TIMED)
    for scene, method in dict.fromkeys((one.scene, one.method) for one in record.latencies):
        chosen = [one for one in record.latencies if (one.scene, one.method) == (scene, method)]
        for place, one in enumerate(sorted(chosen, key=lambda one: order.index(one.source))):
            where = Entry("") if place else Entry(scene, method)
            rows.append([where, *_latency(one, record)])
    return Grid("How long a view takes", columns, rows)


def _latency(one: Latency, record: CacheRecord) -> list[Entry]:
    low, high = one.spread
    entries = [
        Entry(TIMED[one.source]),
        Entry(brief(one.seconds), f"{brief(low)} to {brief(high)}"),
        Entry(str(one.calls), tone="muted"),
    ]
    if one.ratio is None or one.ratio_spread is None:
        return [*entries, EMPTY, EMPTY, Entry("")]
    verdict = judge_hit(one, record)
    tone = {"seen": "holds", "not seen at this scale": "fails"}.get(verdict, "")
    worse, better = one.ratio_spread
    return [
        *entries,
        Entry(significant(one.ratio), f"{significant(worse)} to {significant(better)}"),
        Entry(f"≥ {bare(getattr(record, LIMITS[one.source]))}", tone="muted"),
        Entry(OUTCOMES[verdict], tone=tone),
    ]


def latency_panels(record: CacheRecord, pens: dict[str, Pen]) -> list[Panel]:
    """Return one panel per scene: a row for each source, a marker with its spread for each method, a dash at its
    target.
    """
    there = [source for source in TIMED if any(one.source == source for one in record.latencies)]
    panels = []
    for scene in dict.fromkeys(one.scene for one in record.latencies):
        chosen = [one for one in record.latencies if one.scene == scene]
        methods = [name for name in pens if any(one.method == name for one in chosen)]
        traces: list[Trace] = []
        for place, method in enumerate(methods):
            offset = APART * (place - (len(methods) - 1) / 2)
            own = [one for one in chosen if one.method == method]
            traces += _of_method(own, record, there, offset, pens[method])
        said = "; ".join(f"{one.method}, {TIMED[one.source]}: {brief(one.seconds)}" for one in chosen)
        alt = f"How long a view of {scene} takes. {said}."
        rows = tuple(ROWS[source] for source in there)
        panels.append(Panel(scene, "seconds a view", "", tuple(traces), alt, "log", rows=rows))
    return with_common_limits(panels, "x")


def _of_method(own: list[Latency], record: CacheRecord, there: list[str], offset: float, pen: Pen) -> list[Trace]:
    rendering = next((one.seconds for one in own if one.source == "render"), None)
    traces = []
    for one in own:
        at = there.index(one.source) + offset
        target = getattr(record, LIMITS[one.source]) if one.source in LIMITS else None
        if rendering is not None and target is not None:
            goal = rendering / target
            ends = (at - APART / 2, at + APART / 2)
            traces.append(Trace("target", palette.MUTED.light, "line", (goal, goal), ends, width=1.6))
        name = f"{one.method}, {one.source}"
        traces.append(Trace(name, pen.colour.light, "range", (one.spread[0],), (at,), x_high=(one.spread[1],)))
        point = Trace(name, pen.colour.light, "mark", (one.seconds,), (at,), marker=pen.marker, hollow=pen.hollow)
        traces.append(replace(point, size=5.2))
    return traces


def _tone(source: str) -> str:
    return source.replace(" ", "-")


def _use(one: PathUse) -> Use:
    parts = [
        Part(_tone(source), f"{words} {one.hits.get(source, 0)}", one.hits.get(source, 0), share)
        for source, words in reversed(SOURCES.items())
        if (share := 100 * one.hits.get(source, 0) / one.views if one.views else 0.0)
    ]
    saved = f" ({number(one.seconds_without / one.seconds, 1)} times as long)" if one.seconds else ""
    return Use(
        path=one.path,
        where=f"{one.method} on {one.scene}",
        parts=[replace(part, share=round(part.share, 3)) for part in parts],
        counts={words: one.hits.get(source, 0) for source, words in SOURCES.items()},
        rate=f"{number(100 * one.hit_rate, 1)}{NARROW}%",
        others=_others(one),
        seconds=brief(one.seconds),
        without=f"{brief(one.seconds_without)}{saved}",
        bounds=f"{bytes_said(one.memory_bytes)} in memory, "
        + (f"{bytes_said(one.disk_bytes)} on disk" if one.disk_bytes else "no disk"),
    )


def _others(one: PathUse) -> str:
    """Return mean and range over all seeds; empty if there is one."""
    if not one.other_hit_rates:
        return ""
    rates = [100 * rate for rate in (one.hit_rate, *one.other_hit_rates)]
    mean, low, high = (number(value, 1) for value in (sum(rates) / len(rates), min(rates), max(rates)))
    return f"mean over {len(rates)} seeds {mean}{NARROW}%, {low} to {high}{NARROW}%"


def confused(found: list[Confusion]) -> str:
    """Return what the key of the pose alone would have done; empty if it was not tried."""
    views, stale = sum(one.views for one in found), sum(one.stale for one in found)
    if not views:
        return ""
    wrong = [one for one in found if one.stale]
    off = [significant(one.rmse) for one in sorted(wrong, key=lambda one: one.rmse)]
    by = " to ".join(dict.fromkeys([*off[:1], *off[-1:]]))
    apart = f", off by {by} (RMSE of display colour)" if by else ""
    missed = sum(one.missed for one in found)
    if missed == views:
        ours = "ours missed each of them, as it has to" if views > 1 else "ours missed it, as it has to"
    else:
        at_fault = listed([one.changed for one in found if one.missed < one.views])
        ours = f"ours missed only {missed} of {views}, which is a fault: {at_fault}"
    would = f"would have returned {counted(stale, 'stale picture')} of {views}"
    return f"Listing 5’s key of the pose alone {would}{apart}; {ours}."


def confusions_grid(found: list[Confusion]) -> Grid:
    columns = [
        Column("changed at the same pose", numeric=False),
        Column("views"),
        Column("stale by the pose alone"),
        Column("off by", small="RMSE, display"),
        Column("missed by our key"),
    ]
    rows = [
        [
            Entry(one.changed),
            Entry(str(one.views), tone="muted"),
            Entry(str(one.stale), tone="fails" if one.stale else ""),
            Entry(significant(one.rmse)) if one.stale else EMPTY,
            Entry(str(one.missed), tone="holds" if one.missed == one.views else "fails"),
        ]
        for one in found
    ]
    return Grid("What a key has to tell apart", columns, rows)
