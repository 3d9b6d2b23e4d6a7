"""Attention-prioritised rendering in sentences, each made from figures."""

import math
from collections.abc import Sequence
from statistics import median

from harness.serving_record import Allocation, Anytime, AttentionRecord, FirstFrame, NotByRegions, Order, PhiCheck
from reports.evidence_view import plain
from reports.serving_races import ORDERS, SHARE, Race, earlier, first, mean_error
from reports.serving_wording import ORDERS as WORDS
from reports.serving_wording import brief, factor, of_cases
from reports.wording import NARROW, counted, listed, significant

PERCENT = f"{100 * SHARE:.0f}{NARROW}%"
SAME_TOTAL = 0.05
"""Numbers of samples a ray that differ by less are the same total: allocation rounds down."""


def answer(cases: list[Race]) -> str:
    """Which order is first where it is attended, on how many scenes, and after how long."""
    if not cases:
        return "No order was timed."
    won = [one for one in cases if first(one.attended) == "attention"]
    scenes = list(dict.fromkeys(one.scene for one in cases))
    whole = [scene for scene in scenes if all(one in won for one in cases if one.scene == scene)]
    said = (
        f"In order of attention, what is attended is down to {PERCENT} of the coarse frame’s error sooner than in any "
        f"other order in {len(won)} of {counted(len(cases), 'case')} of scene and map, on {len(whole)} of "
        f"{counted(len(scenes), 'scene')} with every map"
    )
    times = [f"{brief(at)} {WORDS[order]}" for order in ORDERS if (at := _median(cases, order)) is not None]
    return f"{said}: after {listed(times)}{' (medians)' if len(cases) > 1 else ''}." if times else f"{said}."


def _median(cases: list[Race], order: Order) -> float | None:
    """None where some case never got there."""
    times = [one.attended.get(order) for one in cases]
    there = [at for at in times if at is not None]
    return median(there) if there and len(there) == len(times) else None


def paid(cases: list[Race]) -> list[str]:
    """Where the order by attention is not first: in the whole picture, and in what is attended."""
    said = []
    known = [one for one in cases if "attention" in one.whole and len(one.whole) > 1]
    if known:
        won = sum(first(one.whole) == "attention" for one in known)
        parts = [f"Over the whole picture it gets down to {PERCENT} first in {won} of {counted(len(known), 'case')}"]
        for order in ORDERS[1:]:
            behind = [(one.scene, one.attention) for one in known if earlier(one.whole, order, "attention")]
            if behind:
                where = "all of them" if len(behind) == len(known) else f"{len(behind)}: {of_cases(behind)}"
                parts.append(f"it is behind {_named(order)} in {where}")
        said.append("; ".join(parts) + ("." if len(parts) > 1 else ", and is behind no other order."))
    lost = [(one.scene, one.attention) for one in cases if first(one.attended) != "attention"]
    if lost:
        said.append(f"Where it is not first even in what is attended: {of_cases(lost)}.")
    return said


def _named(order: Order) -> str:
    return {"raster": "raster order", "spread": "pixels spread over the picture"}.get(order, order)


def averaged(record: AttentionRecord) -> list[str]:
    """What a viewer sees meanwhile: errors averaged over the time until both are done, against the other orders."""
    said = []
    for order in ORDERS[1:]:
        ratios: dict[bool, list[float]] = {False: [], True: []}
        for one in record.curves:
            mine = _partner(record, one, "attention")
            if one.order != order or mine is None:
                continue
            until = max(mine.seconds[-1], one.seconds[-1])
            for whole, found in ratios.items():
                a, b = mean_error(mine, until, whole), mean_error(one, until, whole)
                if a and b:
                    found.append(a / b)
        if ratios[False] and ratios[True]:
            said.append(
                f"against {_named(order)}, the attended error is {factor(ratios[False])} as large, that of the whole "
                f"picture {factor(ratios[True])}"
            )
    if not said:
        return []
    return [f"Averaged over the time until all is done, {'; '.join(said)}: geometric means over the cases, and ranges."]


