"""Means of nested tables and their errors, for many tables at once: pure functions on arrays [..., scenes, seeds].

A seed without a value is NaN. Each estimate is a mean, its standard error and the degrees of freedom of the error; an
error is NaN if the spread is unknown. The variance of each scene is estimated from its own seeds only, and the degrees
of freedom say how well the error is known (Satterthwaite 1946; Welch 1947).
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Estimated:
    """Estimates as arrays of one shape."""

    mean: np.ndarray
    error: np.ndarray
    freedom: np.ndarray
    spread: np.ndarray
    """The standard deviation behind `error`: that of seeds within a scene, or of the scenes' means."""


def on_these_scenes(values: np.ndarray) -> Estimated:
    """Estimate the mean over scenes of the means over seeds, [...]; the error comes from seeds only.

    The variance is the sum of the scenes' variances, with Satterthwaite's degrees of freedom, (Σ vᵢ)² / Σ (vᵢ² / fᵢ);
    for one scene this is Student's t on its seeds. A scene without a value is not part of the mean. If a scene has only
    one value, its spread is unknown, and the error is NaN.
    """
    means, variances, counts = _by_scene(values)
    there, freedom = counts > 0, np.maximum(counts - 1.0, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        scenes = there.sum(axis=-1)
        parts = np.where(there, variances / counts, 0.0) / scenes[..., None] ** 2
        total, all_freedom = parts.sum(axis=-1), freedom.sum(axis=-1)
        squares = np.where(freedom > 0, parts**2 / freedom, 0.0).sum(axis=-1)
        of_error = np.where(squares > 0, total**2 / squares, all_freedom)
        repeated = there.any(axis=-1) & (there <= (freedom > 0)).all(axis=-1)
        spread = np.sqrt((variances * freedom).sum(axis=-1) / all_freedom)
        error = np.where(repeated, np.sqrt(total), np.nan)
        return _estimated(np.nansum(means, axis=-1) / scenes, error, of_error, spread)


def scenes_like_these(values: np.ndarray) -> Estimated:
    """Estimate the same mean for scenes like these: each scene's mean is one value."""
    means, _, counts = _by_scene(values)
    many = (counts > 0).sum(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.nansum(means, axis=-1) / many
        squares = np.nansum((means - mean[..., None]) ** 2, axis=-1)
        spread = np.where(many > 1, np.sqrt(squares / (many - 1)), np.nan)
        return _estimated(mean, spread / np.sqrt(many), many - 1.0, spread)


def less(after: Estimated, before: Estimated) -> Estimated:
    """Return the difference of two independent estimates: variances add up, with Satterthwaite's freedom."""
    parts = [each.error**2 for each in (after, before)]
    total = parts[0] + parts[1]
    with np.errstate(invalid="ignore", divide="ignore"):
        squares = sum(part**2 / each.freedom for part, each in zip(parts, (after, before), strict=True))
        freedom = np.where(squares > 0, total**2 / squares, after.freedom + before.freedom)
    spread = np.sqrt(after.spread**2 + before.spread**2)
    return _estimated(after.mean - before.mean, np.sqrt(total), freedom, spread)


def medians(values: np.ndarray, axis: int = -1) -> np.ndarray:
    """Return the medians of the finite values along an axis, NaN without one."""
    there = np.isfinite(values)
    counts = there.sum(axis=axis, keepdims=True)
    ordered = np.sort(np.where(there, values, np.inf), axis=axis)
    middle = (np.maximum(counts - 1, 0) // 2, counts // 2)
    low, high = (np.take_along_axis(ordered, place, axis=axis) for place in middle)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(counts > 0, (low + high) / 2, np.nan).squeeze(axis))


def _estimated(*parts: object) -> Estimated:
    """Return arrays, since sums over all axes are scalars."""
    return Estimated(*(np.asarray(part) for part in parts))


def _by_scene(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return means (NaN of none), variances (0 of a single value) and counts [..., scenes]."""
    there = np.isfinite(values)
    counts = there.sum(axis=-1).astype(np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        means = np.where(there, values, 0.0).sum(axis=-1) / counts
        squares = np.where(there, values - means[..., None], 0.0) ** 2
        variances = np.where(counts > 1, squares.sum(axis=-1) / (counts - 1.0), 0.0)
    return means, variances, counts
