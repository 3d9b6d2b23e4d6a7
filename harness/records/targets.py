"""How soon each run of a benchmark reached a PSNR: `OUT/records/targets.json`, as `harness.verdicts.survival` computes
it.

This module imports the standard library and `harness.records.cells` alone, as reports read it.
"""

from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

from harness.records.cells import Estimate, estimate_of, records_folder
from harness.records.json_record import DamagedRecord, load_record, sound, write_record

TARGETS_SCHEMA = 1
TARGETS_FILE = "targets.json"

Axis = Literal["steps", "seconds"]
"""Training steps done, or training seconds of the run's own clock."""
Verdict = Literal["better", "worse", "equivalent", "inconclusive"]


@dataclass(frozen=True)
class Reach:
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


@dataclass(frozen=True)
class ReachCurve:
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


@dataclass(frozen=True)
class TargetComparison:
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
    at_least: float | None = None
    """Per cent that `method` saves of the time to the target itself, or more, with 97.5 % confidence. None where a time
    of the two that was not seen whole may have made it less."""
    at_most: float | None = None
    on_these_scenes: Estimate | None = None
    """In per cent, with error from seeds alone."""
    scenes_like_these: Estimate | None = None
    """None for a single scene."""


@dataclass(frozen=True)
class TargetsRecord:
    """The target, when everybody reached it, and who was sooner."""

    target: float | None
    """dB of mean test PSNR; None where no run of the baseline finished."""
    printed: bool
    """Whether it is the paper's."""
    baseline: str
    """The method from whose runs alone the target was chosen."""
    declared: str
    """How it was chosen, in a sentence."""
    reaches: list[Reach] = field(default_factory=list)
    curves: list[ReachCurve] = field(default_factory=list)
    comparisons: list[TargetComparison] = field(default_factory=list)
    schema: int = TARGETS_SCHEMA

    def comparison(self, scene: str, method: str, against: str, axis: str) -> TargetComparison | None:
        wanted = (scene, method, against, axis)
        found = (one for one in self.comparisons if (one.scene, one.method, one.against, one.axis) == wanted)
        return next(found, None)


def write_targets(out: Path, record: TargetsRecord) -> None:
    """Raises `ValueError` where a figure is not finite."""
    write_record(records_folder(out) / TARGETS_FILE, asdict(record))


def read_targets(out: Path) -> TargetsRecord | None:
    """None for a run recorded before there was one. Raises `DamagedRecord` for what this version does not write."""
    path = records_folder(out) / TARGETS_FILE
    if not path.exists():
        return None
    try:
        data = load_record(path)
        if data.get("schema") != TARGETS_SCHEMA or set(data) != {one.name for one in fields(TargetsRecord)}:
            raise ValueError(f"not a record of schema {TARGETS_SCHEMA}")
        lists = {
            "reaches": [Reach(**one) for one in data["reaches"]],
            "curves": [ReachCurve(**one) for one in data["curves"]],
            "comparisons": [TargetComparison(**_with_pairs(one)) for one in data["comparisons"]],
        }
        return sound(TargetsRecord(**{**data, **lists}), TargetsRecord)
    except (OSError, RecursionError, ValueError, TypeError, KeyError, AttributeError, IndexError) as error:
        raise DamagedRecord(f"{path}: {error}; delete it and run again with --resume") from error


def _with_pairs(row: dict[str, Any]) -> dict[str, Any]:
    names = ("interval", "simultaneous", "difference_interval", "never", "earlier")
    pairs = {name: None if row[name] is None else (row[name][0], row[name][1]) for name in names}
    return {**row, **pairs, **{name: estimate_of(row[name]) for name in ("on_these_scenes", "scenes_like_these")}}
