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
                        table,
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
    note: str = "",
) -> Effect:
    """Any contrast: scene → differences [seeds], NaN where a seed has none, and the same seeds in the same order.

    `scene` is one of `table`, whose other scenes then tell how much seeds differ, or `all`.
    """
    found = judged(table, metric, family, scene)
    one = found.chosen
    return Effect(
        name=name,
        against=against,
        scene=scene,
        metric=metric,
        budget=budget,
        difference=found.difference,
        interval=one.interval,
        simultaneous=one.simultaneous,
        family=family,
        verdict=one.verdict,
        smallest_detectable=one.smallest_detectable,
        pairs=found.pairs,
        unpaired=found.unpaired,
        note=note,
        on_these_scenes=found.on_these_scenes,
    )
