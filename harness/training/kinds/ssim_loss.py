"""1 − SSIM of a complete view as a part of the loss; the metric is `harness.training.scoring.metrics.ssim`."""

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import conv2d

from harness.training.scoring.metrics import ssim_kernel


def ssim_loss(picture: Float[Tensor, "height width 3"], truth: Float[Tensor, "height width 3"]) -> Float[Tensor, ""]:
    """Return 1 − SSIM (Wang et al. 2004) of display colours, differentiable with respect to `picture`."""
    kernel = torch.from_numpy(ssim_kernel(*picture.shape[:2])).to(picture.dtype)
    x, y = picture, truth
    images = torch.stack([x, y, x * x, y * y, x * y]).permute(0, 3, 1, 2).flatten(0, 1)[:, None]
    blurred = conv2d(conv2d(images, kernel[None, None, :, None]), kernel[None, None, None, :])
    mean_x, mean_y, square_x, square_y, product = blurred.unflatten(0, (5, 3))
    variances = (square_x - mean_x**2).clamp(min=0.0) + (square_y - mean_y**2).clamp(min=0.0)
    covariance, c1, c2 = product - mean_x * mean_y, 0.01**2, 0.03**2
    luminance = (2 * mean_x * mean_y + c1) / (mean_x**2 + mean_y**2 + c1)
    loss: Tensor = 1.0 - (luminance * (2 * covariance + c2) / (variances + c2)).mean()
    return loss


def row_length(points: Float[Tensor, "pixels 2"]) -> int:
    """Return the pixels in a row of a view, from where its rays meet a plane parallel to the picture, row by row."""
    steps = points.diff(dim=0)
    turns = torch.nonzero((steps - steps[:1]).norm(dim=1) > 0.5 * steps[:1].norm())
    return int(turns[0]) + 1 if len(turns) else len(points)
