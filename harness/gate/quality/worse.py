"""Is it worse? Short trainings compared with the stored ones of the same seeds, and the comparison of stored cells."""

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from msgspec import structs

from harness.gate import early
from harness.gate.gate_context import GateContext, complete
from harness.gate.gates import DRAWS, GATE_SEEDS, HEADLINES, OTHER_SEEDS, SCORES, TRAINED_METHODS, Gate
from harness.gate.limits import NONE_DIFFERS, judge
from harness.gate.quality.losses import DIGITS, STATISTICS, Judge, Scores, score_and_weights
from harness.gate.quality.short_trainings import ended, trained
from harness.gate.references import References
from harness.records.cells import CellRecord, Checkpoint, empty_cell
from harness.records.study import Answer, Check
from harness.verdicts.comparisons import compare


def _answer(checks: dict[str, Check]) -> str:
    mean = checks.get("worse.all.psnr")
    return f"Is it worse? {mean.why}" if mean else ""


@complete("worse", _answer)
def measure(context: GateContext) -> Iterator[Check | Answer]:
    """Train only the methods that the chosen gates need."""
    chosen = context.of_kind("worse")
    figures = {name: gate for name, gate in chosen.items() if name != STATISTICS}
    if STATISTICS in chosen:
        yield judge(chosen[STATISTICS], [other_statistics(context.references)], NONE_DIFFERS)
    if figures:
        new = scores_of(trained(context, methods_of(figures.values())))
        trainings = Judge.of(context.references, new, bool(early.broken(context)))
        for gate in figures.values():
            yield trainings.check(gate)
        yield Answer(trainings.sentence())


def renew(context: GateContext) -> References:
    """Return the references with new cells; raises `InputError` if one did not end."""
    draws = []
    for draw in range(DRAWS):
        draws.append(scores_of(ended(trained(context, TRAINED_METHODS, draw), "references")))
        context.show.line(f"worse: draw {draw + 1} of {DRAWS} of the rounding")
    others = scores_of(ended(trained(context, TRAINED_METHODS, seeds=OTHER_SEEDS), "references"))
    context.show.line("worse: other seeds")
    cells = {
        key: {score: [float(f"{some[key][score]:.{DIGITS}g}") for some in several] for score in SCORES}
        for several in (draws, [others])
        for key in several[0]
    }
    renewed = structs.replace(context.references, cells=dict(sorted(cells.items())))
    return structs.replace(renewed, statistics=statistics_of(stored_cells(renewed)))


def scores_of(cells: Iterable[CellRecord]) -> Scores:
    """Return the scores; None for every score of a cell that did not end."""
    return {
        f"{cell.scene}/{cell.method}/{cell.seed}": {
            score: cell.scores.get(score) if cell.status == "done" else None for score in SCORES
        }
        for cell in cells
    }


def methods_of(chosen: Iterable[Gate]) -> tuple[str, ...]:
    needed = sum(np.abs(score_and_weights(gate)[1]).sum(axis=0) for gate in chosen)
    return tuple(method for method, weight in zip(TRAINED_METHODS, needed, strict=True) if weight)


def statistics_of(cells: Sequence[CellRecord]) -> dict[str, list[float]]:
    """Return the difference of each headline and the ends of its two intervals."""
    statistics = {}
    methods = {cell.method for cell in cells}
    for row in compare(list(cells), [method for method in TRAINED_METHODS if method in methods]):
        is_headline = (row.method, row.against) in HEADLINES
        if is_headline and (row.scene, row.metric, row.budget) == ("all", "psnr", "steps"):
            estimates = (row.on_these_scenes, row.scenes_like_these)
            ends = [end for estimate in estimates if estimate and estimate.interval for end in estimate.interval]
            if row.difference is not None:
                statistics[f"{row.method}_{row.against}"] = [row.difference, *ends]
    return statistics


def other_statistics(stored: References) -> int:
    """Count the numbers of the stored comparisons that are now different."""
    today = statistics_of(stored_cells(stored))
    differing = 0
    for name in stored.statistics.keys() | today.keys():
        before, now = stored.statistics.get(name, []), today.get(name, [])
        differing += abs(len(now) - len(before))
        differing += sum(not math.isclose(a, b, rel_tol=1e-6) for a, b in zip(now, before, strict=False))
    return differing


def stored_cells(stored: References) -> list[CellRecord]:
    """Return the cells of the gate's seeds that were trained from unchanged first weights."""
    cells = []
    for key, draws in stored.cells.items():
        scene, method, seed = key.split("/")
        if int(seed) in GATE_SEEDS:
            scores = {score: values[0] for score, values in draws.items()}
            point = Checkpoint(1, 1.0, 1, psnr=scores.get("psnr"))
            empty = empty_cell(scene, method, int(seed), "done", "")
            facts = {"reason": None, "steps": 1, "train_seconds": 1.0, "scores": scores, "curve": [point]}
            cells.append(structs.replace(empty, **facts))
    return cells
