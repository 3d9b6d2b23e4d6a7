"""Cells → effects: the differences of a study, judged by the functions that judge a run's comparisons."""

import numpy as np

from harness.comparisons import Budget, differences, family_of, judged, keyed
from harness.evidence_record import Effect
from harness.records import CellRecord


def effects(
    cells: list[CellRecord],
    method: str,
    against: str,
    metrics: tuple[str, ...] = ("psnr", "ssim"),
    budgets: tuple[Budget, ...] = ("steps", "seconds"),
    name: str | None = None,
) -> list[Effect]:
    """`method` − `against`, for each budget and metric: over all scenes of `cells` first, then scene by scene.

    `name` is what the effect is called, where it is not the method's name. `metrics` are names of
    `harness.comparisons.METRICS`; families count those that are given (`family_of`).
    """
    by_key, scenes, seeds = keyed(cells)
    found = []
    for budget in budgets:
        for metric in metrics:
            table = differences(by_key, scenes, seeds, method, against, metric, budget)
            for scene in ["all", *scenes]:
                found.append(
                    effect_of(
                        table if scene == "all" else {scene: table[scene]},
                        name=name or method,
                        against=against,
                        scene=scene,
                        metric=metric,
                        budget=budget,
                        family=family_of(metric, scene, len(scenes), len(metrics)),
                    )
                )
    return found


def effect_of(
    table: dict[str, np.ndarray],
    *,
    name: str,
    against: str,
    scene: str,
    metric: str,
    budget: Budget,
    family: int = 1,
    left_aside: int | None = None,
    note: str = "",
) -> Effect:
    """Any contrast: scene → differences [seeds], NaN where a seed has none, and the same seeds in the same order.

    With several scenes in `table` they are the units, with one its seeds. `left_aside` counts what is missing; None
    counts the NaN. Whatever is missing keeps a verdict from being made.
    """
    one = judged(table, metric, family)
    aside = one.left_aside if left_aside is None else left_aside
    return Effect(
        name=name,
        against=against,
        scene=scene,
        metric=metric,
        budget=budget,
        difference=one.difference,
        interval=one.interval,
        simultaneous=one.simultaneous,
        family=family,
        verdict="inconclusive" if aside else one.verdict,
        smallest_detectable=one.smallest_detectable,
        pairs=one.pairs,
        left_aside=aside,
        note=note,
    )
