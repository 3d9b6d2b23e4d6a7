"""How often a method diverges or ends in an empty picture, and whether another method does so less often.

A failure is a result of its method, and judged only here: differences of scores use the pairs in which neither run
failed. A run that ended for other reasons (a full disk, a killed process) is not counted at all.
"""

from collections import Counter
from dataclasses import dataclass
from typing import Literal

from scipy.special import betaincinv

from harness.records.cells import CellRecord
from harness.records.verdict import Sign
from harness.verdicts.statistics import CONFIDENCE, sign_test

COLLAPSED = "empty collapse"
"""The prefix of the warning of a run that shows little but background."""
FINISHED = ("done", "diverged")
"""The states of a run that is a result of its method."""
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
    """The number of pairs in which only `method` failed."""
    only_against: int
    difference: float
    """The share of the pairs in which `method` failed minus that of `against`."""
    p_value: float
    """The two-sided p-value, the chance of counts at least as unequal if both methods fail equally often, times the
    number of pairs of methods that are compared.
    """
    verdict: Sign
    """The sign of the difference: below 0 if `method` fails less often."""


@dataclass(frozen=True)
class Failures:
    rates: list[FailureRate]
    comparisons: list[FailureComparison]


def failure_of(cell: CellRecord) -> Failure | None:
    """Return how a run failed because of its method; None for all other runs."""
    if cell.status == "diverged":
        return "diverged"
    collapsed = cell.status == "done" and any(warning.startswith(COLLAPSED) for warning in cell.warnings)
    return "empty collapse" if collapsed else None


def state_of(cell: CellRecord) -> str:
    """Return how a run failed because of its method, else its status."""
    return failure_of(cell) or cell.status


def is_lost(cell: CellRecord) -> bool:
    """Return whether a run diverged, ended in empty collapse, or failed for another reason."""
    return cell.status == "error" or failure_of(cell) is not None


def judgeable(cell: CellRecord) -> bool:
    return cell.status == "done" and failure_of(cell) is None


def failures(cells: list[CellRecord], methods: list[str], duels: list[tuple[str, str]]) -> Failures:
    """Return the failure rates of the methods that have runs, and the comparison of each duel that has pairs."""
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
        if many := pairs.total():
            only_method, only_against = pairs[True, False], pairs[False, True]
            p_value = min(1.0, len(duels) * sign_test(only_method, only_against))
            sign: Sign = "above 0" if only_method > only_against else "below 0"
            if p_value >= 1.0 - CONFIDENCE:
                sign = "open"
            difference = (only_method - only_against) / many
            compared.append(
                FailureComparison(method, against, many, only_method, only_against, difference, p_value, sign)
            )
    return Failures(rates, compared)


def exact_interval(failed: int, runs: int) -> tuple[float, float]:
    """Return Clopper and Pearson's interval of a share, which contains any true share in at least 95 % of samples."""
    tail = (1.0 - CONFIDENCE) / 2
    low = float(betaincinv(failed, runs - failed + 1, tail)) if failed else 0.0
    high = float(betaincinv(failed + 1, runs - failed, 1.0 - tail)) if failed < runs else 1.0
    return low, high
