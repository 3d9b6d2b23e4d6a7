"""The best family at each budget with its probability, the crossings of families, and the stability of ranks."""

import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from harness.records.study import Table
from harness.studies.evidence.contrasts import listed
from harness.studies.framework import Found, Rows
from harness.studies.frontier.frontier_context import Frontier, FrontierContext
from harness.verdicts.pareto import best_shares, crossing, front_shares, rank_correlation
from harness.verdicts.statistics import paired_difference


def front(context: FrontierContext) -> Iterator[Found]:
    frontier = context.frontier()
    families, budgets = frontier.trained, frontier.budgets
    tables = [frontier.table(budget, families) for budget in budgets]
    best = [best_shares(table) for table in tables]
    yield answer(families, budgets, best)
    if len(budgets) > 1:
        yield early_and_late(families, budgets, tables)
    for budget, table in zip(budgets, tables, strict=True):
        yield from not_distinguished(budget, families, table)
    columns = ["family", *(f"{budget:g} core s" for budget in budgets)]
    for name, title, shares in (
        ("best", "Probability of the best mean over scenes", np.array(best)),
        ("on_front", "Probability of being on the Pareto front of core seconds and PSNR", front_shares(tables)),
    ):
        rows: Rows = [[family, *(_share(row[place]) for row in shares)] for place, family in enumerate(families)]
        yield Table(name, 0, title, columns, rows)
    yield _crossings(frontier)
    yield _correlations(budgets, tables)


def answer(families: tuple[str, ...], budgets: list[float], best: list[np.ndarray]) -> str:
    parts = []
    for budget, shares in zip(budgets, best, strict=True):
        leader = families[int(np.argmax(shares))]
        parts.append(f"{leader} at {budget:g} core seconds ({_share(shares.max())})")
    return f"Best mean, with the share of draws of scenes in which it is: {listed(parts)}."


def early_and_late(families: tuple[str, ...], budgets: list[float], tables: list[np.ndarray]) -> str:
    early, late = (families[int(np.nanargmax(table.mean(axis=1)))] for table in (tables[0], tables[-1]))
    tau = rank_correlation(tables[0].mean(axis=1), tables[-1].mean(axis=1))
    ends = f"The winner at {budgets[0]:g} core seconds, {early}, is"
    then = f"also the winner at {budgets[-1]:g}" if early == late else f"not that at {budgets[-1]:g}, {late}"
    return f"{ends} {then}; Kendall's τ of the two rankings is {tau:.2f}."


def not_distinguished(budget: float, families: Sequence[str], table: np.ndarray) -> Iterator[str]:
    """Name the families whose mean over scenes may be that of the best, from `table` [families, scenes] of PSNR."""
    known = [place for place in range(len(families)) if not np.isnan(table[place]).any()]
    if len(known) < 2 or table.shape[1] < 2:
        return
    leader = max(known, key=lambda place: float(table[place].mean()))
    near = []
    for place in known:
        if place == leader:
            continue
        simultaneous = paired_difference(table[place] - table[leader], family=len(known) - 1).simultaneous
        if simultaneous is None or simultaneous[1] >= 0.0:
            near.append(families[place])
    if near:
        are = "is" if len(near) == 1 else "are"
        yield f"At {budget:g} core seconds {listed(near)} {are} not distinguished from {families[leader]}."


def _crossings(frontier: Frontier) -> Table:
    rows: Rows = []
    for first, second in itertools.permutations(frontier.trained, 2):
        lines = [np.array([frontier.table(at, (name,))[0] for at in frontier.budgets]) for name in (first, second)]
        if crossed := crossing(frontier.budgets, *lines):
            at, (low, high), share = crossed
            rows.append([second, first, f"{at:.3g}", f"{low:.3g} to {high:.3g}", _share(share)])
    title = "The core seconds from which one family stays ahead of another"
    return Table("crossings", 0, title, ["family", "overtakes", "at", "95 % interval", "share of draws"], rows)


def _correlations(budgets: list[float], tables: list[np.ndarray]) -> Table:
    means = [table.mean(axis=1) for table in tables]
    rows: Rows = [
        [f"{budget:g} core s", *(f"{rank_correlation(ranked, other):.2f}" for other in means)]
        for budget, ranked in zip(budgets, means, strict=True)
    ]
    title = "Kendall's τ between the rankings at two budgets"
    return Table("correlations", 0, title, ["", *(f"{budget:g} core s" for budget in budgets)], rows)


def _share(value: float) -> str:
    """Format a share of draws; it is rounded to 0 or 100 % only if all draws agree."""
    if 0.995 <= value < 1.0:
        return "> 99 %"
    return "< 1 %" if 0.0 < value < 0.005 else f"{100.0 * value:.0f} %"
