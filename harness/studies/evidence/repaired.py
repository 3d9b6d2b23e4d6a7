"""The repaired Q-NeRF on scenes and seeds that it was not chosen on, with all the controls."""

import math
import statistics
from collections.abc import Iterator

from baselines.catalog import CATALOG
from baselines.methods.repaired import CANDIDATES, EXCLUDED
from baselines.numerics.encoding import PHI
from harness.records.cells import CellRecord
from harness.records.study import Check, Effect, Table, check
from harness.studies.choices.repair_search import Search, read_search
from harness.studies.evidence.contrasts import amount, effects, listed, told
from harness.studies.evidence.evidence_context import EvidenceContext, Finding
from harness.studies.evidence.factorial import mean_of, scores_of, spread
from harness.verdicts.comparisons import Budget, keyed

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


def repaired(situation: EvidenceContext) -> Iterator[Finding]:
    """Yield what was chosen against NeRF, against NeRF of its bandwidth, and against itself without the amplifier."""
    trained = situation.trained("repaired")
    cells, found = trained.cells, read_search()
    compared = [one for against in CONTROLS for one in effects(cells, REPAIRED, against, METRICS, tuple(BUDGETS))]
    yield from answers(compared)
    yield equal_time(cells, found.clock)
    yield _others(compared)
    yield _of_the_search(found)
    yield from found.history
    yield from _without_a_score(cells)
    yield from checks(cells, found)
    yield from compared
    yield _scores(cells)
    yield _learnt(cells)
    yield search_table(found)
    yield Table(
        "excluded",
        0,
        "What was no candidate, and why",
        ["mean", "why"],
        [[what, why] for what, why in EXCLUDED.items()],
    )


def answers(compared: list[Effect]) -> Iterator[str]:
    """Answer whether it beats NeRF, whether by the paper's margin, and what else has its encoding; at equal steps
    first, then at equal time.
    """
    for budget, words in BUDGETS.items():
        found = {against: over_all(compared, against, budget) for against in CONTROLS}
        changes = listed(f"{whose} by {told(found[against])}" for against, whose in CONTROLS.items())
        yield f"At {words} the repaired Q-NeRF changes {changes}; {reached(found['nerf'])}."


def reached(one: Effect) -> str:
    """Return where the interval lies relative to the paper's margin."""
    margin = f"the paper's margin of {amount(MARGIN, 'psnr')}"
    if one.simultaneous is None:
        return f"whether {margin} is reached is not settled"
    low, high = one.simultaneous
    if low >= MARGIN:
        return f"{margin} is reached"
    return f"{margin} is not reached" if high < MARGIN else f"whether {margin} is reached is not settled"


def over_all(compared: list[Effect], against: str, budget: Budget, metric: str = "psnr") -> Effect:
    return next(
        one for one in compared if (one.against, one.budget, one.metric, one.scene) == (against, budget, metric, "all")
    )


def _others(compared: list[Effect]) -> str:
    """Return the other scores beside PSNR."""
    others = listed(
        f"{metric} by {told(over_all(compared, 'nerf', 'steps', metric))}" for metric in METRICS if metric != "psnr"
    )
    return f"Other scores at equal steps, against NeRF: {others}."


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
    slower = REPAIRED if ratio > 1.0 else "nerf"
    return (
        f"Equal time is read off runs of equal steps: {slower}, the slower one, is met after "
        f"{100 * min(ratio, 1 / ratio):.0f} % of its training time, before its learning rate has fallen all the way, "
        f"which counts against it {budgets}."
    )


def _of_the_search(found: Search) -> str:
    ties = [one.method for one in found.standings if one.ties]
    best = max((one for one in found.standings if one.mean is not None), key=lambda one: one.mean or 0.0)
    beside = {name: mean_of([row.psnr_val for row in found.rows if row.method == name]) for name in CONTROLS}
    references = listed(f"{amount(mean, 'psnr', sign=False)} of {name}" for name, mean in beside.items() if mean)
    first = f"{len(ties)} of {len(found.standings)} candidates tie with the best" if len(ties) > 1 else "One stood out"
    return (
        f"{first}, {best.method} ({amount(best.mean, 'psnr', sign=False)} on validation views at equal {found.clock}, "
        f"beside {references}); chosen, as the simplest of them, was {found.chosen}."
    )


def _without_a_score(cells: list[CellRecord]) -> Iterator[str]:
    lost = [cell for cell in cells if cell.status != "done"]
    if lost:
        names = listed(f"{cell.method} on {cell.scene}, seed {cell.seed} ({cell.reason})" for cell in lost)
        yield f"{len(lost)} cells have no score, and their pairs are not judged: {names}."


