"""Scores of a trained method on the views, its properties, and pictures for the report."""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import torch

from harness.plan.seeds import generator_for
from harness.records.cells import ViewScore
from harness.records.json_record import finite_or_none
from harness.records.metric_table import LARGEST_PSNR, METRICS, possible_range
from harness.training.batches import Cameras
from harness.training.learner import Learner
from harness.training.scoring import metrics
from harness.training.trainer import Diverged
from scenes.view_sets.pixels import decode_srgb, over_white
from scenes.view_sets.view_set import Split, ViewSet

HISTOGRAM_BINS = 40
SMALL_CHUNK = 256
LARGE_CHUNK = 4096
"""The rays per chunk, row by row, with which the dependence on chunks is measured."""


@dataclass(frozen=True)
class View:
    """A rendered view as arrays [height, width, …]."""

    colour: np.ndarray
    opacity: np.ndarray
    depth: np.ndarray


def cameras_of(views: ViewSet, split: Split, device: torch.device) -> Cameras:
    return Cameras.of(split.camera_to_world, views.width, views.height, views.focal, views.near, views.far).to(device)


def pixel_order(pixels: int) -> torch.Tensor:
    """Return the fixed random order in which the pixels of a view are rendered, int [pixels], on the processor."""
    return torch.randperm(pixels, generator=generator_for("pixel order"))


def render_view(trainer: Learner, cameras: Cameras, view: int, chunk: int) -> View:
    """Render a complete view, its pixels in a fixed random order.

    The order matters only if density depends on the chunk: it then has pixels from all parts of the view, as a training
    batch does, instead of ten rows of background.
    """
    rays = cameras.all_rays(view)
    order = pixel_order(len(rays)).to(rays.origins.device)
    rendering = trainer.render(rays.chosen(order), chunk)
    back = torch.argsort(order)
    parts = (rendering.colour, rendering.opacity, rendering.depth)
    size = (cameras.height, cameras.width)
    return View(*(part[back].cpu().numpy().reshape(*size, *part.shape[1:]) for part in parts))


def render_split(trainer: Learner, cameras: Cameras, chunk: int, chosen: Iterable[int] | None = None) -> Iterator[View]:
    """Render one view at a time, so that only one need be in memory; all views, or the chosen ones."""
    indices = range(len(cameras)) if chosen is None else chosen
    return (render_view(trainer, cameras, index, chunk) for index in indices)


def quick_scores(images: Iterable[View], split: Split) -> dict[str, float | None]:
    """Return psnr, ssim and rmse_linear, each the mean over all views of the split."""
    quick = {"psnr": _capped_psnr, "ssim": metrics.ssim, "rmse_linear": metrics.rmse_linear}
    rows = []
    for image, rgba in zip(images, split.rgba, strict=True):
        truth = over_white(rgba)
        rows.append([_possible(name, score(image.colour, truth), image) for name, score in quick.items()])
    return {name: finite_or_none(value) for name, value in zip(quick, np.mean(rows, axis=0), strict=True)}


def _possible(name: str, score: float, image: View) -> float:
    """Return a score; raises `ValueError` for a score that no colours in 0 … 1 have, as no record can hold it."""
    low, high = possible_range(name)
    if not math.isnan(score) and not low <= score <= high:
        ends = f"{image.colour.min():.3g} to {image.colour.max():.3g}"
        raise ValueError(f"{name} is {score:.4g}, as it renders colours from {ends}; they must lie in 0 … 1")
    return score


Distance = Callable[[np.ndarray, np.ndarray], float | None]
"""An image and the truth [h, w, 3] → their distance, as `harness.training.scoring.lpips` computes it."""