def _partner(record: AttentionRecord, one: Anytime, order: Order) -> Anytime | None:
    """The same picture in another order."""
    wanted = (one.scene, one.method, one.attention, order)
    return next((it for it in record.curves if (it.scene, it.method, it.attention, it.order) == wanted), None)


def allocated(found: list[Allocation]) -> list[str]:
    """Samples placed by attention against the same for each ray: at the same cost, and with the same number."""
    said = []
    cases = [(one, *at) for one in found if one.by_attention and (at := at_cost(found, one))]
    attended = _ratios([(one.rmse_attended, even) for one, even, _ in cases])
    whole = _ratios([(one.rmse_whole, even) for one, _, even in cases])
    if attended and whole:
        said.append(
            "At as many network evaluations, samples that are shared out by attention leave an error of the integral "
            f"that is {factor(attended)} as large in what is attended and {factor(whole)} in the whole picture, "
            f"against the same for each ray, read off between its numbers of samples in {counted(len(cases), 'case')}."
        )
    pairs = pairs_of(found)
    attended = _ratios([(one.rmse_attended, other.rmse_attended) for one, other in pairs])
    whole = _ratios([(one.rmse_whole, other.rmse_whole) for one, other in pairs])
    cost = _ratios([(one.evaluations, other.evaluations) for one, other in pairs])
    if attended and whole:
        truths = [
            (one.truth_attended, other.truth_attended)
            for one, other in pairs
            if one.truth_attended is not None and other.truth_attended is not None
        ]
        against = _ratios(truths)
        tail = f"; against the ground truth, what is attended is {factor(against)} as wrong" if against else ""
        said.append(
            f"With as many samples it is {factor(attended)} and {factor(whole)} as large, but at {factor(cost)} the "
            f"network evaluations, as empty space costs none{tail}."
        )
    return said


def at_cost(found: list[Allocation], one: Allocation) -> tuple[float, float] | None:
    """Attended and whole error of the same for each ray at as many evaluations as `one` took: on a line between two
    numbers of samples, both axes logarithmic. None where it was not measured on both sides.
    """
    same = [
        other
        for other in found
        if not other.by_attention
        and (one.scene, one.method, one.attention) == (other.scene, other.method, other.attention)
    ]
    below = max((it for it in same if it.evaluations <= one.evaluations), key=lambda it: it.evaluations, default=None)
    above = min((it for it in same if it.evaluations >= one.evaluations), key=lambda it: it.evaluations, default=None)
    if below is None or above is None:
        return None
    ends = ((below.rmse_attended, above.rmse_attended), (below.rmse_whole, above.rmse_whole))
    if min(value for pair in ends for value in pair) <= 0:
        return None
    span = math.log(above.evaluations / below.evaluations)
    share = math.log(one.evaluations / below.evaluations) / span if span else 0.0
    attended, whole = (low * (high / low) ** share for low, high in ends)
    return attended, whole


def pairs_of(found: list[Allocation]) -> list[tuple[Allocation, Allocation]]:
    """By attention and the same for each ray, with the same total."""
    return [
        (one, other)
        for one in found
        for other in found
        if one.by_attention
        and not other.by_attention
        and (one.scene, one.method, one.attention) == (other.scene, other.method, other.attention)
        and abs(one.bins - other.bins) <= SAME_TOTAL * other.bins
    ]


def _ratios(pairs: Sequence[tuple[float, float]]) -> list[float]:
    return [one / other for one, other in pairs if one > 0 and other > 0]


def phi_said(phi: PhiCheck) -> list[str]:
    """That a factor scales all alike, and what was found when it was left out."""
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
    """What is not rendered by regions, why, and what that would change; a sentence a method."""
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
    """How soon the viewer shows something, against its target."""
    met = "met" if one.seconds_coarse <= one.target else "missed"
    beside = " side by side" if len(one.methods) > 1 else ""
    return (
        f"The viewer’s first frame of {listed(one.methods)}{beside} on {one.scene}, {one.width} × {one.height} px with "
        f"nothing in the cache, is there after {brief(one.seconds_coarse)} (target {plain(one.target)} s: "
        f"{met}), all of it after {brief(one.seconds_whole)}; the slowest of {counted(one.calls, 'call')}."
    )
