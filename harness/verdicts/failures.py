"""Runs that end without a result: how often a method diverges or shows nothing, and whether another does so less often.

A failure is a result of its method. It is judged here and nowhere else: differences of scores are of the pairs of
which neither failed. A run that ended for other reasons (a full disk, a killed process) is no failure and no run.
"""

from collections import Counter
from dataclasses import dataclass
from typing import Literal

from scipy.special import betaincinv

from harness.records.cells import CellRecord
from harness.records.verdict import Sign
from harness.verdicts.statistics import CONFIDENCE, sign_test

COLLAPSED = "empty collapse"
"""The beginning of the warning of a run that shows little but background."""

FINISHED = ("done", "diverged")
"""The states of a run that says something of its method."""
Failure = Literal["diverged", "empty collapse"]


@dataclass(frozen=True)
class FailureRate:
    method: str
    runs: int
    diverged: int
    collapsed: int
    rate: float
    interval: tuple[float, float]
    """The exact two-sided 95 % interval (Clopper & Pearson), for runs on these scenes with other seeds."""

    @property
    def failed(self) -> int:
        return self.diverged + self.collapsed


@dataclass(frozen=True)
class FailureComparison:
    """How often one method fails and another does not, paired by scene and seed (McNemar, exact)."""

    method: str
    against: str
    pairs: int
    only_method: int
    """The number of pairs of which `method` alone failed."""
    only_against: int
    difference: float
    """The share of the pairs in which `method` failed less that of `against`."""
    p_value: float
    """The two-sided p-value: how often chance alone makes the counts as unequal, if both fail equally often."""
    verdict: Sign
    """The sign of the difference: below 0 if `method` fails less often."""


@dataclass(frozen=True)
class Failures:
    rates: list[FailureRate]
    comparisons: list[FailureComparison]


def failure_of(cell: CellRecord) -> Failure | None:
    """Return how a run failed if its method is the cause; None for all others."""
    if cell.status == "diverged":
        return "diverged"
    collapsed = cell.status == "done" and any(warning.startswith(COLLAPSED) for warning in cell.warnings)
    return "empty collapse" if collapsed else None


def judgeable(cell: CellRecord) -> bool:
    return cell.status == "done" and failure_of(cell) is None


def failures(cells: list[CellRecord], methods: list[str], duels: list[tuple[str, str]]) -> Failures:
    """Return the rates of the methods that have runs, and for each duel with pairs which fails more often."""
    runs = {(cell.method, cell.scene, cell.seed): failure_of(cell) for cell in cells if cell.status in FINISHED}
    rates, compared = [], []
    for method in methods:
        kinds = Counter(failure for (name, _, _), failure in runs.items() if name == method)
        failed = kinds["diverged"] + kinds["empty collapse"]
        if many := kinds.total():
            interval = exact_interval(failed, many)
            rates.append(FailureRate(method, many, kinds["diverged"], kinds["empty collapse"], failed / many, interval))
    for method, against in duels:
        pairs = Counter(
            (failure is not None, runs[against, scene, seed] is not None)
            for (name, scene, seed), failure in runs.items()
            if name == method and (against, scene, seed) in runs
        )
        if pairs:
            compared.append(_comparison(method, against, pairs.total(), pairs[True, False], pairs[False, True]))
    return Failures(rates, compared)


def exact_interval(failed: int, runs: int) -> tuple[float, float]:
    """Return Clopper and Pearson's interval of a share: it holds the truth in 95 % or more, whatever that is."""
    tail = (1.0 - CONFIDENCE) / 2
    low = float(betaincinv(failed, runs - failed + 1, tail)) if failed else 0.0
    high = float(betaincinv(failed + 1, runs - failed, 1.0 - tail)) if failed < runs else 1.0
    return low, high


def _comparison(method: str, against: str, pairs: int, only_method: int, only_against: int) -> FailureComparison:
    difference = (only_method - only_against) / pairs
    p_value = sign_test(only_method, only_against)
    called: Sign = "above 0" if only_method > only_against else "below 0"
    if p_value >= 1.0 - CONFIDENCE:
        called = "open"
    return FailureComparison(method, against, pairs, only_method, only_against, difference, p_value, called)
