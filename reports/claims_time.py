"""Table 3: how soon a score is reached.

The harness judges that as a survival problem (`harness.targets_record`): a run that never gets there is censored, not
dropped. A claim about 30 dB is judged where the runs were watched for 30 dB. Where they were watched for a lower
target, its saving stands beside and the claim is *not tested at this scale*, whatever came out: NeRF was not seen to
get to 30 dB either.
"""

from statistics import median

from harness.targets_record import TargetComparison, TargetsRecord
from reports.judging import judge_difference, rounded_away
from reports.ledger import UNTESTED, Bench, Finding, Printed, Verdict
from reports.scale import strangers, unless_whole
from reports.selection import behind_saving
from reports.wording import count, counted, number

HOW = "{what} until mean test PSNR reaches the target, paired by scene and seed; censored where it never does"
WHAT = {"steps": "training steps", "seconds": "training seconds"}
UNITS = {"steps": 1.0, "seconds": 3600.0}
"""Of the printed figure: steps, and hours."""


def saving(bench: Bench, entry: Printed) -> Finding:
    """Per cent less of steps or seconds to the target."""
    axis, targets = entry.of["axis"], bench.targets
    how = HOW.format(what=WHAT[axis])
    if targets is None or targets.target is None:
        return Finding(UNTESTED, how, note="this run has no record of when a score was reached")
    one = targets.comparison("all", "qnerf", "nerf", axis)
    started = {cell.method for cell in bench.records.cells if cell.status != "not_available"}
    if one is None or not {"qnerf", "nerf"} <= started or not isinstance(entry.printed, int | float):
        return Finding(UNTESTED, how, note="Q-NeRF was not compared with NeRF in this run")
    pair = one.simultaneous or one.interval
    verdict = verdict_of(entry.printed, rounded_away(entry), one, targets.printed)
    verdict = unless_whole(bench.records, verdict)
    note = "; ".join(filter(None, [_note(one, targets), strangers(bench.records)]))
    return Finding(verdict, how, one.saving, pair, note=note, runs=behind_saving(one))


def verdict_of(printed: float, rounding: float, one: TargetComparison, is_printed_target: bool) -> Verdict:
    """By the rule above; what is censored on one side allows no verdict that it could turn."""
    ours, theirs = one.never
    if not is_printed_target:
        return UNTESTED
    if one.unpaired:
        return "inconclusive"
    if ours == one.pairs >= 2 and theirs == 0:
        return "does not hold"
    said = judge_difference(printed, rounding, one.simultaneous or one.interval)
    # the true saving is larger where NeRF was not watched to its end or Q-NeRF was there before the first look
    if said == "does not hold" and (theirs or one.earlier[0]):
        return "inconclusive"
    # and smaller the other way round
    return "inconclusive" if said == "holds" and (ours or one.earlier[1]) else said


def _note(one: TargetComparison, targets: TargetsRecord) -> str:
    """At which target, how many of each got there while both were watched, and whether the saving is a bound."""
    parts = [f"at {number(targets.target, 1)} dB" + ("" if targets.printed else " instead of 30 dB")]
    if one.pairs:
        there = [count(one.pairs - never) for never in one.never]
        parts.append(
            f"within the {WHAT[one.axis]} that both were watched, {there[0]} of {counted(one.pairs, 'run')} of Q-NeRF "
            f"and {there[1]} of {count(one.pairs)} of NeRF reached it"
        )
    for method, earlier in zip(("Q-NeRF", "NeRF"), one.earlier, strict=True):
        if earlier:
            parts.append(f"{earlier} of {counted(one.pairs, 'run')} of {method} had reached it by the first checkpoint")
    if one.saving is not None:
        parts.append(bound(one))
    if one.unpaired:
        parts.append(f"{counted(one.unpaired, 'pair')} lost" if one.pairs else f"all {one.unpaired} pairs lost")
    return "; ".join(filter(None, parts))


def bound(one: TargetComparison) -> str:
    """What the saving is where some times are only known to be longer or shorter."""
    ours, theirs = one.never
    larger, smaller = bool(theirs or one.earlier[0]), bool(ours or one.earlier[1])
    if larger and smaller:
        return "the saving is of the time watched alone"
    return "the true saving is larger" if larger else "the true saving is smaller" if smaller else ""


def time_to_target(bench: Bench, entry: Printed) -> Finding:
    """Steps or hours themselves: of another machine and at another scale, so that they only stand beside."""
    method, axis = entry.of["method"], entry.of["axis"]
    how = f"median {WHAT[axis]} until a run of {method} reaches 30 dB"
    targets = bench.targets
    if targets is None or not targets.printed:
        return Finding(UNTESTED, how, note="runs were not watched for 30 dB, as NeRF does not get there")
    times = [
        one.time if one.known == "reached" else None
        for one in targets.reaches
        if (one.method, one.axis) == (method, axis)
    ]
    known = [time / UNITS[axis] for time in times if time is not None]
    if not times or len(known) < len(times):
        lost = len(times) - len(known)
        return Finding(
            UNTESTED, how, note=f"{lost} of {counted(len(times), 'run')} not seen to reach it" if lost else ""
        )
    digits = entry.digits + 1 if entry.digits else 0
    ends = " to ".join(number(one, digits) if digits else count(round(one)) for one in (min(known), max(known)))
    return Finding(UNTESTED, how, median(known), note=f"{ends} {entry.unit} over scenes and seeds")
