"""Effects → forest plots as plain data: one row per effect, its place on an axis that all rows share, verdict in words.

Places are shares of the axis in per cent, so that a page may draw a row as wide as its column is. An interval that
reaches beyond the axis ends at its edge, and the row says so: three scenes and forty comparisons at once make intervals
of which the axis would show nothing else.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import accumulate

from matplotlib.ticker import MaxNLocator

from harness.records.metric_table import Metric, metric_of
from harness.records.study import Effect
from reports.data.wording import after, counted, interval, signed
from reports.drawing.figure import tick
from reports.page.grid import Entry

BUDGETS = {"steps": "at equal steps", "seconds": "at equal training time"}
WIDEST = 1.6
"""The factor by which an axis, on either side of 0, may reach beyond the largest difference there."""
LEAST = 0.25
"""The least share of the largest difference on any side that the largest one on either side is taken to be."""
MARGIN = 0.06
READABLE = 16
"""The rows that stay in sight without unfolding."""


@dataclass(frozen=True)
class Mark:
    """A horizontal bar from `start` to `end`, in per cent of the axis; cut if it extends beyond it."""

    start: float
    end: float
    cut_start: bool
    cut_end: bool

    @property
    def length(self) -> float:
        return self.end - self.start


@dataclass(frozen=True)
class Row:
    name: str
    against: str
    note: str
    figures: Entry
    """The difference and its interval, with the numbers of both intervals."""
    verdict: str
    tone: str
    dot: float | None
    """None if there is no difference."""
    alone: Mark | None
    together: Mark | None
    title: str
    """All facts of the effect in one line."""


@dataclass(frozen=True)
class Group:
    scene: str
    rows: list[Row]


@dataclass(frozen=True)
class Forest:
    """All effects of one metric at one budget; `groups` are scenes."""

    title: str
    unit: str
    groups: list[Group]
    folded: list[Group]
    zero: float
    band: Mark | None
    """The range of ± the smallest effect of interest, if it is known."""
    of_interest: str
    ticks: list[tuple[float, str]]
    family: str

    @property
    def keys(self) -> list[tuple[str, str]]:
        """Return the class of each kind of mark, and what it means."""
        found = {"dot": "difference", "alone": "its 95 % interval alone", "together": f"so wide that {self.family}"}
        if self.band:
            found["interest"] = f"{self.of_interest}, the smallest effect of interest"
        return list(found.items())


@dataclass(frozen=True)
class Axis:
    """An axis of differences from `low` to `high`; 0 lies between."""

    low: float
    high: float

    def place(self, value: float) -> float:
        """Return the place in per cent of the axis."""
        return round(100 * (value - self.low) / (self.high - self.low), 2)

    def mark(self, pair: tuple[float, float] | None) -> Mark | None:
        """Return the mark of `pair`; None if nothing of it lies on the axis."""
        if pair is None or pair[0] > self.high or pair[1] < self.low:
            return None
        start, end = max(pair[0], self.low), min(pair[1], self.high)
        return Mark(self.place(start), self.place(end), start > pair[0], end < pair[1])

    def ticks(self) -> list[tuple[float, str]]:
        """Return the ticks that have room for their words."""
        every = [(self.place(at), tick(round(float(at), 10))) for at in MaxNLocator(6).tick_values(self.low, self.high)]
        return [(place, words) for place, words in every if 3 <= place <= 97]


def forests(effects: list[Effect], of_interest: dict[str, float]) -> list[Forest]:
    """Return forests by metric and budget in the order of the record; forests of one metric share their axis.

    `of_interest`: metric → the smallest effect that matters to anybody, from the record's settings.
    """
    found = []
    for name in dict.fromkeys(one.metric for one in effects):
        chosen = [one for one in effects if one.metric == name]
        axis = axis_of(chosen, of_interest.get(name, 0.0))
        for budget in dict.fromkeys(one.budget for one in chosen):
            found.append(_forest([one for one in chosen if one.budget == budget], axis, of_interest.get(name)))
    return found


def axis_of(effects: Iterable[Effect], of_interest: float) -> Axis:
    """Return an axis around every difference, the intervals as far as `WIDEST` allows, and the band of interest."""
    there = list(effects)
    values = [one.difference for one in there if one.difference is not None]
    ends = [end for one in there for pair in (one.interval, one.simultaneous) for end in pair or ()]
    least = 1.5 * of_interest or LEAST * max(map(abs, values), default=0.0) or max(map(abs, ends), default=0.0) or 1.0
    above = max([*values, LEAST * max(map(abs, values), default=0.0), least])
    below = max([*(-value for value in values), LEAST * max(map(abs, values), default=0.0), least])
    high = min(max([*ends, *values, least]), WIDEST * above)
    low = -min(max([-end for end in [*ends, *values]] + [least]), WIDEST * below)
    margin = MARGIN * (high - low)
    return Axis(low - margin, high + margin)


def _forest(effects: list[Effect], axis: Axis, of_interest: float | None) -> Forest:
    metric = metric_of(effects[0].metric)
    groups = _groups(effects)
    rows = list(accumulate(len(group.rows) for group in groups))
    shown = max(1, sum(many <= READABLE for many in rows))
    drawn = [Group(group.scene, [row_of(one, metric, axis) for one in group.rows]) for group in groups]
    families = sorted({one.family for one in effects})
    return Forest(
        f"{metric.label} {BUDGETS[effects[0].budget]}",
        metric.unit,
        drawn[:shown],
        drawn[shown:],
        axis.place(0.0),
        axis.mark((-of_interest, of_interest)) if of_interest else None,
        f"±{of_interest:g}{after(metric.unit)}" if of_interest else "",
        axis.ticks(),
        family_said(families),
    )


@dataclass(frozen=True)
class _Effects:
    scene: str
    rows: list[Effect]


def _groups(effects: list[Effect]) -> list[_Effects]:
    """Group by scene, all scenes together first; in each of them parts and interactions, then method against method."""
    scenes = sorted(dict.fromkeys(one.scene for one in effects), key=lambda scene: scene != "all")
    both = len({bool(one.against) for one in effects}) == 2
    found = []
    for scene in scenes:
        for whole in (False, True):
            rows = [one for one in effects if one.scene == scene and bool(one.against) == whole]
            words = f"{scene_said(scene)}, method against method" if both and whole else scene_said(scene)
            found += [_Effects(words, rows)] if rows else []
    return found


def family_said(families: list[int]) -> str:
    """Return what holds together in 95 % of repetitions, from the sizes of the families, rising."""
    if families[-1] == 1:
        return "each comparison stands for itself"
    few = "" if families[0] == families[-1] else f"{families[0]} to "
    return f"all of a family of {few}{counted(families[-1], 'comparison')} hold together in 95 % of repetitions"


def scene_said(scene: str) -> str:
    return "all scenes" if scene == "all" else scene


def row_of(one: Effect, metric: Metric, axis: Axis) -> Row:
    aside = f"{counted(one.unpaired, 'pair')} not judged" if one.unpaired else ""
    note = "; ".join(filter(None, (one.note, aside)))
    inside = one.difference is not None and axis.low <= one.difference <= axis.high
    return Row(
        one.name,
        one.against,
        note,
        figures_of(one, metric),
        one.verdict,
        one.verdict,
        axis.place(one.difference) if one.difference is not None and inside else None,
        axis.mark(one.interval),
        axis.mark(one.simultaneous),
        told(one, metric),
    )


def figures_of(one: Effect, metric: Metric) -> Entry:
    ends = {
        f"{words}{end}": value
        for words, pair in (("", one.interval), ("simultaneous ", one.simultaneous))
        for end, value in zip(("low", "high"), pair or (None, None), strict=True)
    }
    said = signed(one.difference, metric.digits)
    return Entry(said, interval(one.interval, metric.digits), value=one.difference, parts=ends)


def told(one: Effect, metric: Metric) -> str:
    """Return a line such as `φ encoding on lego: +0.31 dB; alone [+0.11, +0.51], together with 23 others [−0.09,
    +0.71]; inconclusive`.
    """
    subject = f"{one.name} against {one.against}" if one.against else one.name
    figure = f"{signed(one.difference, metric.digits)}{after(metric.unit)}"
    alone = f"95 % interval {interval(one.interval, metric.digits)}" if one.interval else "no interval"
    others = f", of {one.family} at once {interval(one.simultaneous, metric.digits)}" if one.simultaneous else ""
    return f"{subject}, {scene_said(one.scene)}, {BUDGETS[one.budget]}: {figure}; {alone}{others}; {one.verdict}"
