"""Paired comparisons of cells at equal steps, equal wall seconds, and equal core seconds."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.records.cells import USUAL, Budget, CellRecord, Comparison, Estimate, Flagged, Robust, Roles
from harness.records.metric_table import METRICS, PRIMARY
from harness.records.verdict import OPEN
from harness.verdicts.estimates.robust import outliers, robust_over_scenes
from harness.verdicts.failures import judgeable
from harness.verdicts.headline_family import by_holm, headline_budgets, is_headline
from harness.verdicts.statistics import estimate, on_one_scene, on_these_scenes, scenes_like_these

FEWEST_SEEDS = 5
"""The minimum number of paired seeds for a verdict on a single scene; with fewer, only the interval is printed."""

SPENT: dict[Budget, str] = {"steps": "steps", "seconds": "train_seconds", "core_seconds": "train_core_seconds"}
"""Map budget → the field of a cell that holds the amount spent."""
AT: dict[Budget, str] = {"steps": "step", "seconds": "seconds", "core_seconds": "core_seconds"}
"""Map budget → the field of a checkpoint that holds the amount spent so far."""
Key = tuple[str, str, int]
"""The scene, method and seed of a cell."""
NO_ESTIMATE = Estimate(None, None, 1, OPEN, None, None)
OPTIONAL = tuple(name for name, metric in METRICS.items() if metric.optional)


def family_of(metric: str, scene: str, scenes: int, metrics: int = len(METRICS) - len(OPTIONAL)) -> int:
    """Return the number of comparisons of two methods at one budget that are judged together with this one.

    Families are declared before any data. PSNR over all scenes is a family of one (`harness.verdicts.headline_family`
    judges it with the other pairs of a run), PSNR by scene a family of the scenes, another metric over all scenes one
    of the metrics, and another metric by scene one of both. `metrics` is the number of metrics, including PSNR, that
    every run has; the family of an optional metric also counts all of them.
    """
    by_metric = 1 if metric == PRIMARY else max(1, metrics - (metrics > 1))
    by_metric += len(OPTIONAL) if metric in OPTIONAL else 0
    return by_metric * (1 if scene == "all" else scenes)


@dataclass(frozen=True)
class Judgement:
    """The judgement of a table of paired differences."""

    difference: float | None
    """The mean over scenes of the means over seeds, which both estimates share."""
    on_these_scenes: Estimate | None
    scenes_like_these: Estimate | None
    pairs: int
    unpaired: int

    @property
    def chosen(self) -> Estimate:
        """Return the estimate of the main verdict: for scenes like these if several were tried."""
        return self.scenes_like_these or self.on_these_scenes or NO_ESTIMATE

    @property
    def fields(self) -> dict[str, Any]:
        names = ("difference", "pairs", "unpaired", "on_these_scenes")
        return {name: getattr(self, name) for name in names} | fields_of(self.chosen)


def fields_of(chosen: Estimate) -> dict[str, Any]:
    """Return the fields that a row repeats from its main estimate."""
    return {name: getattr(chosen, name) for name in ("interval", "simultaneous", "verdict", "smallest_detectable")}


def compare(cells: list[CellRecord], methods: list[str], roles: Roles = USUAL) -> list[Comparison]:
    """Compare every method with the baseline and the controls of `roles`, and the pairs of claims. Pairs are compared
    on each scene on which both methods have cells of any status, and over all scenes if they have cells on all; at
    equal steps, and at equal core seconds, or wall seconds where no core seconds were counted.
    """
    by_key, _, seeds = keyed(cells)
    along, rows, pairs = headline_budgets(budgets_of(cells)), [], roles.pairs(methods)
    throughout = {name for name in METRICS if scored_along(cells, name)}
    in_headline = sum("all" in scenes_of(cells, *pair) for pair in pairs) * len(along)
    for method, against in pairs:
        where = scenes_of(cells, method, against)
        shared = [scene for scene in where if scene != "all"]
        for name, metric in METRICS.items():
            for budget in along if name in throughout else along[:1]:
                table = differences(by_key, shared, seeds, method, against, name, budget)
                if metric.optional:  # a scene without such a score is not a missing pair
                    table = {scene: values for scene, values in table.items() if np.isfinite(values).any()}
                for scene in (scene for scene in where if scene in table or (scene == "all" and table)):
                    headline = is_headline(scene, name, budget, along)
                    family = in_headline if headline else family_of(name, scene, len(table))
                    judgement = judged(table, name, family, scene)
                    rows.append(
                        Comparison(
                            scene=scene,
                            method=method,
                            against=against,
                            metric=name,
                            budget=budget,
                            family=family,
                            scenes_like_these=judgement.scenes_like_these,
                            robust=robust_of(table, scene),
                            flagged=flagged(table, seeds, metric.smallest_of_interest) if scene == "all" else [],
                            **judgement.fields,
                        )
                    )
    return by_holm(rows, along)


def robust_of(table: dict[str, np.ndarray], scene: str) -> Robust | None:
    """Return the robust estimate over `all` scenes of `table`, or over the seeds of one scene; None without a pair."""
    rows = [row for row in table.values() if np.isfinite(row).any()] if scene == "all" else [table[scene]]
    values = np.stack(rows) if rows else np.empty((0, 0))
    if len(rows) == 1:
        values = values[0][np.isfinite(values[0])][:, None]
    if not values.size:
        return None
    middle, low, high = map(float, robust_over_scenes(values))
    return Robust(middle, (low, high) if math.isfinite(low) else None)


def flagged(table: dict[str, np.ndarray], seeds: list[int], margin: float) -> list[Flagged]:
    places = outliers(table, margin)
    usual = float(np.median(np.concatenate([row[np.isfinite(row)] for row in table.values()]))) if places else 0.0
    return [Flagged(scene, seeds[place], float(table[scene][place]), usual) for scene, place in places]


def budgets_of(cells: Iterable[CellRecord]) -> tuple[Budget, ...]:
    """Return the budgets at which `cells` can be compared: core seconds if every trained cell has counted them."""
    counted = all(cell.train_core_seconds is not None for cell in cells if cell.steps)
    return ("steps", "seconds", "core_seconds") if counted else ("steps", "seconds")


def scored_along(cells: Iterable[CellRecord], metric: str) -> bool:
    """Return whether any checkpoint has the metric: older records have some metrics only at the end."""
    return any(getattr(point, metric) is not None for cell in cells for point in cell.curve)


def scenes_of(cells: list[CellRecord], method: str, against: str) -> list[str]:
    """Return the scenes on which both methods have cells, preceded by `all` if these are all scenes."""
    planned = {(cell.scene, cell.method) for cell in cells}
    scenes = sorted({cell.scene for cell in cells})
    shared = [scene for scene in scenes if {(scene, method), (scene, against)} <= planned]
    return ["all", *shared] if shared == scenes else shared


def keyed(cells: list[CellRecord]) -> tuple[dict[Key, CellRecord], list[str], list[int]]:
    """Index cells by scene, method and seed, with all scenes and all seeds."""
    by_key = {(cell.scene, cell.method, cell.seed): cell for cell in cells}
    return by_key, sorted({cell.scene for cell in cells}), sorted({cell.seed for cell in cells})


def differences(
    cells: dict[Key, CellRecord],
    scenes: list[str],
    seeds: list[int],
    method: str,
    against: str,
    metric: str,
    budget: Budget,
) -> dict[str, np.ndarray]:
    """Map scene → `method` − `against` [seeds], NaN if a cell of the pair is missing, failed or has no such score."""

    def difference(scene: str, seed: int) -> float:
        pair = cells.get((scene, method, seed)), cells.get((scene, against, seed))
        first, second = scores_at(*pair, metric, budget)
        return math.nan if first is None or second is None else first - second

    return {scene: np.array([difference(scene, seed) for seed in seeds], dtype=np.float64) for scene in scenes}


def judged(table: dict[str, np.ndarray], metric: str, family: int, scene: str = "all") -> Judgement:
    """Judge scene → differences [seeds], NaN for a missing pair: over all scenes of the `table`, or on one `scene`.

    Pairs without a difference are only counted, since `harness.verdicts.failures` compares failures.
    """
    about, chosen = METRICS[metric], table if scene == "all" else {scene: table[scene]}
    pairs = int(sum(np.isfinite(values).sum() for values in chosen.values()))
    unpaired = sum(values.size for values in chosen.values()) - pairs
    if not pairs:
        return Judgement(None, None, None, 0, unpaired)
    compared = [name for name, values in chosen.items() if np.isfinite(values).any()]
    if scene != "all" or len(compared) == 1:
        (only,) = compared
        here = on_one_scene(table[only], family)
        settled = pairs >= FEWEST_SEEDS
        return Judgement(here.mean, estimate(here, about.smallest_of_interest, settled), None, pairs, unpaired)
    here, elsewhere = on_these_scenes(table, family), scenes_like_these(table, family)
    margin = about.smallest_of_interest
    return Judgement(here.mean, estimate(here, margin), estimate(elsewhere, margin), pairs, unpaired)


def scores_at(
    first: CellRecord | None, second: CellRecord | None, name: str, budget: Budget
) -> tuple[float | None, float | None]:
    """Return a metric of two cells at the steps that both have done, or at the time of the quicker cell."""
    if first is None or second is None or not (judgeable(first) and judgeable(second)):
        return None, None
    if budget == "steps" and first.steps == second.steps:
        return first.scores.get(name), second.scores.get(name)
    spent = [getattr(cell, SPENT[budget]) for cell in (first, second)]
    if None in spent:
        return None, None
    return score_on_curve(first, name, budget, min(spent)), score_on_curve(second, name, budget, min(spent))


def score_on_curve(cell: CellRecord, name: str, budget: Budget, at: float) -> float | None:
    """Return a metric of a cell's curve, linear in the logarithm of steps or seconds between checkpoints; None before
    the first checkpoint, and for a metric that is scored only at the end.
    """
    scored = [(getattr(point, AT[budget]), getattr(point, name, None)) for point in cell.curve]
    points = [(position, value) for position, value in scored if position is not None and value is not None]
    if not points or at < points[0][0]:
        return None
    positions = [math.log(position) for position, _ in points]
    return float(np.interp(math.log(at), positions, [value for _, value in points]))
