"""The runs behind a cell of a table or a point of a drawing."""

from dataclasses import dataclass

from harness.records.cells import Comparison
from harness.records.targets import TargetComparison

TARGET = "target"
"""The value in place of a score for the time at which the run's target was reached."""


@dataclass(frozen=True)
class Selection:
    """A selection of the report's runs; an empty field, such as the scene of a mean, does not restrict it."""

    scene: str = ""
    method: str = ""
    against: str = ""
    """The rival, if the figure is a difference `method` − `against`."""
    metric: str = ""
    """The name of a score, or `TARGET`."""
    budget: str = ""
    """The budget, `steps`, `seconds` or `core_seconds`, of a difference or of the time to the target."""
    seed: int | None = None
    step: int | None = None

    def data(self) -> dict[str, object]:
        return {name: value for name, value in vars(self).items() if value not in ("", None)}


def behind_difference(row: Comparison) -> Selection:
    return Selection("" if row.scene == "all" else row.scene, row.method, row.against, row.metric, row.budget)


def behind_saving(row: TargetComparison) -> Selection:
    return Selection("" if row.scene == "all" else row.scene, row.method, row.against, TARGET, row.axis)
