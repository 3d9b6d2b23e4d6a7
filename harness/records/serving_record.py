"""What serving a trained method was measured to do: `OUT/serving.json`, beside the records of the run.

The view cache (§8.1) and attention-prioritised rendering (§8.2). This module imports the standard library and
`harness.records.cells` alone, as reports read it.
"""

from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

from harness.records.json_record import DamagedRecord, load_record, sound, write_record

SERVING_SCHEMA = 2
SERVING_FILE = "serving.json"

Pair = tuple[float, float]
Source = Literal["render", "level 0", "level 1", "level 2"]
"""Where a picture came from."""
Timed = Source | Literal["level 0 hashed", "level 2 cold"]
"""What is timed. Weights are frozen, so that they are hashed once, and a file is in the operating system's memory, but
for `hashed`, where weights are hashed at every call, and `cold`, where the system has dropped the file's data."""
Order = Literal["attention", "raster", "spread", "plain"]
"""In which a picture was refined after its coarse frame: by Eq. 7's priorities, region after region from the top left,
or pixels of all regions at once in a fixed random order. `plain` has no coarse frame and calls as large as any."""
Measure = Literal["whole", "hardest", "attended"]
"""Where a picture's error is taken: everywhere, in the quarter of the regions in which the coarse frame is most wrong,
or in that which is attended most, of which an order by the same attention is first by construction."""
Way = Literal["even", "samples", "evaluations"]
"""How samples are shared out: the same number for each ray, or by attention, as many samples in all as those or as many
network evaluations in all, with what it cost to find out."""


@dataclass(frozen=True)
class Latency:
    """How long one picture takes, from asking to having it; key and checksum are in it."""

    scene: str
    method: str
    source: Timed
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
    other_hit_rates: list[float] = field(default_factory=list)
    """Of paths like it with other seeds: counted with the same cache, without a clock."""

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
    """Error of a picture while it is being refined: after the coarse frame (a white one at once where there is none),
    and then after each region or as many pixels. Means over the views.
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
    total_spread: Pair
    """Of the last of `seconds`: the least and the most of the repeats."""
    rmse_whole: list[float]
    """Of display colour against the finished plain picture."""
    rmse_hardest: list[float]
    rmse_attended: list[float]

    def rmse(self, measure: Measure) -> list[float]:
        return {"whole": self.rmse_whole, "hardest": self.rmse_hardest, "attended": self.rmse_attended}[measure]


@dataclass(frozen=True)
class Allocation:
    """A picture with its samples shared out in one way."""

    scene: str
    method: str
    attention: str
    way: Way
    against: int
    """Samples a ray of the even picture that this is compared with."""
    views: int
    bins: float
    """Samples a ray, mean over the picture."""
    evaluations: float
    """Of the network, a view, with `own`; empty space costs none, so that as many samples may differ in them."""
    own: float
    """Of these, spent on finding out where samples belong."""
    seconds: float
    """A view, with finding out."""
    seconds_spread: Pair
    """The least and the most of the repeats."""
    rmse_attended: float
    """Of display colour against the same field integrated with `reference_bins`."""
    rmse_whole: float
    truth_attended: float | None
    """Of display colour against the ground truth; None where its views are not there any more."""
    truth_whole: float | None


@dataclass(frozen=True)
class Reaching:
    """When an error has fallen to a share of the coarse frame's, and stays so."""

    scene: str
    method: str
    attention: str
    order: Order
    measure: Measure
    share_of_error: float
    error: float
    """So large it may still be."""
    seconds: float | None
    """None where it never got there."""
    spread: Pair | None
    """The least and the most of the repeats."""


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
    """How soon the viewer has something to show: methods side by side, loaded, nothing in the cache; computed where the
    viewer runs, without the way to a browser.
    """

    scene: str
    methods: list[str]
    width: int
    height: int
    seconds_coarse: float
    """Until the coarse frame of every method is there; the slowest of the calls."""
    seconds_whole: float
    """Until every method is refined; the slowest of the calls."""
    calls: int
    strides: list[int]
    """Of the coarse frames, in the order of `methods`: the largest of the calls, as the viewer goes by its pace."""
    psnr_coarse: list[float | None]
    """dB of the coarse frames against the whole pictures: the worst of the calls; None where they are the same."""
    target: float = 0.5


@dataclass(frozen=True)
class ServingRecord:
    provenance: dict[str, Any]
    settings: dict[str, Any]
    """`scenes`, `methods`, `seed`, `width`, `threads`, `quick`, `complete`, `code`, …"""
    cache: CacheRecord | None
    """None where no method of the run can be rendered here; `left_out` says why."""
    attention: AttentionRecord | None
    first_frame: FirstFrame | None = None
    left_out: list[str] = field(default_factory=list)
    """What was not measured and why, one sentence each."""
    failed: list[str] = field(default_factory=list)
    """Titles of the studies that ended in an error, which is a sentence in `left_out`: nothing of them is here."""
    seconds: float = 0.0
    files: dict[str, str] = field(default_factory=dict)
    """Pictures of the attention's frames, relative to `OUT/records` → SHA-256; empty in earlier versions."""
    schema: int = SERVING_SCHEMA


def write_serving(out: Path, record: ServingRecord) -> None:
    """Raises `ValueError` where a figure is not finite."""
    write_record(out / SERVING_FILE, asdict(record))


def read_serving(path: Path) -> ServingRecord:
    """Raises `DamagedRecord` where the file is not what this version writes."""
    try:
        data = load_record(path)
        data.setdefault("files", {})
        if data.get("schema") != SERVING_SCHEMA or set(data) != {one.name for one in fields(ServingRecord)}:
            raise ValueError(f"not a serving record of schema {SERVING_SCHEMA}, as this version writes it")
        made = {
            "cache": data["cache"] and _cache(data["cache"]),
            "attention": data["attention"] and _attention(data["attention"]),
            "first_frame": data["first_frame"] and FirstFrame(**data["first_frame"]),
        }
        return sound(ServingRecord(**{**data, **made}), ServingRecord)
    except (OSError, RecursionError, ValueError, TypeError, KeyError, AttributeError, IndexError) as error:
        raise DamagedRecord(f"{path}: {error}; run `python -m harness study serving {path.parent}` again") from error


def _cache(row: dict[str, Any]) -> CacheRecord:
    latencies = [
        Latency(**{**one, "spread": _pair(one["spread"]), "ratio_spread": _pair(one["ratio_spread"])})
        for one in row["latencies"]
    ]
    paths, confusions = [PathUse(**one) for one in row["paths"]], [Confusion(**one) for one in row["confusions"]]
    return CacheRecord(**{**row, "latencies": latencies, "paths": paths, "confusions": confusions})


def _attention(row: dict[str, Any]) -> AttentionRecord:
    made = {
        "curves": [Anytime(**{**one, "total_spread": _pair(one["total_spread"])}) for one in row["curves"]],
        "reaching": [Reaching(**{**one, "spread": _pair(one["spread"])}) for one in row["reaching"]],
        "allocations": [
            Allocation(**{**one, "seconds_spread": _pair(one["seconds_spread"])}) for one in row["allocations"]
        ],
        "not_by_regions": [NotByRegions(**one) for one in row["not_by_regions"]],
        "frames": [ExampleFrame(**one) for one in row["frames"]],
    }
    return AttentionRecord(**{**row, **made, "phi": PhiCheck(**row["phi"])})


def _pair(value: list[float] | None) -> Pair | None:
    return None if value is None else (value[0], value[1])
