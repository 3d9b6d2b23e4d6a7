"""Cells → effects of a study; full factorial designs whose corners are methods, paired by scene and seed.

The convention is the usual one of levels ±1 (Box, Hunter & Hunter 2005, Statistics for Experimenters, chapter 5). A
main effect is the mean, over all settings of the other factors, of the score with the factor less the score without it.
An interaction of two factors is half the difference between the effect of the one with and without the other; of three,
half the difference between the interaction of two with and without the third.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Float

from harness.records.cells import CellRecord
from harness.records.metric_table import METRICS
from harness.records.study import Effect, Series
from harness.verdicts.comparisons import Budget, Key, differences, family_of, judged, keyed, score_on_curve
from harness.verdicts.failures import judgeable


def effects(
    cells: list[CellRecord],
    method: str,
    against: str,
    metrics: tuple[str, ...] = ("psnr", "ssim"),
    budgets: tuple[Budget, ...] = ("steps", "seconds"),
    name: str | None = None,
) -> list[Effect]:
    """Return `method` − `against`, for each budget and metric: over all scenes of `cells` first, then scene by scene.

    `name` is what the effect is called if that is not the method's name. `metrics` are names of
    `harness.verdicts.comparisons.METRICS`; families count those that are given (`family_of`).
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
    """Return any contrast: scene → differences [seeds], NaN for a seed without one, and the same seeds in the same
    order.

    `scene` is one of `table`, whose other scenes then show how much seeds differ, or `all`.
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


Corner = tuple[bool, ...]
Term = tuple[str, ...]
"""The factors of a main effect (one of them) or of an interaction."""


@dataclass(frozen=True)
class Design:
    """Which method belongs to which combination of factors."""

    factors: tuple[str, ...]
    methods: dict[Corner, str]
    """All 2^k corners."""

    def terms(self) -> list[Term]:
        """Return the main effects first, then interactions of two, and so on."""
        sizes = range(1, len(self.factors) + 1)
        return [term for size in sizes for term in combinations(self.factors, size)]


def duel(method: str, against: str) -> Design:
    """Return the design of one factor: to take `method` instead of `against`."""
    return Design((method,), {(False,): against, (True,): method})


def signs(design: Design, term: Term) -> Float[np.ndarray, " corners"]:
    """Return ±1 by corner: the product of the levels of the term's factors."""
    places = [design.factors.index(factor) for factor in term]
    return np.array([math.prod(1.0 if corner[place] else -1.0 for place in places) for corner in design.methods])


def contrast(scores: Float[np.ndarray, "*some corners"], design: Design, term: Term) -> Float[np.ndarray, "*some"]:
    """Return the contrast of scores at the corners, in the order of `design.methods`; NaN where one of them is."""
    return np.asarray(scores @ signs(design, term) / (len(design.methods) / 2))


def corner_scores(
    design: Design,
    cells: dict[Key, CellRecord],
    scenes: list[str],
    seeds: list[int],
    metric: str,
    budget: Budget,
    step: int | None = None,
) -> dict[str, np.ndarray]:
    """Return scene → scores [seeds, corners] that may be compared with each other (`scores_together`)."""
    return {
        scene: np.array(
            [
                scores_together(
                    [cells.get((scene, method, seed)) for method in design.methods.values()], metric, budget, step
                )
                for seed in seeds
            ]
        )
        for scene in scenes
    }


def scores_together(
    cells: Sequence[CellRecord | None], metric: str, budget: Budget, step: int | None = None
) -> Float[np.ndarray, " cells"]:
    """Return the scores at `step` if it is given, else at the steps that all have done or at the training time of the
    quickest.

    The score is NaN for a cell that is missing, diverged or failed, and for one that was not scored by then.
    """
    done = [cell for cell in cells if cell is not None and judgeable(cell)]
    if not done:
        return np.full(len(cells), math.nan)
    at = float(step or min(cell.steps if budget == "steps" else cell.train_seconds for cell in done))

    def score(cell: CellRecord | None) -> float:
        if cell is None or not judgeable(cell):
            return math.nan
        if budget == "seconds" and step is None:
            found = score_on_curve(cell, metric, "seconds", at)
        else:
            found = cell.scores.get(metric) if at == cell.steps else score_on_curve(cell, metric, "step", at)
        return math.nan if found is None else found

    return np.array([score(cell) for cell in cells])


def contrast_tables(
    design: Design, term: Term, cells: list[CellRecord], metric: str, budget: Budget, step: int | None = None
) -> dict[str, np.ndarray]:
    """Return scene → the contrast [seeds], NaN if a corner has no score."""
    scores = corner_scores(design, *keyed(cells), metric, budget, step)
    return {scene: contrast(values, design, term) for scene, values in scores.items()}


