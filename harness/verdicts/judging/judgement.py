"""Judgement of a table of results: distinguished methods, letters, suspect results, and the lines that report them."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
from msgspec import structs

from harness.records.judgements import JudgementRecord, Pair, Place, Ranking, Suspect, changed_pairs
from harness.records.metric_table import PRIMARY
from harness.verdicts.estimates.max_t import LEAST_UNITS, letters, step_down_max_t, written
from harness.verdicts.estimates.multiplicity import holm
from harness.verdicts.estimates.nested import medians
from harness.verdicts.statistics import critical, decided, estimate, on_these_scenes, paired_difference, shift_found
from harness.verdicts.tables.files import read_rows
from harness.verdicts.tables.result_table import MARGINS, ResultTable, scene_means, table_of
from harness.verdicts.tables.rows import Rows
from scenes.files.digest import file_digest
from scenes.files.errors import InputError


def headline(record: JudgementRecord) -> str:
    many = f"{len(record.given.places)} methods on {len(record.scenes)} scenes"
    return f"{many}: {in_words(record, record.given)}"


def in_words(record: JudgementRecord, ranking: Ranking) -> str:
    if record.baseline is not None:
        verdicts = Counter(pair.verdict.phrase for pair in ranking.pairs)
        known = [f"{many} {phrase}" for phrase, many in verdicts.items()]
        return f"differences from {record.baseline}: {'; '.join(known)}"
    every, all_many = sum(pair.distinguished for pair in ranking.pairs), len(ranking.pairs)
    if every in (0, all_many):
        return "all distinguished from each other" if every else "no two distinguished"
    first = ranking.places[0].method
    level = sum(first in (pair.method, pair.against) and not pair.distinguished for pair in ranking.pairs)
    others = f"{level or 'none'} of the other {len(ranking.places) - 1}"
    return f"{first} leads; {others} not distinguished from it, {every} of all {all_many} pairs distinguished"


def number(record: JudgementRecord, value: float | None, sign: str = "") -> str:
    """Format with two decimals for dB, and with four significant digits otherwise."""
    if value is None:
        return "–"
    text = format(value, f"{sign}.2f" if record.unit else f"{sign}#.4g")
    return text.replace("-", "−")


def suspect_line(record: JudgementRecord, suspect: Suspect) -> str:
    unit = f" {record.unit}" if record.unit else ""
    seed = f", seed {suspect.seed}" if suspect.seed else ""
    value, expected = (number(record, score) + unit for score in (suspect.value, suspect.expected))
    return f"{suspect.method} on {suspect.scene}{seed}: {value}, expected {expected} from method and scene"


def without_line(record: JudgementRecord) -> str:
    if record.without_suspects is None:
        return ""
    many, them = len(changed_pairs(record)), "it" if len(record.suspects) == 1 else "them"
    changes = f"{many or 'no'} verdict{'' if many == 1 else 's'} change{'s' if many == 1 else ''}"
    return f"Without {them}: {in_words(record, record.without_suspects)}; {changes}."


def lines(record: JudgementRecord) -> Iterator[str]:
    """Yield the table of a terminal, suspect results, missing ones, and notes for the reader."""
    if record.read_as:
        yield f"{record.read_as}."
    yield headline(record)
    rows = table(record)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for name, *numbers, last in rows:
        middle = "  ".join(f"{text:>{width}}" for text, width in zip(numbers, widths[1:-1], strict=True))
        yield f"  {name:{widths[0]}}  {middle}  {last}".rstrip()
    if record.baseline is None:
        yield f"{letters_line(record.given)} Ranks hold together in 95 %."
    for suspect in record.suspects[:10]:
        yield f"suspect: {suspect_line(record, suspect)}"
    if len(record.suspects) > 10:
        yield f"suspect: {len(record.suspects) - 10} more"
    if record.without_suspects is not None:
        yield without_line(record)
    if record.missing:
        yield missing_line(record)
    yield from record.notes
    for other in record.other_metrics:
        yield ""
        yield from lines(other)


def table(record: JudgementRecord) -> Sequence[tuple[str, ...]]:
    """Return a header and a row per method, best first: letters, rank and difference from the next, or from the
    baseline.
    """
    head = ("method", f"mean {record.metric}", "scenes")
    first = [(place.method, number(record, place.mean), str(place.scenes)) for place in record.given.places]
    if record.baseline is not None:
        of = {pair.method: pair for pair in record.given.pairs}
        return [(*head, f"against {record.baseline}")] + [(*own, _against(record, of.get(own[0]))) for own in first]
    of = {pair.method: pair for pair in record.given.neighbours}
    return [(*head, "letters", "rank", "best", "to settle", "minus the next")] + [
        (
            *own,
            written(place.groups) or "–",
            shown_rank(place),
            shown_best(place),
            str(pair.scenes_to_settle) if (pair := of.get(place.method)) and pair.scenes_to_settle else "",
            _against(record, pair),
        )
        for own, place in zip(first, record.given.places, strict=True)
    ]


def letters_line(ranking: Ranking) -> str:
    if any(place.groups for place in ranking.places):
        return "Two methods are distinguished unless they share a letter."
    return "No letters are given, as too many would be needed: the pairs say which methods are distinguished."


def shown_rank(place: Place) -> str:
    """Format a rank as `2`, or `2–4`; empty if it has none."""
    return "–".join(map(str, dict.fromkeys(place.rank or ())))


def shown_best(place: Place) -> str:
    return "" if place.best is None else f"{100 * place.best:.0f} %"


def missing_line(record: JudgementRecord) -> str:
    shown = "; ".join(record.missing[:5]) + (f"; {len(record.missing) - 5} more" if len(record.missing) > 5 else "")
    return f"Without a result ({len(record.missing)}): {shown}. Pairs are compared on the scenes that both have."


def _against(record: JudgementRecord, pair: Pair | None) -> str:
    if pair is None:
        return "–"
    ends = pair.scenes_like_these.simultaneous if pair.scenes_like_these else None
    within = f" [{', '.join(number(record, end, '+') for end in ends)}]" if ends else ""
    return f"{number(record, pair.difference, '+')}{within} {pair.verdict.phrase}"


SUSPECT_DEVIATIONS = 7.0
"""The distance from the fit, in robust standard deviations, at which a result is suspect. Tables with normal residuals
have almost no suspect; one in four tables of 17 methods and 8 scenes has one if residuals follow Student's t with four
degrees of freedom.
"""
SUSPECT_MARGINS = 10.0
"""The minimum distance of a suspect in smallest effects of interest: in a small table the spread is hardly known."""
SMALLEST_FIT = 3
"""The minimum number of methods and of scenes: with two, it is unknown which result is an outlier."""
POLISHES = 20
BOOTSTRAPS = 4000
MOST_SCENES = 100_000
"""The number of scenes above which a difference counts as not to be settled."""


def judge_files(
    paths: Sequence[Path],
    metrics: Sequence[str],
    lower: Sequence[str],
    margin: float | None,
    baseline: str | None,
    methods: Sequence[str] = (),
) -> JudgementRecord:
    """Judge the table in `paths` with the digests of its files; raises `InputError` as `judge_rows`."""
    rows = read_rows(paths, metrics[0] if metrics else None)
    digests = {str(path): file_digest(path) for path in paths if path.is_file()}
    record = judge_rows(rows, metrics, lower, margin, baseline, methods)
    return structs.replace(record, source=", ".join(map(str, paths)), digests=digests)


def judge_rows(
    rows: Rows,
    metrics: Sequence[str],
    lower: Sequence[str],
    margin: float | None,
    baseline: str | None,
    methods: Sequence[str] = (),
) -> JudgementRecord:
    """Judge the first of `metrics`, by default the primary one, and each further one by itself. Raises `InputError` as
    `table_of` and `judge`, and for a margin of several metrics.
    """
    metrics = list(dict.fromkeys(metrics))
    if margin is not None and len(metrics) > 1:
        raise InputError(f"--margin {margin}: has the unit of one metric; judge one at a time, or leave it out")
    first, *more = [table_of(rows, metric, lower, methods) for metric in (metrics or (None,))]
    if baseline is not None and methods and baseline not in methods:
        raise InputError(f"--baseline {baseline}: is not among --methods {' '.join(methods)}; add it to them")
    judged = {first.metric, *(table.metric for table in more)}
    left = [name for name in first.other_metrics if name not in judged]
    others = [judge(replace(table, other_metrics=[]), None, baseline) for table in more]
    record = judge(replace(first, other_metrics=left), margin, baseline)
    return structs.replace(record, other_metrics=others)


def judge(table: ResultTable, margin: float | None, baseline: str | None) -> JudgementRecord:
    """Judge a table; raises `InputError` for a baseline that is not in the table, and for an invalid margin."""
    if baseline is not None and baseline not in table.methods:
        raise InputError(f"--baseline {baseline}: no such method; methods of the table: {', '.join(table.methods)}")
    if margin is None:
        margin = MARGINS.get(table.metric, 0.0)
    if not 0 <= margin < float("inf"):
        raise InputError(f"--margin {margin}: must be 0 or more")
    suspicious = suspects(table, margin)
    cleaned = without(table, suspicious)
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
        notes=[*table.notes, *notes(table, margin)],
        suspects=suspicious,
        given=ranking(table, margin, baseline),
        without_suspects=ranking(cleaned, margin, baseline) if cleaned else None,
        digests={},
        read_as=table.read_as,
    )


def ranking(table: ResultTable, margin: float, baseline: str | None = None) -> Ranking:
    """Compare every pair, or every method with `baseline`; return the methods from best to worst."""
    cells = scene_means(table.values)
    means = adjusted_means(cells)
    order = [int(place) for place in np.argsort(-means if table.higher_is_better else means, kind="stable")]
    if baseline is None:
        duels = list(combinations(order, 2))
    else:
        rival = table.methods.index(baseline)
        duels = [(row, rival) for row in order if row != rival]
    differences = np.array([cells[a] - cells[b] for a, b in duels]).reshape(len(duels), -1)
    pairs = _signed([_pair(table, a, b, len(duels), margin) for a, b in duels], differences, margin)
    if baseline is None:
        neighbours = {(table.methods[a], table.methods[b]) for a, b in pairwise(order)}
        pairs = [_settled(p, len(duels)) if (p.method, p.against) in neighbours else p for p in pairs]
        at = {table.methods[row]: place for place, row in enumerate(order)}
        groups = letters(len(order), [(at[p.method], at[p.against]) for p in pairs if p.distinguished])
    else:
        groups = [[] for _ in order]
    scenes = np.isfinite(table.values).any(axis=2).sum(axis=1)
    best = best_shares(cells, table.higher_is_better) if baseline is None else [None] * len(order)
    places = [
        Place(
            method=table.methods[row],
            mean=float(means[row]),
            scenes=int(scenes[row]),
            seconds=table.seconds[row],
            steps=table.steps[row],
            groups=of,
            core_seconds=table.core_seconds[row],
            rank=_rank(table.methods[row], pairs, len(order), table.higher_is_better) if baseline is None else None,
            best=best[row],
            origin=table.origins[row] if table.origins else "",
        )
        for row, of in zip(order, groups, strict=True)
    ]
    return Ranking(places, pairs, len(duels))


def _signed(pairs: list[Pair], differences: np.ndarray, margin: float) -> list[Pair]:
    """Return the pairs with signs that hold together: by sign flips or, if a pair has few scenes, by Holm's procedure
    on t: no flip of few signs is rare enough, and the step-down procedure would hand that on to the other pairs.
    """
    if np.isfinite(differences).sum(axis=1).min(initial=differences.shape[1]) >= LEAST_UNITS:
        adjusted: Sequence[float | None] = step_down_max_t(differences).tolist()
    else:
        adjusted = holm([pair.scenes_like_these.p if pair.scenes_like_these else None for pair in pairs], len(pairs))
    return [
        structs.replace(pair, scenes_like_these=decided(known, p, pair.difference or 0.0, margin))
        if (known := pair.scenes_like_these) is not None and p is not None
        else pair
        for pair, p in zip(pairs, adjusted, strict=True)
    ]


def _settled(pair: Pair, family: int) -> Pair:
    """Return the pair with the number of scenes that would settle its sign, if that is open."""
    known = pair.scenes_like_these
    if pair.distinguished or known is None or not known.effect:
        return pair
    effect = abs(known.effect)

    def finds(scenes: int) -> bool:
        freedom = float(scenes - 1)
        return shift_found(critical(freedom, family), freedom) <= effect * math.sqrt(scenes)

    high = pair.scenes + 1
    while not finds(high):
        high *= 2
        if high > MOST_SCENES:
            return pair
    low = max(high // 2, pair.scenes)
    while high - low > max(1, low // 200):
        low, high = (low, middle) if finds(middle := (low + high) // 2) else (middle, high)
    return structs.replace(pair, scenes_to_settle=high)


def _rank(method: str, pairs: Sequence[Pair], count: int, higher_is_better: bool) -> tuple[int, int]:
    """Return the first and the last place that the known signs leave: they hold together for all methods."""
    winning = "above 0" if higher_is_better else "below 0"
    results = [
        (pair.verdict if pair.method == method else pair.verdict.turned).sign == winning
        for pair in pairs
        if pair.distinguished and method in (pair.method, pair.against)
    ]
    return 1 + results.count(False), count - results.count(True)


def best_shares(cells: np.ndarray, higher_is_better: bool) -> Sequence[float | None]:
    """Return the probability of each method that its mean is the best, over scenes reweighted by Dirichlet weights
    (Rubin 1981); None if a cell of [methods, scenes] is missing, and for fewer scenes than show a sign.
    """
    if not np.isfinite(cells).all() or cells.shape[1] < LEAST_UNITS:
        return [None] * len(cells)
    weights = np.random.default_rng(0).dirichlet(np.ones(cells.shape[1]), BOOTSTRAPS)
    means = weights @ (cells if higher_is_better else -cells).T
    # methods that are equal share a draw
    best = means >= means.max(axis=1, keepdims=True) - 1e-12
    shares: list[float] = (best / best.sum(axis=1, keepdims=True)).mean(axis=0).tolist()
    return shares


def adjusted_means(cells: np.ndarray) -> np.ndarray:
    """Return each method's mean [methods] over all scenes of `cells` [methods, scenes]; with missing cells that of an
    additive least-squares fit, so that missing a hard scene is not an advantage.
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


