"""A table of results → which methods are told apart, which are not, and which results are suspect: pure functions.

Scenes are the units: a leaderboard's scenes stand for others like them. Pairs are compared over the scenes that both
have, and every interval that a verdict is taken from is as wide as the number of pairs asks for (Bonferroni).
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from harness.comparisons import PRIMARY
from harness.judge.record import JudgementRecord, Pair, Place, Ranking, Suspect
from harness.judge.table import MARGINS, Table
from harness.records import Estimate
from harness.statistics import PairedDifference, detectable, on_these_scenes, paired_difference, verdict
from scenes.errors import InputError

SUSPECT_DEVIATIONS = 8.0
"""Robust standard deviations from the fit at which a result is suspect: next to none is in a table of normal residuals,
and one in ten tables of 17 methods and 8 scenes has one where they are of Student's t with four degrees of freedom."""
SUSPECT_MARGINS = 10.0
"""Smallest effects of interest that it must be away as well: in a small table the spread itself is hardly known."""
SMALLEST_FIT = 3
"""Methods, and scenes, below which nobody can say which of two results is off."""
POLISHES = 20


def judge(table: Table, margin: float | None, baseline: str | None, digests: dict[str, str]) -> JudgementRecord:
    """Raises `InputError` for a baseline that is no method of the table, and a margin that is no size."""
    if baseline is not None and baseline not in table.methods:
        raise InputError(f"--baseline {baseline}: no such method; methods of the table: {', '.join(table.methods)}")
    if margin is None:
        margin = MARGINS.get(table.metric, 0.0)
    if not 0 <= margin < float("inf"):
        raise InputError(f"--margin {margin}: must be 0 or more")
    found = suspects(table, margin)
    cleaned = without(table, found)
    has = np.isfinite(table.values).any(axis=2)
    return JudgementRecord(
        source=table.source,
        metric=table.metric,
        unit="dB" if table.metric == PRIMARY else "",
        higher_is_better=table.higher_is_better,
        margin=margin,
        baseline=baseline,
        scenes=table.scenes,
        seeds=len(table.seeds),
        results=int(np.isfinite(table.values).sum()),
        missing=[f"{table.methods[i]}, {table.scenes[j]}" for i, j in np.argwhere(~has)],
        notes=[*table.notes, *training_notes(table), *seed_notes(table), *margin_notes(table, margin)],
        suspects=found,
        given=ranking(table, margin, baseline),
        without_suspects=ranking(cleaned, margin, baseline) if cleaned else None,
        digests=digests,
    )


def ranking(table: Table, margin: float, baseline: str | None = None) -> Ranking:
    """Every pair, or every method against `baseline`, with the methods from best to worst."""
    means = adjusted_means(scene_means(table.values))
    order = [int(place) for place in np.argsort(-means if table.higher_is_better else means, kind="stable")]
    many = len(order)
    if baseline is None:
        duels = [(a, b) for a in range(many) for b in range(a + 1, many)]
    else:
        rival = order.index(table.methods.index(baseline))
        duels = [(a, rival) for a in range(many) if a != rival]
    pairs = []
    for a, b in duels:
        shown = baseline is not None or b == a + 1
        differences = table.values[order[a]] - table.values[order[b]]
        names = table.methods[order[a]], table.methods[order[b]]
        pairs.append(_pair(*names, differences, len(duels), margin, table.higher_is_better, shown))
    ranked = Ranking([_place(table, row, float(means[row])) for row in order], pairs, len(duels))
    return ranked if baseline is not None else _grouped(ranked)


def scene_means(values: np.ndarray) -> np.ndarray:
    """[methods, scenes, seeds] → [methods, scenes], means over the seeds that are there; NaN where none is."""
    there = np.isfinite(values)
    counts = there.sum(axis=2)
    return np.where(counts > 0, np.where(there, values, 0.0).sum(axis=2) / np.maximum(counts, 1), np.nan)


def adjusted_means(cells: np.ndarray) -> np.ndarray:
    """Each method's mean [methods] over all scenes of `cells` [methods, scenes].

    With missing cells it is that of an additive fit by least squares: who lacks a hard scene is not ahead for that.
    """
    there = np.isfinite(cells)
    known = np.where(there, cells, 0.0)
    rows, columns = there.sum(axis=1), there.sum(axis=0)
    of_scene = np.zeros(cells.shape[1])
    for _ in range(1 if there.all() else 500):
        of_method = (known - there * of_scene).sum(axis=1) / rows
        before, of_scene = of_scene, (known - there * of_method[:, None]).sum(axis=0) / columns
        if np.allclose(before, of_scene, rtol=0, atol=1e-9 * (1 + np.abs(of_scene).max())):
            break
    return np.asarray(of_method + (0.0 if there.all() else of_scene.mean()))


def _pair(
    method: str, against: str, differences: np.ndarray, family: int, margin: float, higher: bool, shown: bool
) -> Pair:
    """From `differences` [scenes, seeds], NaN where there is no pair; with what it could have found if `shown`."""
    means = scene_means(differences[None])[0]
    there = means[np.isfinite(means)]
    if not there.size:
        return Pair(method, against, 0, None, None, None)

    def estimate(result: PairedDifference) -> Estimate:
        said = verdict(result, margin, higher)
        least = detectable(result, margin) if shown else None
        return Estimate(result.interval, result.simultaneous, family, said, least, result.effect)

    like = estimate(paired_difference(there, family)) if there.size > 1 else None
    here = None
    if np.isfinite(differences).sum(axis=1).max() > 1:
        names = {str(place): row for place, row in enumerate(differences)}
        here = estimate(on_these_scenes(names, family))
    return Pair(method, against, int(there.size), float(there.mean()), like, here)


