"""Fairness gates: the comparison itself favours no method.

Two copies of a method under different names must end bit-identical, methods must share the same bits, and the
comparison must find no difference between equal cells.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path

import torch
from torch import Tensor

from baselines.catalog import CATALOG
from baselines.contract import Rays
from harness.gate.gate_context import GateContext, complete
from harness.gate.gates import TRAINED_METHODS
from harness.gate.limits import NONE_DIFFERS, judge
from harness.gate.quality.short_trainings import TRAIN
from harness.plan.group_task import GroupTask
from harness.plan.schedule import Budget
from harness.plan.settings import GridSettings, ScoreSettings
from harness.records.cells import CellRecord
from harness.records.study import Check
from harness.studies.drawn_views import disc_views
from harness.training.learner import Job, Learner
from harness.training.lockstep import box_of, train_group
from harness.training.make_learner import learner_for
from harness.verdicts.comparisons import compare
from scenes.view_sets.view_set import ViewSet

COPY_STEPS = 40
"""The steps of a copy, enough for the occupancy grid to skip empty space."""
CPU = torch.device("cpu")


@complete("fairness")
def measure(context: GateContext) -> Iterator[Check]:
    """Train on a view set that needs no renderer, and count inequalities."""
    scratch, views = context.scratch, drawn()
    copies = cache(lambda method: copied(method, views, scratch / method))
    for name, gate in context.of_kind("fairness").items():
        match name.split(".")[1:]:
            case ["first_weights"]:
                differing = first_weights(TRAINED_METHODS, views)
            case ["batches"]:
                differing = other_batches(TRAINED_METHODS, views, scratch / "batches")
            case ["copies", method]:
                differing = copies(method)[0]
            case _:
                differing = seen_differences(copies("nerf")[1], "nerf")
        yield judge(gate, [differing], NONE_DIFFERS, "nothing to compare" if differing is None else "")


def drawn() -> ViewSet:
    return disc_views(24, 8, 2, seed=1)


def task_of(methods: tuple[str, ...], seed: int, out: Path) -> GroupTask:
    train = replace(TRAIN, rays=128, warm_up_steps=5, grid=GridSettings(cells=16, first_step=20, every=5))
    score = ScoreSettings(checkpoints=1, chunk=1024, train_views=1, stored_views=0)
    return GroupTask("drawn", seed, methods, train, score, Budget(COPY_STEPS, None), out)


def first_weights(methods: tuple[str, ...], views: ViewSet) -> int | None:
    """Count first weights that differ between methods in tensors of one name and shape; None without such tensors."""
    train, box, budget = task_of(methods, 0, Path()).train, box_of(views, CPU), Budget(COPY_STEPS, None)
    states = [
        dict(learner_for(Job(method, box, train, budget, "drawn/0", CPU, True)).fields.state_dict())
        for method in methods
    ]
    differing = [
        int((first[name] != second[name]).sum())
        for first, second in combinations(states, 2)
        for name in first.keys() & second.keys()
        if first[name].shape == second[name].shape and first[name].numel() > 1
    ]
    return sum(differing) if differing else None


def other_batches(methods: tuple[str, ...], views: ViewSet, out: Path) -> int | None:
    """Count batches of lockstep training that differ from the first method's; None without two methods."""
    batches: dict[str, list[tuple[Tensor, ...]]] = {}
    cells = list(train_group(task_of(methods, 0, out), views, {}, lambda share: None, watching([], batches)))
    if len(batches) < 2 or any(cell.status != "done" for cell in cells):
        return None
    first = batches[methods[0]]
    differing = 0
    for method in methods[1:]:
        differing += abs(len(batches[method]) - len(first))
        for batch, other in zip(first, batches[method], strict=False):
            differing += not all(torch.equal(a, b) for a, b in zip(batch, other, strict=True))
    return differing


def copied(method: str, views: ViewSet, out: Path) -> tuple[int | None, list[CellRecord]]:
    """Train a method and its copy in lockstep with two seeds. Return how many weights and scores differ, None if a cell
    did not end, and the cells.
    """
    methods = (method, copy_of(method))
    cells: list[CellRecord] = []
    weights: dict[tuple[str, int], dict[str, Tensor]] = {}
    CATALOG[methods[1]] = CATALOG[method]
    try:
        for seed in (0, 1):
            learners: list[Learner] = []
            cells += train_group(task_of(methods, seed, out), views, {}, lambda share: None, watching(learners))
            weights |= {(learner.method, seed): dict(learner.fields.state_dict()) for learner in learners}
    finally:
        del CATALOG[methods[1]]
    if any(cell.status != "done" for cell in cells):
        return None, cells
    differing = 0
    for seed in (0, 1):
        first, second = (weights[name, seed] for name in methods)
        differing += sum(int((first[key] != second[key]).sum()) for key in first)
        scores = [next(cell.scores for cell in cells if (cell.method, cell.seed) == (name, seed)) for name in methods]
        differing += sum(scores[0][key] != scores[1][key] for key in scores[0])
    return differing, cells


def copy_of(method: str) -> str:
    """Return a name of another length and alphabetical order."""
    return f"another_{method}"


def watching(made: list[Learner], batches: dict[str, list[tuple[Tensor, ...]]] | None = None) -> Callable[..., Learner]:
    """Return a maker of learners that records them in `made`, and their batches in `batches`."""

    def make(job: Job) -> Learner:
        learner = learner_for(job)
        made.append(learner)
        if batches is not None:
            train_on = learner.train_on

            def recorded(rays: Rays, colours: Tensor) -> None:
                batches.setdefault(job.method, []).append((rays.origins, rays.directions, colours))
                train_on(rays, colours)

            learner.train_on = recorded  # type: ignore[method-assign]
        return learner

    return make


def seen_differences(cells: list[CellRecord], method: str) -> int | None:
    """Count comparisons with the copy at equal steps that find a difference; None without a comparison."""
    rows = [row for row in compare(cells, [method, copy_of(method)]) if row.budget == "steps" and row.pairs]
    if not rows:
        return None
    return sum(row.difference != 0 or row.unpaired > 0 or row.verdict.sign != "open" for row in rows)
