"""Adjusted p-values of comparisons that are judged together: pure functions on lists, None for a missing p-value.

Holm (1979) bounds the probability of any wrong rejection in a declared family; Benjamini and Hochberg (1995) bound the
expected share of wrong rejections among the rejected rows of a long table.
"""

from collections.abc import Sequence

import numpy as np


def holm(values: Sequence[float | None], family: int | None = None) -> list[float | None]:
    """Return p-values adjusted by Holm's step-down procedure; `family`, the declared size, counts missing ones too."""
    known = _known(values)
    order = np.argsort(known, kind="stable")
    many = max(family or 0, known.size)
    stepped = np.maximum.accumulate(known[order] * (many - np.arange(known.size)))
    return _back(values, order, np.minimum(stepped, 1.0))


def benjamini_hochberg(values: Sequence[float | None]) -> list[float | None]:
    """Return the q-value of each row: the false discovery rate at which it would just be among the discoveries."""
    known = _known(values)
    order = np.argsort(known, kind="stable")
    stepped = known[order] * known.size / (1 + np.arange(known.size))
    return _back(values, order, np.minimum(np.minimum.accumulate(stepped[::-1])[::-1], 1.0))


def _known(values: Sequence[float | None]) -> np.ndarray:
    return np.array([value for value in values if value is not None], dtype=np.float64)


def _back(values: Sequence[float | None], order: np.ndarray, sorted_values: np.ndarray) -> list[float | None]:
    known = np.empty(order.size)
    known[order] = sorted_values
    rest = iter(known.tolist())
    return [None if value is None else next(rest) for value in values]
