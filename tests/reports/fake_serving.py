"""A made-up serving record with every kind of finding: targets met, missed and open, stale pictures, an order by
attention that is first in most cases and not in all, a method that is not rendered by regions, pictures.

python -m tests.reports.fake_serving OUT    writes OUT/serving.json and its pictures beside a run
"""

import math
import sys
from pathlib import Path
from typing import Any, get_args

import matplotlib.image
import numpy as np

from harness.records.cells import records_folder
from harness.records.serving_record import (
    Allocation,
    Anytime,
    AttentionRecord,
    CacheRecord,
    Confusion,
    ExampleFrame,
    FirstFrame,
    Latency,
    Measure,
    NotByRegions,
    Order,
    PathUse,
    PhiCheck,
    Reaching,
    ServingRecord,
    Way,
    write_serving,
)

PROVENANCE: dict[str, Any] = {"commit": "0123456789ab", "python": "3.11.2", "cores": 2, "packages": {"torch": "2.15.0"}}
SCENES = ("chair", "drums", "lego")
MAPS = ("point", "gradients")
REGIONS = 25
ORDERS: tuple[Order, ...] = get_args(Order)
PHI = (1 + math.sqrt(5)) / 2


def fake_serving(**changes: Any) -> ServingRecord:
    parts: dict[str, Any] = {
        "provenance": PROVENANCE,
        "settings": {"scenes": list(SCENES), "methods": ["nerf", "qnerf"], "seed": 0, "width": 40, "threads": 2,
                     "quick": False},
        "cache": fake_cache(),
        "attention": fake_attention(),
        "first_frame": FirstFrame("chair", ["nerf", "qnerf"], 40, 40, 0.31, 0.92, 5, [2, 3], [24.1, None]),
        "left_out": ["camera paths were followed with nerf alone: hits are any method's"],
        "seconds": 203.0,
    }  # fmt: skip
    return ServingRecord(**{**parts, **changes})


def latency(method: str, source: Any, seconds: float, rendering: float | None = None, spread: float = 1.3) -> Latency:
    """Spread by a factor both ways."""
    ratio = None if rendering is None else rendering / seconds
    around = None if ratio is None else (ratio / spread, ratio * spread)
    return Latency("chair", method, source, seconds, (seconds / spread, seconds * spread), 100, ratio, around)


def fake_cache(**changes: Any) -> CacheRecord:
    """Memory meets its target, the disk misses it with nerf and is open with qnerf."""
    latencies = [
        latency("nerf", "render", 0.045),
        latency("nerf", "level 0", 1.4e-5, 0.045),
        latency("nerf", "level 1", 1.6e-5, 0.045),
        latency("nerf", "level 2", 1.5e-3, 0.045),
        latency("nerf", "level 0 hashed", 6e-4, 0.045),
        latency("nerf", "level 2 cold", 2.5e-3, 0.045),
        latency("qnerf", "render", 0.075),
        latency("qnerf", "level 0", 1.4e-5, 0.075),
        latency("qnerf", "level 1", 1.7e-5, 0.075),
        latency("qnerf", "level 2", 1.4e-3, 0.075),
        latency("qnerf", "level 0 hashed", 6e-4, 0.075),
        latency("qnerf", "level 2 cold", 2.5e-3, 0.075),
    ]
    paths = [
        PathUse("chair", "nerf", "an orbit of 20 views, three times", 60,
                {"render": 20, "level 0": 20, "level 1": 20, "level 2": 0}, 1 << 30, 0, 0.93, 2.8),
        PathUse("chair", "nerf", "a walk of 40 steps", 40, {"render": 22, "level 0": 3, "level 1": 6, "level 2": 9},
                960_000, 1 << 30, 1.02, 1.8, [0.15, 0.6]),
    ]  # fmt: skip
    confusions = [
        Confusion("10 more steps of training", 4, 4, 0.0123, 4),
        Confusion("focal length 1.25 times as long", 4, 4, 0.141, 4),
        Confusion("a pose one unit in the last place away", 4, 0, 0.0, 4),
    ]
    record = CacheRecord(40, 40, latencies, paths, confusions, 32_000, 21_400)
    return CacheRecord(**{**record.__dict__, **changes})


