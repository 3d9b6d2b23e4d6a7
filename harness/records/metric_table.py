"""The table of metrics, for everything that computes, compares or shows scores.

The name of a metric is also the name of its function in `harness.training.scoring.metrics`, of a field in the records
of scores, and of a column of the page.
"""

import math
from typing import Literal, NamedTuple


class Metric(NamedTuple):
    """A score of the test set."""

    name: str
    label: str
    unit: str
    digits: int
    digits_of_difference: int
    higher_is_better: bool
    smallest_of_interest: float
    """The smallest effect of interest; for PSNR the smallest step of the paper's Table 4."""
    meaning: str
    compares: Literal["colour", "light", "features", "depth", "opacity"] = "colour"
    """The part of a view that its function compares with the truth."""
    largest: float = math.inf
    """The value that a larger score is clipped to."""
    error: str = ""
    """The label of its figure of error against work (1 − score if higher is better); empty without such a figure."""
    optional: bool = False
    """Whether only some scenes or runs have it: unclipped light is compared if display colour cannot hold it
    (`hdr_metrics` of a scene's needs), and features if the user provides the weights of LPIPS."""


LARGEST_PSNR = 100.0
"""The PSNR of an image that is identical to the truth, used only in means."""
METRICS: dict[str, Metric] = {
    metric.name: metric
    for metric in (
        Metric("psnr", "PSNR", "dB", 2, 2, True, 0.2, "per test image in display colour over white, then averaged",
               largest=LARGEST_PSNR),
        Metric("ssim", "SSIM", "", 3, 4, True, 0.005, "11 × 11 Gaussian, σ = 1.5, averaged over channels",
               error="1 − SSIM"),
        Metric("rmse_linear", "linear RMSE", "", 4, 4, False, 0.002, "in linear light",
               error="RMSE in linear light"),
        Metric("flip", "FLIP", "", 3, 4, False, 0.005, "visible difference when flipping between the images",
               error="FLIP"),
        Metric("delta_e", "ΔE₀₀", "", 2, 2, False, 0.1, "CIEDE2000 colour difference"),
        Metric("depth_rmse", "depth RMSE", "", 3, 4, False, 0.02,
               "in scene units, along the ray, where there is geometry", "depth", error="depth RMSE (scene units)"),
        Metric("opacity_iou", "opacity IoU", "", 3, 4, True, 0.005, "overlap of the opaque silhouettes",
               "opacity"),
        Metric("rel_mse", "relMSE", "", 4, 4, False, 0.01,
               "squared error over the true light's square + 0.01, light not clipped", "light", optional=True),
        Metric("smape", "SMAPE", "", 4, 4, False, 0.01,
               "absolute error over the sum of both lights + 0.01, light not clipped", "light", optional=True),
        Metric("hdr_flip", "HDR-FLIP", "", 3, 4, False, 0.005,
               "FLIP, the largest over exposures, light not clipped", "light", optional=True),
        Metric("lpips", "LPIPS", "", 3, 4, False, 0.005, "distance of a network's features, version 0.1", "features",
               optional=True),
    )
}  # fmt: skip
"""Name → metric, in the order of columns and comparisons."""
POSSIBLE = {
    "psnr": (0.0, 400.0), "ssim": (-1.0, 1.0), "rmse_linear": (0.0, 1.0), "flip": (0.0, 1.0),
    "delta_e": (0.0, 200.0), "depth_rmse": (0.0, math.inf), "opacity_iou": (0.0, 1.0),
    "rel_mse": (0.0, math.inf), "lpips": (0.0, math.inf), "smape": (0.0, 1.0), "hdr_flip": (0.0, 1.0),
}  # fmt: skip
"""The range of possible scores of any two images in 0 … 1."""
PRIMARY = "psnr"
SMALLEST_SAVING = 5.0
"""The smallest saving of interest, in per cent of training time: the paper prints 18 and 19."""


def metric_of(name: str) -> Metric:
    """Return a line of the table; a metric that this version does not know is labelled by its name."""
    return METRICS.get(name) or Metric(name, name, "", 3, 4, True, 0.0, "")


def possible_range(name: str) -> tuple[float, float]:
    """Return the range of possible scores; all numbers for a metric that is not known."""
    return POSSIBLE.get(name, (-math.inf, math.inf))
