"""The repaired Q-NeRF on scenes and seeds that it was not chosen on, with all the controls."""

import math
import statistics
from collections.abc import Iterator

from baselines.catalog import CATALOG
from baselines.methods.repaired import CANDIDATES, EXCLUDED
from baselines.numerics.encoding import PHI
from harness.records.cells import Budget, CellRecord
from harness.records.study import Check, Effect, Table, check
from harness.studies.choices.repair_search import Search, read_search
from harness.studies.evidence.contrasts import (
    amount,
    chosen,
    effects,
    in_words,
    listed,
    score_table,
    without_a_score,
)
from harness.studies.evidence.evidence_context import EvidenceContext
from harness.studies.framework import Found
from harness.verdicts.comparisons import keyed

REPAIRED = "qnerf_repaired"
CONTROLS = {
    "nerf": "NeRF's PSNR",
    "nerf_matched": "that of NeRF whose frequencies reach no further (what is gained beyond bandwidth)",
    "nerf_phi_encoding_phi_skip": "that of itself without the amplifier (what Eq. 4 does)",
}
"""The controls: vanilla; the same bandwidth without φ; φ encoding and φ skip without an amplifier."""
METRICS = ("psnr", "ssim", "rmse_linear", "depth_rmse")
BUDGETS: dict[Budget, str] = {"steps": "equal steps", "seconds": "equal time"}
MARGIN = 1.2
"""The least gain over NeRF, in dB, that the paper's abstract claims for Q-NeRF."""
CHUNK_BAR = 2e-6
OPAQUE = 0.999


def repaired(context: EvidenceContext) -> Iterator[Found]:
    """Yield what was chosen against NeRF, against NeRF of its bandwidth, and against itself without the amplifier."""
    cells, search = context.trained("repaired").cells, read_search()
    compared = [
        effect
        for against in CONTROLS
        for effect in effects(cells, REPAIRED, against, metrics=METRICS, budgets=tuple(BUDGETS))
    ]
    # whether it beats NeRF, whether by the paper's margin, and what else has its encoding
    for budget, words in BUDGETS.items():
        over_all = chosen(compared, scene="all", budget=budget)
        changes = listed(f"{CONTROLS[effect.against]} by {in_words(effect)}" for effect in over_all)
        yield f"At {words} the repaired Q-NeRF changes {changes}; {_reached(over_all[0])}."
    yield equal_time(cells, search.clock)
    against_nerf = [chosen(compared, scene="all", against="nerf", metric=metric) for metric in METRICS[1:]]
    changes = listed(f"{effect.metric} by {in_words(effect)}" for (effect,) in against_nerf)
    yield f"Other scores at equal steps, against NeRF: {changes}."
    yield _of_the_search(search)
    yield from search.history
    yield from without_a_score(cells)
    yield from _checks(cells, search)
    yield from compared
    columns, scores = score_table(cells, (REPAIRED, *CONTROLS), ("psnr",))
    title = "PSNR at equal steps, dB: mean ± sd over seeds"
    yield Table("repaired_scores", 0, title, ["method", *columns], [[method, *row] for method, row in scores.items()])
    yield _learnt(cells)
    yield _search_table(search)
    yield Table("excluded", 0, "What was no candidate, and why", ["mean", "why"], [[*row] for row in EXCLUDED.items()])


def _reached(effect: Effect) -> str:
    """Return where the interval lies relative to the paper's margin."""
    margin = f"the paper's margin of {amount(MARGIN, 'psnr')}"
    low, high = effect.simultaneous or (-math.inf, math.inf)
    if low >= MARGIN:
        return f"{margin} is reached"
    return f"{margin} is not reached" if high < MARGIN else f"whether {margin} is reached is not settled"


def equal_time(cells: list[CellRecord], clock: str) -> str:
    """Return what equal time means, from runs of equal steps; `clock` is the unit of the search's budget."""
    by_key, scenes, seeds = keyed([cell for cell in cells if cell.status == "done"])
    pairs = [
        (by_key.get((scene, REPAIRED, seed)), by_key.get((scene, "nerf", seed))) for scene in scenes for seed in seeds
    ]
    ratios = [mine.train_seconds / other.train_seconds for mine, other in pairs if mine and other]
    budgets = f"(the search gave every cell equal {clock} instead, and each ran through its schedule)"
    if not ratios:
        return f"How far the slower method had come at equal time is not known: no pair ended {budgets}."
    ratio = math.exp(statistics.fmean(map(math.log, ratios)))
    return (
        f"Equal time is read off runs of equal steps: {REPAIRED if ratio > 1.0 else 'nerf'}, the slower one, is met "
        f"after {100 * min(ratio, 1 / ratio):.0f} % of its training time, before its learning rate has fallen all the "
        f"way, which counts against it {budgets}."
    )


