"""What serving a trained method was measured to do: `OUT/serving.json`, beside the records of the run.

The view cache (§8.1) and attention-prioritised rendering (§8.2). This module imports the standard library and
`harness.records` alone, as reports read it.
"""

import json
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

from harness.records import DamagedRecord, write_json

SERVING_SCHEMA = 1
SERVING_FILE = "serving.json"

Pair = tuple[float, float]
Source = Literal["render", "level 0", "level 1", "level 2"]
"""Where a picture came from."""
Order = Literal["attention", "raster", "spread"]
"""In which a picture was refined: by Eq. 7's priorities, region after region from the top left, or pixels of all
regions at once in a fixed random order."""


@dataclass(frozen=True)
class Latency:
    """How long one picture takes, from asking to having it; key and checksum are in it."""

    scene: str
    method: str
    source: Source
    seconds: float
    """Median."""
    spread: Pair
    """From the 5th to the 95th percentile of the calls."""
    calls: int
    ratio: float | None = None
    """Rendering takes as many times as long; None for rendering itself."""
    ratio_spread: Pair | None = None
    """Quartile of rendering against the opposite quartile of this, both ways."""


@dataclass(frozen=True)
class PathUse:
    """A camera path that was looked at through a cache."""

    scene: str
    method: str
    path: str
    """In words: `an orbit of 40 views, three times`."""
    views: int
    """Asked for."""
    hits: dict[str, int]
    """Source → number of views."""
    memory_bytes: int
    """Bound of level 0 and 1 together."""
    disk_bytes: int
    """Bound of level 2."""
    seconds: float
    seconds_without: float
    """With every view rendered."""

    @property
    def hit_rate(self) -> float:
        return 1.0 - self.hits.get("render", 0) / self.views if self.views else 0.0


@dataclass(frozen=True)
class Confusion:
    """What a key of the pose alone (Listing 5) would have returned, and what ours did."""

    changed: str
    """What was different at the same pose, in words: `more training`."""
    views: int
    stale: int
    """Views for which the key of the pose alone was in the cache already, with another picture behind it."""
    rmse: float
    """Between what it would have returned and what was asked for, display colour, over these views."""
    missed: int
    """Of the views, for which our key was new, as it has to be."""


@dataclass(frozen=True)
class CacheRecord:
    width: int
    height: int
    latencies: list[Latency]
    paths: list[PathUse]
    confusions: list[Confusion]
    memory_bytes_per_view: int
    disk_bytes_per_view: int
    target_memory: float = 1000.0
    """Times faster than rendering that a hit in memory should be."""
    target_disk: float = 50.0


@dataclass(frozen=True)
class Anytime:
    """Error of a picture while it is being refined: after the coarse frame, and then after each region or as many
    pixels. Means over the views.
    """

    scene: str
    method: str
    attention: str
    """Which map of attention: point, mask, gradients, error or foveal."""
    order: Order
    views: int
    seconds: list[float]
    """Since the view was asked for, with the coarse frame in it, and the map where the order needs one."""
    share: list[float]
    """Of the rays at full resolution that are done."""
    rmse_attended: list[float]
    """Of display colour against the finished plain picture, in the quarter of the regions that is attended most."""
    rmse_whole: list[float]


@dataclass(frozen=True)
class Allocation:
    """A picture with so many samples: the same number for each ray, or more where attention is."""

    scene: str
    method: str
    attention: str
    by_attention: bool
    views: int
    bins: float
    """Samples a ray, mean over the picture; the same total with and without attention."""
    evaluations: float
    """Of the network, a view; empty space costs none, so that equal totals of samples may differ in them."""
    seconds: float
    """A view; by attention with the coarse frame and the map in it, which sharing out equally needs none of."""
    rmse_attended: float
    """Of display colour against the same field integrated with `reference_bins`."""
    rmse_whole: float
    truth_attended: float | None
    """Of display colour against the ground truth; None where its views are not there any more."""
    truth_whole: float | None


@dataclass(frozen=True)
class Reaching:
    """When the attended error has fallen to a share of the coarse frame's."""

    scene: str
    method: str
    attention: str
    order: Order
    share_of_error: float
    seconds: float | None
    """None where it never got there."""
    share_of_time: float | None
    """Of the whole picture's seconds in this order."""


