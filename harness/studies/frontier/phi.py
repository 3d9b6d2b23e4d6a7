"""Grids whose resolutions grow by the golden ratio, each family compared with its controls."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

from harness.records.study import Effect
from harness.studies.evidence.contrasts import chosen, effects_of_table, in_words, listed, score_table, without_a_score
from harness.studies.framework import Found
from harness.studies.frontier.frontier_context import PHI_METHODS, Frontier, FrontierContext

CONTROLS = {"same_ends": "the same coarsest and finest level", "same_size": "an equal number of learnt numbers"}


def phi(context: FrontierContext) -> Iterator[Found]:
    amount, budget = context.amount, context.amount.phi_budget
    cells = context.trained("phi").cells
    frontier = Frontier(replace(amount, seeds=amount.phi_seeds), {budget: cells})
    effects = []
    for family, control in product(("planes", "hash_grid"), CONTROLS):
        method, against = f"{family}_phi", f"{family}_{control}"
        differences = frontier.values(budget, method, "psnr") - frontier.values(budget, against, "psnr")
        table = dict(zip(amount.scenes, differences, strict=True))
        effects += effects_of_table(table, method, "psnr", "core_seconds", 1, against=against)
    yield from sentences(effects, budget)
    yield from without_a_score(cells)
    yield from effects
    title = f"PSNR at {budget:g} core seconds, dB: mean ± sd over seeds"
    yield score_table("phi_scores", title, cells, PHI_METHODS, ("psnr",))


def sentences(effects: list[Effect], budget: float) -> list[str]:
    """Return a sentence per family with the effects over all scenes, after `budget` core seconds."""
    told = []
    for family in ("planes", "hash_grid"):
        changes = [
            f"{in_words(effect)} against {what}"
            for control, what in CONTROLS.items()
            for effect in chosen(effects, scene="all", budget="core_seconds", against=f"{family}_{control}")
        ]
        if changes:
            told.append(f"Growing by φ changes the PSNR of {family} at {budget:g} core seconds by {listed(changes)}.")
    return told