def seeds_meet(first: np.ndarray, second: np.ndarray) -> bool:
    """Return whether two methods [scenes, seeds] have results of the same seeds on each scene that both have."""
    there, other = np.isfinite(first), np.isfinite(second)
    both = there.any(axis=1) & other.any(axis=1)
    return bool((there == other)[both].all())


def _pair(table: ResultTable, row: int, against: int, family: int, margin: float) -> Pair:
    """Compare two methods, paired by scene and seed, or by scene where their seeds are not the same."""
    first, second = table.values[row], table.values[against]
    paired = seeds_meet(first, second)
    differences = first - second if paired else np.subtract(*scene_means(np.stack([first, second])))[:, None]
    names = table.methods[row], table.methods[against]
    means = scene_means(differences[None])[0]
    there = means[np.isfinite(means)]
    if not there.size:
        return Pair(*names, 0, None, None, None)
    # a few differences that are printed as equal do not show their spread
    shows_spread = there.size >= LEAST_UNITS or np.ptp(there) > 1e-9 * np.abs(there).max()
    like = estimate(paired_difference(there, family), margin) if there.size > 1 and shows_spread else None
    seeded = np.isfinite(differences).sum(axis=1).max() > 1
    of_scenes = {str(place): row for place, row in enumerate(differences)}
    here = estimate(on_these_scenes(of_scenes, family), margin) if seeded else None
    return Pair(*names, int(there.size), float(there.mean()), like, here)


