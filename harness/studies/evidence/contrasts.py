"""Effects of full factorial designs whose corners are methods, paired by scene and seed; and effects as text.

The convention is the usual one of levels ±1 (Box, Hunter & Hunter 2005, Statistics for Experimenters, chapter 5). A
main effect is the mean, over all settings of the other factors, of the score with the factor less the score without it.
An interaction of two factors is half the difference between the effect of the first with and without the second; of
three, half the difference between the interaction of two with and without the third.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from jaxtyping import Float

from harness.records import metric_table
from harness.records.cells import Budget, CellRecord
from harness.records.study import Effect, Series, Table
from harness.records.verdict import phrase_with
from harness.studies.framework import Rows
from harness.verdicts.comparisons import family_of, judged, keyed, score_on_curve
from harness.verdicts.failures import judgeable

METRICS = ("psnr", "ssim")
BUDGETS: tuple[Budget, ...] = ("steps", "seconds")
Tables = dict[str, np.ndarray]
"""Scene → contrasts [seeds], NaN for a seed without one; the same seeds in the same order."""
Term = tuple[str, ...]
"""The factor of a main effect, or the factors of an interaction."""


@dataclass(frozen=True)
class Design:
    factors: tuple[str, ...]
    methods: dict[tuple[bool, ...], str]
    """All 2^k corners."""

    def terms(self) -> list[Term]:
        sizes = range(1, len(self.factors) + 1)
        return [term for size in sizes for term in combinations(self.factors, size)]


def duel(method: str, against: str) -> Design:
    return Design((method,), {(False,): against, (True,): method})


def signs(design: Design, term: Term) -> Float[np.ndarray, " corners"]:
    """Return ±1 by corner: the product of the levels of the term's factors."""
    places = [design.factors.index(factor) for factor in term]
    return np.array([math.prod(1.0 if corner[place] else -1.0 for place in places) for corner in design.methods])


def contrast(scores: Float[np.ndarray, "*some corners"], design: Design, term: Term) -> Float[np.ndarray, "*some"]:
    """Return the contrast of scores at the corners, in the order of `design.methods`; NaN if one of them is NaN."""
    return np.asarray(scores @ signs(design, term) / (len(design.methods) / 2))


def scores_together(
    cells: Sequence[CellRecord | None], metric: str, budget: Budget, step: int | None = None
) -> Float[np.ndarray, " cells"]:
    """Return the scores at `step` if it is given, else at the steps that all have done or at the training time of the
    quickest; NaN for a cell that is missing, diverged or failed, or has no score by then.
    """
    done = [cell for cell in cells if cell is not None and judgeable(cell)]
    if not done:
        return np.full(len(cells), math.nan)
    at = float(step or min(cell.steps if budget == "steps" else cell.train_seconds for cell in done))

    def score(cell: CellRecord | None) -> float:
        if cell is None or not judgeable(cell):
            return math.nan
        if budget == "seconds" and step is None:
            value = score_on_curve(cell, metric, "seconds", at)
        else:
            value = cell.scores.get(metric) if at == cell.steps else score_on_curve(cell, metric, "steps", at)
        return math.nan if value is None else value

    return np.array([score(cell) for cell in cells])


def contrast_tables(
    design: Design, term: Term, cells: list[CellRecord], metric: str, budget: Budget, step: int | None = None
) -> Tables:
    """Return the contrasts of scores that may be compared with each other, NaN if a corner has no score."""
    by_key, scenes, seeds = keyed(cells)
    tables = {}
    for scene in scenes:
        corners = [[by_key.get((scene, method, seed)) for method in design.methods.values()] for seed in seeds]
        scores = np.array([scores_together(corner, metric, budget, step) for corner in corners])
        tables[scene] = contrast(scores, design, term)
    return tables


def effects_of_table(
    table: Tables,
    name: str,
    metric: str,
    budget: Budget,
    metrics: int,
    together: int = 1,
    against: str = "",
    note: str = "",
) -> list[Effect]:
    """Return one contrast over all scenes of `table`, then scene by scene.

    Its family (`family_of`) holds this number of `metrics`, and `together` contrasts that make up one question.
    """
    effects = []
    for scene in ["all", *table]:
        family = together * family_of(metric, scene, len(table), metrics)
        judgement = judged(table, metric, family, scene)
        fields = judgement.fields | {"family": family, "note": note, "p": judgement.chosen.p}
        effects.append(Effect(name, against, scene, metric, budget, **fields))
    return effects


def contrast_effects(
    design: Design,
    cells: list[CellRecord],
    where: str = "",
    budgets: tuple[Budget, ...] = BUDGETS,
    together: int = 1,
    against: str = "",
) -> list[Effect]:
    """Return every term of the design over all scenes and scene by scene; `where` is added to the factors' names.

    Each main effect is a separate question, as a method is (`harness.verdicts.comparisons.family_of`). All interactions
    are judged together. `together` counts the places at which a term is tested if their verdicts make one answer.
    """
    interactions = len(design.terms()) - len(design.factors)
    effects = []
    for budget, metric, term in product(budgets, METRICS, design.terms()):
        table = contrast_tables(design, term, cells, metric, budget)
        name, note = f"{' × '.join(term)} {where}".strip(), "" if len(term) == 1 else "interaction"
        family = together * (interactions if note else 1)
        effects += effects_of_table(table, name, metric, budget, len(METRICS), family, against, note)
    return effects


