"""The times at which cells reach a PSNR, and which method was sooner: times are censored, never dropped.

A run that ends below the target is censored: its time is known to be longer. A run that diverged or ended in empty
collapse never reaches the target, even if it scored above it before, because that is a result of its method. A run
that failed for other reasons (a full disk, a killed process) is censored when it failed, and its pairs are not judged.
A run above the target at its first checkpoint reached it at that time or earlier, and counts with the time of the
checkpoint. At equal steps this can hide a difference but never create one; on another clock no method is called sooner
than such a run.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Literal

import numpy as np
from msgspec.structs import replace

from harness.records.cells import USUAL, CellRecord, Estimate, Roles
from harness.records.claims import ClaimFile
from harness.records.metric_table import SMALLEST_SAVING
from harness.records.targets import Axis, Reach, ReachCurve, TargetComparison, TargetsRecord
from harness.records.verdict import OPEN, Sign, Verdict, verdict_of
from harness.verdicts.comparisons import (
    AT,
    FEWEST_SEEDS,
    NO_ESTIMATE,
    SPENT,
    Key,
    budgets_of,
    family_of,
    fields_of,
    scenes_of,
)
from harness.verdicts.failures import COLLAPSED, judgeable, state_of
from harness.verdicts.statistics import (
    CONFIDENCE,
    PairedDifference,
    on_one_scene,
    on_these_scenes,
    scenes_like_these,
    sign_test,
)

LOST = {"diverged": "diverged", COLLAPSED: "ended in empty collapse", "error": "failed", "done": "has no score"}
"""Map state → why a run counts as not reaching the target, even if it scored above it before."""
STAYING = {LOST[state] for state in ("diverged", COLLAPSED, "done")}
"""Why runs never reach the target and stay at risk."""


def targets(
    cells: list[CellRecord], methods: list[str], roles: Roles = USUAL, claims: Iterable[ClaimFile] = ()
) -> TargetsRecord:
    """Return a target PSNR that only the baseline's runs determine, the times of reaching it, and their comparisons.
    Cells that were not available do not count. The first target that `claims` name is preferred.
    """
    runs = [cell for cell in cells if cell.status != "not_available"]
    baseline = roles.among(methods).baseline
    printed = next((file for file in claims if file.target is not None), None)
    target, declared = chosen_target([cell for cell in runs if cell.method == baseline], baseline, printed)
    if target is None:
        return TargetsRecord(None, False, baseline, declared, [], [], [])
    scenes, axes = sorted({cell.scene for cell in runs}), budgets_of(runs)
    reaches = [reach(cell, axis, target) for axis in axes for cell in runs]
    curves = []
    for axis, method, scene in product(axes, methods, ["all", *scenes]):
        own = [each for each in reaches if (each.axis, each.method) == (axis, method) and scene in ("all", each.scene)]
        if own:
            curves.append(ReachCurve(method, scene, axis, *kaplan_meier(own)))
    comparisons = [
        compared(runs, method, against, axis, target, scene)
        for axis in axes
        for method, against in roles.pairs(methods)
        for scene in scenes_of(runs, method, against)
    ]
    return TargetsRecord(
        target, printed is not None and target == printed.target, baseline, declared, reaches, curves, comparisons
    )


def chosen_target(runs: list[CellRecord], baseline: str, printed: ClaimFile | None = None) -> tuple[float | None, str]:
    """Return the printed target if half of the `runs` reach it, else the largest whole dB that half of them reach, with
    a sentence on the choice; None if fewer than half of the runs finished with a score.
    """
    best = [max((psnr for _, psnr in scored(cell, "steps") if judgeable(cell)), default=-math.inf) for cell in runs]
    best.sort(reverse=True)
    median = best[math.ceil(len(best) / 2) - 1] if best else -math.inf
    if not math.isfinite(median):
        return None, f"No target: fewer than half of {baseline}'s runs have a score."

    def reaching(target: float) -> int:
        return sum(psnr >= target for psnr in best)

    also = ""
    if printed is not None and printed.target is not None:
        if median >= printed.target:
            many = f"{reaching(printed.target)} of {len(best)} runs of {baseline}"
            return printed.target, f"{printed.target:g} dB as in {printed.title}: {many} reach it."
        also = f"; {reaching(printed.target)} reach the {printed.target:g} dB of {printed.title}"
    target = math.floor(median)
    return float(target), (
        f"{target} dB, the largest whole number that at least half of {baseline}'s runs reach "
        f"({reaching(target)} of {len(best)}{also}); chosen from {baseline}'s runs alone."
    )


def reach(cell: CellRecord, axis: Axis, target: float) -> Reach:
    """Return when `cell` first reached `target`, on a line over the logarithm of time between checkpoints."""
    points = scored(cell, axis)
    if not judgeable(cell) or not points:
        watched = points[-1][0] if points else float(getattr(cell, SPENT[axis]) or 0.0)
        return Reach(cell.scene, cell.method, cell.seed, axis, watched, "never", LOST[state_of(cell)])
    time, known = first_reached(points, target)
    why = f"ended at {points[-1][1]:.2f} dB" if known == "never" else ""
    return Reach(cell.scene, cell.method, cell.seed, axis, time, known, why)


def first_reached(
    points: list[tuple[float, float]], target: float
) -> tuple[float, Literal["reached", "never", "earlier"]]:
    """Return the time and `Reach.known` from at least one point (time, score), in the order of time."""
    if points[0][1] >= target:
        return points[0][0], "earlier"
    for (before, low), (after, high) in pairwise(points):
        if high >= target:
            share = (target - low) / (high - low)
            return math.exp(math.log(before) + share * (math.log(after) - math.log(before))), "reached"
    return points[-1][0], "never"


def kaplan_meier(reaches: list[Reach]) -> tuple[list[float], list[float], list[int]]:
    """Return (times, share that has reached the target, runs at risk just before), as `ReachCurve` holds them.

    Runs that diverged or collapsed stay at risk until the last run ends: censoring them earlier would count them as no
    worse than the others. Runs that failed for other reasons are censored when they failed.
    """
    end = max(each.time for each in reaches)
    lost = [each.known == "never" and each.why in STAYING for each in reaches]
    watched = np.array([end if is_lost else each.time for each, is_lost in zip(reaches, lost, strict=True)])
    event = np.array([each.known != "never" for each in reaches])
    times = np.unique(np.append(watched[event], end))
    left, share, at_risk = 1.0, [], []
    for time in times:
        risk = int((watched >= time).sum())
        left *= 1.0 - (event & (watched == time)).sum() / risk
        share.append(1.0 - float(left))
        at_risk.append(risk)
    return [float(time) for time in times], share, at_risk


@dataclass(frozen=True)
class Paired:
    """The paired runs of two methods, observed until the horizon of their scene."""

    pairs: dict[tuple[str, int], tuple[Reach, Reach]]
    """Map scene and seed → when each run of the pair reached the target."""
    horizons: dict[str, float]
    """Map scene with a pair → the shortest time that a finished run of the two was observed there."""
    seeds: list[int]

    def table(self, value: Callable[[float, float], float]) -> dict[str, np.ndarray]:
        """Map scene → `value` of both times [seeds], NaN for a missing pair."""
        values = {key: value(first.time, second.time) for key, (first, second) in self.pairs.items()}
        return {
            scene: np.array([values.get((scene, seed), math.nan) for seed in self.seeds]) for scene in self.horizons
        }

    def count(self, known: str) -> tuple[int, int]:
        first, second = (sum(pair[side].known == known for pair in self.pairs.values()) for side in (0, 1))
        return first, second

    def may_be_false(self, sign: Sign) -> bool:
        """Return whether a run that counts as the later one of a pair may have been the sooner one."""
        known = {"above 0": self.pairs.values(), "below 0": [pair[::-1] for pair in self.pairs.values()], "open": ()}
        return any(later.known == "earlier" and first.time < later.time for first, later in known[sign])

    def sooner(self, family: int, of_scenes: bool) -> Sign:
        """Return the method that was first in more pairs, or on more scenes, than chance explains (exact two-sided sign
        test).
        """
        table = self.table(lambda first, second: float(np.sign(second - first)))
        signs = [np.nanmean(values) for values in table.values()] if of_scenes else np.concatenate([*table.values()])
        ahead, behind = sum(sign > 0 for sign in signs), sum(sign < 0 for sign in signs)
        if sign_test(ahead, behind) >= (1.0 - CONFIDENCE) / family:
            return "open"
        return "above 0" if ahead > behind else "below 0"


def compared(
    cells: Iterable[CellRecord], method: str, against: str, axis: Axis, target: float, scene: str
) -> TargetComparison:
    """Compare `method` with `against` on one scene, or on `all` of `cells`, by the restricted time min(T, horizon).

    The horizon of a scene is the shortest time that a finished run of the two was observed there. Restricted times are
    fully observed, so that their interval is valid under any censoring; for the time to the target itself it is at most
    a bound. If the time of any pair is only a bound, no saving is called smaller than matters.
    """
    runs = {(cell.scene, cell.method, cell.seed): cell for cell in cells}
    shared = [name for name in scenes_of(list(runs.values()), method, against) if name != "all"]
    chosen = sorted({name for name, _, _ in runs}) if scene == "all" else [scene]
    paired = _paired(runs, chosen, method, against, axis, target)
    family = family_of("psnr", scene, len(shared))
    here = elsewhere = apart = saving = None
    # if both times of every pair are bounds on the same side, it is unknown which was sooner
    if not all(first.known == second.known != "reached" for first, second in paired.pairs.values()):
        ratios = paired.table(lambda first, second: math.log(first / second))
        differences = paired.table(lambda first, second: first - second)
        saving = _per_cent(on_these_scenes(ratios).mean)
        if scene == "all" and len(ratios) > 1:
            here = _estimate(paired, on_these_scenes(ratios, family))
            elsewhere = _estimate(paired, scenes_like_these(ratios, family), of_scenes=True)
            apart = scenes_like_these(differences)
        else:
            (only,) = ratios
            here = _estimate(paired, on_one_scene(ratios[only], family), len(paired.pairs) >= FEWEST_SEEDS)
            apart = on_one_scene(differences[only])
    estimated = elsewhere or here or NO_ESTIMATE
    never, earlier = paired.count("never"), paired.count("earlier")
    low, high = estimated.interval or (None, None)
    return TargetComparison(
        scene=scene,
        method=method,
        against=against,
        axis=axis,
        horizon=min(paired.horizons.values(), default=0.0),
        saving=saving,
        family=family,
        difference=apart.mean if apart else None,
        difference_interval=_with_width(apart.interval if apart else None),
        pairs=len(paired.pairs),
        never=never,
        earlier=earlier,
        unpaired=len(chosen) * len(paired.seeds) - len(paired.pairs),
        # a time of `against` beyond the horizon, or of `method` before its first checkpoint, only increases the saving
        at_least=None if never[0] or earlier[1] else low,
        at_most=None if never[1] or earlier[0] else high,
        on_these_scenes=here,
        scenes_like_these=elsewhere,
        **fields_of(estimated),
    )


def _estimate(paired: Paired, result: PairedDifference, settled: bool = True, of_scenes: bool = False) -> Estimate:
    """Return the estimate in per cent of time saved, without a verdict unless `settled`; `of_scenes` if its unit is the
    scene.
    """
    verdict = verdict_of(_in_per_cent(result.simultaneous), SMALLEST_SAVING) if settled else OPEN
    bounds = any(each.known != "reached" for pair in paired.pairs.values() for each in pair)
    if settled and bounds:
        if not _with_width(result.interval):  # times that are bounds are equal by construction
            verdict = Verdict(paired.sooner(result.family, of_scenes), "open")
        elif verdict.size == "smaller than matters":
            verdict = Verdict(verdict.sign, "open")
        if paired.may_be_false(verdict.sign):
            verdict = OPEN
    detectable = result.smallest_detectable
    return Estimate(
        _in_per_cent(_with_width(result.interval)),
        _in_per_cent(_with_width(result.simultaneous)),
        result.family,
        verdict,
        None if detectable is None else _per_cent(-detectable),
        None if result.effect is None else -result.effect,
    )


def _with_width(interval: tuple[float, float] | None) -> tuple[float, float] | None:
    """Return None for an interval of width 0: equal times do not show the spread of times."""
    return interval if interval is not None and interval[1] > interval[0] else None


def _paired(
    runs: dict[Key, CellRecord], scenes: list[str], method: str, against: str, axis: Axis, target: float
) -> Paired:
    paired = Paired({}, {}, sorted({seed for _, _, seed in runs}))
    for scene in scenes:
        sides = {seed: (runs.get((scene, method, seed)), runs.get((scene, against, seed))) for seed in paired.seeds}
        finished = [cell for pair in sides.values() for cell in pair if cell is not None and cell.status == "done"]
        horizon = min((points[-1][0] for cell in finished if (points := scored(cell, axis))), default=None)
        if horizon is None:
            continue
        for seed, (first, second) in sides.items():
            if first is not None and second is not None and "error" not in (first.status, second.status):
                reaches = reach(first, axis, target), reach(second, axis, target)
                paired.pairs[scene, seed] = _cut(reaches[0], horizon), _cut(reaches[1], horizon)
                paired.horizons[scene] = horizon
    return paired


def scored(cell: CellRecord, axis: Axis) -> list[tuple[float, float]]:
    points = [(getattr(point, AT[axis]), point.psnr) for point in cell.curve]
    return sorted((float(time), psnr) for time, psnr in points if time and psnr is not None)


def _cut(full: Reach, horizon: float) -> Reach:
    if full.known != "never" and full.time <= horizon:
        return full
    return replace(full, time=horizon, known="never")


def _per_cent(log_ratio: float) -> float:
    """Return the saving in per cent: 0 for a ratio of 1, 50 for 1/2, −100 for 2."""
    return -100.0 * math.expm1(log_ratio)


def _in_per_cent(interval: tuple[float, float] | None) -> tuple[float, float] | None:
    if interval is None or max(interval) > 300:  # it would overflow
        return None
    return _per_cent(interval[1]), _per_cent(interval[0])
