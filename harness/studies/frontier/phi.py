"""Grids whose resolutions grow by the golden ratio, each family compared with its controls."""

from collections.abc import Iterator

import numpy as np

from harness.records.cells import CellRecord
from harness.records.study import Effect, Table
from harness.studies.evidence.contrasts import (
    Tables,
    chosen,
    effects_of_table,
    in_words,
    listed,
    score_table,
    without_a_score,
)
from harness.studies.framework import Found
from harness.studies.frontier.frontier_context import PHI_METHODS, FrontierContext
from harness.verdicts.failures import judgeable

CONTROLS = {"same_ends": "the same coarsest and finest level", "same_size": "an equal number of learnt numbers"}


def phi(context: FrontierContext) -> Iterator[Found]:
    cells = context.trained("phi").cells
    effects = [
        effect
        for family in ("planes", "hash_grid")
        for control in CONTROLS
        for effect in effects_of_table(
            _differences(context, cells, f"{family}_phi", f"{family}_{control}"),
            f"{family}_phi", "psnr", "core_seconds", 1, against=f"{family}_{control}",
        )
    ]  # fmt: skip
    yield from sentences(effects, context.amount.phi_budget)
    yield from without_a_score(cells)
    yield from effects
    columns, scores = score_table(cells, PHI_METHODS, ("psnr",))
    title = f"PSNR at {context.amount.phi_budget:g} core seconds, dB: mean ± sd over seeds"
    yield Table("phi_scores", 0, title, ["method", *columns], [[method, *row] for method, row in scores.items()])


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


def _differences(context: FrontierContext, cells: list[CellRecord], method: str, against: str) -> Tables:
    """Return the differences of the final scores by scene, NaN for a seed without one."""
    scores = {(c.scene, c.method, c.seed): c.scores.get("psnr") for c in cells if judgeable(c)}
    amount = context.amount

    def of(scene: str, name: str) -> np.ndarray:
        return np.array([scores.get((scene, name, seed)) for seed in amount.phi_seeds], dtype=np.float64)

    return {scene: of(scene, method) - of(scene, against) for scene in amount.scenes}
