"""1 − SSIM as a loss: against the metric, and the length of a row of any camera's picture."""

import numpy as np
import pytest
import torch

from baselines.splats.gaussians import Pencil, on_plane
from harness.training.kinds.ssim_loss import row_length, ssim_loss
from harness.training.scoring.metrics import ssim
from tests.harness.training.test_batches import POSES, cameras


@pytest.mark.parametrize("shape", [(20, 31, 3), (4, 7, 3)])
def test_it_is_one_minus_the_metric_and_has_its_slope(shape: tuple[int, int, int]) -> None:
    draw = np.random.default_rng(0)
    truth = draw.uniform(size=shape)
    picture = torch.tensor(np.clip(truth + 0.1 * draw.normal(size=shape), 0.0, 1.0), requires_grad=True)
    loss = ssim_loss(picture, torch.from_numpy(truth))
    assert loss.item() == pytest.approx(1.0 - ssim(picture.detach().numpy(), truth), abs=1e-9)
    assert 0.01 < loss.item() < 0.9
    (slope,) = torch.autograd.grad(loss, picture)
    along = torch.from_numpy(draw.normal(size=shape))
    ahead, behind = (1.0 - ssim((picture.detach() + h * along).numpy(), truth) for h in (1e-5, -1e-5))
    assert float((slope * along).sum()) == pytest.approx((ahead - behind) / 2e-5, rel=1e-5)


@pytest.mark.parametrize(("width", "height"), [(5, 4), (40, 3), (2, 9), (6, 1)])
def test_the_end_of_a_row_is_found_in_any_picture(width: int, height: int) -> None:
    for view in range(len(POSES)):
        rays = cameras(width, height, 0.7 * width).all_rays(view)
        pencil = Pencil.of(rays.origins[0], rays.directions, rays.near)
        assert row_length(on_plane(rays.directions, pencil.axes)) == width
