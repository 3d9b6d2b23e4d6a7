"""A made-up record of serving with every kind of finding: targets met, missed and open, stale pictures, an order by
attention that is first in most cases and not in all, a study that was cut short, a picture.

python -m tests.reports.fake_serving OUT    writes OUT/serving.json and its picture beside a run
"""

import sys
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np

from harness.records.study import Answer, Check, Finding, Picture, Studies, StudyInfo, StudyRecord, Table, check
from tests.reports.fake_shelf import lines, shelf, write_shelf

SETTINGS: dict[str, Any] = {"scenes": ["chair"], "methods": ["nerf", "qnerf"], "seed": 0, "width": 40, "quick": False}
PICTURE = "records/images/serving/chair.nerf.raster.png"


def hit(place: str, ratio: float, method: str = "nerf", spread: float = 1.1) -> Check:
    """Return a hit that is spread by a factor both ways."""
    target = 50.0 if place.startswith("disk") else 1000.0
    low, high = ratio / spread, ratio * spread
    judged = "pass" if low >= target else "fail" if high < target else "inconclusive"
    return Check(
        f"rendering against a hit of {place}", ratio, low=target, unit="×", why="30.9 µs against 59.4 ms on chair",
        subject=method, owner="machine", status=judged, spread=(low, high), repeats=100, id=f"hit.{place}.{method}",
    )  # fmt: skip


def stale(kinds: int, ours: float = 100.0) -> list[Check]:
    why = "of 9 kinds, off by up to 0.857 (a black background); invisible in 8 bits: near and far"
    status = "fail" if kinds else "pass"
    pose = Check("stale kinds", float(kinds), high=0.0, why=why, owner="paper", status=status, repeats=9, id="key.pose")
    return [pose, check("share of views for which our key is new", ours, 100.0, unit="%", id="key.ours")]


def earlier(measure: str, cases: int, status: Any = "measured") -> Check:
    what, why = f"cases in which attention is earlier, {measure}", "of 6 cases, later in 1"
    return Check(what, float(cases), why=why, owner="paper", status=status, repeats=6, id=f"earlier.{measure}")


def phi(changed: int) -> Check:
    why = "of 18 maps; the priorities sum to 1.618, not to 1: they are no probabilities"
    return Check("maps that φ changes", float(changed), why=why, owner="paper", repeats=18, id="phi.changed")


def fake_findings() -> dict[str, list[Finding]]:
    """Return study → its findings."""
    ratios = {"memory.0": 3000.0, "memory.1": 1050.0, "disk.warm": 70.0, "disk.cold": 30.0}
    axes, at = ("seconds since the view was asked for", "RMSE, display"), [0.0, 0.1, 0.2, 0.4]
    return {
        "latency": [
            Answer("Rendering takes 3000 times as long as a hit in memory."),
            *(hit(place, ratio) for place, ratio in ratios.items()),
            hit("memory.0", 2000.0, "qnerf"),
            Table("latencies", 0, "How long a view takes", ["method", "a view", "median s"], [["nerf", "hit", 3e-5]]),
        ],
        "confusions": [
            Answer("A key of the pose alone would return another picture after 8 of 9 kinds of change."),
            *stale(8),
            Table("confusions", 0, "What a key has to tell apart", ["changed", "off by"], [["more <b>steps", 0.1]]),
        ],
        "anytime": [
            Answer("Attention is first in 1 of 6 cases of scene and map."),
            *(Check(f"until a tenth is left, {order}", 63.3, unit="ms", owner="machine", spread=(48.0, 80.0), repeats=6,
                    id=f"whole.{order}") for order in ("attention", "raster", "spread", "plain")),
            *(earlier(measure, 4) for measure in ("whole", "hardest")),
            earlier("attended", 6, "pass"),
            Check("raster order against attention", 1.5, unit="×", owner="machine", spread=(1.2, 1.9), repeats=6,
                  id="sooner.attended"),
            *lines("chair, the whole picture, point", 0, axes, at, lambda x, slow: 0.0001 + 0.1 * slow * (x < 0.4),
                   {"attention": (1.0,), "plain rendering": (3.0,)}, log="y"),
            Picture(0, "raster order, after 40 % of the time", "24.1 dB against the finished picture", PICTURE),
        ],
        "priorities": [Answer("The priorities sum to 1.618, not to 1."), phi(0)],
    }  # fmt: skip


def fake_serving(settings: dict[str, Any] | None = None, **changes: list[Finding] | None) -> Studies:
    """Return the record with other findings of some studies, or without them; with other settings beside its own."""
    findings = {name: listed for name, listed in {**fake_findings(), **changes}.items() if listed is not None}
    studies = [
        StudyRecord(StudyInfo(name, name.capitalize(), f"Does {name} hold?", "Timed in turn."), "", listed, 12.0)
        for name, listed in findings.items()
    ]
    return shelf("serving", studies, {**SETTINGS, **(settings or {})}, {})


def write_fake_serving(out: Path, record: Studies | None = None) -> Path:
    (out / PICTURE).parent.mkdir(parents=True, exist_ok=True)
    matplotlib.image.imsave(out / PICTURE, np.linspace(0.0, 1.0, 40 * 40 * 3).reshape(40, 40, 3))
    return write_shelf(out, record or fake_serving())


if __name__ == "__main__":
    write_fake_serving(Path(sys.argv[1]))
