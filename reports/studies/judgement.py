"""The judgement of a user's table → judgement.html, self-contained and designed like the report."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import NamedTuple

from markupsafe import Markup

from harness.records.cells import Estimate
from harness.records.judgements import JudgementRecord, Pair, Ranking, changed_pairs
from harness.records.verdict import Verdict
from harness.verdicts.estimates.max_t import written
from harness.verdicts.estimates.multiplicity import benjamini_hochberg
from harness.verdicts.judging.judgement import (
    headline,
    letters_line,
    missing_line,
    number,
    shown_best,
    shown_rank,
    suspect_line,
    without_line,
)
from reports.data.wording import duration, mark_of, tone_of_sign
from reports.drawing.figure import padded, plots
from reports.drawing.palette import INK, KNOWN, MUTED
from reports.drawing.traces import Panel, Trace
from reports.page import shell
from reports.page.grid import EMPTY, Q_COLUMN, Column, Entry, Grid, q_entry, value_entry, without_empty_columns
from reports.page.shell import Layout, section
from scenes.files.atomic import write_atomically

FROM_BEST = "Methods from best to worst"
MOST_TITLES = 40
"""The number of methods up to which each pair of the matrix shows its numbers."""
MOST_CHANGES = 30
ROW_INCHES = 0.19
LEAST_FOR_FAR = 6
FAR = 6.0
"""The robust standard deviations from the median beyond which a mean is off the axis, and printed with the name."""


class Square(NamedTuple):
    tone: str
    mark: str
    title: str


def methods_grid(record: JudgementRecord, ranking: Ranking, caption: str = FROM_BEST) -> Grid:
    """Return methods from best to worst with letters, rank and difference from the next, or from the baseline."""
    everything = record.baseline is None
    by_method = {pair.method: pair for pair in (ranking.neighbours if everything else ranking.pairs)}
    rival = "the next" if everything else str(record.baseline)
    columns = [
        Column("method", numeric=False),
        Column(f"mean {record.metric}{f' ({record.unit})' if record.unit else ''}"),
        Column("scenes"),
        Column("letters", numeric=False),
        Column("rank", small="95 %, all together"),
        Column("best", small="probability"),
        Column(f"minus {rival}", small="on scenes like these"),
        Column("sign, size", numeric=False),
        Q_COLUMN,
        Column("detectable gap"),
        Column("scenes to settle"),
        Column(f"minus {rival}", small="on these scenes"),
        Column("training"),
        Column("core seconds"),
        Column("steps"),
    ]
    rows, q, scenes_differ = [], _q_values(ranking), len({place.scenes for place in ranking.places}) > 1
    for place in ranking.places:
        pair = by_method.get(place.method)
        estimate = pair.scenes_like_these if pair else None
        least = estimate.smallest_detectable if estimate else None
        rows.append(
            [
                Entry(place.method, place.origin),
                Entry(number(record, place.mean), value=place.mean),
                Entry(str(place.scenes), value=place.scenes) if scenes_differ else EMPTY,
                Entry(written(place.groups)) if everything else EMPTY,
                Entry(shown_rank(place), value=place.rank[0]) if place.rank else EMPTY,
                Entry(shown_best(place), value=place.best) if place.best is not None else EMPTY,
                difference(record, pair, estimate),
                Entry(estimate.verdict.phrase, tone=tone(record, estimate.verdict)) if estimate else EMPTY,
                q_entry(q.get(pair)),
                value_entry(least, partial(number, record)),
                value_entry(pair.scenes_to_settle if pair else None, str),
                difference(record, pair, pair.on_these_scenes if pair else None, worded=True),
                value_entry(place.seconds, duration),
                value_entry(place.core_seconds, duration),
                value_entry(place.steps, "{:,.0f}".format),
            ]
        )
    note = _note(ranking, everything)
    return without_empty_columns(Grid(caption, columns, rows, note=note), always=2)


def _note(ranking: Ranking, everything: bool) -> str:
    note = (
        f"Signs and intervals are at 95 % for all {ranking.family} comparisons together: signs by the step-down max-T "
        "procedure over flips of the scenes' signs (Holm's where two methods share fewer than six scenes), intervals "
        "by Bonferroni's t, which end at 0 where the two disagree. The detectable gap is the smallest true difference "
        "whose sign such a table finds in 80 % of cases, and the scenes to settle are as many as would find this one. "
        "q is the lowest false discovery rate at which a pair counts as different (Benjamini and Hochberg, over all "
        "pairs)."
    )
    groups = (
        f" {letters_line(ranking)} The probability of being best is that of the mean over scenes like these (Bayesian "
        "bootstrap)."
    )
    return note + (groups if everything else "")


def _q_values(ranking: Ranking) -> dict[Pair | None, float]:
    p = [pair.scenes_like_these.p if pair.scenes_like_these else None for pair in ranking.pairs]
    adjusted = zip(ranking.pairs, benjamini_hochberg(p), strict=True)
    return {pair: q for pair, q in adjusted if q is not None}


def difference(record: JudgementRecord, pair: Pair | None, estimate: Estimate | None, worded: bool = False) -> Entry:
    """Return the difference with its simultaneous interval, and if `worded` with the verdict."""
    if pair is None or estimate is None:
        return EMPTY
    words = within(record, estimate) + (f"\n{estimate.verdict.phrase}" if worded else "")
    return Entry(number(record, pair.difference, "+"), words, value=pair.difference)


def tone(record: JudgementRecord, verdict: Verdict) -> str:
    return tone_of_sign(verdict.sign, record.higher_is_better)


def within(record: JudgementRecord, estimate: Estimate) -> str:
    ends = estimate.simultaneous
    return f"[{number(record, ends[0], '+')}, {number(record, ends[1], '+')}]" if ends else ""


def matrix(record: JudgementRecord) -> list[tuple[str, list[Square]]]:
    """Return each method's row against every method, in their order; nothing against a baseline."""
    if record.baseline is not None:
        return []
    names = [place.method for place in record.given.places]
    squares = {}
    for pair in record.given.pairs:
        estimate = pair.scenes_like_these
        ends = f" {within(record, estimate)}" if estimate else ""
        known = f"{number(record, pair.difference, '+')}{ends}, {pair.verdict.phrase}"
        numbers = known if estimate else "no interval"
        title = f"{pair.method} − {pair.against}: {numbers}" if len(names) <= MOST_TITLES else ""
        turned = pair.verdict.turned
        squares[pair.method, pair.against] = Square(tone(record, pair.verdict), mark_of(pair.verdict), title)
        squares[pair.against, pair.method] = Square(tone(record, turned), mark_of(turned), title)
    itself = Square("itself", "", "")
    return [(name, [squares.get((name, other), itself) for other in names]) for name in names]