def _of_the_search(search: Search) -> str:
    ties = sum(rank.ties for rank in search.standings)
    best = max((rank for rank in search.standings if rank.mean is not None), key=lambda rank: rank.mean or 0.0)
    beside = {name: _mean(search, name) for name in CONTROLS}
    references = listed(f"{amount(mean, 'psnr', sign=False)} of {name}" for name, mean in beside.items() if mean)
    first = f"{ties} of {len(search.standings)} candidates tie with the best" if ties > 1 else "One stood out"
    return (
        f"{first}, {best.method} ({amount(best.mean, 'psnr', sign=False)} on validation views at equal {search.clock}, "
        f"beside {references}); chosen, as the simplest of them, was {search.chosen}."
    )


def _mean(search: Search, method: str) -> float | None:
    """Return the mean score of a method over the cells of the search that have one."""
    scores = [row.psnr_val for row in search.rows if row.method == method and row.psnr_val is not None]
    return statistics.fmean(scores) if scores else None


def _checks(cells: list[CellRecord], search: Search) -> Iterator[Check]:
    """Yield what must hold for this to be the search's own choice, judged elsewhere, and a field that can be opaque."""
    yield check(
        "methods that were judged and are not what the search chose",
        float(CATALOG[REPAIRED].parts != CANDIDATES[search.chosen]),
        high=0.0,
        why=f"chosen: {search.chosen}",
    )
    scenes, seeds = {row.scene for row in search.rows}, {row.seed for row in search.rows}
    yield check(
        "scenes and seeds of the verdict that the choice was made on",
        float(len({cell.scene for cell in cells} & scenes) + len({cell.seed for cell in cells} & seeds)),
        high=0.0,
        why=f"chosen on {listed(sorted(scenes))}, seeds {listed(map(str, sorted(seeds)))}",
    )
    mine = [cell for cell in cells if cell.method == REPAIRED and cell.status == "done"]
    lost = sum(cell.method == REPAIRED for cell in cells) - len(mine)
    missing = f"; {lost} cells did not end" if lost else ""
    for what, name, low, high in (
        ("largest difference of a colour between calls of different size", "chunk_max_difference", None, CHUNK_BAR),
        ("opacity of a unit of the densest matter in the thinnest cell", "opacity_unit_slab", OPAQUE, None),
    ):
        values = [
            (value, f"{cell.scene}, seed {cell.seed}")
            for cell in mine
            if isinstance(value := cell.properties.get(name), float)
        ]
        if not values or len(values) < len(mine):
            why = f"measured in {len(values)} of {len(mine)} cells that ended{missing}"
            yield check(what, None, low, high, why=why)
        else:
            value, where = max(values) if low is None else min(values)
            yield check(what, value, low, high, why=f"{where} of {len(values)} cells{missing}")


def _learnt(cells: list[CellRecord]) -> Table:
    """Return αφ at the end: at 1 Eq. 4 is the identity."""
    by_key, scenes, seeds = keyed([cell for cell in cells if cell.curve])
    rows: list[list[str | float | None]] = []
    for scene in scenes:
        ended = [by_key.get((scene, REPAIRED, seed)) for seed in seeds]
        alphas = [cell.curve[-1].alpha if cell else None for cell in ended]
        rows.append([scene, *(None if alpha is None else alpha * PHI for alpha in alphas)])
    columns = ["scene", *(f"seed {seed}" for seed in seeds)]
    return Table("contrast_learnt", 0, "Contrast αφ that was learnt; at 1 the amplifier does nothing", columns, rows)


def _search_table(search: Search) -> Table:
    """Return every candidate and reference, in the order in which a tie is decided."""
    keys = list(dict.fromkeys((row.scene, row.seed) for row in search.rows))
    by_key = {(row.method, row.scene, row.seed): row.psnr_val for row in search.rows}
    ranks = {rank.method: rank for rank in search.standings}
    rows: list[list[str | float | None]] = []
    for method in dict.fromkeys([*ranks, *(row.method for row in search.rows)]):
        scores = [by_key.get((method, scene, seed)) for scene, seed in keys]
        if rank := ranks.get(method):
            role = "chosen" if method == search.chosen else "ties" if rank.ties else ""
            rows.append([method, rank.mean, rank.behind, rank.standard_error, role, *scores])
        else:
            rows.append([method, _mean(search, method), None, None, "reference", *scores])
    columns = ["candidate", "mean, dB", "behind the best, dB", "standard error, dB", "role"]
    columns += [f"{scene}, seed {seed}" for scene, seed in keys]
    title = f"The search: PSNR on validation views at equal training time, in {search.clock}"
    return Table("repair_search", 0, title, columns, rows)
