"""Serving in words: times, bytes, targets, and which order of rendering gets there first."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from harness.records.serving_record import (
    Allocation,
    Anytime,
    AttentionRecord,
    FirstFrame,
    Measure,
    NotByRegions,
    Order,
    PhiCheck,
    Way,
)
from reports.data.wording import NARROW, Verdict, bare, counted, listed, number, significant

SOURCES = {
    "render": "rendered",
    "level 2": "disk (level 2)",
    "level 1": "memory (level 1)",
    "level 0": "memory (level 0)",
}
"""The sources from the slowest to the fastest."""
TIMED = {
    "render": "rendered",
    "level 2 cold": "disk, file not in the system’s memory",
    "level 2": "disk, file in the system’s memory",
    "level 0 hashed": "memory (level 0), weights hashed at the call",
    "level 1": "memory (level 1)",
    "level 0": "memory (level 0)",
}
"""The timed operations, in the same order."""
MAPS = {
    "point": "a point of interest",
    "mask": "a user’s mask",
    "gradients": "gradients of the coarse frame",
    "error": "estimated error",
    "foveal": "falling off as in an eye",
}
"""Attention maps in words; others are named as in the record."""
ORDERS = {"attention": "by attention", "raster": "in raster order", "spread": "spread", "plain": "plain"}
MEASURES: dict[Measure, str] = {
    "whole": "the whole picture",
    "hardest": "the quarter of the regions in which the coarse frame is most wrong",
    "attended": "the quarter of the regions that is attended most",
}
WAYS: dict[Way, str] = {
    "evaluations": "by attention, as many evaluations",
    "samples": "by attention, as many samples",
    "even": "the same for each ray",
}
OUTCOMES: dict[Verdict, str] = {"seen": "met", "not seen at this scale": "missed", "inconclusive": "open"}


def brief(seconds: float) -> str:
    """Return the time as 18.3 µs, 45.2 ms, 1.20 s."""
    for size, unit in ((1.0, "s"), (1e-3, "ms")):
        if seconds >= size:
            return f"{significant(seconds / size)} {unit}"
    return "0 s" if seconds == 0 else f"{significant(seconds * 1e6)} µs"


def bytes_said(many: int) -> str:
    """Return the size as 160 kB, 1.05 MB: powers of a thousand."""
    for size, unit in ((10**9, "GB"), (10**6, "MB"), (10**3, "kB")):
        if many >= size:
            return f"{significant(many / size)} {unit}"
    return counted(many, "byte")


def times(ratios: Sequence[float]) -> str:
    """Return the factor as 2 100 times, 2 100 to 3 900 times."""
    low, high = significant(min(ratios)), significant(max(ratios))
    return f"{low} times" if low == high else f"{low} to {high} times"


def outcome(verdicts: Sequence[Verdict]) -> str:
    """Return `met`, `missed`, `met in 4 of 6 cases, missed in 1, open in 1: its spread reaches across`."""
    kinds = [one for one in OUTCOMES if one in verdicts]
    across = ": the spread reaches across" if "inconclusive" in kinds else ""
    if len(kinds) == 1:
        return f"{OUTCOMES[kinds[0]]}{across}"
    parts = [f"{OUTCOMES[kind]} in {sum(one == kind for one in verdicts)}" for kind in kinds]
    parts[0] += f" of {len(verdicts)} cases"
    return f"{', '.join(parts)}{across}"


def factor(ratios: Sequence[float]) -> str:
    """Return geometric mean and range: `0.61 times (0.41 to 0.92)`."""
    from statistics import geometric_mean

    middle = number(geometric_mean(ratios))
    low, high = number(min(ratios)), number(max(ratios))
    return f"{middle} times" if low == high else f"{middle} times ({low} to {high})"


def of_cases(names: Sequence[tuple[str, str]]) -> str:
    """Return scene and map, gathered by scene: `lego (point, foveal) and ship (mask)`."""
    scenes = dict.fromkeys(scene for scene, _ in names)
    gathered = [
        f"{scene} ({', '.join(dict.fromkeys(kind for one, kind in names if one == scene))})" for scene in scenes
    ]
    return listed(gathered)


SHARE = 0.1
"""The share of the coarse frame's error at which a picture is called useful."""
RACED_ORDERS: tuple[Order, ...] = ("attention", "raster", "spread", "plain")