def view_scores(
    image: View, split: Split, index: int, chosen: Iterable[str] = METRICS, lpips: Distance | None = None
) -> ViewScore:
    """Return the chosen scores of one view, each by the function of its name; None where the truth lacks the data."""
    rgba = split.rgba[index]
    sides: dict[str, tuple[np.ndarray, ...]] = {
        "colour": (image.colour, over_white(rgba)),
        "opacity": (image.opacity, rgba[..., 3]),
        "features": (image.colour, over_white(rgba)),
    }
    if split.light is not None and (light := split.light(split.names[index])) is not None:
        sides["light"] = (decode_srgb(image.colour), light)
    if split.depth is not None:
        sides["depth"] = (image.depth, split.depth[index], rgba[..., 3] > 0.99)
    scores: dict[str, float | None] = {}
    for name in chosen:
        arrays = sides.get(METRICS[name].compares)
        measure = lpips if METRICS[name].compares == "features" else getattr(metrics, name)
        score = None if arrays is None or measure is None else measure(*arrays)
        scores[name] = None if score is None else _possible(name, min(score, METRICS[name].largest), image)
    noise = None if split.noise_mse is None else float(split.noise_mse[index])
    ceiling = None if noise is None else finite_or_none(metrics.psnr_from_mse(noise))
    return ViewScore(view=split.names[index], psnr_ceiling=ceiling, **scores)


