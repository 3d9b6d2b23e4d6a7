"""Abstract and Table 2: how much better, and how good."""

from harness.json_record import finite_or_none
from harness.records import Comparison
from reports.headline import roles
from reports.judging import half_unit, interval_of_mean, judge_gain, judge_level, rounded_away
from reports.ledger import UNTESTED, Bench, Finding, Pair, Printed, Verdict
from reports.scale import strangers, unless_whole
from reports.selection import Selection, behind_difference
from reports.wording import counted, interval, listed, signed

MARGINS = {"psnr": 0.2, "ssim": 0.005}
"""Smallest differences of interest, as the harness declares them for its comparisons."""

PAIRED = "mean test {metric} at equal steps, paired by {units}"


def interval_judged(one: Comparison) -> Pair | None:
    """The one that verdicts are taken from; runs recorded before there were families have only their own."""
    return one.simultaneous or one.interval


def gain(bench: Bench, entry: Printed) -> Finding:
    """A gain of one method over another, on a scene or over all."""
    scene, method, against, metric = (entry.of[name] for name in ("scene", "method", "against", "metric"))
    one = bench.records.comparison(scene, method, against, metric)
    how = PAIRED.format(metric=metric.upper(), units="scene and seed" if scene == "all" else "seed")
    if one is None or not isinstance(entry.printed, int | float) or not tried(bench, one):
        return Finding(UNTESTED, how, note=f"{method} was not compared with {against} {_where(scene)} in this run")
    pair = interval_judged(one)
    verdict = judge_gain(entry.printed, rounded_away(entry), one.difference, pair, one.unpaired)
    if scene == "all":
        verdict = unless_whole(bench.records, verdict)
    return Finding(verdict, how, one.difference, pair, note=_note(bench, scene), runs=behind_difference(one))


def tried(bench: Bench, one: Comparison) -> bool:
    """Whether there is a difference, or runs of both methods that could have given one and were lost."""
    if one.difference is not None:
        return True
    started = {
        cell.method
        for cell in bench.records.cells
        if one.scene in ("all", cell.scene) and cell.status != "not_available"
    }
    return {one.method, one.against} <= started


def range_of_gains(bench: Bench, entry: Printed) -> Finding:
    """1.2–1.8 dB on all scenes: refuted by one of them or by their mean, established only by every one.

    That every scene gains at least the lower end implies that their mean does. So it *does not hold* where the interval
    of a printed scene or that of the mean ends below the lower end, and *holds* where the interval of each printed
    scene lies at or above it.
    """
    how = "worst to best scene; refuted by a scene or by the mean, holds only if every scene of Table 2 reaches it"
    one = bench.records.comparison("all", "qnerf", "nerf")
    if one is None or not isinstance(entry.printed, tuple) or not tried(bench, one):
        return Finding(UNTESTED, how, note="Q-NeRF was not compared with NeRF in this run")
    low = entry.printed[0]
    rounding, pair = half_unit(low, entry.unit), interval_judged(one)
    of_mean = unless_whole(bench.records, judge_gain(low, rounding, one.difference, pair, one.unpaired))
    rows = {name: bench.records.comparison(name, "qnerf", "nerf") for name in bench.scenes_of_table2()}
    there = {name: row.difference for name, row in rows.items() if row and row.difference is not None}
    each = [
        judge_gain(low, rounding, row.difference, interval_judged(row), row.unpaired) if row else UNTESTED
        for row in rows.values()
    ]
    verdict: Verdict = "inconclusive"
    if "does not hold" in (of_mean, *each):
        verdict = "does not hold"
    elif of_mean == "holds" and all(one == "holds" for one in each):
        verdict = "holds"
    below = [name for name, one in zip(rows, each, strict=True) if one == "does not hold"]
    mean = f"mean {signed(one.difference)} {interval(pair)}".strip() if one.difference is not None else ""
    notes = [f"below it on {listed(below)}" if below else "", mean, _note(bench, "all")]
    ends = (min(there.values()), max(there.values())) if there else None
    behind = behind_difference(one) if set(bench.records.scenes) <= set(rows) else None
    return Finding(verdict, how, ends, note="; ".join(filter(None, notes)), runs=behind)


def score(bench: Bench, entry: Printed) -> Finding:
    """How good a method gets. At another scale, or on other pictures than the paper's, the value only stands beside."""
    scene, method, metric = (entry.of[name] for name in ("scene", "method", "metric"))
    how = f"mean test {metric.upper()} of this run’s {method}, by seed"
    scenes = [name.lower() for name in bench.scenes_of_table2()] if scene == "all" else [scene]
    ran = [name for name in scenes if name in bench.records.scenes]
    by_seed: dict[int, list[float]] = {}
    lost = 0
    for name in ran:
        for cell in bench.records.cells_of(name, method):
            value = finite_or_none(cell.scores.get(metric))
            if cell.status == "done" and value is not None:
                by_seed.setdefault(cell.seed, []).append(value)
            else:
                lost += 1
    means = [sum(values) / len(values) for values in by_seed.values() if len(values) == len(ran)]
    if not means:
        return Finding(UNTESTED, how, note=f"{method} has no score {_where(scene)} in this run")
    pair = interval_of_mean(means)
    missing = [name for name in scenes if name not in ran]
    notes = [
        f"without {listed(missing)}" if missing else "",
        f"{counted(lost, 'cell')} without a score" if lost else "",
    ]
    measured = sum(means) / len(means)
    elsewhere = all(not one.rendered for one in bench.records.run.scenes)
    if not (bench.at_paper_scale and elsewhere):
        notes.append("other pictures than the paper’s" if bench.at_paper_scale else "")
        return Finding(UNTESTED, how, measured, pair, note="; ".join(filter(None, notes)))
    printed = entry.printed if isinstance(entry.printed, int | float) else float("nan")
    verdict = "inconclusive" if missing or lost else judge_level(printed, MARGINS[metric], pair)
    notes.append("on the view sets that were given: whether these are the paper’s, this program cannot tell")
    behind = Selection("" if scene == "all" else scene, method, metric=metric)
    exactly = behind if scene != "all" or set(ran) == set(bench.records.scenes) else None
    return Finding(verdict, how, measured, pair, note="; ".join(filter(None, notes)), runs=exactly)


def _where(scene: str) -> str:
    return "over all scenes" if scene == "all" else f"on {scene}"


def _note(bench: Bench, scene: str) -> str:
    """What is left of a gain over the baseline once bandwidth is matched, and what could not be paired."""
    records, parts = bench.records, []
    if scene == "all":
        parts.append(strangers(records))
    over_baseline = records.comparison(scene, "qnerf", "nerf")
    if over_baseline and over_baseline.unpaired:
        lost = counted(over_baseline.unpaired, "pair")
        parts.append(f"{lost} lost" if over_baseline.pairs else f"all {lost} lost")
    control = roles(records).control
    one = records.comparison(scene, "qnerf", control) if control else None
    if one is not None and one.difference is not None:
        shown = f"{signed(one.difference)} {interval(interval_judged(one))}".strip()
        parts.append(f"against {control}: {shown} ({one.verdict})")
    return "; ".join(filter(None, parts))
