"""Attention-prioritised rendering as measured → the report's section on it, as plain data."""

from dataclasses import dataclass, replace
from pathlib import Path

from markupsafe import Markup

from harness.records.serving_record import (
    Allocation,
    Anytime,
    AttentionRecord,
    ExampleFrame,
    FirstFrame,
    Measure,
    Order,
    ServingRecord,
)
from reports.data.serving_load import is_quick, is_whole
from reports.data.wording import NARROW, count, counted, duration, number
from reports.drawing.figure import Plot, plots
from reports.drawing.images import data_uri, read, side_for, smaller
from reports.drawing.palette import key
from reports.drawing.series_charts import panel, panels_of
from reports.page.grid import EMPTY, Column, Entry, Grid
from reports.studies.serving_curves import ALLOCATED, PENS, SIZE, allocation_series, anytime_panels
from reports.studies.serving_said import (
    MAPS,
    MEASURES,
    RACED_ORDERS,
    WAYS,
    Race,
    Times,
    allocated,
    answer,
    averaged,
    brief,
    compared,
    first,
    phi_said,
    plainly,
    races,
    seen_first,
    totals,
)

FRAMES_BYTES = 400_000
"""The bytes of the page that example frames may take."""
IN_SIGHT = 6
"""The cases of the table that need no unfolding."""


@dataclass(frozen=True)
class Tab:
    """One choice of the reader."""

    name: str
    label: str


@dataclass(frozen=True)
class Choice:
    """The content that is shown when its map and its method are chosen."""

    name: str
    words: str
    """A description of what is attended to, as far as the record says it."""
    curves: list[tuple[str, list[Plot]]]
    """The curves by where the error is taken, in words."""
    allocations: list[Plot]


@dataclass(frozen=True)
class Frame:
    title: str
    psnr: str
    image: str


@dataclass(frozen=True)
class Strip:
    title: str
    frames: list[Frame]


@dataclass(frozen=True)
class Attention:
    answer: str
    sentences: list[tuple[str, str]]
    """Pairs of a topic and its finding."""
    maps: list[Tab]
    methods: list[Tab]
    choices: list[Choice]
    orders: list[tuple[str, Markup]]
    ways: list[tuple[str, Markup]]
    races: Grid | None
    allocations: Grid | None
    strips: list[Strip]
    tile: int

    @property
    def rules(self) -> Markup:
        """Return the style that shows what is chosen, and what is missing if nothing was measured for it."""
        known = {one.name for one in self.choices}
        shown = [
            f'.served:has([name=map][value="{kind.name}"]:checked):has([name=served][value="{method.name}"]:checked) .'
            + (name if (name := f"{kind.name}-{method.name}") in known else "unmeasured")
            for kind in self.maps
            for method in self.methods
        ]
        return Markup(f"{','.join(shown)}{{display:block}}\n") if shown else Markup("")


@dataclass(frozen=True)
class About:
    """The facts that both sections about serving state about themselves."""

    quick: bool
    whole: bool
    left_out: list[str]
    failed: list[str]
    measured: str


def about(record: ServingRecord) -> About:
    settings = record.settings
    parts = [f"seed {settings['seed']}"] if "seed" in settings else []
    parts += [f"{settings['width']} px wide"] if "width" in settings else []
    parts += [counted(settings["threads"], "thread")] if isinstance(settings.get("threads"), int) else []
    parts += [f"measured in {duration(record.seconds)}"] if record.seconds else []
    return About(is_quick(record), is_whole(record), record.left_out, record.failed, ", ".join(parts))


def attention(record: ServingRecord, folder: Path) -> Attention | None:
    """Return the section; None if nothing of it was measured. `folder` holds the run's records, where the pictures
    are.
    """
    found, seen = record.attention, record.first_frame
    if found is None:
        return _bare(seen) if seen or record.left_out else None
    cases = races(found)
    there: list[Anytime | Allocation] = [*found.curves, *found.allocations]
    kinds = list(dict.fromkeys(one.attention for one in there))
    served = list(dict.fromkeys(one.method for one in there))
    maps = [Tab(f"map{place}", _map(kind)) for place, kind in enumerate(kinds)]
    methods = [Tab(f"served{place}", method) for place, method in enumerate(served)]
    choices = [
        choice
        for tab, kind in zip(maps, kinds, strict=True)
        for by, method in zip(methods, served, strict=True)
        if (choice := _choice(f"{tab.name}-{by.name}", record, found, kind, method))
    ]
    return Attention(
        answer=answer(cases),
        sentences=[
            *(("who is first", one) for one in compared(cases)),
            *(("all of it", one) for one in totals(found)),
            *(("meanwhile", one) for one in averaged(found)),
            *(("samples", one) for one in allocated(found.allocations)),
            *(("φ", one) for one in phi_said(found.phi)),
            *(("not by regions", one) for one in plainly(found.not_by_regions)),
            *_viewer(seen),
        ],
        maps=maps,
        methods=methods,
        choices=choices,
        orders=[(order, key(PENS[order])) for order in RACED_ORDERS if any(one.order == order for one in found.curves)],
        ways=[(name, key(pen)) for name, pen in ALLOCATED.items()] if found.allocations else [],
        races=races_grid(cases) if cases else None,
        allocations=allocations_grid(found.allocations, found.reference_bins) if found.allocations else None,
        strips=strips(found.frames, folder),
        tile=found.tile,
    )


