"""The best method at each budget, with its bootstrap share, and where curves cross: pure functions on tables of scores.

A table is [methods, scenes], in dB, each score the mean over seeds; NaN if a method failed, diverged or cannot be
trained there. Scenes are drawn with replacement (the bootstrap of Efron 1979), the same for all methods and budgets.
With few scenes the shares are overconfident: two scenes have only three different draws.
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

DRAWS = 4000


def resamples(scenes: int) -> Float[np.ndarray, "draws scenes"]:
    """Return how often each scene is drawn, as weights of sum 1; the draws are always the same."""
    generator = np.random.default_rng(0)
    return generator.multinomial(scenes, np.full(scenes, 1.0 / scenes), size=DRAWS) / scenes


def drawn_means(
    table: Float[np.ndarray, "*lines scenes"], weights: Float[np.ndarray, "draws scenes"]
) -> Float[np.ndarray, "*lines draws"]:
    """Return the mean over the drawn scenes; −∞ if a drawn scene has no score, so that a failure is never best."""
    missing = np.isnan(table).astype(float) @ weights.T
    means = np.nan_to_num(table) @ weights.T
    return np.where(missing > 0.0, -math.inf, means)


def best_shares(table: Float[np.ndarray, "methods scenes"]) -> Float[np.ndarray, " methods"]:
    """Return the share of draws in which each method has the best mean; equal methods share a draw, and all are 0 if no
    method has a mean.
    """
    means = drawn_means(table, resamples(table.shape[1]))
    best = np.isfinite(means) & (means >= means.max(axis=0) - 1e-12)
    return np.asarray((best / np.maximum(best.sum(axis=0), 1)).mean(axis=1))


def front_shares(
    tables: Sequence[Float[np.ndarray, "methods scenes"]],
) -> Float[np.ndarray, "budgets methods"]:
    """Return the share of draws in which each method at each budget is on the Pareto front of cost and quality: no
    method at that budget or a smaller one has a better mean. `tables` are in order of rising budgets.
    """
    weights = resamples(tables[0].shape[1])
    best, shares = np.full(len(weights), -math.inf), []
    for table in tables:
        means = drawn_means(table, weights)
        best = np.maximum(best, means.max(axis=0))
        shares.append(((means >= best) & np.isfinite(means)).mean(axis=1))
    return np.array(shares)


def crossing(
    budgets: Sequence[float], first: Float[np.ndarray, "budgets scenes"], second: Float[np.ndarray, "budgets scenes"]
) -> tuple[float, tuple[float, float], float] | None:
    """Return the budget beyond which `second` stays ahead of `first`, its 95 % interval, and the share of draws with
    such a budget; None if the means have none. Between budgets the difference is linear in the logarithm of the budget.
    """
    weights = resamples(first.shape[1])
    crossings = [_last_crossing(budgets, line) for line in drawn_means(second - first, weights).T]
    known = np.array([at for at in crossings if at is not None])
    middle = _last_crossing(budgets, (second - first).mean(axis=1))
    if middle is None or not len(known):
        return None
    low, high = np.quantile(known, [0.025, 0.975])
    return middle, (float(low), float(high)), len(known) / len(crossings)


def _last_crossing(budgets: Sequence[float], difference: np.ndarray) -> float | None:
    """Return where the difference becomes positive for good; None if it never or always is, or is not finite."""
    if not np.isfinite(difference).all() or difference[-1] <= 0.0 or (difference > 0.0).all():
        return None
    at = int(np.nonzero(difference <= 0.0)[0][-1])
    share = difference[at] / (difference[at] - difference[at + 1])
    low, high = math.log(budgets[at]), math.log(budgets[at + 1])
    return math.exp(low + share * (high - low))


def rank_correlation(first: Float[np.ndarray, " methods"], second: Float[np.ndarray, " methods"]) -> float:
    """Return Kendall's τ-b of two lists of scores; NaN if all scores of a list are equal."""
    upper = np.triu_indices(len(first), 1)
    signs, others = (np.sign(values[:, None] - values[None])[upper] for values in (first, second))
    scale = math.sqrt(float((signs**2).sum()) * float((others**2).sum()))
    return float((signs * others).sum()) / scale if scale else math.nan