def fake_attention(**changes: Any) -> AttentionRecord:
    curves = [
        fake_curve(scene, kind, order, 1 + 0.3 * place)
        for place, scene in enumerate(SCENES)
        for kind in MAPS
        for order in ORDERS
    ]
    record = AttentionRecord(
        width=40,
        height=40,
        tile=8,
        reference_bins=512,
        curves=curves,
        reaching=reachings(curves),
        allocations=[
            fake_allocation(scene, kind, way, bins)
            for scene in SCENES
            for kind in MAPS
            for way, bins in (("even", 8), ("even", 16), ("even", 32), ("samples", 16), ("evaluations", 16))
        ],
        not_by_regions=[NotByRegions("qnerf", "chair", "its density depends on which points share a call", 0.0131)],
        phi=PhiCheck(PHI, 18, 0, 0),
        frames=[
            ExampleFrame("chair", "nerf", "none", "finished", "images/serving/finished.png"),
            ExampleFrame("chair", "nerf", "none", "coarse frame", "images/serving/coarse.png", 19.2),
            ExampleFrame("chair", "nerf", "point", "by attention, after 40 % of the time", "images/serving/point.png",
                         24.6),
        ],
    )  # fmt: skip
    return AttentionRecord(**{**record.__dict__, **changes})


def fake_curve(scene: str, kind: str, order: Order, slow: float) -> Anytime:
    """By attention the attended error is gone after a quarter; on lego by gradients it begins too late to be first. The
    hardest quarter takes half as long again. Plain rendering begins with white, and is a third faster.
    """
    late = 0.2 if order == "attention" and (scene, kind) == ("lego", "gradients") else 0.0
    begin = 0.0 if order == "plain" else 0.012 * slow + late + (0.002 if order == "attention" else 0.0)
    share = [place / REGIONS for place in range(REGIONS + 1)]
    pace = {"attention": 4.0, "raster": 1.25, "spread": 1.0, "plain": 1.0}[order]
    left = [max(0.0, 1 - pace * done) for done in share]
    hard = [max(0.0, 1 - pace / 1.5 * done) for done in share]
    takes = (0.056 if order == "plain" else 0.08) * slow
    white = 3.0 if order == "plain" else 1.0
    total = begin + takes
    return Anytime(
        scene=scene,
        method="nerf",
        attention=kind,
        order=order,
        views=3,
        seconds=[begin + takes * done for done in share],
        share=share,
        total_spread=(0.99 * total, 1.01 * total),
        rmse_whole=[
            white * 0.07 * math.sqrt(1 - done) * (1.1 if order == "attention" and done > 0 else 1) for done in share
        ],
        rmse_hardest=[white * 0.11 * math.sqrt(one) for one in hard],
        rmse_attended=[white * 0.09 * math.sqrt(one) for one in left],
    )


def reaching(one: Anytime, measure: Measure, error: float, share: float = 0.1, spread: float = 1.001) -> Reaching:
    """First at most a share of the coarse frame's `error`, and from then on."""
    above = [place for place, value in enumerate(one.rmse(measure)) if value > share * error]
    place = above[-1] + 1 if above else 0
    at = one.seconds[place] if place < len(one.seconds) else None
    around = None if at is None else (at / spread, at * spread)
    return Reaching(one.scene, one.method, one.attention, one.order, measure, share, share * error, at, around)


def reachings(curves: list[Anytime], spread: float = 1.001) -> list[Reaching]:
    """Of the coarse frame's error, which is that of the first order."""
    begun = {(one.scene, one.attention): one for one in reversed(curves) if one.order != "plain"}
    return [
        reaching(one, measure, begun[one.scene, one.attention].rmse(measure)[0], spread=spread)
        for one in curves
        for measure in get_args(Measure)
    ]


def fake_allocation(scene: str, kind: str, way: Way, bins: int) -> Allocation:
    """With as many samples at twice the cost the error is 0.6 times as large where it is attended and 0.8 times in the
    whole picture; at the same cost 0.9 and 1.1 times.
    """
    error, evaluations = 0.4 / bins, 800.0 * bins
    attended, whole, cost = {"even": (1.0, 1.0, 1.0), "samples": (0.6, 0.8, 2.0), "evaluations": (0.9, 1.1, 1.0)}[way]
    own = 0.0 if way == "even" else 0.0625 * evaluations
    seconds = 0.002 * bins * cost
    return Allocation(
        scene, "nerf", kind, way, bins, 1, float(bins), evaluations * cost, own, seconds,
        (0.9 * seconds, 1.1 * seconds), error * attended, 0.8 * error * whole, 0.08 + 0.1 * error, 0.07 + 0.1 * error,
    )  # fmt: skip


def write_fake_serving(out: Path, record: ServingRecord | None = None) -> Path:
    """Writes the record and its pictures under `out` and returns `out`."""
    made = record or fake_serving()
    write_serving(out, made)
    noise = np.random.default_rng(0).random((40, 40, 3))
    for frame in made.attention.frames if made.attention else []:
        path = records_folder(out) / frame.image
        path.parent.mkdir(parents=True, exist_ok=True)
        matplotlib.image.imsave(path, noise)
    return out


if __name__ == "__main__":
    write_fake_serving(Path(sys.argv[1]))
