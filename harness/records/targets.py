"""When each run reached a target PSNR: `OUT/records/targets.json`, computed by `harness.verdicts.survival`."""

from collections.abc import Iterable
from pathlib import Path
from typing import Literal

from msgspec import field

from harness.records.cells import Budget, CellRecord, Estimate, records_folder, require_unchanged
from harness.records.former.four_words import in_two_words
from harness.records.json_record import Record, read_record, write_record
from harness.records.verdict import Verdict

TARGETS_SCHEMA = 1
TARGETS_FILE = "targets.json"

Axis = Budget
"""The axis of time: steps, wall seconds or core seconds of training."""


class Reach(Record, frozen=True):
    """The time at which one run first reached the target, as far as it is known, on one axis."""

    scene: str
    method: str
    seed: int
    axis: Axis
    time: float
    """The time of reaching it; for `never` that of the last checkpoint, for `earlier` that of the first."""
    known: Literal["reached", "never", "earlier"]
    """never     not reached by the end of the run, or the run diverged or failed: censored, the true time is longer
    earlier   already reached at the first checkpoint: the true time is `time` or less"""
    why: str = ""
    """The reason of `never`: ended below the target, diverged, or failed."""


class ReachCurve(Record, frozen=True):
    """The Kaplan–Meier step function: the share of a method's runs that have reached the target by a time."""

    method: str
    scene: str
    """A scene's name, or `all`."""
    axis: Axis
    time: list[float]
    """Rising times: a share holds until the next time. Before the first it is 0; the last ends the curve."""
    share: list[float]
    """The share, 0 … 1, at each time."""
    at_risk: list[int]
    """The number of runs that were observed and below the target just before each time."""


class TargetComparison(Record, frozen=True):
    """How much sooner `method` reaches the target than `against`, paired over scenes and seeds.

    The compared quantity is the restricted time min(T, horizon), since times beyond the horizon were not observed;
    `interval` is that of its saving. The time to the target itself has only bounds, `at_least` and `at_most`.
    """

    scene: str
    """A scene's name, or `all`."""
    method: str
    against: str
    axis: Axis
    horizon: float
    """The shortest time that a finished run of the two was observed on the scene; for `all` the minimum over scenes."""
    saving: float | None
    """The saving in per cent of `against`'s restricted time, from the mean of log ratios; None without a ratio."""
    interval: tuple[float, float] | None
    """The 95 % interval of this comparison only, in per cent; None if equal times would leave it without width. Like
    all fields that `Estimate` has too, it is for scenes like these if several were tried."""
    simultaneous: tuple[float, float] | None
    """The interval that the verdict comes from, for `family` comparisons together."""
    family: int
    verdict: Verdict
    """The verdict on the saving: above 0 means sooner."""
    smallest_detectable: float | None
    """The true saving in per cent that 80 % of such samples would find."""
    difference: float | None
    """The difference of the mean restricted times, `method` − `against`, in steps, seconds or core seconds."""
    difference_interval: tuple[float, float] | None
    """The 95 % interval of this comparison only."""
    pairs: int
    never: tuple[int, int]
    """The paired runs of `method` and of `against` that had not reached it by the horizon."""
    earlier: tuple[int, int]
    """The paired runs of `method` and of `against` that had reached it by their first checkpoint."""
    unpaired: int
    """The pairs with a run that does not exist, or that failed for reasons unrelated to its method."""
    at_least: float | None
    """The minimum saving in per cent, with 97.5 % confidence; None if a censored time may have lowered it."""
    at_most: float | None
    on_these_scenes: Estimate | None
    """The saving in per cent, with an error from seeds only."""
    scenes_like_these: Estimate | None
    """The saving that treats scenes as drawn too; None for a single scene."""


class TargetsRecord(Record, frozen=True):
    """The target, the times at which every run reached it, and their comparisons."""

    target: float | None
    """The target mean test PSNR in dB; None if no run of the baseline finished."""
    printed: bool
    """Whether the target is the paper's."""
    baseline: str
    """The method whose runs determine the target."""
    declared: str
    """A sentence on how it was chosen."""
    reaches: list[Reach]
    curves: list[ReachCurve]
    comparisons: list[TargetComparison]
    schema: int = TARGETS_SCHEMA
    digests: dict[str, str] = field(default_factory=dict)
    """Map file name of each cell that it was computed from → digest of its record; empty in an older run."""

    def comparison(self, scene: str, method: str, against: str, axis: str) -> TargetComparison | None:
        about = (scene, method, against, axis)
        rows = (row for row in self.comparisons if (row.scene, row.method, row.against, row.axis) == about)
        return next(rows, None)


def write_targets(out: Path, record: TargetsRecord) -> None:
    """Write the record; raises `ValueError` if a figure is not finite."""
    write_record(records_folder(out) / TARGETS_FILE, record)


def read_targets(out: Path, cells: Iterable[CellRecord] = ()) -> TargetsRecord | None:
    """Read the record; None for an older run. Raises `DamagedRecord`, also if one of `cells` has changed since."""
    path = records_folder(out) / TARGETS_FILE
    if not path.exists():
        return None
    record = read_record(path, TargetsRecord, TARGETS_SCHEMA, former=in_two_words)
    require_unchanged(path, record.digests, cells)
    return record