def _place(table: Table, row: int, mean: float) -> Place:
    scenes = int(np.isfinite(table.values[row]).any(axis=1).sum())
    return Place(table.methods[row], mean, scenes, table.seconds[row], table.steps[row], [])


def _grouped(ranked: Ranking) -> Ranking:
    """With its groups: the longest runs of neighbours in which no two methods are told apart."""
    names = [one.method for one in ranked.places]
    apart = {frozenset((pair.method, pair.against)) for pair in ranked.pairs if pair.told_apart}
    runs: list[tuple[int, int]] = []
    first = 0
    for last in range(len(names)):
        while any(frozenset((names[place], names[last])) in apart for place in range(first, last)):
            first += 1
        if runs and runs[-1][0] == first:
            runs[-1] = first, last
        else:
            runs.append((first, last))
    groups = [[number for number, (a, b) in enumerate(runs, 1) if a <= place <= b] for place in range(len(names))]
    return replace(ranked, places=[replace(one, groups=of) for one, of in zip(ranked.places, groups, strict=True)])


def suspects(table: Table, margin: float) -> list[Suspect]:
    """Results that lie far from a fit of method plus scene by medians, the farthest first."""
    values = table.values
    if min(values.shape[:2]) < SMALLEST_FIT:
        return []
    fit = polished(_median(values, 2))
    residuals = values - fit[..., None]
    sizes = np.abs(residuals)
    methods, scenes = values.shape[:2]
    # medians take up a part of the spread, which in a small table is most of it
    taken = ((methods - 1) * (scenes - 1) / (methods * scenes)) ** 0.5
    of_method = _median(sizes.reshape(methods, -1), 1)[:, None, None]
    of_scene = _median(sizes.transpose(1, 0, 2).reshape(scenes, -1), 1)[None, :, None]
    spread = 1.4826 * np.maximum(np.nanmedian(sizes), np.maximum(of_method, of_scene)) / taken
    least = np.maximum(SUSPECT_DEVIATIONS * spread, SUSPECT_MARGINS * margin)
    rounding = 1e-9 * np.nanmax(np.abs(values))
    found = [
        Suspect(
            table.methods[i], table.scenes[j], table.seeds[k], float(values[i, j, k]), float(fit[i, j]),
            # of a table without any other spread it is as many as one likes
            float(residuals[i, j, k] / max(spread[i, j, 0], rounding)),
        )
        for i, j, k in np.argwhere(sizes > np.maximum(least, rounding))
    ]  # fmt: skip
    return sorted(found, key=lambda one: -abs(one.value - one.expected))


def polished(cells: np.ndarray) -> np.ndarray:
    """Tukey's median polish: what method and scene let one expect of each of `cells` [methods, scenes]."""
    residuals = cells.copy()
    for _ in range(POLISHES):
        residuals = residuals - _median(residuals, 1)[:, None]
        residuals = residuals - _median(residuals, 0)[None]
    return np.asarray(cells - residuals)


def _median(values: np.ndarray, axis: int) -> np.ndarray:
    """As `nanmedian`, NaN without a warning where nothing is there."""
    there = np.isfinite(values).any(axis=axis, keepdims=True)
    found = np.nanmedian(np.where(there, values, 0.0), axis=axis, keepdims=True)
    return np.asarray(np.where(there, found, np.nan).squeeze(axis))


def without(table: Table, found: list[Suspect]) -> Table | None:
    """`table` without these results; None where there is none, or where a method would have no result left."""
    if not found:
        return None
    values = table.values.copy()
    for one in found:
        values[table.methods.index(one.method), table.scenes.index(one.scene), table.seeds.index(one.seed)] = np.nan
    kept = np.isfinite(values).any(axis=(0, 2))
    if not np.isfinite(values).any(axis=(1, 2)).all():
        return None
    scenes = [name for name, has in zip(table.scenes, kept, strict=True) if has]
    return replace(table, values=values[:, kept], scenes=scenes)


def seed_notes(table: Table) -> Iterator[str]:
    if (np.isfinite(table.values).sum(axis=2) > 1).any():
        yield (
            "On these scenes: the error comes from seeds alone. On scenes like these: scenes are drawn too, Student's "
            "t over their means; verdicts and groups are of this kind. Seeds are paired by their names."
        )
    else:
        yield (
            "One result for each method and scene: how much seeds differ is not known. Nothing is said of these very "
            "scenes, only of scenes like these."
        )


def margin_notes(table: Table, margin: float) -> Iterator[str]:
    if margin == 0:
        yield f"No smallest effect of interest is known for {table.metric}: nothing is called equivalent (--margin)."


def training_notes(table: Table) -> Iterator[str]:
    known = [one for one in table.steps if one is not None]
    if known and max(known) > 1.01 * min(known):
        yield f"Methods were trained for {min(known):,.0f} to {max(known):,.0f} steps: scores are compared as they are."