def checks(cells: list[CellRecord], found: Search) -> Iterator[Check]:
    """Yield what must hold for this to be the search's own choice, judged elsewhere, and a field that can be opaque."""
    mine = [cell for cell in cells if cell.method == REPAIRED and cell.status == "done"]
    lost = sum(cell.method == REPAIRED for cell in cells) - len(mine)
    yield check(
        "methods that were judged and are not what the search chose",
        float(CATALOG[REPAIRED].parts != CANDIDATES[found.chosen]),
        high=0.0,
        why=f"chosen: {found.chosen}",
    )
    searched = {row.scene for row in found.rows}, {row.seed for row in found.rows}
    shared = {cell.scene for cell in cells} & searched[0], {cell.seed for cell in cells} & searched[1]
    yield check(
        "scenes and seeds of the verdict that the choice was made on",
        float(len(shared[0]) + len(shared[1])),
        high=0.0,
        why=f"chosen on {listed(sorted(searched[0]))}, seeds {listed(map(str, sorted(searched[1])))}",
    )
    yield _worst(
        "largest difference of a colour between calls of different size", mine, lost, "chunk_max_difference", CHUNK_BAR
    )
    yield _worst("opacity of a unit of the densest matter in the thinnest cell", mine, lost, "opacity_unit_slab", None)


def _worst(what: str, cells: list[CellRecord], lost: int, name: str, high: float | None) -> Check:
    """Return the worst of all trained cells; at most `high`, or at least opaque."""
    there = [
        (value, f"{cell.scene}, seed {cell.seed}")
        for cell in cells
        if isinstance(value := cell.properties.get(name), float)
    ]
    missing = f"; {lost} cells did not end" if lost else ""
    low = OPAQUE if high is None else None
    if not there or len(there) < len(cells):
        return check(what, None, low, high, why=f"measured in {len(there)} of {len(cells)} cells that ended{missing}")
    value, where = max(there) if low is None else min(there)
    return check(what, value, low, high, why=f"{where} of {len(there)} cells{missing}")


def _scores(cells: list[CellRecord]) -> Table:
    _, scenes, _ = keyed(cells)
    rows: list[list[str | float | None]] = [
        [method, *(spread(scores_of(cells, scene, method, "psnr")) for scene in scenes)]
        for method in (REPAIRED, *CONTROLS)
    ]
    return Table("repaired_scores", 0, "PSNR at equal steps, dB: mean ± sd over seeds", ["method", *scenes], rows)


def _learnt(cells: list[CellRecord]) -> Table:
    """Return αφ at the end: at 1 Eq. 4 is the identity."""
    _, scenes, seeds = keyed(cells)
    rows: list[list[str | float | None]] = []
    for scene in scenes:
        mine = {cell.seed: cell for cell in cells if (cell.scene, cell.method) == (scene, REPAIRED) and cell.curve}
        alphas = [mine[seed].curve[-1].alpha if seed in mine else None for seed in seeds]
        rows.append([scene, *(None if alpha is None else alpha * PHI for alpha in alphas)])
    columns = ["scene", *(f"seed {seed}" for seed in seeds)]
    return Table("contrast_learnt", 0, "Contrast αφ that was learnt; at 1 the amplifier does nothing", columns, rows)


def search_table(found: Search) -> Table:
    """Return every candidate and reference, in the order in which a tie is decided."""
    cells = list(dict.fromkeys((row.scene, row.seed) for row in found.rows))
    scores = {(row.method, row.scene, row.seed): row for row in found.rows}
    placed = {one.method: one for one in found.standings}
    rows: list[list[str | float | None]] = []
    for method in dict.fromkeys([*placed, *(row.method for row in found.rows)]):
        mine = [scores[method, scene, seed] for scene, seed in cells if (method, scene, seed) in scores]
        one = placed.get(method)
        role = "reference" if one is None else "chosen" if method == found.chosen else "ties" if one.ties else ""
        rows.append(
            [
                method,
                one.mean if one else mean_of([row.psnr_val for row in mine]),
                one.behind if one else None,
                one.standard_error if one else None,
                role,
                *(row.psnr_val for row in mine),
            ]
        )
    columns = ["candidate", "mean, dB", "behind the best, dB", "standard error, dB", "role"]
    columns += [f"{scene}, seed {seed}" for scene, seed in cells]
    return Table(
        "repair_search",
        0,
        f"The search: PSNR on validation views at equal training time, in {found.clock}",
        columns,
        rows,
    )
