"""A trained method compared with the views: scores of the fixed test set, properties, and pictures for the report."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import torch

from baselines.contract import Rays, Rendering
from harness.plan.seeds import generator_for
from harness.records.cells import ViewScore
from harness.records.json_record import finite_or_none
from harness.training import metrics
from harness.training.batches import Cameras
from harness.training.learner import Learner
from harness.training.trainer import Diverged
from scenes.view_sets.pixels import over_white
from scenes.view_sets.view_set import Split, ViewSet

HISTOGRAM_BINS = 40
SMALL_CHUNK = 256
LARGE_CHUNK = 4096
"""The rays per chunk in the measurement of chunk dependence, row by row."""
LARGEST_PSNR = 100.0
"""The PSNR of an image that is identical to the truth, in means alone."""


@dataclass(frozen=True)
class View:
    """A rendered view as arrays [height, width, …]."""

    colour: np.ndarray
    opacity: np.ndarray
    depth: np.ndarray

    @staticmethod
    def of(rendering: Rendering, height: int, width: int) -> "View":
        def image(values: torch.Tensor) -> np.ndarray:
            return values.cpu().numpy().reshape(height, width, *values.shape[1:])

        return View(image(rendering.colour), image(rendering.opacity), image(rendering.depth))


def cameras_of(views: ViewSet, split: Split, device: torch.device) -> Cameras:
    return Cameras.of(split.camera_to_world, views.width, views.height, views.focal, views.near, views.far).to(device)


def pixel_order(pixels: int) -> torch.Tensor:
    """Return the fixed random order in which the pixels of a view are rendered, int [pixels], on the processor."""
    return torch.randperm(pixels, generator=generator_for("pixel order"))


def render_view(trainer: Learner, cameras: Cameras, view: int, chunk: int) -> View:
    """Render a full view, its pixels in one fixed random order.

    The order matters only to a density that depends on the chunk: a chunk then holds pixels of all parts of the view,
    as a training batch does, and not ten rows of background.
    """
    rays = cameras.all_rays(view)
    order = pixel_order(len(rays)).to(rays.origins.device)
    shuffled = Rays(rays.origins[order], rays.directions[order], rays.near, rays.far)
    rendering = trainer.render(shuffled, chunk)
    back = torch.argsort(order)
    in_order = Rendering(
        rendering.colour[back], rendering.opacity[back], rendering.depth[back], rendering.network_evaluations
    )
    return View.of(in_order, cameras.height, cameras.width)


def render_split(trainer: Learner, cameras: Cameras, chunk: int) -> Iterator[View]:
    """Render one view at a time: no more than one need be in memory."""
    return (render_view(trainer, cameras, index, chunk) for index in range(len(cameras)))


def quick_scores(images: Iterable[View], split: Split) -> dict[str, float | None]:
    """Return psnr, ssim and rmse_linear, each the mean over all views of the split."""
    rows = []
    for image, rgba in zip(images, split.rgba, strict=True):
        truth = over_white(rgba)
        rows.append([score(image.colour, truth) for score in (_capped_psnr, metrics.ssim, metrics.rmse_linear)])
    means = np.mean(rows, axis=0)
    return {name: finite_or_none(value) for name, value in zip(("psnr", "ssim", "rmse_linear"), means, strict=True)}


def scores_along(images: Iterable[View], split: Split) -> dict[str, float | None]:
    """Return a checkpoint's scores: psnr, ssim, rmse_linear, flip and depth_rmse, each the mean over the views that
    have it.

    The geometry of a view whose truth has none, or no opaque pixel, is excluded.
    """
    rows: dict[str, list[float | None]] = {}
    for index, image in enumerate(images):
        truth = over_white(split.rgba[index])
        for name, score in ALONG_TRAINING.items():
            rows.setdefault(name, []).append(score(image.colour, truth))
        rows.setdefault("depth_rmse", []).append(_depth_rmse(image, split, index))
    found = {name: [value for value in values if value is not None] for name, values in rows.items()}
    return {name: finite_or_none(float(np.mean(values))) if values else None for name, values in found.items()}


def _depth_rmse(image: View, split: Split, index: int) -> float | None:
    if split.depth is None:
        return None
    return metrics.depth_rmse(image.depth, split.depth[index], split.rgba[index][..., 3] > 0.99)


def _capped_psnr(image: np.ndarray, truth: np.ndarray) -> float:
    return min(metrics.psnr(image, truth), LARGEST_PSNR)


ALONG_TRAINING: dict[str, Callable[[np.ndarray, np.ndarray], float]] = {
    "psnr": _capped_psnr,
    "ssim": metrics.ssim,
    "rmse_linear": metrics.rmse_linear,
    "flip": metrics.flip,
}
"""The scores of colour that every checkpoint has."""


def view_scores(image: View, split: Split, index: int) -> ViewScore:
    """Return every score of one view; geometry if the view set carries it."""
    rgba = split.rgba[index]
    truth = over_white(rgba)
    noise = None if split.noise_mse is None else float(split.noise_mse[index])
    return ViewScore(
        view=split.names[index],
        psnr=_capped_psnr(image.colour, truth),
        ssim=metrics.ssim(image.colour, truth),
        flip=metrics.flip(image.colour, truth),
        delta_e=metrics.delta_e(image.colour, truth),
        rmse_linear=metrics.rmse_linear(image.colour, truth),
        depth_rmse=_depth_rmse(image, split, index),
        opacity_iou=metrics.opacity_iou(image.opacity, rgba[..., 3]),
        psnr_ceiling=None if noise is None else finite_or_none(metrics.psnr_from_mse(noise)),
    )


SCORES = ("psnr", "ssim", "flip", "delta_e", "rmse_linear", "depth_rmse", "opacity_iou", "psnr_ceiling")


def mean_scores(rows: list[ViewScore]) -> dict[str, float | None]:
    """Average over views; a score that a view lacks (no true depth, identical images) is averaged over the others."""
    means: dict[str, float | None] = {}
    for name in SCORES:
        values = [value for row in rows if (value := getattr(row, name)) is not None]
        means[name] = float(np.mean(values)) if values else None
    return means


def train_psnr(trainer: Learner, views: ViewSet, count: int, chunk: int) -> float | None:
    """Return the mean PSNR over `count` evenly spread training views: how well they are fitted, beside
    generalisation.
    """
    cameras = cameras_of(views, views.train, trainer.device)
    chosen = np.unique(np.linspace(0, len(cameras) - 1, min(count, len(cameras))).round().astype(int))
    values = [
        _capped_psnr(render_view(trainer, cameras, int(i), chunk).colour, over_white(views.train.rgba[i]))
        for i in chosen
    ]
    return finite_or_none(float(np.mean(values)))


def floor_psnr(views: ViewSet) -> float | None:
    """Return the PSNR of answering every test view with the nearest training view: below it nothing is learnt."""
    train, test = views.train.camera_to_world[:, :3, 3], views.test.camera_to_world[:, :3, 3]
    nearest = np.argmin(np.linalg.norm(test[:, None] - train[None], axis=-1), axis=1)
    values = [
        _capped_psnr(over_white(views.train.rgba[i]), over_white(views.test.rgba[k])) for k, i in enumerate(nearest)
    ]
    return finite_or_none(float(np.mean(values)))


@torch.no_grad()
def density_histogram(trainer: Learner, occupied: np.ndarray | None = None, points: int = 32) -> dict[str, list[float]]:
    """Return shares of a regular grid of points over the box by density, before and after the amplifier.

    Densities are per half of the box's longest side. Bins are linear up to the method's limit if it has one, else
    logarithmic from 1e-3 to 1e3. With the true occupancy of the points, bool [points, points, points], the same is
    given for those inside and outside geometry, and how many of them there are; it is used here alone, never trained
    on.
    """
    axis = (torch.arange(points, device=trainer.device) + 0.5) / points
    unit = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij"), dim=-1).reshape(-1, 3)
    per_box = trainer.box.half_extent
    before, after = (one * per_box for one in trainer.field.density_before_and_after(trainer.box.from_unit(unit)))
    if not bool(torch.isfinite(after).all()):
        raise Diverged(trainer.step, "density after the amplifier")
    limit = trainer.field.density_limit * per_box
    bounded = np.isfinite(limit)
    edges = np.linspace(0.0, limit, HISTOGRAM_BINS + 1) if bounded else np.geomspace(1e-3, 1e3, HISTOGRAM_BINS + 1)
    sides = {
        name: np.clip(values.double().cpu().numpy().reshape(-1), edges[0], edges[-1])
        for name, values in (("before", before), ("after", after))
    }
    found = {"edges": edges.tolist(), **{name: _shares(values, edges) for name, values in sides.items()}}
    if occupied is None:
        return found
    inside = occupied.reshape(-1)
    for where, chosen in (("inside", inside), ("outside", ~inside)):
        found |= {f"{name}_{where}": _shares(values[chosen], edges) for name, values in sides.items()}
    return {**found, "points": [float(inside.sum()), float((~inside).sum())]}


def _shares(values: np.ndarray, edges: np.ndarray) -> list[float]:
    counts, _ = np.histogram(values, edges)
    return [float(share) for share in counts / max(len(values), 1)]


@torch.no_grad()
def measured_properties(trainer: Learner, test: Cameras) -> dict[str, float | str | None]:
    """Return the chunk dependence of one test view, the grid's occupied share, and the largest density found, per half
    of the box's longest side, with the opacity that this length of it has.
    """
    rays = test.all_rays(0)
    large = trainer.render(rays, LARGE_CHUNK).colour
    small = trainer.render(rays, SMALL_CHUNK).colour
    difference = (large - small).abs()
    axis = (torch.arange(48, device=trainer.device) + 0.5) / 48
    unit = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij"), dim=-1).reshape(-1, 3)
    densest = float(trainer.field.density(trainer.box.from_unit(unit)).max()) * trainer.box.half_extent
    return {
        "chunk_max_difference": float(difference.max()),
        "chunk_rms_difference": float(difference.square().mean().sqrt()),
        "largest_density": densest,
        "opacity_unit_slab": -float(np.expm1(-densest)),
        "occupied_share": trainer.grid.occupied_share() if trainer.grid else None,
    }
