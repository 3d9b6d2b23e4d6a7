"""A GPU trains what the processor trains: the same rays and first weights, sums in another order."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from baselines.catalog import CATALOG
from baselines.contract import Box, Rays
from baselines.numerics.optimisers import OptimiserName
from harness.plan.profiles import TUNED
from harness.plan.settings import TrainSettings
from harness.training.checkpoints import load_checkpoint, save_checkpoint
from harness.training.learner import Job
from harness.training.trainer import Trainer
from tests.harness.tiny import BUDGET, CPU, TRAIN, rays_and_colours

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU")
NETWORKS = [name for name, method in CATALOG.items() if method.is_field]


def trained(method: str, kind: str, settings: TrainSettings, steps: int) -> Trainer:
    device = torch.device(kind)
    box = Box(-torch.ones(3, device=device), torch.ones(3, device=device))
    learner = Trainer(Job(method, box, settings, BUDGET, 0, device))
    for step in range(steps):
        learner.train_on(*batch(step, device))
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
