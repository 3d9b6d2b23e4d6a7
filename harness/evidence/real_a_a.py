"""Real runs of one method, put into two groups by their seeds and compared as if they were two methods.

The groups share runs from split to split, so that there is less to learn from them than their number says. Unlike the
methods of one run, the two groups share neither rays nor first weights nor the load of the machine while their clocks
ran: they differ by more than the pairs of a run.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cache
from itertools import combinations, permutations

import numpy as np

from harness.comparisons import PRIMARY, Budget, compare, family_of
from harness.records import CellRecord, Comparison
from harness.statistics import CONFIDENCE, critical
from harness.survival import chosen_target, compared
from harness.targets_record import TargetComparison

METHOD = "nerf"
TWIN = "nerf_again"
REPETITIONS = 4000
"""Of runs that are drawn to see how much their splits vary together."""


def splits(cells: list[CellRecord]) -> list[list[CellRecord]]:
    """Each way to rename one half of the seeds as another method, and to pair it with the other half."""
    found = []
    for first, second in ways(sorted({cell.seed for cell in cells})):
        place = {seed: (METHOD, k) for k, seed in enumerate(first)} | {seed: (TWIN, k) for k, seed in enumerate(second)}
        chosen = [cell for cell in cells if cell.seed in place]
        found.append([replace(one, method=place[one.seed][0], seed=place[one.seed][1]) for one in chosen])
    return found


def ways(seeds: list[int]) -> Iterator[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Both halves of the seeds in every pairing; an odd seed stays out."""
    half = len(seeds) // 2
    seeds = seeds[: 2 * half]
    for first in combinations(seeds, half):
        if first[0] != seeds[0]:
            continue  # the same two groups the other way round
        for second in permutations(seed for seed in seeds if seed not in first):
            yield first, second


@cache
def independent_families(scenes: int, seeds: int) -> int:
    """So many independent families of single scenes would hold a false call in a share that varies by chance as much
    as that of all splits of the same `seeds` runs on each scene does: simulated, with normal noise.

    1 where there is no telling, as no interval exists.
    """
    if seeds < 4:
        return 1
    first, second = (np.array(one) for one in zip(*ways(list(range(seeds))), strict=True))
    freedom = first.shape[1] - 1
    threshold = critical(freedom, family_of(PRIMARY, "one of them", scenes))
    generator = np.random.default_rng(20260112)
    shares = []
    for _ in range(REPETITIONS):
        scores = generator.standard_normal((scenes, seeds))
        difference = scores[:, first] - scores[:, second]
        error = difference.std(axis=2, ddof=1) / (freedom + 1) ** 0.5
        shares.append(float((np.abs(difference.mean(axis=2)) > threshold * error).any(axis=0).mean()))
    share = 1 - CONFIDENCE
    return max(1, round(share * (1 - share) / float(np.var(shares))))


def comparisons(cells: list[CellRecord]) -> list[Comparison]:
    """Every split, compared by the function that compares the methods of a run."""
    return [one for twins in splits(cells) for one in compare(twins, [METHOD, TWIN])]


def times(cells: list[CellRecord]) -> list[TargetComparison]:
    """Steps to the target that the runs themselves choose, over all scenes, of every split; none without a target."""
    target, _ = chosen_target(cells, METHOD)
    if target is None:
        return []
    return [compared(twins, TWIN, METHOD, "steps", target, "all") for twins in splits(cells)]


def overall(rows: list[Comparison], budget: Budget = "steps") -> list[Comparison]:
    """PSNR over all scenes."""
    return [one for one in rows if (one.scene, one.metric, one.budget) == ("all", PRIMARY, budget)]


def share_called(rows: Iterable[Comparison | TargetComparison]) -> float:
    """Better or worse, of `rows`, at least one."""
    return float(np.mean([one.verdict in ("better", "worse") for one in rows]))


def share_of_families(rows: list[Comparison]) -> float:
    """Of splits in which PSNR at equal steps is called better or worse on any scene."""
    chosen = [one for one in rows if (one.metric, one.budget) == (PRIMARY, "steps") and one.scene != "all"]
    scenes = len({one.scene for one in chosen})
    called = np.array([one.verdict in ("better", "worse") for one in chosen]).reshape(-1, scenes)
    return float(called.any(axis=1).mean())