def mean_of(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def spread_indices(count: int, length: int) -> list[int]:
    """Return at most `count` evenly spread indices of a sequence of `length`."""
    indices: list[int] = np.unique(np.linspace(0, length - 1, min(count, length)).round().astype(int)).tolist()
    return indices


def _capped_psnr(image: np.ndarray, truth: np.ndarray) -> float:
    return min(metrics.psnr(image, truth), LARGEST_PSNR)


def _mean_psnr(pairs: Iterable[tuple[np.ndarray, np.ndarray]]) -> float | None:
    return finite_or_none(float(np.mean([_capped_psnr(image, truth) for image, truth in pairs])))


def mean_scores(rows: list[ViewScore]) -> dict[str, float | None]:
    """Average over views. If some views lack a score (no true depth, identical images), average over the others."""
    return {name: mean_of(getattr(row, name) for row in rows) for name in (*METRICS, "psnr_ceiling")}


def train_psnr(trainer: Learner, views: ViewSet, count: int, chunk: int) -> float | None:
    """Return the mean PSNR over `count` evenly spread training views, which says how well they are fitted."""
    cameras = cameras_of(views, views.train, trainer.device)
    chosen = spread_indices(count, len(cameras))
    return _mean_psnr((render_view(trainer, cameras, i, chunk).colour, over_white(views.train.rgba[i])) for i in chosen)


def floor_psnr(views: ViewSet) -> float | None:
    """Return the PSNR of a copy of the nearest training view for every test view: below it nothing is learnt."""
    train, test = views.train.camera_to_world[:, :3, 3], views.test.camera_to_world[:, :3, 3]
    nearest = np.argmin(np.linalg.norm(test[:, None] - train[None], axis=-1), axis=1)
    return _mean_psnr((over_white(views.train.rgba[i]), over_white(views.test.rgba[k])) for k, i in enumerate(nearest))


def _grid_over(trainer: Learner, points: int) -> torch.Tensor:
    """Return the centres [points³, 3] of equal cells of the box."""
    axis = (torch.arange(points, device=trainer.device) + 0.5) / points
    unit = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij"), dim=-1).reshape(-1, 3)
    return trainer.box.from_unit(unit)


@torch.no_grad()
def density_histogram(trainer: Learner, occupied: np.ndarray | None = None, points: int = 32) -> dict[str, list[float]]:
    """Return a histogram of the density before and after the amplifier, over a regular grid of points of the box.

    Densities are per half of the box's longest side. Bins are linear up to the method's limit, or without a limit
    logarithmic from 1e-3 to 1e3. With the true occupancy of the points, bool [points, points, points], which training
    never uses, the points inside and outside geometry are also counted separately.
    """
    per_box = trainer.box.half_extent
    before, after = (sigma * per_box for sigma in trainer.field.density_before_and_after(_grid_over(trainer, points)))
    if not bool(torch.isfinite(after).all()):
        raise Diverged(trainer.step, "density after the amplifier")
    limit = trainer.field.density_limit * per_box
    bounded = np.isfinite(limit)
    edges = np.linspace(0.0, limit, HISTOGRAM_BINS + 1) if bounded else np.geomspace(1e-3, 1e3, HISTOGRAM_BINS + 1)
    sides = {
        name: np.clip(values.double().cpu().numpy().reshape(-1), edges[0], edges[-1])
        for name, values in (("before", before), ("after", after))
    }
    histogram = {"edges": edges.tolist(), **{name: _shares(values, edges) for name, values in sides.items()}}
    if occupied is None:
        return histogram
    inside = occupied.reshape(-1)
    for where, chosen in (("inside", inside), ("outside", ~inside)):
        histogram |= {f"{name}_{where}": _shares(values[chosen], edges) for name, values in sides.items()}
    return {**histogram, "points": [float(inside.sum()), float((~inside).sum())]}


def _shares(values: np.ndarray, edges: np.ndarray) -> list[float]:
    counts, _ = np.histogram(values, edges)
    return [float(share) for share in counts / max(len(values), 1)]


NORMALS = 2000
"""The maximum number of pixels of a view whose normals are compared."""
ACROSS = 256.0
"""The number of steps across the box for differences of density: about two per pixel."""


@torch.no_grad()
def normal_error(trainer: Learner, image: View, cameras: Cameras, split: Split, index: int) -> float | None:
    """Return the mean angle in degrees between the true normal and the direction in which the learned density falls at
    the rendered depth, over evenly spread pixels that are opaque in both; None if the view has no true normal or no
    such pixel. Both are turned towards the camera; where the density is constant, the angle counts as 90°.
    """
    if split.normal is None:
        return None
    truth = split.normal[index].reshape(-1, 3)
    opaque = (split.rgba[index][..., 3] > 0.99) & (image.opacity > 0.5)
    seen = np.flatnonzero(opaque.ravel() & (np.linalg.norm(truth, axis=-1) > 0.5))
    if not len(seen):
        return None
    seen = seen[:: max(1, len(seen) // NORMALS)]
    chosen = torch.from_numpy(seen).to(trainer.device)
    rays = cameras.all_rays(index)
    direction = rays.directions[chosen]
    depth = torch.from_numpy(image.depth.ravel()[seen]).to(direction)
    points = rays.origins[chosen] + depth[:, None] * direction
    steps = 2.0 * trainer.box.half_extent / ACROSS * torch.eye(3, device=trainer.device)
    falls = torch.stack([trainer.field.density(points - step) - trainer.field.density(points + step) for step in steps])
    normals = [falls.T.double(), torch.from_numpy(truth[seen]).to(direction).double()]
    learnt, true = (torch.nn.functional.normalize(n, dim=-1) for n in normals)
    away = -direction.double()
    learnt, true = (torch.where((n * away).sum(-1, keepdim=True) < 0.0, -n, n) for n in (learnt, true))
    return float(torch.rad2deg(torch.arccos((learnt * true).sum(-1).clamp(-1.0, 1.0))).mean())


@torch.no_grad()
def measured_properties(trainer: Learner, test: Cameras) -> dict[str, float | str | None]:
    """Return the dependence of one test view on chunks, the grid's occupied share, and the largest density per half of
    the box's longest side, with its opacity over that length.
    """
    rays = test.all_rays(0)
    difference = (trainer.render(rays, LARGE_CHUNK).colour - trainer.render(rays, SMALL_CHUNK).colour).abs()
    densest = float(trainer.field.density(_grid_over(trainer, 48)).max()) * trainer.box.half_extent
    return {
        "chunk_max_difference": float(difference.max()),
        "chunk_rms_difference": float(difference.square().mean().sqrt()),
        "largest_density": densest,
        "opacity_unit_slab": -float(np.expm1(-densest)),
        "occupied_share": trainer.grid.occupied_share() if trainer.grid else None,
    }
