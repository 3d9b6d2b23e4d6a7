"""The plain step as the oracle: the fast trainer computes the same."""

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from torch import Tensor, nn

from baselines.contract import Accelerations, Box, NetworkSize, Rays
from baselines.plain import PlainField, plain_loss, plain_render
from harness.plan.schedule import Budget
from harness.plan.seeds import generator_for
from harness.plan.settings import GridSettings, TrainSettings
from harness.training.learner import Job
from harness.training.trainer import Trainer

SIZE = NetworkSize(depth=8, width=48, colour_layers=2, colour_width=24, position_bands=6, direction_bands=3)
BOX = Box(torch.tensor([-3.0, -2.6, -2.8]), torch.tensor([3.0, 2.9, 2.7]))
SAMPLES, RAYS, SEED = 24, 96, 5
DENSE = replace(Accelerations(), grid=False, clipping=False)
SETTINGS = TrainSettings(
    network=SIZE,
    rays=RAYS,
    bins=SAMPLES,
    first_bins=SAMPLES,
    fine_bins=0,
    clip_norm=1e9,
    grid=GridSettings(cells=0),
    accelerations=DENSE,
)
COLOUR_BOUND = 1e-6
LOSS_BOUND = 1e-6
GRADIENT_BOUND = 1e-5
"""The bounds of the trainer in float32 against the plain step in float64: absolute for colours, relative to the loss,
relative to the largest entry of each gradient. Rounding f π x at 2^5 already changes the encoding by 3e-6.
"""
Batch = tuple[Rays, Tensor]


def rays_inside(seed: int = 8) -> Batch:
    """Rays whose whole way from near to far lies in the box, so that cutting them to it changes nothing."""
    generator = torch.Generator().manual_seed(seed)
    origins = 0.5 * torch.randn(RAYS, 3, generator=generator).clamp(-1.5, 1.5)
    directions = nn.functional.normalize(torch.randn(RAYS, 3, generator=generator), dim=-1)
    return Rays(origins, directions, 0.25, 1.75), torch.rand(RAYS, 3, generator=generator)


def rays_through(seed: int = 8) -> Batch:
    """Rays that begin and end far outside of the box; some miss it."""
    generator = torch.Generator().manual_seed(seed)
    origins = 8.0 * nn.functional.normalize(torch.randn(RAYS, 3, generator=generator), dim=-1)
    aims = 3.0 * torch.randn(RAYS, 3, generator=generator)
    directions = nn.functional.normalize(aims - origins, dim=-1)
    return Rays(origins, directions, 2.0, 14.0), torch.rand(RAYS, 3, generator=generator)


def trainer(view_dependent: bool = True) -> Trainer:
    learner = Trainer(Job("nerf", BOX, SETTINGS, Budget(10, None), SEED, torch.device("cpu"), view_dependent))
    generator = torch.Generator().manual_seed(9)
    with torch.no_grad():  # as after training: contrast, and biases that are not zero
        learner.field.density_head.weight *= 8.0
        for name, weight in learner.field.named_parameters():
            if name.endswith("bias"):
                weight.copy_(0.1 * torch.randn(weight.shape, generator=generator))
    return learner


def oracle(learner: Trainer, view_dependent: bool = True) -> PlainField:
    """Return the plain field in float64, box included."""
    box = Box(BOX.lower.double(), BOX.upper.double())
    field = PlainField(SIZE, box, "another seed", view_dependent)
    field.load_state_dict(learner.field.state_dict())
    return field.double()


def step_of(learner: Trainer, batch: Batch) -> tuple[float, dict[str, Tensor]]:
    """Loss and gradients of one training step, caught before the optimiser gets them."""
    caught: dict[str, Tensor] = {}

    def catch(*_: object, **__: object) -> None:
        caught.update({name: weight.grad.clone() for name, weight in learner.field.named_parameters()})

    learner.optimiser.step = catch  # type: ignore[method-assign]
    learner.train_on(*batch)
    loss = learner.trace["loss"][0]
    assert loss is not None
    return loss, caught


