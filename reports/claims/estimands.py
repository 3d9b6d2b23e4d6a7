"""Two questions about one difference, side by side, and how often runs fail: the context of every verdict."""

from harness.records.cells import Comparison, Estimate
from harness.verdicts.comparisons import duels
from harness.verdicts.failures import FailureComparison, FailureRate, Failures, failures
from reports.claims.psnr_table import lines
from reports.data.load import Records
from reports.data.selection import behind_difference
from reports.data.wording import NARROW, counted, number, signed
from reports.page.grid import EMPTY, Column, Entry, Grid

BUDGETS = {"steps": "equal steps", "seconds": "equal training time"}
SENSES = {"on_these_scenes": "on these scenes", "scenes_like_these": "on scenes like these"}
EXPLAINED = (
    "On these scenes asks what another run with other seeds would say of the very scenes that were tried; its error "
    "comes from the seeds alone. On scenes like these asks what to expect of a scene that was not tried; its error "
    "comes from how much the scenes differ."
)


def sense_of(one: Comparison) -> str:
    """Return which of the two questions the verdict of a row answers."""
    return SENSES["scenes_like_these"] if one.scenes_like_these else SENSES["on_these_scenes"]


def difference_in_words(one: Comparison, scenes: list[str], seeds: list[int]) -> str:
    """Format a difference: `qnerf − nerf = −5.57 dB after equal steps (95 % interval −7.89 to −3.25; 8 scenes × 3
    seeds)`.
    """
    budget = f"after {BUDGETS[one.budget]}" if one.budget == "steps" else f"at {BUDGETS[one.budget]}"
    where = counted(len(scenes), "scene") if len(scenes) > 1 else scenes[0]
    size = f"{where} × {counted(len(seeds), 'seed')}"
    pair = one.simultaneous or one.interval
    known = f"95{NARROW}% interval {between(pair)}; {size}" if pair else f"too few for an interval; {size}"
    lost = f"; {one.unpaired} of {one.pairs + one.unpaired} pairs not judged" if one.unpaired else ""
    return f"{one.method} − {one.against} = {signed(one.difference)} dB {budget} ({known}{lost})"


def between(pair: tuple[float, float], digits: int = 2) -> str:
    """Format an interval: `−7.89 to −3.25`."""
    return f"{signed(pair[0], digits)} to {signed(pair[1], digits)}"


def senses_grid(records: Records) -> Grid:
    """Tabulate PSNR over all scenes, one row per pair of methods and budget."""
    chosen = [one for one in records.comparisons if (one.scene, one.metric) == ("all", "psnr") and one.on_these_scenes]
    rows = [
        [
            Entry(one.method, f"− {one.against}"),
            Entry(f"at {BUDGETS[one.budget]}"),
            Entry(f"{signed(one.difference)} dB", value=one.difference, runs=behind_difference(one)),
            *(_estimate(getattr(one, name)) for name in SENSES),
        ]
        for one in chosen
    ]
    columns = [Column("method", numeric=False), Column("budget", numeric=False), Column("difference")]
    columns += [Column(words, small="95 % interval") for words in SENSES.values()]
    note = f"{EXPLAINED} d is the difference in standard deviations of the pairs within a scene, or of the scenes."
    return Grid("The same difference, asked about twice", columns, rows, note=note)


def _estimate(one: Estimate | None) -> Entry:
    if one is None or one.interval is None:
        return EMPTY
    effect = f"d = {signed(one.effect, 1)}" if one.effect is not None else ""
    low, high = one.interval
    return Entry(between(one.interval), lines(one.verdict, effect), one.verdict, low, {"low": low, "high": high})


def found_failures(records: Records) -> Failures:
    return failures(records.cells, records.methods, duels(records.methods))


def rates_grid(records: Records) -> Grid:
    """Tabulate how often each method failed; empty if no run did."""
    found = found_failures(records)
    rates = found.rates if any(one.failed for one in found.rates) else []
    columns = [Column("method", numeric=False), *map(Column, ("runs", "diverged", "empty collapse", "rate"))]
    columns.append(Column("against", small="paired", numeric=False))
    rows = [
        [
            Entry(one.method),
            *(Entry(str(many)) for many in (one.runs, one.diverged, one.collapsed)),
            _rate(one),
            Entry("\n".join(map(_compared, (row for row in found.comparisons if row.method == one.method))) or "–"),
        ]
        for one in rates
    ]
    note = (
        "A run failed where it diverged or shows little but background. Rates have exact 95 % intervals (Clopper and "
        "Pearson), pairs of the same scene and seed an exact test (McNemar). All differences of scores are of the "
        "pairs of which neither failed."
    )
    return Grid("How often runs fail", columns, rows, note=note)


def _rate(one: FailureRate) -> Entry:
    low, high = (number(100 * end, 0) for end in one.interval)
    return Entry(f"{number(100 * one.rate, 0)}{NARROW}%", f"{low} to {high}{NARROW}%", value=100 * one.rate)


def _compared(one: FailureComparison) -> str:
    words = {"better": "fails less often", "worse": "fails more often", "inconclusive": "not told apart"}[one.verdict]
    sides = f"{one.only_method} : {one.only_against} of {counted(one.pairs, 'pair')}"
    return f"{one.against}: {words} ({sides}, p = {number(one.p_value, 3)})"
