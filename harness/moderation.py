"""Variances of few values each, over many scenes at once: pure functions on arrays [..., scenes].

Three seeds know their own variance badly. What the variances of a study's scenes say together (Smyth 2004, Linear
models and empirical Bayes methods): each is drawn from a scaled inverse χ² about a common one, whose location and
whose degrees of freedom are estimated from all of them.
"""

import numpy as np
from scipy.special import digamma, polygamma

SMALLEST_SHARE = 1e-5
"""A variance counts as no less than this share of the median, so that scores that agree by chance to all digits do not
pull the prior to 0."""


def error_of_mean(variances: np.ndarray, freedom: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Standard error of a sum whose variance is Σ weights · variances [..., scenes], and its degrees of freedom.

    `freedom` [scenes] are those of the variances, at least 1. Nothing is assumed of how alike the variances are: the
    degrees of freedom are Satterthwaite's, with squares of estimated variances corrected for their own uncertainty,
    and no more than all the scenes have together.
    """
    parts = weights * variances
    total = parts.sum(axis=-1)
    spread = (parts**2 / (freedom + 2.0)).sum(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        found = np.where(spread > 0, total**2 / spread, np.inf)
    return np.asarray(np.sqrt(total)), np.asarray(np.minimum(found, freedom.sum()))


def moderated(variances: np.ndarray, freedom: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each variance [..., scenes] as its own values and the other scenes' together say, and its degrees of freedom.

    `freedom` [scenes] are those of the variances; 0 where a scene has a single value and only the others speak for it.
    With fewer than two scenes that have a variance there is nothing to learn from.
    """
    known = freedom > 0
    if known.sum() < 2:
        return variances, np.broadcast_to(freedom, variances.shape)
    location, prior = _prior(variances[..., known], freedom[known])
    location, prior = location[..., None], prior[..., None]
    own = np.where(known, variances, 0.0)
    with np.errstate(invalid="ignore"):
        mixed = (prior * location + freedom * own) / (prior + freedom)
    return np.where(np.isinf(prior), location, mixed), np.minimum(prior + freedom, freedom.sum())


def _prior(variances: np.ndarray, freedom: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The common variance and its degrees of freedom [...]; infinite where the variances differ no more than chance
    alone makes them."""
    least = SMALLEST_SHARE * np.median(variances, axis=-1, keepdims=True)
    raised = np.maximum(variances, np.maximum(least, np.finfo(np.float64).tiny))
    logs = np.log(raised) - digamma(freedom / 2) + np.log(freedom / 2)
    excess = np.asarray(logs.var(axis=-1, ddof=1) - polygamma(1, freedom / 2).mean())
    prior = np.full(excess.shape, np.inf)
    differ = excess > 0
    prior[differ] = 2.0 * _inverse_trigamma(excess[differ])
    pooled = (variances * freedom).sum(axis=-1) / freedom.sum()
    half = np.where(differ, prior, 2.0) / 2
    return np.where(differ, np.exp(logs.mean(axis=-1) + digamma(half) - np.log(half)), pooled), prior


def _inverse_trigamma(values: np.ndarray) -> np.ndarray:
    """By Newton's method from above on 1/trigamma, which is convex: Smyth 2004, appendix."""
    found = 0.5 + 1.0 / values
    for _ in range(50):
        trigamma = polygamma(1, found)
        found = found + trigamma * (1.0 - trigamma / values) / polygamma(2, found)
    return found