def suspects(table: ResultTable, margin: float) -> list[Suspect]:
    """Return the results far from a fit of method plus scene by medians, the farthest first."""
    values = table.values
    if min(values.shape[:2]) < SMALLEST_FIT:
        return []
    fit = polished(medians(values, 2))
    residuals = values - fit[..., None]
    sizes = np.abs(residuals)
    methods, scenes = values.shape[:2]
    # the fit absorbs a part of the spread, which is large in a small table
    taken = ((methods - 1) * (scenes - 1) / (methods * scenes)) ** 0.5
    of_method = medians(sizes.reshape(methods, -1), 1)[:, None, None]
    of_scene = medians(sizes.transpose(1, 0, 2).reshape(scenes, -1), 1)[None, :, None]
    # of the table, or of method and scene together: the spread of only the method would hide most of its outliers
    spread = 1.4826 * np.maximum(np.nanmedian(sizes), np.sqrt(of_method * of_scene)) / taken
    limit = np.maximum(SUSPECT_DEVIATIONS * spread, SUSPECT_MARGINS * margin)
    rounding = 1e-9 * np.nanmax(np.abs(values))
    far = []
    for i, j, k in np.argwhere(sizes > np.maximum(limit, rounding)):
        deviation = residuals[i, j, k] / max(spread[i, j, 0], rounding)  # `rounding` only avoids a division by 0
        where = table.methods[i], table.scenes[j], table.seeds[k]
        far.append(Suspect(*where, float(values[i, j, k]), float(fit[i, j]), float(deviation)))
    return sorted(far, key=lambda suspect: -abs(suspect.value - suspect.expected))


