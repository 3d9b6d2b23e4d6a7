"""Who is best at which budget, how surely, and where lines cross: pure functions on tables of scores.

A table is [methods, scenes], in dB, each score the mean over seeds; NaN where a method has none, because it failed,
diverged or cannot be trained there. Scenes are drawn with replacement (the bootstrap of Efron 1979), the same for all
methods and budgets, as scenes are what a claim is about. With few scenes its shares are too sure: of two scenes there
are but three draws.
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

DRAWS = 4000


def resamples(scenes: int, draws: int = DRAWS) -> Float[np.ndarray, "draws scenes"]:
    """Return how often each scene is drawn, as weights of sum 1; always the same draws."""
    generator = np.random.default_rng(0)
    return generator.multinomial(scenes, np.full(scenes, 1.0 / scenes), size=draws) / scenes


def drawn_means(
    table: Float[np.ndarray, "*lines scenes"], weights: Float[np.ndarray, "draws scenes"]
) -> Float[np.ndarray, "*lines draws"]:
    """Return the mean over the drawn scenes; −∞ where a drawn scene has no score: nobody is best by failing."""
    missing = np.isnan(table).astype(float) @ weights.T
    means = np.nan_to_num(table) @ weights.T
    return np.where(missing > 0.0, -math.inf, means)


def best_shares(table: Float[np.ndarray, "methods scenes"]) -> Float[np.ndarray, " methods"]:
    """Return the share of draws in which each method has the best mean; all 0 if none has one."""
    means = drawn_means(table, resamples(table.shape[1]))
    first = np.argmax(means, axis=0)[np.isfinite(means.max(axis=0))]
    shares: np.ndarray = np.bincount(first, minlength=len(table)) / means.shape[1]
    return shares


def front_shares(
    tables: Sequence[Float[np.ndarray, "methods scenes"]],
) -> Float[np.ndarray, "budgets methods"]:
    """Return the share of draws in which each method at each budget is on the Pareto front of cost and quality: nothing
    of that cost or less has a better mean. `tables` are those of rising budgets.
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
    """Return the budget from which `second` is ahead of `first` for good, its 95 % interval, and the share of draws
    with such a point; None if the means have none.

    Between budgets the difference is linear in the logarithm of the budget.
    """
    weights = resamples(first.shape[1])
    found = [_last_crossing(budgets, line) for line in drawn_means(second - first, weights).T]
    known = np.array([at for at in found if at is not None])
    middle = _last_crossing(budgets, (second - first).mean(axis=1))
    if middle is None or not len(known):
        return None
    low, high = np.quantile(known, [0.025, 0.975])
    return middle, (float(low), float(high)), len(known) / len(found)


def _last_crossing(budgets: Sequence[float], difference: np.ndarray) -> float | None:
    """Return where the difference turns positive and stays so; None if it never does, always is, or is not finite."""
    if not np.isfinite(difference).all() or difference[-1] <= 0.0 or (difference > 0.0).all():
        return None
    at = int(np.nonzero(difference <= 0.0)[0][-1])
    share = difference[at] / (difference[at] - difference[at + 1])
    low, high = math.log(budgets[at]), math.log(budgets[at + 1])
    return math.exp(low + share * (high - low))


def rank_correlation(first: Float[np.ndarray, " methods"], second: Float[np.ndarray, " methods"]) -> float:
    """Return Kendall's τ-b of two lists of scores; NaN if one of them is all ties."""
    one, other = (np.sign(values[:, None] - values[None]) for values in (first, second))
    upper = np.triu_indices(len(first), 1)
    one, other = one[upper], other[upper]
    scale = math.sqrt(float((one**2).sum()) * float((other**2).sum()))
    return float((one * other).sum()) / scale if scale else math.nan