@dataclass(frozen=True)
class NotByRegions:
    """A method whose picture depends on which rays share a call: it is rendered plainly, whatever is attended."""

    method: str
    scene: str
    reason: str
    rmse: float
    """Display colour, of region after region against the plain picture: what rendering by regions would change."""


@dataclass(frozen=True)
class PhiCheck:
    """What the factor φ of Eq. 7 changes."""

    sum_of_priorities: float
    """φ, where shares would sum to 1."""
    maps: int
    """Attention maps looked at."""
    orders_changed: int
    """Of these, in how many the order of regions is another one without φ."""
    allocations_changed: int


@dataclass(frozen=True)
class ExampleFrame:
    """A picture for the report."""

    scene: str
    method: str
    attention: str
    title: str
    """In a few words: `by attention, after 25 % of the time`."""
    image: str
    """PNG, relative to `OUT/records`."""
    psnr: float | None = None
    """Against the finished plain picture; None where that is not what is shown, or it is the same."""


@dataclass(frozen=True)
class AttentionRecord:
    width: int
    height: int
    tile: int
    """Side of a region in pixels."""
    reference_bins: int
    curves: list[Anytime]
    reaching: list[Reaching]
    allocations: list[Allocation]
    not_by_regions: list[NotByRegions]
    phi: PhiCheck
    frames: list[ExampleFrame] = field(default_factory=list)


@dataclass(frozen=True)
class FirstFrame:
    """How soon the viewer shows something: methods side by side, nothing in the cache."""

    scene: str
    methods: list[str]
    width: int
    height: int
    seconds_coarse: float
    """Until the coarse frame of every method is there; the slowest of the calls."""
    seconds_whole: float
    """Until every method is refined; the slowest of the calls."""
    calls: int
    target: float = 0.5


@dataclass(frozen=True)
class ServingRecord:
    provenance: dict[str, Any]
    settings: dict[str, Any]
    """`scenes`, `methods`, `seed`, `width`, `threads`, `quick`."""
    cache: CacheRecord | None
    """None where no method of the run can be rendered here; `left_out` says why."""
    attention: AttentionRecord | None
    first_frame: FirstFrame | None = None
    left_out: list[str] = field(default_factory=list)
    """What was not measured and why, one sentence each."""
    seconds: float = 0.0
    schema: int = SERVING_SCHEMA


def write_serving(out: Path, record: ServingRecord) -> None:
    """Raises `ValueError` where a figure is not finite."""
    write_json(out / SERVING_FILE, asdict(record))


def read_serving(path: Path) -> ServingRecord:
    """Raises `DamagedRecord` where the file is not what this version writes."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        if data.get("schema") != SERVING_SCHEMA or set(data) != {one.name for one in fields(ServingRecord)}:
            raise ValueError(f"not a serving record of schema {SERVING_SCHEMA}")
        made = {
            "cache": data["cache"] and _cache(data["cache"]),
            "attention": data["attention"] and _attention(data["attention"]),
            "first_frame": data["first_frame"] and FirstFrame(**data["first_frame"]),
        }
        return ServingRecord(**{**data, **made})
    except (OSError, ValueError, TypeError, KeyError, AttributeError, IndexError) as error:
        raise DamagedRecord(f"{path}: {error}; run `python -m harness serving` again") from error


def _cache(row: dict[str, Any]) -> CacheRecord:
    latencies = [
        Latency(**{**one, "spread": _pair(one["spread"]), "ratio_spread": _pair(one["ratio_spread"])})
        for one in row["latencies"]
    ]
    paths, confusions = [PathUse(**one) for one in row["paths"]], [Confusion(**one) for one in row["confusions"]]
    return CacheRecord(**{**row, "latencies": latencies, "paths": paths, "confusions": confusions})


def _attention(row: dict[str, Any]) -> AttentionRecord:
    lists = {
        "curves": Anytime,
        "reaching": Reaching,
        "allocations": Allocation,
        "not_by_regions": NotByRegions,
        "frames": ExampleFrame,
    }
    made = {name: [kind(**one) for one in row[name]] for name, kind in lists.items()}
    return AttentionRecord(**{**row, **made, "phi": PhiCheck(**row["phi"])})


def _pair(value: list[float] | None) -> Pair | None:
    return None if value is None else (value[0], value[1])
