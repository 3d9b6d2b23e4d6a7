"""The short trainings of `worse` and `families`, each cell in a process of one thread."""

import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import torch

from harness.execution.ground_truth import read_views, view_set_folders
from harness.gate.gate_context import GateContext
from harness.gate.gates import GATE_SEEDS, RESOLUTION, STEPS, TRAINED_SCENES
from harness.machine.stopping import in_workers
from harness.plan.group_task import GroupTask
from harness.plan.profiles import SHORT_TRAINING
from harness.plan.run_plan import Plan
from harness.plan.schedule import Budget
from harness.plan.seeds import generator_for
from harness.plan.settings import GridSettings, ScoreSettings, ViewSettings
from harness.records.cells import CellRecord
from harness.training.learner import Job, Learner
from harness.training.lockstep import train_group
from harness.training.make_learner import learner_for
from scenes.files.errors import InputError

LAST_BIT = 2.0**-23
TRAIN = replace(
    SHORT_TRAINING,
    warm_up_steps=20,
    contrast_weight=0.0,
    grid=GridSettings(cells=32, first_step=60, every=20),
    precision="float32",
)
"""The training settings, in float32, so that machines differ only by rounding."""


def trained(
    context: GateContext,
    methods: tuple[str, ...],
    draw: int = 0,
    scenes: tuple[str, ...] = TRAINED_SCENES,
    seeds: tuple[int, ...] = GATE_SEEDS,
) -> list[CellRecord]:
    """Return all cells of `methods`, trained with one process per core."""
    plan = Plan(
        profile="gate",
        scenes=scenes,
        methods=methods,
        seeds=seeds,
        budget=Budget(steps=STEPS, seconds=None),
        train=TRAIN,
        score=ScoreSettings(checkpoints=1, chunk=2048, train_views=1, stored_views=1),
        views=ViewSettings(resolution=RESOLUTION, train=40, val=0, test=6, spp_train=16, spp_test=64),
    )
    folders = view_set_folders(plan, context.view_sets, context.show)
    tasks = [
        GroupTask(
            scene, seed, methods, plan.train, plan.score, plan.budget, context.scratch, folders[scene], plan.views
        )
        for scene, seed in plan.groups()
    ]
    many = min(context.machine.workers, len(tasks))
    return [cell for cells in in_workers([partial(train_one, task, draw) for task in tasks], many) for cell in cells]


def train_one(task: GroupTask, draw: int) -> list[CellRecord]:
    place = Path(tempfile.mkdtemp(dir=task.out))
    views = read_views(task.view_set, task.views, place)
    return list(train_group(replace(task, out=place), views, {}, lambda share: None, rounded_otherwise(draw)))


def rounded_otherwise(draw: int) -> Callable[..., Learner]:
    """Return a maker of learners with random changes in the last bit of their first weights; draw 0 changes none."""

    def make(job: Job) -> Learner:
        learner = learner_for(job)
        if draw:
            generator = generator_for("rounding", draw, job.method)
            with torch.no_grad():
                for weight in learner.fields.parameters():
                    weight.mul_(1.0 + LAST_BIT * torch.randint(-1, 2, weight.shape, generator=generator))
        return learner

    return make


def ended(cells: list[CellRecord], what: str) -> list[CellRecord]:
    """Return the cells of a renewal; raises `InputError` if one did not end, as `what` cannot be made then."""
    if stopped := [
        f"{cell.scene} {cell.method} seed {cell.seed}: {cell.reason}" for cell in cells if cell.status != "done"
    ]:
        raise InputError(f"--renew: no {what} can be made of trainings that did not end ({'; '.join(stopped)})")
    return cells