@dataclass(frozen=True)
class At:
    """Seconds, and the least and the most of the repeats."""

    seconds: float
    least: float
    most: float


Times = dict[Order, At | None]
"""Order → its time; None if it never gets there."""


@dataclass(frozen=True)
class Race:
    """One picture in all orders that were measured."""

    scene: str
    method: str
    attention: str
    times: dict[Measure, Times]

    def to(self, measure: Measure) -> Times:
        return self.times.get(measure, {})


def races(record: AttentionRecord, share: float = SHARE) -> list[Race]:
    """Return the races in the order of the record."""
    known: dict[tuple[str, str, str], dict[Measure, Times]] = {}
    for one in record.reaching:
        if math.isclose(one.share_of_error, share):
            times = known.setdefault((one.scene, one.method, one.attention), {}).setdefault(one.measure, {})
            times[one.order] = None if one.seconds is None or one.spread is None else At(one.seconds, *one.spread)
    return [Race(*name, times) for name, times in known.items()]


def earlier(times: Times, one: Order, other: Order) -> bool:
    """Whether `one` gets there, and `other` never, or later in every repeat than `one` in any."""
    mine, theirs = times.get(one), times.get(other)
    return mine is not None and (theirs is None or mine.most < theirs.least)


def first(times: Times) -> Order | None:
    """Return the order that gets there before all others; None if none does, or if the repeats leave it undecided."""
    there = [one for one, at in times.items() if at is not None]
    return next((one for one in there if all(earlier(times, one, other) for other in times if other != one)), None)


def mean_error(curve: Anytime, until: float, measure: Measure) -> float | None:
    """Return the mean over time of an error from the first frame on, until so many seconds: what a viewer sees
    meanwhile.

    A picture keeps its last error until the next region is done. The mean is None if the first frame comes later.
    """
    begin = curve.seconds[0]
    if until <= begin:
        return None
    ends = [*curve.seconds[1:], math.inf]
    spans = [max(0.0, min(end, until) - at) for at, end in zip(curve.seconds, ends, strict=True)]
    return sum(span * value for span, value in zip(spans, curve.rmse(measure), strict=True)) / (until - begin)


PERCENT = f"{100 * SHARE:.0f}{NARROW}%"


def answer(cases: list[Race]) -> str:
    """Return which order is first to the complete picture, in how many cases, and after how long."""
    if not cases:
        return "No order was timed."
    times = [f"{brief(at)} {ORDERS[order]}" for order in RACED_ORDERS if (at := _median(cases, order)) is not None]
    after = f": {listed(times)}{' (medians)' if len(cases) > 1 else ''}" if times else ""
    return (
        f"Until {PERCENT} of the coarse frame’s error is left in the whole picture{after}; the order by attention is "
        f"first {_counted(cases, 'whole')} of scene and map."
    )


def _median(cases: list[Race], order: Order) -> float | None:
    """Return the median; None if some case never got there."""
    times = [one.to("whole").get(order) for one in cases]
    there = [at.seconds for at in times if at is not None]
    return median(there) if there and len(there) == len(times) else None


def _counted(cases: list[Race], measure: Measure) -> str:
    """Return in how many cases attention is first of all orders, and in how many it is undecided."""
    known = [one for one in cases if one.to(measure)]
    won = sum(first(one.to(measure)) == "attention" for one in known)
    open_ = sum(first(one.to(measure)) is None for one in known)
    undecided = f" ({open_} undecided: repeats overlap)" if open_ else ""
    return f"in {won} of {counted(len(known), 'case')}{undecided}"


