"""Means of nested tables and their errors, of many tables at once: pure functions on arrays [..., scenes, seeds].

NaN stands where a seed has no value. Each estimate is a mean, its standard error and the degrees of freedom of that;
an error is NaN where nothing is known of the spread. Three seeds estimate their variance badly: the variances of
a study's scenes are combined as in Smyth 2004 (Linear models and empirical Bayes methods): each is drawn from a scaled
inverse χ² about a common one, whose location and whose degrees of freedom are estimated from all of them.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import digamma, polygamma

SMALLEST_SHARE = 1e-5
"""What a variance counts as at least, of the median: scores that agree by chance do not pull the prior to 0."""


@dataclass(frozen=True)
class Estimated:
    """Estimates as arrays of one shape."""

    mean: np.ndarray
    error: np.ndarray
    freedom: np.ndarray
    spread: np.ndarray
    """The standard deviation of what `error` was made from: of seeds within a scene, or of the scenes' means."""


def on_these_scenes(values: np.ndarray) -> Estimated:
    """Estimate the mean over scenes of the means over seeds, [...]; error from seeds alone.

    Nothing is assumed of how alike the scenes' variances are: the degrees of freedom are Satterthwaite's, with squares
    of estimated variances corrected for their own uncertainty, and no more than all scenes have together. A scene with
    one value borrows the pooled variance of the others; one without any is no part of the mean.
    """
    means, variances, counts = _by_scene(values)
    freedom = np.maximum(counts - 1.0, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        shares = np.where(counts > 0, 1.0 / counts, 0.0)
        all_freedom = freedom.sum(axis=-1)
        borrowed = np.where(counts == 1, 1.0, 0.0).sum(axis=-1) / all_freedom
        scenes = (counts > 0).sum(axis=-1)
        parts = variances * np.where(freedom > 0, shares + borrowed[..., None] * freedom, 0.0) / scenes[..., None] ** 2
        total, squares = parts.sum(axis=-1), (parts**2 / (freedom + 2.0)).sum(axis=-1)
        of_error = np.where(squares > 0, np.minimum(total**2 / squares, all_freedom), all_freedom)
        spread = np.sqrt((variances * freedom).sum(axis=-1) / all_freedom)
        error = np.where(all_freedom > 0, np.sqrt(total), np.nan)
        return _estimated(np.nansum(means, axis=-1) / scenes, error, of_error, spread)


def on_each_scene(values: np.ndarray) -> Estimated:
    """Estimate the mean over seeds of every scene [..., scenes], its variance moderated by those of the others."""
    means, variances, counts = _by_scene(values)
    posterior, freedom = moderated(variances, np.maximum(counts - 1.0, 0.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        error = np.where(freedom > 0, np.sqrt(posterior / counts), np.nan)
    return _estimated(means, error, freedom, np.sqrt(posterior))


def scenes_like_these(values: np.ndarray) -> Estimated:
    """Estimate as `on_these_scenes`, but for scenes that were not tried: each scene's mean is one value."""
    means, _, counts = _by_scene(values)
    many = (counts > 0).sum(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.nansum(means, axis=-1) / many
        squares = np.nansum((means - mean[..., None]) ** 2, axis=-1)
        spread = np.where(many > 1, np.sqrt(squares / (many - 1)), np.nan)
        return _estimated(mean, spread / np.sqrt(many), many - 1.0, spread)


def _estimated(*parts: Any) -> Estimated:
    """Return arrays, since sums over all axes are scalars."""
    return Estimated(*map(np.asarray, parts))


def moderated(variances: np.ndarray, freedom: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return each variance [..., scenes] moderated by the other scenes' ones, and its degrees of freedom.

    `freedom` [..., scenes] is 0 where a scene has no variance of its own. With fewer than two scenes that have a
    variance there is nothing to learn from.
    """
    location, prior = (part[..., None] for part in _prior(variances, freedom))
    with np.errstate(invalid="ignore", divide="ignore"):
        mixed = (prior * location + freedom * variances) / (prior + freedom)
    posterior = np.where(np.isinf(prior), location, np.where(prior > 0, mixed, variances))
    return posterior, np.minimum(prior + freedom, freedom.sum(axis=-1, keepdims=True))


def _prior(variances: np.ndarray, freedom: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the common variance and its degrees of freedom [...]: infinite where the variances differ no more than
    chance alone makes them, 0 where there are not two of them.
    """
    known = freedom > 0
    count = known.sum(axis=-1)
    half = np.where(known, freedom, 2.0) / 2
    with np.errstate(invalid="ignore", divide="ignore"):
        least = SMALLEST_SHARE * np.asarray(_median(variances, known))[..., None]
        raised = np.maximum(variances, np.maximum(least, np.finfo(np.float64).tiny))
        logs = np.where(known, np.log(raised) - digamma(half) + np.log(half), 0.0)
        mean = logs.sum(axis=-1) / count
        squares = np.where(known, (logs - mean[..., None]) ** 2, 0.0).sum(axis=-1)
        excess = squares / (count - 1) - np.where(known, polygamma(1, half), 0.0).sum(axis=-1) / count
        differ = (excess > 0) & (count > 1)
        prior = 2.0 * _inverse_trigamma(np.asarray(np.where(differ, excess, 1.0)))
        fitted = np.exp(mean + digamma(prior / 2) - np.log(prior / 2))
        pooled = (variances * freedom).sum(axis=-1) / freedom.sum(axis=-1)
    prior = np.where(differ, prior, np.where(count > 1, np.inf, 0.0))
    return np.where(differ, fitted, np.where(count > 1, pooled, 0.0)), prior


def _median(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    ordered = np.sort(np.where(known, values, np.inf), axis=-1)
    middle = np.maximum(known.sum(axis=-1, keepdims=True) - 1, 0) // 2
    medians = np.take_along_axis(ordered, middle, axis=-1)[..., 0]
    return np.asarray(np.where(np.isfinite(medians), medians, 0.0))


def _inverse_trigamma(values: np.ndarray) -> np.ndarray:
    """Invert by Newton's method on 1/trigamma, which is convex: Smyth 2004, appendix."""
    inverse = np.asarray(0.5 + 1.0 / values)
    for _ in range(50):
        trigamma = polygamma(1, inverse)
        step = trigamma * (1.0 - trigamma / values) / polygamma(2, inverse)
        inverse = np.asarray(inverse + step)
        if not (np.abs(step) > 1e-9 * inverse).any():
            break
    return inverse


def _by_scene(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return means (NaN of none), variances (0 of a single value) and counts [..., scenes]."""
    there = np.isfinite(values)
    counts = there.sum(axis=-1).astype(np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        means = np.where(there, values, 0.0).sum(axis=-1) / counts
        squares = np.where(there, values - means[..., None], 0.0) ** 2
        variances = np.where(counts > 1, squares.sum(axis=-1) / (counts - 1.0), 0.0)
    return means, variances, counts