def effects(
    cells: list[CellRecord],
    method: str,
    against: str,
    where: str = "",
    budgets: tuple[Budget, ...] = BUDGETS,
    together: int = 1,
) -> list[Effect]:
    return contrast_effects(duel(method, against), cells, where, budgets, together, against)


def chosen(some: Iterable[Effect], **facts: str) -> list[Effect]:
    """Return the effects with these facts, on PSNR at equal steps unless they name another metric or budget."""
    required = {"metric": "psnr", "budget": "steps", **facts}
    return [effect for effect in some if all(getattr(effect, name) == value for name, value in required.items())]


def common_steps(cells: list[CellRecord]) -> list[int]:
    """Return the steps at which all cells that are done were scored."""
    scored = [{point.step for point in cell.curve} for cell in cells if cell.status == "done"]
    return sorted(set.intersection(*scored)) if scored else []


def line(tables: dict[float, Tables], panel: str, name: str, x_label: str) -> Series:
    """Draw a contrast of PSNR over places on the axis: its mean, and a separate interval for each place."""
    judgements = [judged(table, "psnr", 1) for table in tables.values()]
    intervals = [judgement.chosen.interval for judgement in judgements]
    low, high = ([interval and interval[end] for interval in intervals] for end in (0, 1))
    y = [judgement.difference for judgement in judgements]
    return Series(panel, 0, name, x_label, "difference of PSNR, dB", list(tables), y, low, high, log_y=False)


def along_training(design: Design, term: Term, cells: list[CellRecord], panel: str, name: str) -> Series:
    tables = {float(at): contrast_tables(design, term, cells, "psnr", "steps", at) for at in common_steps(cells)}
    return line(tables, panel, name, "training step")


def spread(scores: list[float | None], metric: str) -> str:
    """Return `24.10 ± 0.05` with the standard deviation over seeds, and the number of seeds if some are missing."""
    known, digits = [score for score in scores if score is not None], metric_table.METRICS[metric].digits
    if not known:
        return "no seed ended well"
    text = f"{np.mean(known):.{digits}f}"
    text += f" ± {np.std(known, ddof=1):.{digits}f}" if len(known) > 1 else ""
    return text if len(known) == len(scores) else f"{text} ({len(known)} of {len(scores)} seeds)"


def spread_of(cells: list[CellRecord], scene: str, method: str, metric: str) -> str:
    return spread([cell.scores.get(metric) for cell in cells if (cell.scene, cell.method) == (scene, method)], metric)


def score_table(
    id: str, title: str, cells: list[CellRecord], methods: Iterable[str], metrics: tuple[str, ...] = METRICS
) -> Table:
    """Return a row of scores as text for each method, scene by scene and metric by metric."""
    keys = list(product(keyed(cells)[1], metrics))
    labels = {metric: ", ".join(filter(None, metric_table.METRICS[metric][1:3])) for metric in metrics}
    columns = ["method", *(f"{scene}: {labels[metric]}" for scene, metric in keys)]
    rows: Rows = [
        [method, *(spread_of(cells, scene, method, metric) for scene, metric in keys)]
        for method in dict.fromkeys(methods)
    ]
    return Table(id, 0, title, columns, rows)


def without_a_score(cells: list[CellRecord], where: str = "") -> Iterator[str]:
    """Yield a sentence that names the cells that are not done, if there are any."""
    lost = [
        f"{cell.method} on {cell.scene}, seed {cell.seed} ({cell.reason})" for cell in cells if cell.status != "done"
    ]
    if lost:
        yield f"{where}{len(lost)} of {len(cells)} cells have no score, and their pairs are not judged: {listed(lost)}."


def number(value: float, metric: str, sign: bool = True) -> str:
    """Return the value with the digits of its metric and a true minus sign."""
    return f"{value:{'+' if sign else ''}z.{metric_table.METRICS[metric].digits}f}".replace("-", "−")


def amount(value: float | None, metric: str, sign: bool = True) -> str:
    if value is None:
        return "no figure"
    return f"{number(value, metric, sign)} {metric_table.METRICS[metric].unit}".strip()


def in_words(effect: Effect) -> str:
    """Return `+0.81 dB (95 % interval +0.52 to +1.10: above 0, matters)`; the interval is the verdict's."""
    lost = f", {effect.unpaired} of {effect.unpaired + effect.pairs} pairs without a score" if effect.unpaired else ""
    size = amount(effect.difference, effect.metric)
    if effect.difference is None or effect.simultaneous is None:
        return f"{size} (no interval{lost})"
    low, high = (number(end, effect.metric) for end in effect.simultaneous)
    kind = "95 % interval" if effect.family == 1 else f"95 % interval, {effect.family} together,"
    return f"{size} ({kind} {low} to {high}: {phrase_with(effect.verdict, effect.simultaneous)}{lost})"


def in_brief(effect: Effect) -> str:
    """Return the effect as `+0.81 [+0.52, +1.10]` for a cell of a table; the interval is the verdict's."""
    if effect.difference is None:
        return "no figure"
    ends = [number(end, effect.metric) for end in effect.simultaneous or ()]
    return number(effect.difference, effect.metric) + (f" [{', '.join(ends)}]" if ends else "")


def listed(parts: Iterable[str]) -> str:
    *first, last = parts
    return f"{', '.join(first)} and {last}" if first else last
