"""Table 3: how soon a score is reached.

The harness judges that as a survival problem (`harness.targets_record`): a run that never gets there is censored, not
dropped. A claim about 30 dB is judged where the runs were watched for 30 dB. Where they were watched for a lower
target, its saving stands beside and the claim is *not tested at this scale*, with one exception: where every run of
NeRF reached the lower target and not one of Q-NeRF did, the claim *does not hold* at that scale, as who never gets to
the lower target while it is watched does not get to a higher one either.
"""

from statistics import median

from harness.targets_record import TargetComparison, TargetsRecord
from reports.judging import half_unit, judge_difference
from reports.ledger import UNTESTED, Bench, Finding, Pair, Printed, Verdict
from reports.wording import counted, number

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
    if one is None or one.saving is None or not isinstance(entry.printed, int | float):
        return Finding(UNTESTED, how, note="Q-NeRF was not compared with NeRF in this run")
    pair = one.simultaneous or one.interval
    verdict = verdict_of(entry.printed, half_unit(entry.printed), one, targets.printed)
    return Finding(verdict, how, one.saving, pair, note=_note(one, targets))


def verdict_of(printed: float, rounding: float, one: TargetComparison, is_printed_target: bool) -> Verdict:
    """By the rule above; what is censored on one side allows no verdict that it could turn."""
    ours, theirs = one.never
    if one.left_aside:
        return "inconclusive" if is_printed_target else UNTESTED
    if ours == one.pairs >= 2 and theirs == 0:
        return "does not hold"
    if not is_printed_target:
        return UNTESTED
    said = judge_difference(printed, rounding, one.simultaneous or one.interval)
    # the true saving is larger where NeRF was not watched to its end or Q-NeRF was there before the first look
    if said == "does not hold" and (theirs or one.earlier[0]):
        return "inconclusive"
    # and smaller the other way round
    return "inconclusive" if said == "holds" and (ours or one.earlier[1]) else said


def _note(one: TargetComparison, targets: TargetsRecord) -> str:
    parts = [f"at {number(targets.target, 1)} dB" + ("" if targets.printed else " instead of 30 dB")]
    for method, never, earlier in zip(("Q-NeRF", "NeRF"), one.never, one.earlier, strict=True):
        if never:
            parts.append(f"{never} of {counted(one.pairs, 'run')} of {method} never reached it")
        if earlier:
            parts.append(f"{earlier} of {counted(one.pairs, 'run')} of {method} had reached it by the first checkpoint")
    if one.left_aside:
        parts.append(f"{counted(one.left_aside, 'pair')} lost")
    return "; ".join(parts)


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
    pair: Pair | None = (min(known), max(known)) if len(known) > 1 else None
    return Finding(UNTESTED, how, median(known), pair, note="range over scenes and seeds")