def contrast_effects(
    design: Design,
    cells: list[CellRecord],
    where: str,
    metrics: tuple[str, ...] = ("psnr", "ssim"),
    budgets: tuple[Budget, ...] = ("steps", "seconds"),
    together: int = 1,
) -> list[Effect]:
    """Return every term of the design over all scenes and scene by scene; `where` is added to the factors' names.

    A main effect is a question of its own, as a method is (`harness.verdicts.comparisons.family_of`). Interactions are
    judged all together. `together` counts the places at which a term is tested if their verdicts make one answer.
    """
    interactions = len(design.terms()) - len(design.factors)
    return [
        one
        for budget in budgets
        for metric in metrics
        for term in design.terms()
        for one in effects_of_table(
            contrast_tables(design, term, cells, metric, budget),
            name=f"{' × '.join(term)} {where}".strip(),
            metric=metric,
            budget=budget,
            metrics=len(metrics),
            together=together * (1 if len(term) == 1 else interactions),
            note="" if len(term) == 1 else "interaction",
        )
    ]


def effects_of_table(
    table: dict[str, np.ndarray],
    *,
    name: str,
    metric: str,
    budget: Budget,
    metrics: int,
    together: int = 1,
    note: str = "",
) -> list[Effect]:
    """Return one contrast over all scenes of `table`, then scene by scene. `together` contrasts make up one
    question.
    """
    return [
        effect_of(
            table,
            name=name,
            against="",
            scene=scene,
            metric=metric,
            budget=budget,
            family=together * family_of(metric, scene, len(table), metrics),
            note=note,
        )
        for scene in ["all", *table]
    ]


def common_steps(cells: list[CellRecord]) -> list[int]:
    """Return the steps at which every cell that ended well was scored."""
    scored = [{point.step for point in cell.curve} for cell in cells if cell.status == "done"]
    return sorted(set.intersection(*scored)) if scored else []


def line(
    tables: dict[float, dict[str, np.ndarray]], metric: str, *, panel: str, name: str, x_label: str, y_label: str
) -> Series:
    """Return a line of place on the axis → a contrast there: its mean and the 95 % interval of that place alone."""
    judged = [
        effect_of(table, name=name, against="", scene="all", metric=metric, budget="steps") for table in tables.values()
    ]
    return Series(
        panel=panel,
        item=0,
        name=name,
        x_label=x_label,
        y_label=y_label,
        x=list(tables),
        y=[one.difference for one in judged],
        low=[one.interval and one.interval[0] for one in judged],
        high=[one.interval and one.interval[1] for one in judged],
        log_x=True,
        log_y=False,
    )


UNITS = {"psnr": " dB", "delta_e": "", "depth_rmse": " scene units"}
DIGITS = {"psnr": 2, "delta_e": 2}
NO_FIGURE = "no figure"


def amount(value: float | None, metric: str, sign: bool = True) -> str:
    """Return the difference as `+0.81 dB`, with a true minus sign."""
    if value is None:
        return NO_FIGURE
    digits = DIGITS.get(metric, 3)
    return _number(value, digits, sign) + UNITS.get(metric, "")


def told(one: Effect, gain: bool = True) -> str:
    """Return the effect as `+0.81 dB (95 % interval +0.52 to +1.10: better)`, with the interval that the verdict is
    taken from.

    Without `gain`, as for an interaction, more is called "above 0" and not "better".
    """
    aside = f", {one.unpaired} of {one.unpaired + one.pairs} pairs without a score" if one.unpaired else ""
    if one.difference is None or one.simultaneous is None:
        return f"{amount(one.difference, one.metric)} (no interval{aside})"
    digits = DIGITS.get(one.metric, 3)
    low, high = (_number(end, digits, True) for end in one.simultaneous)
    kind = "95 % interval" if one.family == 1 else f"95 % interval, {one.family} together,"
    return f"{amount(one.difference, one.metric)} ({kind} {low} to {high}: {said(one, gain)}{aside})"


def short(one: Effect) -> str:
    """Return the effect as `+0.81 [+0.52, +1.10]`, for a cell of a table: no unit, no verdict; the interval is the
    verdict's.
    """
    digits = DIGITS.get(one.metric, 3)
    if one.difference is None:
        return NO_FIGURE
    ends = [_number(end, digits, True) for end in one.simultaneous or ()]
    return _number(one.difference, digits, True) + (f" [{', '.join(ends)}]" if ends else "")


def said(one: Effect, gain: bool = True) -> str:
    """Return the verdict in words."""
    interest = METRICS[one.metric].smallest_of_interest
    if one.verdict == "equivalent":
        return f"within ±{interest}{UNITS.get(one.metric, '')}"
    if one.verdict == "inconclusive":
        return "not settled"
    if gain:
        return one.verdict
    return "above 0" if (one.difference or 0.0) > 0 else "below 0"


def listed(parts: Iterable[str]) -> str:
    """Return the items as `a, b and c`."""
    *first, last = parts
    return f"{', '.join(first)} and {last}" if first else last


def _number(value: float, digits: int, sign: bool) -> str:
    text = f"{value:+.{digits}f}" if sign else f"{value:.{digits}f}"
    if float(text) == 0:
        text = text.lstrip("+-")
    return text.replace("-", "−")
