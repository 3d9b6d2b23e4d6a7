"""How soon each run of a benchmark reached a PSNR: `OUT/records/targets.json`, as `harness.verdicts.survival` computes
it.

This module imports modules of records alone, as reports read it.
"""

from pathlib import Path
from typing import Literal

from harness.records.cells import Estimate, records_folder
from harness.records.json_record import Record, read_record, write_record

TARGETS_SCHEMA = 1
TARGETS_FILE = "targets.json"

Axis = Literal["steps", "seconds"]
"""Training steps done, or training seconds of the run's own clock."""
Verdict = Literal["better", "worse", "equivalent", "inconclusive"]


class Reach(Record, frozen=True):
    """When one run first reached the target, as far as that is known. Every run has one for each axis."""

    scene: str
    method: str
    seed: int
    axis: Axis
    time: float
    """Of the first reaching. `never`: how long the run was watched. `earlier`: its first checkpoint."""
    known: Literal["reached", "never", "earlier"]
    """never     not reached until the run's end, or the run diverged or failed: censored, the true time is longer
    earlier   reached by the first checkpoint already: the true time is `time` or less"""
    why: str = ""
    """Of `never`: ended below the target, diverged, or failed."""


class ReachCurve(Record, frozen=True):
    """Kaplan–Meier: the share of a method's runs that have reached the target by a time. A step function."""

    method: str
    scene: str
    """A scene's name, or `all`."""
    axis: Axis
    time: list[float]
    """Rising; the share holds from here to the next one. Before the first it is 0; the last is where the curve ends."""
    share: list[float]
    """0 … 1, equally long."""
    at_risk: list[int]
    """Runs that were watched and below the target just before each time, equally long."""


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
    """The common end of watching: the shortest that a finished run of the two methods was watched on the scene. Of
    `all` the shortest of the scenes', which each keep their own."""
    saving: float | None
    """Per cent of `against`'s restricted time, from the mean of the logarithms of the ratios; below 0 where `method`
    needs more. None where no pair tells anything."""
    interval: tuple[float, float] | None
    """95 %, of this comparison alone, in per cent; None where times agree so that it would have no width. As all that
    has the name of a part of `Estimate`: of scenes like these where several were tried."""
    simultaneous: tuple[float, float] | None
    """The one that the verdict is taken from: as many are looked at together as `family` says."""
    family: int
    verdict: Verdict
    """better: sooner."""
    smallest_detectable: float | None
    """The true saving in per cent that such a sample would find in 80 % of repetitions."""
    difference: float | None
    """Of the mean restricted times, `method` − `against`, in steps or seconds."""
    difference_interval: tuple[float, float] | None
    """95 %, of this comparison alone."""
    pairs: int
    never: tuple[int, int]
    """Runs among the pairs that had not reached it by the horizon: of `method`, of `against`."""
    earlier: tuple[int, int]
    """Runs among the pairs that had reached it by their first checkpoint: of `method`, of `against`."""
    unpaired: int
    """Pairs of which a run does not exist, or failed for reasons that are not its method's."""
    at_least: float | None
    """Per cent that `method` saves of the time to the target itself, or more, with 97.5 % confidence. None where a time
    of the two that was not seen whole may have made it less."""
    at_most: float | None
    on_these_scenes: Estimate | None
    """In per cent, with error from seeds alone."""
    scenes_like_these: Estimate | None
    """None for a single scene."""


class TargetsRecord(Record, frozen=True):
    """The target, when everybody reached it, and who was sooner."""

    target: float | None
    """dB of mean test PSNR; None where no run of the baseline finished."""
    printed: bool
    """Whether it is the paper's."""
    baseline: str
    """The method from whose runs alone the target was chosen."""
    declared: str
    """How it was chosen, in a sentence."""
    reaches: list[Reach]
    curves: list[ReachCurve]
    comparisons: list[TargetComparison]
    schema: int = TARGETS_SCHEMA

    def comparison(self, scene: str, method: str, against: str, axis: str) -> TargetComparison | None:
        wanted = (scene, method, against, axis)
        found = (one for one in self.comparisons if (one.scene, one.method, one.against, one.axis) == wanted)
        return next(found, None)


def write_targets(out: Path, record: TargetsRecord) -> None:
    """Raises `ValueError` where a figure is not finite."""
    write_record(records_folder(out) / TARGETS_FILE, record)


def read_targets(out: Path) -> TargetsRecord | None:
    """None for a run recorded before there was one. Raises `DamagedRecord` for what this version does not write."""
    path = records_folder(out) / TARGETS_FILE
    return read_record(path, TargetsRecord, TARGETS_SCHEMA) if path.exists() else None
