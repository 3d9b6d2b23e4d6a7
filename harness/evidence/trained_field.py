"""A trained field to look at: from a checkpoint of the studies where there is one, else trained now."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from harness.checkpoints import checkpoint_path, load_checkpoint, tensors_of
from harness.evidence.situation import Situation
from harness.ground_truth import read_views
from harness.lockstep import box_of, needs_view_direction, stream_of
from harness.needed import for_scene
from harness.plan import Plan
from harness.runner import view_set_folders
from harness.settings import TrainSettings
from harness.solo import trained_alone
from harness.trainer import Trainer
from scenes.view_set import ViewSet


@dataclass(frozen=True)
class TrainedField:
    """A network method after its training, and what it was trained on."""

    trainer: Trainer
    views: ViewSet
    origin: str
    """In words: from where."""


def trained_field(situation: Situation, training: str, scene: str, method: str, seed: int = 0) -> TrainedField:
    """`method` as `training` leaves it. It is not trained again where the folder of the studies has it.

    What is rendered has float32 products, whatever it was trained with: their rounding is not what is looked at.
    """
    device = torch.device(situation.machine.device)
    plan = situation.plan(training)
    folder = view_set_folders(replace(plan, scenes=(scene,)), situation.view_sets, situation.show)[scene]
    views = read_views(folder, plan.views, situation.scratch)
    stored = situation.out / "studies" / training
    weights = checkpoint_path(stored, scene, method, seed)
    if weights.exists() and _settings_of(stored) == json.loads(json.dumps(plan.settings())):
        trainer = restored(weights, plan, views, stream_of(scene, seed), method, device)
        return TrainedField(trainer, views, f"checkpoint of the training {training}")
    alone = trained_alone(method, views, stream_of(scene, seed), plan.train, plan.budget, device)
    if not isinstance(alone, Trainer):
        raise TypeError(f"{method} is no network")
    found = empty_trainer(plan, views, stream_of(scene, seed), method, device)
    found.restore(tensors_of(alone), alone.step)
    return TrainedField(found, views, f"trained now, as {training} does")


def restored(weights: Path, plan: Plan, views: ViewSet, stream: str, method: str, device: torch.device) -> Trainer:
    """A trainer at the end of its budget, with the weights and the occupied cells of a checkpoint."""
    trainer = empty_trainer(plan, views, stream, method, device)
    load_checkpoint(trainer, weights, plan.budget.steps or trainer.settings.grid.first_step + 1)
    return trainer


def empty_trainer(plan: Plan, views: ViewSet, stream: str, method: str, device: torch.device) -> Trainer:
    """As the run makes it for this scene, with float32 products."""
    settings: TrainSettings = replace(for_scene(plan.train, views), precision="float32")
    directed = needs_view_direction(views)
    return Trainer(method, box_of(views, device), settings, plan.budget, stream, device, directed)


def _settings_of(stored: Path) -> object:
    from harness.json_record import DamagedRecord
    from harness.records import read_run

    try:
        return read_run(stored).settings
    except DamagedRecord:
        return None