def _bare(seen: FirstFrame | None) -> Attention:
    """Return the viewer's first frame alone, if anything."""
    said = "No method of this run was rendered by regions."
    return Attention(said, _viewer(seen), [], [], [], [], [], None, None, [], 0)


def _viewer(seen: FirstFrame | None) -> list[tuple[str, str]]:
    return [("viewer", seen_first(seen))] if seen else []


def _map(kind: str) -> str:
    return MAPS.get(kind, kind)


def _choice(name: str, record: ServingRecord, found: AttentionRecord, kind: str, method: str) -> Choice | None:
    curves = [one for one in found.curves if (one.attention, one.method) == (kind, method)]
    shares = [one for one in found.allocations if (one.attention, one.method) == (kind, method)]
    if not curves and not shares:
        return None
    described = record.settings.get("attention")
    words = str(described.get(kind, "")) if isinstance(described, dict) else ""
    shown = [(said, _curves(curves, found, measure, name)) for measure, said in MEASURES.items()] if curves else []
    return Choice(name, words, shown, _shared(shares, name))


def _curves(curves: list[Anytime], found: AttentionRecord, measure: Measure, name: str) -> list[Plot]:
    """Return the curves, ordered so that attention is last, on top."""
    sorted_ = sorted(curves, key=lambda one: -RACED_ORDERS.index(one.order))
    panels = anytime_panels(sorted_, found.reaching, measure)
    return plots(panels, f"{name}-{measure}")


def _shared(found: list[Allocation], name: str) -> list[Plot]:
    drawn = panels_of(allocation_series(found))
    return plots((replace(panel(title, group, ALLOCATED), size=SIZE) for title, group in drawn), f"{name}-samples")


def races_grid(cases: list[Race]) -> Grid:
    """Return the seconds of every order to the same share of the error; the first of each group stands out."""
    there = [order for order in RACED_ORDERS if any(order in times for one in cases for times in one.times.values())]
    columns = [Column("where", numeric=False), Column("attention", numeric=False)]
    columns += [Column(order, small=measure) for measure in MEASURES for order in there]
    rows = []
    before = None
    for one in cases:
        where = Entry(one.scene, one.method) if (one.scene, one.method) != before else Entry("")
        before = (one.scene, one.method)
        times = [entry for measure in MEASURES for entry in _times(one.to(measure), there)]
        rows.append([where, Entry(_map(one.attention)), *times])
    note = (
        "Whole picture, its hardest quarter and that which is attended most. ▲ the first of the orders in every "
        "repeat. A dash: it never got there, or was not measured."
    )
    return Grid("Until a tenth of the coarse frame’s error is left", columns, rows, note=note)


def _times(times: Times, orders: list[Order]) -> list[Entry]:
    best = first(times)
    return [
        EMPTY
        if (at := times.get(order)) is None
        else Entry(brief(at.seconds), f"{brief(at.least)} to {brief(at.most)}", tone="better" if order == best else "")
        for order in orders
    ]


def allocations_grid(found: list[Allocation], reference_bins: int) -> Grid:
    """Return every picture with its samples distributed in either way."""
    columns = [Column(name, numeric=False) for name in ("where", "attention", "samples")]
    columns += [Column(name) for name in ("a ray", "evaluations")]
    columns += [Column("of these", small="to find out"), Column("time")]
    columns += [Column("attended", small="against the integral"), Column("whole", small="against the integral")]
    columns += [Column("attended", small="against the truth"), Column("whole", small="against the truth")]
    rows = []
    for one in found:
        errors = (one.rmse_attended, one.rmse_whole, one.truth_attended, one.truth_whole)
        rows.append(
            [
                Entry(one.scene, one.method),
                Entry(_map(one.attention)),
                Entry(WAYS[one.way]),
                Entry(number(one.bins, 1)),
                Entry(count(round(one.evaluations))),
                Entry(count(round(one.own))),
                Entry(brief(one.seconds), f"{brief(one.seconds_spread[0])} to {brief(one.seconds_spread[1])}"),
                *(Entry(number(error, 5)) if error is not None else EMPTY for error in errors),
            ]
        )
    note = (
        f"RMSE of display colour. The integral: the same field with {reference_bins} samples a ray. Empty space costs "
        "no evaluation, so that equal numbers of samples differ in them."
    )
    return Grid("Every picture with its samples shared out", columns, rows, note=note)


def strips(frames: list[ExampleFrame], folder: Path) -> list[Strip]:
    """Return the strips by scene and method, in the order of the record."""
    side = side_for(len(frames), FRAMES_BYTES)
    found = []
    for scene, method in dict.fromkeys((one.scene, one.method) for one in frames):
        shown = [
            Frame(
                one.title.replace(" %", f"{NARROW}%"),
                f"{number(one.psnr, 1)}{NARROW}dB" if one.psnr is not None else "",
                data_uri(smaller(picture, side)),
            )
            for one in frames
            if (one.scene, one.method) == (scene, method) and (picture := read(folder, one.image)) is not None
        ]
        if shown:
            found.append(Strip(f"{scene}, {method}", shown))
    return found
