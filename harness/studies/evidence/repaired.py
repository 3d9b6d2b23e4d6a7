"""The repaired Q-NeRF on seeds and views that it was not chosen on, with all the controls."""

import math
import statistics
from collections.abc import Iterator

from baselines.numerics.encoding import PHI
from harness.records.cells import Budget, CellRecord
from harness.records.study import Check, Effect, Table, check
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
    cells = context.trained("repaired").cells
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
    yield equal_time(cells)
    against_nerf = [chosen(compared, scene="all", against="nerf", metric=metric) for metric in METRICS[1:]]
    changes = listed(f"{effect.metric} by {in_words(effect)}" for (effect,) in against_nerf)
    yield f"Other scores at equal steps, against NeRF: {changes}."
    yield from without_a_score(cells)
    yield from _checks(cells)
    yield from compared
    columns, scores = score_table(cells, (REPAIRED, *CONTROLS), ("psnr",))
    title = "PSNR at equal steps, dB: mean ± sd over seeds"
    yield Table("repaired_scores", 0, title, ["method", *columns], [[method, *row] for method, row in scores.items()])
    yield _learnt(cells)


def _reached(effect: Effect) -> str:
    """Return where the interval lies relative to the paper's margin."""
    margin = f"the paper's margin of {amount(MARGIN, 'psnr')}"
    low, high = effect.simultaneous or (-math.inf, math.inf)
    if low >= MARGIN:
        return f"{margin} is reached"
    return f"{margin} is not reached" if high < MARGIN else f"whether {margin} is reached is not settled"


def equal_time(cells: list[CellRecord]) -> str:
    """Return what equal time means, from runs of equal steps."""
    by_key, scenes, seeds = keyed([cell for cell in cells if cell.status == "done"])
    pairs = [
        (by_key.get((scene, REPAIRED, seed)), by_key.get((scene, "nerf", seed))) for scene in scenes for seed in seeds
    ]
    ratios = [mine.train_seconds / other.train_seconds for mine, other in pairs if mine and other]
    if not ratios:
        return "How far the slower method had come at equal time is not known: no pair ended."
    ratio = math.exp(statistics.fmean(map(math.log, ratios)))
    return (
        f"Equal time is read off runs of equal steps: {REPAIRED if ratio > 1.0 else 'nerf'}, the slower one, is met "
        f"after {100 * min(ratio, 1 / ratio):.0f} % of its training time, before its learning rate has fallen all the "
        f"way, which counts against it."
    )


def _checks(cells: list[CellRecord]) -> Iterator[Check]:
    """Yield what must hold for this to be a field that can be opaque."""
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
