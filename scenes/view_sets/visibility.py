"""What cameras see of the box. Poses in other axes, or inverted, see nothing of it."""

from dataclasses import dataclass

import numpy as np

from scenes.view_sets.source import LEAST_ALPHA
from scenes.view_sets.view_set import Split, ViewSet

ACROSS = 100
"""The maximum number of tested pixels per row."""
LEAST_COVERED = 0.9
"""The share of covered pixels that should see the box, which should hold all visible geometry."""
LEAST_LENGTH = 1e-4
"""The length inside a box, relative to its longest side, from which a ray counts as meeting it."""
OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Visibility:
    """Shares of the pixels of some views, 0 … 1."""

    rays: float
    """The share of all pixels whose ray meets the box between near and far."""
    covered: float | None
    """The share of the covered pixels that see the box; None if all pixels are covered, as without alpha, or none."""
    views: np.ndarray
    """The share of each view: of its covered pixels, or, as above, of all; NaN for a view without covered pixels."""

    @property
    def share(self) -> float:
        return self.rays if self.covered is None else self.covered

    @property
    def line(self) -> str:
        """Return a line such as `53 % of the training rays meet the box, and 100 % of those of covered pixels`."""
        covered = "" if self.covered is None else f", and {self.covered:.0%} of those of covered pixels"
        return f"{self.rays:.0%} of the training rays meet the box{covered}"


def visibility_of(views: ViewSet, split: Split | None = None) -> Visibility:
    """Return what the views of a split, by default those of training, see of the box of `views`; at least one view."""
    split = split or views.train
    return _visibility(views, split.camera_to_world, _seen(views, split), views.near, views.far)


def likely_cause(views: ViewSet, split: Split) -> str | None:
    """Return why the cameras do not see the box, and the remedy; None if no other reading of the poses sees it."""
    poses, seen = split.camera_to_world, _seen(views, split)
    inverse = np.linalg.inv(poses)
    readings = {
        "near and far leave it out: choose others (--near, --far)": poses,
        "the poses seem to have OpenCV's axes, y down and z forward: negate their second and third column": poses
        @ OPENCV,
        "the poses seem to be world-to-camera: invert them": inverse,
        "the poses seem to be world-to-camera, in OpenCV's axes: invert them, then negate the second and third "
        "column": inverse @ OPENCV,
    }
    for cause, reading in readings.items():
        if _visibility(views, reading, seen, 0.0, np.inf).share >= LEAST_COVERED:
            return cause
    return None


def _seen(views: ViewSet, split: Split) -> np.ndarray:
    """Return whether the tested pixels are covered, bool [views, pixels]."""
    step = _step(views)
    return np.stack([(image[::step, ::step, 3] >= LEAST_ALPHA).ravel() for image in split.rgba])


def _step(views: ViewSet) -> int:
    return max(1, views.width // ACROSS)


def _visibility(views: ViewSet, poses: np.ndarray, seen: np.ndarray, near: float, far: float) -> Visibility:
    step = _step(views)
    column, row = np.meshgrid(np.arange(0, views.width, step), np.arange(0, views.height, step))
    x, y = column + 0.5 - 0.5 * views.width, 0.5 * views.height - row - 0.5
    rays = np.stack([x.ravel(), y.ravel(), np.full(x.size, -views.focal)], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    met = np.stack([_met(pose, rays, views.bounds, near, far) for pose in poses])
    if seen.all() or not seen.any():
        return Visibility(float(met.mean()), None, met.mean(axis=1))
    # geometry that covers a part of a pixel may lie off its central ray
    covered = seen & np.stack([_met(pose, rays, _wider(views, pose), near, far) for pose in poses])
    pixels = seen.sum(axis=1)
    of_views = np.where(pixels > 0, covered.sum(axis=1) / np.maximum(pixels, 1), np.nan)
    return Visibility(float(met.mean()), float(covered.sum() / seen.sum()), of_views)


def _wider(views: ViewSet, pose: np.ndarray) -> np.ndarray:
    """Return the box, wider on every side by the length of a pixel in its middle."""
    away = float(np.linalg.norm(pose[:3, 3] - views.bounds.mean(axis=0)))
    return np.asarray(views.bounds + away / views.focal * np.array([[-1.0], [1.0]]))


def _met(pose: np.ndarray, rays: np.ndarray, bounds: np.ndarray, near: float, far: float) -> np.ndarray:
    directions = rays @ pose[:3, :3].T
    directions = np.where(np.abs(directions) < 1e-12, 1e-12, directions)  # parallel to a side: they meet far away
    ends = (bounds[:, None] - pose[:3, 3]) / directions
    into, out_of = ends.min(axis=0).max(axis=-1), ends.max(axis=0).min(axis=-1)
    longest = float((bounds[1] - bounds[0]).max())
    return np.asarray(np.minimum(out_of, far) - np.maximum(into, near) > LEAST_LENGTH * longest)
