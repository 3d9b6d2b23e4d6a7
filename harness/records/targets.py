"""How soon each run of a benchmark reached a PSNR: `OUT/records/targets.json`, as `harness.verdicts.survival` computes
it.

This module imports modules of records alone, as reports read it.
"""

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
"""The axis of time: training steps, or wall or core seconds of training."""


class Reach(Record, frozen=True):
    """The time at which one run first reached the target, as far as it is known; one for each axis."""

    scene: str
    method: str
    seed: int
    axis: Axis
    time: float
    """The time of reaching; for `never` that of the last look, for `earlier` that of the first checkpoint."""
    known: Literal["reached", "never", "earlier"]
    """never     not reached until the run's end, or the run diverged or failed: censored, the true time is longer
    earlier   reached by the first checkpoint already: the true time is `time` or less"""
    why: str = ""
    """The reason of `never`: ended below the target, diverged, or failed."""


class ReachCurve(Record, frozen=True):
    """The Kaplan–Meier step function: the share of a method's runs that have reached the target by a time."""

    method: str
    scene: str
    """A scene's name, or `all`."""
    axis: Axis
    time: list[float]
    """Rising times: a share holds until the next one. Before the first it is 0; the last ends the curve."""
    share: list[float]
    """The shares, 0 … 1, one for each time."""
    at_risk: list[int]
    """The number of runs that were watched and below the target just before each time."""


class TargetComparison(Record, frozen=True):
    """How much sooner `method` reaches the target than `against`, paired over scenes and seeds.

    What is compared is the restricted time min(T, horizon): all that a time can say that was only watched until then.
    `interval` is of its saving. Of the time to the target itself that is one bound or both: `at_least`, `at_most`.
    """

    scene: str
    """A scene's name, or `all`."""
    method: str
    against: str
    axis: Axis
    horizon: float
    """The shortest time that a finished run of the two was watched on the scene; for `all` the shortest of these."""
    saving: float | None
    """The saving in per cent of `against`'s restricted time, from the mean of log ratios; None without any."""
    interval: tuple[float, float] | None
    """95 %, of this comparison alone, in per cent; None where times agree so that it would have no width. As all that
    has the name of a part of `Estimate`: of scenes like these where several were tried."""
    simultaneous: tuple[float, float] | None
    """The interval that the verdict is taken from, for `family` comparisons together."""
    family: int
    verdict: Verdict
    """The verdict on the saving: above 0 means sooner."""
    smallest_detectable: float | None
    """The true saving in per cent that such a sample would find in 80 % of repetitions."""
    difference: float | None
    """The difference of the mean restricted times, `method` − `against`, in steps, seconds or core seconds."""
    difference_interval: tuple[float, float] | None
    """The 95 % interval of this comparison alone."""
    pairs: int
    never: tuple[int, int]
    """The paired runs of `method` and of `against` that had not reached it by the horizon."""
    earlier: tuple[int, int]
    """The paired runs of `method` and of `against` that had reached it by their first checkpoint."""
    unpaired: int
    """The pairs of which a run does not exist, or failed for reasons that are not its method's."""
    at_least: float | None
    """The least per cent that `method` saves, with 97.5 % confidence; None if a censored time may have made it less."""
    at_most: float | None
    on_these_scenes: Estimate | None
    """The saving in per cent, with the error of seeds alone."""
    scenes_like_these: Estimate | None
    """The saving for which scenes are drawn too; None for a single scene."""


class TargetsRecord(Record, frozen=True):
    """The target, the times at which every run reached it, and their comparisons."""

    target: float | None
    """The target in dB of mean test PSNR; None if no run of the baseline finished."""
    printed: bool
    """Whether the target is the paper's."""
    baseline: str
    """The method from whose runs alone the target was chosen."""
    declared: str
    """How it was chosen, in a sentence."""
    reaches: list[Reach]
    curves: list[ReachCurve]
    comparisons: list[TargetComparison]
    schema: int = TARGETS_SCHEMA
    digests: dict[str, str] = field(default_factory=dict)
    """The digest of each cell's record that it was computed from, by the name of its file; empty in an older run."""

    def comparison(self, scene: str, method: str, against: str, axis: str) -> TargetComparison | None:
        for row in self.comparisons:
            if (row.scene, row.method, row.against, row.axis) == (scene, method, against, axis):
                return row
        return None


def write_targets(out: Path, record: TargetsRecord) -> None:
    """Write the record; raises `ValueError` if a figure is not finite."""
    write_record(records_folder(out) / TARGETS_FILE, record)


def read_targets(out: Path, cells: Iterable[CellRecord] = ()) -> TargetsRecord | None:
    """Read the record; None for an older run. Raises `DamagedRecord` for anything that this version does not write, and
    where one of `cells` has changed since.
    """
    path = records_folder(out) / TARGETS_FILE
    if not path.exists():
        return None
    record = read_record(path, TargetsRecord, TARGETS_SCHEMA, former=in_two_words)
    require_unchanged(path, record.digests, cells)
    return record