def suspects_grid(record: JudgementRecord) -> Grid:
    columns = [Column("result", numeric=False), Column("is"), Column("expected"), Column("robust deviations")]
    rows = [
        [
            Entry(f"{suspect.method} on {suspect.scene}", f"seed {suspect.seed}" if suspect.seed else ""),
            Entry(number(record, suspect.value), tone="failed", value=suspect.value),
            Entry(number(record, suspect.expected), value=suspect.expected),
            Entry(f"{suspect.deviation:.0f}".replace("-", "−"), value=suspect.deviation),
        ]
        for suspect in record.suspects
    ]
    note = (
        "Expected is the value of a fit of method plus scene by medians. A result is suspect if it is off by 7 robust "
        "standard deviations of the table, or of its method and scene together if that is more, and by 10 times the "
        "smallest effect of interest."
    )
    return Grid("Results far from the expectation for their method and scene", columns, rows, note=note)


def changes_grid(record: JudgementRecord) -> Grid:
    columns = [Column("pair", numeric=False), Column("as given", numeric=False), Column("without", numeric=False)]
    changes = changed_pairs(record)
    rows = [
        [Entry(f"{pair.method} − {pair.against}"), Entry(pair.verdict.phrase), Entry(after.phrase)]
        for pair, after in changes[:MOST_CHANGES]
    ]
    more = len(changes) - len(rows)
    return Grid("Verdicts that change", columns, rows, note=f"{more} more are in judgement.json." if more else "")


def panel(record: JudgementRecord) -> Panel:
    """Return means with a bar for each letter below; with a baseline, differences with their intervals."""
    return _groups(record) if record.baseline is None else _against(record)


def _groups(record: JudgementRecord) -> Panel:
    places = record.given.places
    means = [place.mean for place in places]
    limits = _limits(means)
    groups = sorted({group for place in places for group in place.groups})
    members = {group: [place for place in places if group in place.groups] for group in groups}
    bars = {group: several for group, several in members.items() if len(several) > 1}
    rows = [
        place.method
        if limits is None or limits[0] <= place.mean <= limits[1]
        else f"{place.method} ({number(record, place.mean)})"
        for place in places
    ]
    of_bars = [[place.mean for place in several] for several in bars.values()]
    lows, highs = tuple(map(min, of_bars)), tuple(map(max, of_bars))
    at = tuple(map(float, range(len(places) + len(bars))))
    dots = [*zip(means, at, strict=False)]
    dots += [(mean, row) for row, some in zip(at[len(places) :], of_bars, strict=True) for mean in some]
    traces = (
        Trace("mean", KNOWN["nerf"].light, "dots", tuple(x for x, _ in dots), tuple(y for _, y in dots)),
        Trace("not distinguished", INK.light, "range", lows, at[len(places) :], highs),
    )
    title = f"Mean {record.metric}, and methods that share a letter"
    words = [f"{written([group])}: {', '.join(place.method for place in several)}" for group, several in bars.items()]
    rows += [written([group]) for group in bars]
    made = _panel(record, title, f"mean {record.metric}", traces, words or ["No two methods share a letter"], rows)
    return replace(made, x_limits=limits)