def polished(cells: np.ndarray) -> np.ndarray:
    """Return the expected value of each of `cells` [methods, scenes] by Tukey's median polish."""
    residuals = cells.copy()
    for _ in range(POLISHES):
        residuals = residuals - medians(residuals, 1)[:, None]
        residuals = residuals - medians(residuals, 0)[None]
    return np.asarray(cells - residuals)


def without(table: ResultTable, suspicious: list[Suspect]) -> ResultTable | None:
    """Return `table` without these results; None if there are none, or if a method would lose all its results."""
    if not suspicious:
        return None
    values = table.values.copy()
    for suspect in suspicious:
        row, column = table.methods.index(suspect.method), table.scenes.index(suspect.scene)
        values[row, column, table.seeds.index(suspect.seed)] = np.nan
    kept = np.isfinite(values).any(axis=(0, 2))
    if not np.isfinite(values).any(axis=(1, 2)).all():
        return None
    scenes = [name for name, has in zip(table.scenes, kept, strict=True) if has]
    return replace(table, values=values[:, kept], scenes=scenes)


def notes(table: ResultTable, margin: float) -> Iterator[str]:
    if others := ", ".join(table.other_metrics):
        yield f"Other metrics in the table, not judged here (--metric): {others}."
    known = [steps for steps in table.steps if steps is not None]
    if known and max(known) > 1.01 * min(known):
        yield f"Methods were trained for {min(known):,.0f} to {max(known):,.0f} steps: scores are compared as they are."
    if (np.isfinite(table.values).sum(axis=2) > 1).any():
        yield (
            "On these scenes: the error comes from seeds only. On scenes like these: scenes are drawn too; verdicts, "
            "letters and ranks are of this kind. Seeds are paired by their names."
        )
        if not all(seeds_meet(first, second) for first, second in combinations(table.values, 2)):
            yield "Methods have different seeds: where two have other seeds, their means over seeds are compared."
    else:
        yield (
            "One result per method and scene: the spread of seeds is not known. Nothing is said about these very "
            "scenes, only about scenes like these."
        )
    if margin == 0:
        yield f"No smallest effect of interest is known for {table.metric}: sizes stay open (--margin)."
