"""What measuring a kind of gate gets to work with, and gives."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from harness.gate.catalog import Gate
from harness.gate.limits_file import LimitsFile
from harness.gate.outcome import Sample
from harness.gate.references import References
from harness.progress import Progress


@dataclass(frozen=True)
class Situation:
    """One run of the gates."""

    out: Path
    limits: LimitsFile
    references: References
    """What the class of processor gave that is measured, or another class."""
    images: Path
    """Folder of the stored mean and variance of the reference renders."""
    view_sets: Path
    workers: int
    show: Progress


Measure = Callable[[Situation, tuple[Gate, ...]], dict[str, Sample]]
"""New measurements for the gates asked for; one that is missing fails."""