def expected_step(field: PlainField, batch: Batch) -> tuple[float, dict[str, Tensor]]:
    rays, colours = batch
    loss = plain_loss(field, rays.to(torch.float64), colours.double(), SAMPLES, generator_for(SEED, 0, "jitter"))
    loss.backward()
    return loss.item(), {name: weight.grad for name, weight in field.named_parameters() if weight.grad is not None}


def step_gap(learner: Trainer, field: PlainField, batch: Batch) -> tuple[float, float]:
    """Relative difference of the losses, and the largest of the gradients relative to their largest entries."""
    (loss, gradients), (expected, truth) = step_of(learner, batch), expected_step(field, batch)
    assert set(gradients) == set(truth)
    gaps = [float((gradients[name] - truth[name]).abs().max() / truth[name].abs().max()) for name in truth]
    return abs(loss - expected) / expected, max(gaps)


def loss_gap(
    view_dependent: bool = True,
    rays: Callable[[int], Batch] = rays_inside,
    spoil: Callable[[PlainField], None] = lambda field: None,
    batches: int = 4,
) -> tuple[float, float]:
    """Return the gaps of the batch that agrees best. Where rounding switches a unit on or off at one sample, a gradient
    jumps by up to 4e-3, in plain float32 as well; an error is seen in every batch.
    """
    gaps = []
    for seed in range(batches):
        learner = trainer(view_dependent)
        field = oracle(learner, view_dependent)
        spoil(field)
        gaps.append(step_gap(learner, field, rays(seed)))
    return min(loss for loss, _ in gaps), min(gradient for _, gradient in gaps)


def colour_gap(learner: Trainer, field: PlainField, batch: Batch | None = None) -> float:
    rays, _ = batch or rays_inside()
    with torch.no_grad():
        expected = plain_render(field, rays.to(torch.float64), SAMPLES, torch.ones(3, dtype=torch.float64), None)
    return float((learner.render(rays, RAYS).colour - expected).abs().max())


@pytest.mark.parametrize(
    ("view_dependent", "rays", "larger"), [(True, rays_inside, 1), (False, rays_inside, 1), (True, rays_through, 5)]
)
def test_trainer_agrees_with_the_plain_step(view_dependent: bool, rays: Callable[..., Batch], larger: int) -> None:
    """Outside of the box positions are up to five times as large as the encoding is made for, and so is rounding."""
    learner = trainer(view_dependent)
    assert colour_gap(learner, oracle(learner, view_dependent), rays()) < larger * COLOUR_BOUND
    loss, gradient = loss_gap(view_dependent, rays)
    assert loss < larger * LOSS_BOUND
    assert gradient < larger * GRADIENT_BOUND


def _another_box(field: PlainField) -> None:
    field.box = Box(field.box.lower, 1.001 * field.box.upper)


def _a_bias(field: PlainField) -> None:
    with torch.no_grad():
        field.colour_net[1].bias[0] += 0.01


@pytest.mark.parametrize("spoil", [_another_box, _a_bias])
def test_a_field_that_differs_is_seen(spoil: Callable[[PlainField], None]) -> None:
    learner = trainer()
    field = oracle(learner)
    spoil(field)
    assert colour_gap(learner, field) > 5 * COLOUR_BOUND
    loss, gradient = loss_gap(spoil=spoil, batches=1)
    assert loss > 5 * LOSS_BOUND
    assert gradient > 5 * GRADIENT_BOUND


def test_weights_start_as_those_of_the_field() -> None:
    learner = Trainer(Job("nerf", BOX, SETTINGS, Budget(10, None), SEED, torch.device("cpu")))
    ours, theirs = PlainField(SIZE, BOX, f"{SEED}/coarse").state_dict(), learner.field.state_dict()
    assert list(ours) == list(theirs)
    assert all(torch.equal(ours[name], theirs[name]) for name in ours)
