"""The two questions that a difference answers, side by side, and how often runs fail: the context of every verdict."""

from harness.records.cells import Comparison, Estimate
from harness.records.verdict import Verdict, phrase_with
from harness.verdicts.failures import Failures, failures
from harness.verdicts.headline_family import is_headline
from reports.claims.psnr_table import ends_of, lines
from reports.data.load import Records
from reports.data.outcome import doubts
from reports.data.selection import behind_difference
from reports.data.wording import BUDGETS, NARROW, NOTHING, counted, interval, number, signed, tone_of_sign
from reports.page.grid import EMPTY, Column, Entry, Grid, without_empty_columns

SENSES = {"on_these_scenes": "on these scenes", "scenes_like_these": "on scenes like these"}
FAMILY = (
    "Equal steps and equal core seconds of all pairs are one family: p is adjusted by Holm’s procedure and decides the "
    "sign, the intervals are wide enough for all of them together (Bonferroni), and end at 0 where only Holm decides."
)
EXPLAINED = (
    "On these scenes asks what another run with other seeds would say of these scenes; its error "
    "comes only from the seeds. On scenes like these asks what to expect of a scene that was not tried; its error "
    "comes from how much the scenes differ."
)


def difference_in_words(row: Comparison, scenes: list[str], seeds: list[int]) -> str:
    """Format `qnerf − nerf = −5.57 dB after equal steps (95 % interval −7.89 to −3.25; 8 scenes × 3 seeds)`."""
    budget = f"after {BUDGETS[row.budget]}" if row.budget == "steps" else f"at {BUDGETS[row.budget]}"
    where = counted(len(scenes), "scene") if len(scenes) > 1 else scenes[0]
    size = f"{where} × {counted(len(seeds), 'seed')}"
    pair = row.simultaneous or row.interval
    known = f"95{NARROW}% interval {between(pair)}; {size}" if pair else f"too few for an interval; {size}"
    lost = f"; {row.unpaired} of {row.pairs + row.unpaired} pairs not judged" if row.unpaired else ""
    return f"{row.method} − {row.against} = {signed(row.difference)} dB {budget} ({known}{lost})"


def between(pair: tuple[float, float]) -> str:
    """Format an interval: `−7.89 to −3.25`."""
    return f"{signed(pair[0])} to {signed(pair[1])}"


def judged_in_words(pair: tuple[float, float], verdict: Verdict) -> str:
    """Format `−0.13 to +0.50: sign and size open`."""
    return f"{between(pair)}: {phrase_with(verdict, pair)}"


def senses_grid(records: Records) -> Grid:
    """Tabulate PSNR over all scenes, one row per pair of methods and budget."""
    along = [row.budget for row in records.comparisons]
    rows = [
        [
            Entry(row.method, f"− {row.against}"),
            Entry(f"at {BUDGETS[row.budget]}"),
            Entry(f"{signed(row.difference)} dB", value=row.difference, runs=behind_difference(row)),
            *(_estimate(getattr(row, name)) for name in SENSES),
            _robust(row),
        ]
        for row in records.comparisons
        if is_headline(row.scene, row.metric, row.budget, along) and row.on_these_scenes
    ]
    columns = [Column("method", numeric=False), Column("budget", numeric=False), Column("difference")]
    columns += [Column(words, small="95 % interval") for words in SENSES.values()]
    columns.append(Column("robust", small="Hodges–Lehmann"))
    flagged = [words for row in records.comparisons if row.flagged and row.metric == "psnr" for words in doubts(row)]
    effect = "d is the difference in standard deviations of the pairs within a scene, or of the scenes."
    note = f"{EXPLAINED} {FAMILY} {effect}"
    grid = Grid("One difference, two questions", columns, rows, note=" ".join([note, *flagged]))
    return without_empty_columns(grid, always=5)


def _estimate(about: Estimate | None) -> Entry:
    pair = (about.simultaneous or about.interval) if about else None
    if about is None or pair is None:
        return EMPTY
    effect = f"d = {signed(about.effect, 1)}" if about.effect is not None else ""
    chance = f"p = {number(about.p_adjusted, 3)}" if about.p_adjusted is not None else ""
    tone, words = tone_of_sign(about.verdict.sign), lines(phrase_with(about.verdict, pair), chance, effect)
    return Entry(between(pair), words, tone, pair[0], ends_of(pair))


def _robust(row: Comparison) -> Entry:
    if row.robust is None:
        return EMPTY
    return Entry(f"{signed(row.robust.difference)} dB", interval(row.robust.interval), value=row.robust.difference)


def failures_of(records: Records) -> Failures:
    return failures(records.cells, records.methods, records.run.roles.pairs(records.methods))


def rates_grid(records: Records) -> Grid:
    failed = failures_of(records)
    rates = failed.rates if any(rate.failed for rate in failed.rates) else []
    words = {"below 0": "fails less often", "above 0": "fails more often", "open": "not distinguished"}
    columns = [Column("method", numeric=False), *map(Column, ("runs", "diverged", "empty collapse", "rate"))]
    columns.append(Column("against", small="paired", numeric=False))
    rows = []
    for rate in rates:
        low, high = (number(100 * end, 0) for end in rate.interval)
        share = f"{number(100 * rate.rate, 0)}{NARROW}%"
        against = [
            f"{duel.against}: {words[duel.verdict]} ({duel.only_method} : {duel.only_against} of "
            f"{counted(duel.pairs, 'pair')}, p = {number(duel.p_value, 3)})"
            for duel in failed.comparisons
            if duel.method == rate.method
        ]
        rows.append(
            [
                Entry(rate.method),
                *(Entry(str(many), value=many) for many in (rate.runs, rate.diverged, rate.collapsed)),
                Entry(share, f"{low} to {high}{NARROW}%", value=100 * rate.rate),
                Entry("\n".join(against) or NOTHING),
            ]
        )
    note = (
        "A run failed if it diverged or shows little but background. Rates have exact 95 % intervals (Clopper and "
        "Pearson), pairs of the same scene and seed an exact test (McNemar). All differences of scores are over the "
        "pairs in which neither run failed."
    )
    return Grid("How often runs fail", columns, rows, note=note)
