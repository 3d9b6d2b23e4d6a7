"""How much a difference of two methods changes between two situations: a paired difference of differences.

Situations are early and late in training, two optimisers, equal steps and equal seconds, two processors, or two runs.
Equal verdicts do not show that nothing changed, nor unequal ones that something did: the change itself is estimated.
"""

from dataclasses import dataclass

import numpy as np

from harness.records.cells import Budget, CellRecord
from harness.records.metric_table import METRICS, PRIMARY
from harness.verdicts.comparisons import FEWEST_SEEDS, Judgement, differences, judged, keyed
from harness.verdicts.estimates import nested
from harness.verdicts.statistics import difference_of, estimate, paired_difference

Table = dict[str, np.ndarray]
"""Scene → paired differences of two methods [seeds], NaN for a missing pair."""


@dataclass(frozen=True)
class Condition:
    """Cells, and the budget at which their methods are compared."""

    cells: list[CellRecord]
    budget: Budget = "steps"


@dataclass(frozen=True)
class Change:
    """The change of `method` − `against` from one situation to another, on the scenes that both have."""

    method: str
    against: str
    before: float
    after: float
    judgement: Judgement
    """The judgement of `after` − `before`."""
    by_scene: dict[str, float]
    """Scene → the change of the mean over seeds."""


def change(method: str, against: str, before: Condition, after: Condition, family: int = 1) -> Change | None:
    """Return the change of a difference of PSNR, one of `family` judged together; None without a shared scene."""
    tables, seeds = [], []
    for situation in (before, after):
        by_key, scenes, numbers = keyed(situation.cells)
        tables.append(differences(by_key, scenes, numbers, method, against, PRIMARY, situation.budget))
        seeds.append(numbers)
    return change_of(method, against, *tables, paired=seeds[0] == seeds[1], family=family)


def changes(pairs: list[tuple[str, str]], before: Condition, after: Condition) -> list[Change]:
    """Return the changes of pairs of methods, which form a family."""
    all_changes = (change(*pair, before, after, len(pairs)) for pair in pairs)
    return [each for each in all_changes if each is not None]


def change_of(
    method: str, against: str, before: Table, after: Table, *, paired: bool, family: int = 1
) -> Change | None:
    """Return the change between two tables of differences, over the scenes with a difference in both; with `paired`
    they have the same seeds in the same order.

    If paired, each scene and seed has a change, which is judged as any paired difference. Otherwise the squared errors
    of the two situations add up (Welch). Over scenes it is Student's t in both cases.
    """
    shared = [scene for scene in before if scene in after]
    if paired:
        shared = [scene for scene in shared if np.isfinite(after[scene] - before[scene]).any()]
    else:
        shared = [scene for scene in shared if all(np.isfinite(side[scene]).any() for side in (before, after))]
    if not shared:
        return None
    first, second = (np.stack([side[scene] for scene in shared]) for side in (before, after))
    if paired:
        there = np.isfinite(second - first)
        first, second = (np.where(there, side, np.nan) for side in (first, second))
    means = [np.nanmean(side, axis=1) for side in (first, second)]
    moved = means[1] - means[0]
    if paired:
        judgement = judged(dict(zip(shared, second - first, strict=True)), PRIMARY, family)
    else:
        margin, pairs = METRICS[PRIMARY].smallest_of_interest, int(np.isfinite(second).sum())
        less = nested.less(nested.on_these_scenes(second), nested.on_these_scenes(first))
        seeds = min(int(np.isfinite(side).sum()) for side in (first, second))
        settled = len(moved) > 1 or seeds >= FEWEST_SEEDS
        here = estimate(difference_of(less, len(moved), family), margin, settled)
        elsewhere = estimate(paired_difference(moved, family), margin) if len(moved) > 1 else None
        judgement = Judgement(float(moved.mean()), here, elsewhere, pairs, second.size - pairs)
    by_scene = dict(zip(shared, map(float, moved), strict=True))
    return Change(method, against, float(means[0].mean()), float(means[1].mean()), judgement, by_scene)
