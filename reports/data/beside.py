"""The measurements that may lie beside a run's records in its folder and stand in its report."""

from dataclasses import dataclass

from harness.records.study import Studies


@dataclass(frozen=True)
class Beside:
    """The measurements beside a run; None for those that were not made."""

    stability: Studies | None = None
    evidence: Studies | None = None
    serving: Studies | None = None


ALONE = Beside()