def compared(cases: list[Race]) -> list[str]:
    """Compare the complete picture order against order, then the parts of it."""
    said = []
    parts = []
    for order in RACED_ORDERS[1:]:
        known = [one for one in cases if {"attention", order} <= set(one.to("whole"))]
        if not known:
            continue
        ahead = sum(earlier(one.to("whole"), "attention", order) for one in known)
        behind = [(one.scene, one.attention) for one in known if earlier(one.to("whole"), order, "attention")]
        open_ = len(known) - ahead - len(behind)
        late = f", later in {len(behind)} ({_where(behind, known)})" if behind else ""
        parts.append(f"{_named(order)}: earlier in {ahead}{late}{f', undecided in {open_}' if open_ else ''}")
    if parts:
        said.append(f"In the whole picture, attention against {'; against '.join(parts)}.")
    if any(one.to("hardest") for one in cases):
        said.append(
            "In the quarter of the regions in which the coarse frame is most wrong, which no map chooses, attention is "
            f"first {_counted(cases, 'hardest')}."
        )
    if any(one.to("attended") for one in cases):
        said.append(
            f"In the quarter of the regions that is attended most it is first {_counted(cases, 'attended')}: before "
            "other orders of regions by construction, as the map that orders them also says which are attended."
        )
    return said


def _where(some: list[tuple[str, str]], known: list[Race]) -> str:
    return "all of them" if len(some) == len(known) else of_cases(some)


def totals(record: AttentionRecord) -> list[str]:
    """Return the cost of the parts: the complete picture's seconds in each order against those of plain rendering."""
    parts = []
    for order in RACED_ORDERS[:-1]:
        found = [
            one.seconds[-1] / plainly_.seconds[-1]
            for one in record.curves
            if one.order == order and (plainly_ := _partner(record, one, "plain")) and plainly_.seconds[-1] > 0
        ]
        if found:
            parts.append(f"{factor(found)} {ORDERS[order]}")
    if not parts:
        return []
    return [
        "Seconds until all is there, against plain rendering, which has no coarse frame and shows nothing before its "
        f"first call is done: {listed(parts)}."
    ]


def _named(order: Order) -> str:
    named = {"raster": "raster order", "spread": "pixels spread over the picture", "plain": "plain rendering"}
    return named.get(order, order)


def averaged(record: AttentionRecord) -> list[str]:
    """Return what a viewer sees meanwhile: errors averaged over the time until both are done, against the other
    orders.
    """
    said = []
    for order in RACED_ORDERS[1:]:
        ratios: dict[Measure, list[float]] = {"whole": [], "hardest": []}
        for one in record.curves:
            mine = _partner(record, one, "attention")
            if one.order != order or mine is None:
                continue
            until = max(mine.seconds[-1], one.seconds[-1])
            for measure, found in ratios.items():
                a, b = mean_error(mine, until, measure), mean_error(one, until, measure)
                if a and b:
                    found.append(a / b)
        if ratios["whole"] and ratios["hardest"]:
            said.append(
                f"against {_named(order)}, the error of the whole picture is {factor(ratios['whole'])} as large, that "
                f"of the hardest quarter {factor(ratios['hardest'])}"
            )
    if not said:
        return []
    return [f"Averaged over the time until all is done, {'; '.join(said)}: geometric means over the cases, and ranges."]


def _partner(record: AttentionRecord, one: Anytime, order: Order) -> Anytime | None:
    """Return the same picture in another order."""
    wanted = (one.scene, one.method, one.attention, order)
    return next((it for it in record.curves if (it.scene, it.method, it.attention, it.order) == wanted), None)


def allocated(found: list[Allocation]) -> list[str]:
    """Compare samples placed by attention with the same for each ray: at the same total cost, and with as many."""
    said = []
    if pairs := pairs_of(found, "evaluations"):
        said.append(
            "At the same total cost, in network evaluations and with those of finding out where samples belong "
            f"({_percent([one.own / one.evaluations for one, _ in pairs])} of them), samples by attention leave an "
            f"error of the integral that is {_errors(pairs)}, against the same for each ray; {_cost(pairs)}."
        )
    if pairs := pairs_of(found, "samples"):
        said.append(
            f"With as many samples it is {_errors(pairs)}, but that is no equal cost, as empty space needs no "
            f"evaluation: {_cost(pairs)}."
        )
    return said


