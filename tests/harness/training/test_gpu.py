"""A GPU trains what the processor trains: the same rays and first weights, sums in another order."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from baselines.catalog import CATALOG
from baselines.contract import Box, Rays
from baselines.numerics.optimisers import OptimiserName
from harness.plan.profiles import TUNED
from harness.plan.schedule import Budget
from harness.plan.settings import TrainSettings
from harness.training.batches import Batch
from harness.training.checkpoints import load_checkpoint, save_checkpoint
from harness.training.learner import Job, take_turn
from harness.training.trainer import Diverged, Trainer
from harness.training.turns import Turns, in_turns
from tests.harness.tiny import BUDGET, CPU, TRAIN, rays_and_colours

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU")
NETWORKS = [name for name, method in CATALOG.items() if method.is_field]


def fresh(method: str, kind: str, settings: TrainSettings, budget: Budget = BUDGET) -> Trainer:
    device = torch.device(kind)
    box = Box(-torch.ones(3, device=device), torch.ones(3, device=device))
    return Trainer(Job(method, box, settings, budget, 0, device))


def trained(method: str, kind: str, settings: TrainSettings, steps: int) -> Trainer:
    learner = fresh(method, kind, settings)
    for step in range(steps):
        learner.train_on(*batch(step, learner.device))
    return learner


def batch(seed: int, device: torch.device) -> tuple[Rays, torch.Tensor]:
    rays, colours = rays_and_colours(seed=seed)
    return rays.to(device), colours.to(device)


def picture(method: str, kind: str, settings: TrainSettings, steps: int) -> torch.Tensor:
    learner = trained(method, kind, settings, steps)
    rays, _ = batch(77, learner.device)
    return learner.render(rays, 16).colour.to(CPU)


@pytest.mark.parametrize("method", NETWORKS)
def test_every_method_shows_what_it_shows_on_the_processor(method: str) -> None:
    """Twelve steps: over the first refresh of the grid."""
    first, first_on_gpu = (picture(method, kind, TRAIN, 0) for kind in ("cpu", "cuda"))
    torch.testing.assert_close(first_on_gpu, first, atol=1e-5, rtol=1e-4)
    later, later_on_gpu = (picture(method, kind, TRAIN, 12) for kind in ("cpu", "cuda"))
    assert (later - first).abs().mean() > 1e-3  # it has learnt something
    torch.testing.assert_close(later_on_gpu, later, atol=2e-2, rtol=0.0)
    assert (later_on_gpu - later).abs().mean() < 0.1 * (later - first).abs().mean()


@pytest.mark.parametrize("optimiser", ["adam", "soap", "muon"])
def test_every_optimiser_takes_the_processors_steps(optimiser: OptimiserName) -> None:
    settings = replace(TRAIN, **TUNED[optimiser])
    first = picture("qnerf", "cpu", settings, 0)
    later, later_on_gpu = (picture("qnerf", kind, settings, 3) for kind in ("cpu", "cuda"))
    assert (later_on_gpu - later).abs().mean() < 1e-2 * (later - first).abs().mean()


def test_bfloat16_products_are_near_float32s() -> None:
    exact = picture("nerf", "cpu", TRAIN, 12)
    rounded = picture("nerf", "cuda", replace(TRAIN, precision="bfloat16"), 12)
    assert 0.0 < (rounded - exact).abs().mean() < 2e-2


def test_a_cell_on_a_gpu_resumes(tmp_path: Path) -> None:
    whole, half, resumed = (trained("qnerf", "cuda", TRAIN, steps) for steps in (8, 4, 0))
    save_checkpoint(half, tmp_path / "half")
    load_checkpoint(resumed, tmp_path / "half", half.step)
    resumed.restore_optimiser(half.optimiser_tensors())
    for step in range(4, 8):
        resumed.train_on(*batch(step, resumed.device))
    rays, _ = batch(77, whole.device)
    torch.testing.assert_close(resumed.render(rays, 16).colour, whole.render(rays, 16).colour, atol=1e-2, rtol=0.0)


# turns: a step compiled and captured as one graph


TURNING = replace(TRAIN, fine_bins=8, grid=replace(TRAIN.grid, cells=0))


def in_a_graph(method: str, settings: TrainSettings, steps: int, spoilt: int | None = None) -> Trainer:
    learner = in_turns(fresh(method, "cuda", settings, Budget(steps, None)))

    def batch_at(step: int) -> Batch:
        rays, colours = batch(step, learner.device)
        return Batch(rays, colours / 0.0 if step == spoilt else colours)

    while learner.step < steps:
        take_turn(learner, batch_at)
    assert isinstance(learner, Trainer)
    return learner


@pytest.mark.parametrize("method", ["nerf", "nerf_matched", "qnerf", "qnerf_repaired"])
@pytest.mark.parametrize("cells", [0, 8])
def test_a_graph_takes_the_processors_steps(method: str, cells: int) -> None:
    settings = replace(TURNING, grid=replace(TRAIN.grid, cells=cells))
    learner = in_a_graph(method, settings, 12)
    assert isinstance(learner.turns, Turns)
    assert learner.turns.form == "compiled, captured"
    single = trained(method, "cpu", settings, 12)
    assert learner.trace["loss"] == pytest.approx(single.trace["loss"], rel=1e-2)


def test_equal_runs_have_equal_bits_in_a_graph() -> None:
    first, second = (in_a_graph("qnerf", TURNING, 150).fields.state_dict() for _ in range(2))
    assert all(torch.equal(first[name], second[name]) for name in first)


def test_a_step_in_the_middle_of_a_graphs_turn_is_named() -> None:
    with pytest.raises(Diverged, match="step 57: loss"):
        in_a_graph("nerf", TURNING, 150, spoilt=57)
