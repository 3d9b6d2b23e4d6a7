"""What a cell of a table or a point of a drawing stands for: which runs a reader finds behind it."""

from dataclasses import dataclass, fields
from typing import Any

from harness.records.cells import Comparison
from harness.records.targets import TargetComparison

TARGET = "target"
"""In place of a score: how soon the run's target was reached."""


@dataclass(frozen=True)
class Selection:
    """Runs of the report; what is left empty is not restricted, as the scene of a mean over all of them."""

    scene: str = ""
    method: str = ""
    against: str = ""
    """The rival, where the figure is a difference `method` − `against`."""
    metric: str = ""
    """A score's name, or `TARGET`."""
    budget: str = ""
    """`steps` or `seconds`, of a difference or of the way to the target."""
    seed: int | None = None
    step: int | None = None

    def data(self) -> dict[str, Any]:
        """What is restricted, for JSON."""
        given = {one.name: getattr(self, one.name) for one in fields(self)}
        return {name: value for name, value in given.items() if value not in ("", None)}


def behind_difference(one: Comparison) -> Selection:
    """The pairs of runs that a difference is taken over."""
    return Selection("" if one.scene == "all" else one.scene, one.method, one.against, one.metric, one.budget)


def behind_saving(one: TargetComparison) -> Selection:
    """The pairs of runs that a saving is taken over."""
    return Selection("" if one.scene == "all" else one.scene, one.method, one.against, TARGET, one.axis)
