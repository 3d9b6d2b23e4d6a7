"""What measuring a kind of gate gets to work with, and gives."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from harness.gate.catalog import Gate
from harness.gate.limits_file import LimitsFile
from harness.gate.outcome import Sample
from harness.progress import Progress


@dataclass(frozen=True)
class Situation:
    """One run of the gates."""

    out: Path
    limits: LimitsFile
    images: Path
    """Folder of the stored mean and variance of the reference renders."""
    view_sets: Path
    workers: int
    show: Progress


Measure = Callable[[Situation, tuple[Gate, ...]], dict[str, Sample]]
"""New measurements for the gates asked for; one that is missing fails."""
Renewal = dict[str, list[float]]
Renew = Callable[[Situation, tuple[Gate, ...]], Renewal]
"""What limits are made of, for the gates asked for."""