def _limits(means: list[float]) -> tuple[float, float] | None:
    """Return limits without methods far from the others, which would determine the axis; None if there are none."""
    if len(means) < LEAST_FOR_FAR:
        return None
    middle = median(means)
    reach = FAR * 1.4826 * median(abs(mean - middle) for mean in means)
    near = [mean for mean in means if abs(mean - middle) <= reach]
    return padded(near, log=False) if len(near) < len(means) else None


def _against(record: JudgementRecord) -> Panel:
    pairs = [pair for pair in record.given.pairs if pair.scenes_like_these and pair.scenes_like_these.simultaneous]
    ends = [pair.scenes_like_these.simultaneous or (0.0, 0.0) for pair in pairs if pair.scenes_like_these]
    at = tuple(map(float, range(len(pairs))))
    lows, highs = tuple(low for low, _ in ends), tuple(high for _, high in ends)
    traces = (
        Trace("no difference", MUTED.light, "floor", (0.0, 0.0), (-0.5, len(pairs) - 0.5)),
        Trace("simultaneous 95 % interval", KNOWN["nerf"].light, "range", lows, at, highs),
        Trace("difference", KNOWN["nerf"].light, "dots", tuple(pair.difference or 0.0 for pair in pairs), at),
    )
    title = f"{record.metric} minus that of {record.baseline}"
    words = [f"{pair.method} {number(record, pair.difference, '+')} {pair.verdict.phrase}" for pair in pairs]
    return _panel(record, title, title, traces, words, [pair.method for pair in pairs])


def _panel(
    record: JudgementRecord, title: str, label: str, traces: tuple[Trace, ...], words: list[str], rows: list[str]
) -> Panel:
    unit = f" ({record.unit})" if record.unit else ""
    size = (6.4, 0.75 + ROW_INCHES * len(rows))
    return Panel(title, f"{label}{unit}", "", traces, f"{title}: {'; '.join(words)}.", rows=tuple(rows), size=size)


def judgement_page(record: JudgementRecord) -> str:
    layout = Layout()
    parts, clean = layout.parts, record.without_suspects
    better = "higher" if record.higher_is_better else "lower"
    settings = {"metric": record.metric, "better": better, "smallest effect of interest": record.margin}
    settings |= {"baseline": record.baseline} if record.baseline is not None else {}
    without, squares = without_line(record) if record.suspects else "", matrix(record)
    margin = f"{record.margin}{' ' * bool(record.unit)}{record.unit}"
    others = [
        section(
            f"metric-{place}",
            f"Another metric: {other.metric}",
            parts.paragraph(headline(other)),
            parts.table(methods_grid(other, other.given)),
            parts.figures(plots([panel(other)], f"judgement-{place}"), "single"),
            *(parts.paragraph(f"Suspect: {suspect_line(other, suspect)}.") for suspect in other.suspects[:3]),
        )
        for place, other in enumerate(record.other_metrics, 2)
    ]
    return layout.page(
        "judgement_page.html",
        headline(record),
        [
            section("methods", "Methods", parts.table(methods_grid(record, record.given), False)),
            section("picture", "Means and groups", parts.figures(plots([panel(record)], "judgement"), "single")),
            section("pairs", "Pairs", parts.pairs(squares, margin) if squares else Markup("")),
            section(
                "suspects",
                "Suspect results",
                parts.table(suspects_grid(record), False),
                parts.paragraph(without),
                parts.table(changes_grid(record)),
                parts.table(methods_grid(record, clean, "Without the suspect results") if clean else None),
            ),
            *others,
        ],
        [("SHA-256 of the table", [*record.digests.items()]), ("Settings", shell.settings_rows(settings))],
        record=record,
        notes=[
            *([f"{record.read_as}."] if record.read_as else []),
            *([missing_line(record)] if record.missing else []),
            *record.notes,
        ],
        suspects=[suspect_line(record, suspect) for suspect in record.suspects[:3]],
        without=without,
    )


def write_judgement_page(record: JudgementRecord, out: Path) -> Path:
    path = out / "judgement.html"
    write_atomically(path, judgement_page(record), fsync=False)
    return path
