"""Effects → forest plots, a row per effect, whose axis all forests of a metric share; and a table of all facts."""

from textwrap import fill

from harness.records.metric_table import metric_of
from harness.records.study import Effect
from harness.records.verdict import phrase_with
from harness.verdicts.estimates.multiplicity import benjamini_hochberg
from reports.data.wording import BUDGETS, DISCOVERIES, after, counted, interval, mark_of, number, signed, tone_of_sign
from reports.drawing.palette import INK, KNOWN, MUTED
from reports.drawing.traces import Panel, Trace
from reports.page.grid import EMPTY, Q_COLUMN, Column, Entry, Grid, q_entry, without_empty_columns

WIDEST = 1.6
"""The factor by which an axis may reach beyond the largest difference on either side of 0."""
LEAST = 0.25
"""Each side of the axis reaches at least this share of the largest difference on the other side."""
MARGIN = 0.06
LONGEST_NAME = 38
"""The letters of a line in the name of a row."""
WIDTH = 7.6


def forests(effects: list[Effect], of_interest: dict[str, float]) -> dict[tuple[str, str, str], Panel]:
    """Map metric, budget and scene → forest; forests of one metric share their axis.

    Single scenes have a forest only if no effect is over all scenes. `of_interest`: metric → what matters.
    """
    over_all = {(effect.metric, effect.budget) for effect in effects if effect.scene == "all"}
    drawn = [effect for effect in effects if effect.scene == "all" or (effect.metric, effect.budget) not in over_all]
    grouped: dict[tuple[str, str, str], list[Effect]] = {}
    for effect in drawn:
        grouped.setdefault((effect.metric, effect.budget, effect.scene), []).append(effect)
    limits = {
        name: limits_of([effect for effect in drawn if effect.metric == name], of_interest.get(name, 0.0))
        for name in {effect.metric for effect in drawn}
    }
    return {key: _forest(rows, limits[key[0]], of_interest.get(key[0])) for key, rows in grouped.items()}


def limits_of(effects: list[Effect], of_interest: float) -> tuple[float, float]:
    """Return limits around every difference, the intervals as far as `WIDEST` allows, and the band of interest.

    Three scenes and forty simultaneous comparisons give intervals so wide that an axis would show nothing else.
    """
    values = [effect.difference for effect in effects if effect.difference is not None]
    ends = [end for effect in effects for pair in (effect.interval, effect.simultaneous) for end in pair or ()]
    largest = LEAST * max(map(abs, values), default=0.0)
    least = 1.5 * of_interest or largest or max(map(abs, ends), default=0.0) or 1.0
    above = max([*values, largest, least])
    below = max([*(-value for value in values), largest, least])
    high = min(max([*ends, *values, least]), WIDEST * above)
    low = -min(max([-end for end in [*ends, *values]] + [least]), WIDEST * below)
    margin = MARGIN * (high - low)
    return low - margin, high + margin


def _forest(effects: list[Effect], limits: tuple[float, float], of_interest: float | None) -> Panel:
    metric = metric_of(effects[0].metric)
    rows = sorted(effects, key=lambda effect: bool(effect.against))  # parts and interactions before pairs of methods
    title = f"{metric.label} at {BUDGETS[effects[0].budget]}, {scene_words(effects[0].scene)}"
    colour, ends = KNOWN["nerf"].light, (-0.5, len(rows) - 0.5)
    traces = [Trace("no difference", INK.light, "floor", (0.0, 0.0), ends)]
    if of_interest:
        band = f"±{of_interest:g}{after(metric.unit)}, the smallest effect of interest"
        corners = (-of_interest, of_interest, of_interest, -of_interest)
        traces.insert(0, Trace(band, MUTED.light, "area", corners, (ends[0], ends[0], ends[1], ends[1])))
    for words, width, pairs in (
        ("simultaneous interval", 1.0, [effect.simultaneous for effect in rows]),
        ("own interval", 3.0, [effect.interval for effect in rows]),
    ):
        known = [(pair[0], float(place), pair[1]) for place, pair in enumerate(pairs) if pair is not None]
        if known:
            low, at, high = zip(*known, strict=True)
            traces.append(Trace(words, colour, "range", low, at, high, width=width))
    for words, is_open in (("sign known", False), ("sign open", True)):
        dots = [
            (effect.difference, float(place))
            for place, effect in enumerate(rows)
            if effect.difference is not None and (effect.verdict.sign == "open") == is_open
        ]
        if dots:
            x, y = zip(*dots, strict=True)
            traces.append(Trace(f"difference, {words}", colour, "mark", x, y, marker="o", hollow=is_open, size=5.5))
    figures = [
        f"{signed(effect.difference, metric.digits)}  {interval(effect.interval, metric.digits)}  "
        f"{mark_of(effect.verdict)}"
        for effect in rows
    ]
    names = tuple(fill(row_name(effect), LONGEST_NAME) for effect in rows)
    words = "; ".join(
        f"{row_name(effect)} {figure} {phrase_with(effect.verdict, effect.simultaneous)}"
        for effect, figure in zip(rows, figures, strict=True)
    )
    return Panel(
        title,
        f"difference in {metric.label}" + (f" ({metric.unit})" if metric.unit else ""),
        "",
        tuple(traces),
        f"{title}: {words}.",
        x_limits=limits,
        rows=names,
        figures=tuple(figures),
        size=(WIDTH, 0.7 + (0.3 if any("\n" in name for name in names) else 0.21) * len(rows)),
    )


