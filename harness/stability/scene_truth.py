"""Rendered views against what a scene's closed form says, and how far noise may part the two. Arrays alone."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenes.images import read_channels
from scenes.truth import Truth, pixel_means

COLOURS = "RGBA"
LARGEST_Z = 4.0
STRATA = (13, 16)
"""The closed form is averaged over a pixel twice, by one random ray in each of so many strata along either axis: free
of bias, and what the two differ by is the noise of their mean. Even grids of the same sizes are off by their alignment
with straight edges: beneath fields half a pixel wide by four standard errors of six views."""


@dataclass(frozen=True)
class Views:
    """Some views of a view set as they were rendered, and their closed form; n views."""

    names: tuple[str, ...]
    rendered: np.ndarray
    """float64 [n, h, w, 4]: linear, premultiplied."""
    variance: np.ndarray
    """[n, h, w, 4]: what the renderer estimates of its noise, and what the two means of the closed form differ by."""
    truth: np.ndarray
    """[n, h, w, 4]."""
    depth: np.ndarray
    """[n, h, w]: rendered, 0 where nothing was hit."""
    true_depth: np.ndarray

    @property
    def covered(self) -> np.ndarray:
        """Pixels [n, h, w] that are covered from border to border, by the rendering and by the closed form."""
        whole: np.ndarray = (self.rendered[..., 3] > 1 - 1e-6) & (self.truth[..., 3] > 1 - 1e-9)
        return whole

    def of(self, name: str) -> "Views":
        """The one view of that name."""
        one = slice(index := self.names.index(name), index + 1)
        return Views(
            (name,), self.rendered[one], self.variance[one], self.truth[one], self.depth[one], self.true_depth[one]
        )


def read_views_and_truth(folder: Path, names: Iterable[str], poses: Iterable[np.ndarray], truth: Truth) -> Views:
    """`names` inside a view set's folder, without suffix, and their cameras [4, 4]."""
    names = tuple(names)
    rows = []
    for number, (name, pose) in enumerate(zip(names, poses, strict=True)):
        channels = read_channels(folder / f"{name}.exr")
        rendered = np.stack([channels[one] for one in COLOURS], axis=-1).astype(np.float64)
        noise = np.stack([channels[f"V.{one}"] for one in COLOURS], axis=-1).astype(np.float64)
        height, width = rendered.shape[:2]
        mean, apart, depth = closed_form(truth, pose, width, height, number)
        rows.append((rendered, noise + apart, mean, channels["Z"], depth))
    return Views(names, *(np.stack(column).astype(np.float64) for column in zip(*rows, strict=True)))


def closed_form(
    truth: Truth, pose: np.ndarray, width: int, height: int, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means over pixels [h, w, 4], the variance of each, and depth [h, w]."""
    (first, first_depth), (second, second_depth) = (
        pixel_means(truth, pose, width, height, strata, np.random.default_rng((seed, strata))) for strata in STRATA
    )
    return (first + second) / 2, (first - second) ** 2 / 4, (first_depth + second_depth) / 2


def z_score(estimate: float, truth: float, variance: float) -> float:
    """(estimate − truth) / standard error. Without variance: 0 where they agree to float32's digits, else infinite."""
    difference = estimate - truth
    if variance <= 0.0:
        return 0.0 if abs(difference) <= 1e-6 * max(abs(truth), 1.0) else float("inf")
    return difference / float(np.sqrt(variance))


def worst_z(views: Views, chosen: np.ndarray | None = None) -> float:
    """Of the means of red, green, blue and opacity over the pixels `chosen` [n, h, w]: the largest |z|."""
    picked = np.ones(views.depth.shape, bool) if chosen is None else chosen
    count = np.count_nonzero(picked)
    return max(
        abs(
            z_score(
                float(views.rendered[picked][:, i].mean()),
                float(views.truth[picked][:, i].mean()),
                float(views.variance[picked][:, i].sum()) / count**2,
            )
        )
        for i in range(len(COLOURS))
    )


def unexplained(views: Views) -> float:
    """Mean square difference of pixels over what noise explains: about 1 where every pixel is right, not means alone.

    0 where there is neither difference nor noise.
    """
    square, noise = float(np.mean((views.rendered - views.truth) ** 2)), float(np.mean(views.variance))
    # float32 colours carry a rounding error that no noise explains
    return square / (noise + 1e-13) if square > 1e-13 else 0.0


def depth_error(views: Views) -> float:
    """Largest |rendered − true| distance over pixels that are wholly covered, scene units; NaN where none is."""
    if not views.covered.any():
        return float("nan")
    return float(np.abs(views.depth - views.true_depth)[views.covered].max())


def explained_share(mse: float, variance: float) -> float:
    """R² = 1 − mse / variance: 1 where everything is explained, 0 for what one flat colour would reach."""
    return 1.0 - mse / variance


def colour_variance(pixels: np.ndarray) -> float:
    """Mean square distance of pixels [n, 3] from the one colour that is nearest to them all."""
    values = pixels.astype(np.float64)
    return float(np.mean((values - values.mean(axis=0)) ** 2))
