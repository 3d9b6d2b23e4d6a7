"""The densities that pictures are made of: the renderer's own weights, their quantiles, and the ceiling."""

import math
from dataclasses import replace

import pytest
import torch

from baselines.numerics.bounds import ray_box
from harness.training.scoring.densities import density_properties, quantiles_by_weight, rendered_samples
from harness.training.scoring.evaluate import cameras_of
from harness.training.trainer import Trainer
from scenes.view_sets.view_set import ViewSet
from tests.baselines.analytic import chord
from tests.harness.tiny import CPU, TRAIN, rays_and_colours, trainer

NAMES = ("density_by_weight_50", "density_by_weight_90", "density_by_weight_99")


def with_density(learner: Trainer, density) -> Trainer:
    """Return the same learner with a grey field of that density [points] of x [points, 3] per scene unit."""
    learner.coarse.density_and_colour = lambda x, view, ray: (density(x), torch.full_like(x, 0.5))
    return learner


def properties(learner: Trainer, views: ViewSet) -> dict[str, float | None]:
    return density_properties(learner, views, cameras_of(views, views.test, CPU))


def test_quantiles_by_weight_are_those_of_values_that_are_repeated() -> None:
    values, counts = torch.tensor([3.0, 1.0, 7.0, 2.0]), torch.tensor([2, 5, 1, 2])
    shares = (0.05, 0.5, 0.51, 0.7, 0.71, 0.9, 0.91, 1.0)
    repeated = sorted(values.repeat_interleave(counts).tolist())
    expected = [repeated[math.ceil(share * 10 - 1e-9) - 1] for share in shares]
    assert quantiles_by_weight(values, 0.125 * counts, shares) == expected


@pytest.mark.parametrize("fine_bins", [0, 8])
def test_the_samples_of_a_picture_are_those_that_it_is_made_of(fine_bins: int) -> None:
    learner = trainer("nerf", replace(TRAIN, first_bins=16, fine_bins=fine_bins))
    rays, _ = rays_and_colours(40)
    rendering = learner.render(rays, 40)
    sigma, w = rendering.samples.density.double(), rendering.samples.weight.double()
    assert sigma.shape == w.shape == (40, 16 + fine_bins)
    torch.testing.assert_close(w.sum(-1).float(), rendering.opacity)
    # a weight of T (1 − e^−τ): what is behind is dimmed by all that is in front
    tau = -torch.log1p(-w / (1.0 - w.cumsum(-1) + w))
    lengths = tau / sigma
    assert (lengths > 0).all()
    if not fine_bins:
        assert ((lengths - lengths[:, :1]).abs() < 1e-3).all(), "bins of a ray are equally long"


def test_samples_of_many_chunks_are_not_kept() -> None:
    rays, _ = rays_and_colours(40)
    assert trainer().render(rays, 39).samples is None


def test_what_lies_at_the_ceiling_is_told_from_what_lies_below_it(ball: ViewSet) -> None:
    """The tiny box is ±1: densities per scene unit are those per half box, and the limit is 25."""
    for density, share in ((25.0, 1.0), (24.8, 1.0), (24.7, 0.0), (3.0, 0.0)):
        found = properties(with_density(trainer("qnerf"), lambda x, d=density: torch.full_like(x[:, 0], d)), ball)
        assert found["density_limit"] == 25.0
        assert found["weight_at_ceiling"] == share
        assert [found[name] for name in NAMES] == pytest.approx([density] * 3)


def test_a_solid_in_fog_has_the_weight_of_its_pixels(ball: ViewSet) -> None:
    """An opaque ball is in a fog whose weight is known in front of the ball and next to it."""

    def density(x: torch.Tensor) -> torch.Tensor:
        return torch.where(x.norm(dim=-1) < 0.5, 25.0, 0.2)

    learner = with_density(trainer("qnerf", replace(TRAIN, bins=400, first_bins=400)), density)
    cameras = cameras_of(ball, ball.test, CPU)
    at_ceiling = whole = 0.0
    for view in range(len(cameras)):
        rays = cameras.all_rays(view)
        enter, leave, _ = ray_box(rays.origins, rays.directions, -torch.ones(3), torch.ones(3), rays.near, rays.far)
        along, inside = -(rays.origins * rays.directions).sum(-1), 0.5 * chord(rays, 0.5)
        fog = 1.0 - torch.exp(-0.2 * (leave - enter))
        before = torch.exp(-0.2 * (along - inside - enter).clamp(min=0.0))
        solid = torch.where(inside > 0, before * (1.0 - torch.exp(-50.0 * inside)), 0.0)
        behind = before * torch.exp(-50.0 * inside) * (1.0 - torch.exp(-0.2 * (leave - along - inside).clamp(min=0.0)))
        at_ceiling += float(solid.sum())
        whole += float(torch.where(inside > 0, 1.0 - before + solid + behind, fog).sum())
    found = properties(learner, ball)
    assert found["weight_at_ceiling"] == pytest.approx(at_ceiling / whole, rel=0.02)
    assert 0.1 < at_ceiling / whole < 0.9
    assert found["density_by_weight_99"] == 25.0


def test_a_method_without_a_limit_has_no_ceiling(ball: ViewSet) -> None:
    found = properties(with_density(trainer("nerf"), lambda x: torch.full_like(x[:, 0], 1e5)), ball)
    assert (found["density_limit"], found["opacity_of_a_pixel"], found["weight_at_ceiling"]) == (None, 1.0, 0.0)
    assert found["density_by_weight_50"] == pytest.approx(1e5)


def test_a_pixel_is_as_wide_as_the_cameras_see_it(ball: ViewSet) -> None:
    centre = ball.bounds.mean(axis=0)
    positions = ball.train.camera_to_world[:, :3, 3]
    pixel = sum(math.dist(position, centre) for position in positions) / len(positions) / ball.focal
    longest = float((ball.bounds[1] - ball.bounds[0]).max())
    found = properties(trainer("qnerf"), ball)
    # the tiny box is ±1, and the pixel is that of the view set's own box in half boxes
    assert found["opacity_of_a_pixel"] == pytest.approx(1.0 - math.exp(-25.0 * pixel / (0.5 * longest)))


def test_an_empty_picture_and_one_without_samples_say_nothing_of_weight(
    ball: ViewSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    unknown = {"weight_at_ceiling": None, **dict.fromkeys(NAMES)}
    found = properties(with_density(trainer("qnerf"), lambda x: torch.zeros_like(x[:, 0])), ball)
    assert found.items() > unknown.items()
    learner = trainer("qnerf")
    monkeypatch.setattr(learner, "render", lambda rays, chunk: replace(trainer().render(rays, chunk), samples=None))
    assert properties(learner, ball).items() > unknown.items()
    assert rendered_samples(learner, cameras_of(ball, ball.test, CPU)) is None