def row_name(effect: Effect) -> str:
    note = "; ".join(
        filter(None, (effect.note, f"{counted(effect.unpaired, 'pair')} not judged" if effect.unpaired else ""))
    )
    name = f"{effect.name} − {effect.against}" if effect.against else effect.name
    return f"{name} ({note})" if note else name


def forest_key(effects: list[Effect]) -> str:
    low, high = min(effect.family for effect in effects), max(effect.family for effect in effects)
    family = (
        f"all of a family of {low if low < high else ''}{' to ' if low < high else ''}{counted(high, 'comparison')}"
    )
    together = f"{family} hold together in 95 % of repetitions" if high > 1 else "each comparison stands for itself"
    return (
        "Dot and thick bar: difference and its own 95 % interval, as printed on the right. Thin bar: the interval "
        f"that gives the verdict, so wide that {together}. Filled dot, ▲ and ▼: above or below 0; "
        "hollow dot and ?: sign open; =: smaller than matters. Grey band: differences too small to matter."
    )


def scene_words(scene: str) -> str:
    return "all scenes" if scene == "all" else scene


def effects_grid(effects: list[Effect]) -> Grid:
    labels = ("effect", "against", "scene", "metric", "budget")
    figures = ("difference", "95 % interval", "simultaneous", "of")
    columns = [
        *(Column(label, numeric=False) for label in labels),
        *map(Column, figures),
        Q_COLUMN,
        *map(Column, ("detectable", "pairs", "unpaired")),
        Column("sign, size", numeric=False),
    ]
    rows = []
    for effect, q in zip(effects, benjamini_hochberg([effect.p for effect in effects]), strict=True):
        metric = metric_of(effect.metric)
        unit = after(metric.unit) if effect.difference is not None else ""
        rows.append(
            [
                Entry(effect.name, effect.note),
                Entry(effect.against) if effect.against else EMPTY,
                Entry(scene_words(effect.scene)),
                Entry(metric.label),
                Entry(BUDGETS[effect.budget]),
                Entry(f"{signed(effect.difference, metric.digits)}{unit}", value=effect.difference),
                _interval(effect.interval, metric.digits),
                _interval(effect.simultaneous, metric.digits),
                Entry(str(effect.family), tone="muted", value=effect.family),
                q_entry(q),
                Entry(number(effect.smallest_detectable, metric.digits), value=effect.smallest_detectable),
                Entry(str(effect.pairs), tone="muted", value=effect.pairs),
                Entry(str(effect.unpaired), tone="fails" if effect.unpaired else "muted", value=effect.unpaired),
                Entry(
                    phrase_with(effect.verdict, effect.simultaneous),
                    tone=tone_of_sign(effect.verdict.sign, metric.higher_is_better),
                ),
            ]
        )
    note = (
        "The verdict comes from the simultaneous interval: in 95 % of repetitions, all intervals of a family hold the "
        "truth; “of” is the size of that family. “detectable”: the true difference whose sign a sample with this "
        "spread finds in 80 % of repetitions."
    )
    note += f" {DISCOVERIES}" if any(effect.p is not None for effect in effects) else ""
    return without_empty_columns(Grid(f"Every effect: {counted(len(effects), 'comparison')}", columns, rows, note=note))


def _interval(pair: tuple[float, float] | None, digits: int) -> Entry:
    return Entry(interval(pair, digits), parts=dict(zip(("low", "high"), pair, strict=True))) if pair else EMPTY