def _errors(pairs: list[tuple[Allocation, Allocation]]) -> str:
    whole = _ratios([(one.rmse_whole, other.rmse_whole) for one, other in pairs])
    attended = _ratios([(one.rmse_attended, other.rmse_attended) for one, other in pairs])
    if not whole or not attended:
        return "the same: none"
    return f"{factor(whole)} as large in the whole picture and {factor(attended)} in what is attended"


def _cost(pairs: list[tuple[Allocation, Allocation]]) -> str:
    """Return evaluations and seconds, and the comparison with the truth if it is known."""
    evaluations = factor([one.evaluations / other.evaluations for one, other in pairs])
    seconds = _ratios([(one.seconds, other.seconds) for one, other in pairs])
    truths = [
        (one.truth_whole, other.truth_whole)
        for one, other in pairs
        if one.truth_whole is not None and other.truth_whole is not None
    ]
    against = _ratios(truths)
    return (
        f"it takes {evaluations} the evaluations"
        + (f" and {factor(seconds)} the seconds" if seconds else "")
        + (f", and against the ground truth the picture is {factor(against)} as wrong" if against else "")
    )


def _percent(shares: list[float]) -> str:
    low, high = f"{100 * min(shares):.0f}", f"{100 * max(shares):.0f}"
    return f"{low}{NARROW}%" if low == high else f"{low} to {high}{NARROW}%"


def pairs_of(found: list[Allocation], way: Way) -> list[tuple[Allocation, Allocation]]:
    """Return pairs of an allocation by attention and the even picture that it is compared with."""
    even = {(one.scene, one.method, one.attention, one.against): one for one in found if one.way == "even"}
    return [
        (one, other)
        for one in found
        if one.way == way and (other := even.get((one.scene, one.method, one.attention, one.against)))
    ]


def _ratios(pairs: Sequence[tuple[float, float]]) -> list[float]:
    return [one / other for one, other in pairs if one > 0 and other > 0]


def phi_said(phi: PhiCheck) -> list[str]:
    """Return that a factor scales all alike, and what was found when it was left out."""
    if not phi.maps:
        return []
    changed = phi.orders_changed + phi.allocations_changed
    why = (
        "a common factor scales all alike and changes nothing"
        if not changed
        else "which a common factor cannot do: a fault of rounding, or of ours"
    )
    return [
        f"φ of Eq. 7: priorities sum to {significant(phi.sum_of_priorities, 4)}, not to 1, so that they are no "
        f"probabilities. Of {counted(phi.maps, 'map')} looked at, leaving φ out changed the order in "
        f"{phi.orders_changed} and the samples in {phi.allocations_changed}: {why}."
    ]


def plainly(found: list[NotByRegions]) -> list[str]:
    """Return what is not rendered by regions, why, and what that would change; one sentence per method."""
    said = []
    for method, reason in dict.fromkeys((one.method, one.reason) for one in found):
        off = [
            f"{significant(one.rmse)} on {one.scene}" for one in found if (one.method, one.reason) == (method, reason)
        ]
        said.append(
            f"{method} is not rendered by regions: {reason.rstrip('.')}. By regions its picture would be off by "
            f"{listed(off)} (RMSE of display colour)."
        )
    return said


def seen_first(one: FirstFrame) -> str:
    """Return how soon the viewer shows something, against its target."""
    met = "met" if one.seconds_coarse <= one.target else "missed"
    beside = " side by side" if len(one.methods) > 1 else ""
    coarse = [
        f"{method} a ray for each {stride} × {stride} px"
        + (f" at {score:.1f}{NARROW}dB of the whole picture" if score is not None else "")
        for method, stride, score in zip(one.methods, one.strides, one.psnr_coarse, strict=True)
    ]
    return (
        f"The viewer’s first frame of {listed(one.methods)}{beside} on {one.scene}, {one.width} × {one.height} px with "
        f"methods loaded and nothing in the cache, is computed after {brief(one.seconds_coarse)} (target "
        f"{bare(one.target)} s: {met}), coarse: {listed(coarse)}; all of it after {brief(one.seconds_whole)}, both "
        f"on the server, without the way to a browser; the slowest of {counted(one.calls, 'call')}."
    )
