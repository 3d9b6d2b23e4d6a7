"""Fake records of studies: for each shelf a small record with every kind of finding.

python -m tests.reports.fake_studies OUT    writes the record of every shelf
"""

import math
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from harness.records.study import (
    SHELVES,
    Answer,
    Check,
    Effect,
    Finding,
    Series,
    Studies,
    StudyInfo,
    StudyRecord,
    Table,
    check,
    write_studies,
)
from harness.records.verdict import OPEN, verdict_of
from harness.studies.frontier.error_against_time import ERROR
from harness.studies.frontier.frontier_studies import STUDIES
from harness.studies.speed.questions import QUESTIONS
from reports.studies.publishing import without

PROVENANCE: dict[str, Any] = {"commit": "0123456789ab", "python": "3.11.2", "cores": 2, "packages": {"torch": "2.15.0"}}
INTEREST = {"psnr": 0.2, "ssim": 0.005}
SETTINGS: dict[str, dict[str, Any]] = {
    "evidence": {"quick": False, "device": "cpu", "smallest_of_interest": INTEREST},
    "stability": {"methods": ["nerf", "qnerf"], "quick": False},
    "speed": {"quick": False, "repeats": 5, "rays": 1024},
    "serving": {"scenes": ["chair"], "methods": ["nerf", "qnerf"], "seed": 0, "width": 40, "quick": False},
    "frontier": {"amount": {"scenes": ["chair", "ship"], "seeds": [0]}, "device": "cpu"},
}
MACHINE = {"processor": "AMD EPYC 9R14", "threads": 2, "device": "cpu", "bfloat16_products": True}


def fake_studies(shelf: str, failing: bool = False, charts: bool = True, **changes: Any) -> Studies:
    """Return the record of a shelf; with `failing` one of our own checks fails. Charts take most of a page's time."""
    made: dict[str, Callable[[], list[StudyRecord]]] = {
        "evidence": lambda: _evidence(failing),
        "stability": lambda: _stability(failing),
        "speed": _speed,
        "serving": serving_studies,
        "frontier": _frontier,
    }
    provenance = PROVENANCE | MACHINE if shelf == "speed" else PROVENANCE
    record = Studies(shelf, provenance, SETTINGS[shelf], made[shelf](), finished=True)
    return replace(record if charts else without(record, Series), **changes)


def write_fake_studies(out: Path, record: Studies | str) -> Path:
    """Write the record, or that of a shelf; return `out`."""
    record = fake_studies(record) if isinstance(record, str) else record
    out.mkdir(parents=True, exist_ok=True)
    write_studies(out / SHELVES[record.shelf], record)
    return out


def study(name: str, title: str, *findings: Finding, question: str = "", method: str = "", bar: str = "",
          scale: str = "", seconds: float = 12.3) -> StudyRecord:  # fmt: skip
    facts = {"input": f"what is put into {name}", "danger": f"the danger of {name}", "bar": bar} if bar else {}
    return StudyRecord(StudyInfo(name, title, question, method, facts), scale, list(findings), seconds)


def effect(name: str, against: str, difference: float | None, half: float = 0.1, /, **changes: Any) -> Effect:
    """Return a difference over all scenes: its interval is ± `half`, and the simultaneous interval three times that."""
    near, wide = (
        None if difference is None else (round(difference - k * half, 4), round(difference + k * half, 4))
        for k in (1, 3)
    )
    verdict = OPEN if wide is None else verdict_of(wide, INTEREST[changes.get("metric", "psnr")])
    usual = Effect(name, against, "all", "psnr", "steps", difference, near, wide, 8, verdict, 0.4, 9, 0)
    return replace(usual, **changes)


def lines(
    panel: str, item: int, axes: tuple[str, str], x: list[float], y_of: Callable[..., float],
    names: dict[str, tuple[float, ...]], log: str = "xy", band: float = 0.0,
) -> list[Series]:  # fmt: skip
    """Return a line per name: `y_of` of x and the numbers of that name; `band` is the relative half width of a band."""
    made = [
        Series(panel, item, name, *axes, x, [y_of(at, *more) for at in x], log_x="x" in log, log_y="y" in log)
        for name, more in names.items()
    ]
    if not band:
        return made
    edges = [([(1 - band) * y for y in line.y], [(1 + band) * y for y in line.y]) for line in made]
    return [replace(line, low=low, high=high) for line, (low, high) in zip(made, edges, strict=True)]


def _evidence(failing: bool) -> list[StudyRecord]:
    checks = [
        check("share of simulated A/A comparisons that are called better or worse", 0.024, high=0.05, why="of 4000"),
        check("share of real A/A comparisons that are called better or worse", 0.081 if failing else 0.031, high=0.05,
              why="15 pairs of seeds on 8 scenes"),
        check("share of planted effects that are found", 0.846, low=0.8, why="each the smallest detectable"),
    ]  # fmt: skip
    power = lines("Power: how often a planted effect is found", 0, ("planted / detectable", "share found"),
                  [0.0, 0.5, 1.0, 1.5], lambda size, slope: min(1.0, slope * size), {"8 scenes": (0.7,)},
                  log="", band=0.05)  # fmt: skip
    spread = Table("spread", 0, "Spread between seeds", ["scene", "SD (dB)", "range (dB)"], [["mic", None, 0.52]])
    parts = {"φ encoding": 0.92, "amplifier": -2.61, "φ skip": -0.04, "φ encoding × amplifier": -0.31}
    effects = [
        effect(name, "", size + 0.02 * place, 0.1 + 0.04 * abs(size), scene=scene, budget=budget, note="Listing 2")
        for budget in ("steps", "seconds")
        for place, scene in enumerate(("all", "lego", "ficus"))
        for name, size in parts.items()
    ]
    effects += [effect(name, "", 0.01 * size, 0.003, metric="ssim") for name, size in parts.items()]
    effects.append(effect("qnerf", "nerf", -1.9, 3.4, unpaired=2, verdict=OPEN))
    effects.append(effect("qnerf", "nerf", None, scene="lego", budget="seconds", pairs=0, unpaired=3))
    rivals = {"nerf_phi_encoding": (0.9,), "nerf_matched": (0.93,)}
    gains = lines("Difference from nerf over resolution", 0, ("pixels across", "difference (dB)"), [100.0, 200.0],
                  lambda size, gain: gain * 100 / size, rivals, log="x")  # fmt: skip
    scale, how = "lego, ficus; 3 seeds; 500 steps", "In real training runs."
    return [
        study("calibration", "Is the comparer calibrated?", Answer("It sees a difference in 2.4 % of 4000 cases."),
              Answer("Test PSNR spreads by 0.21 dB on hotdog."), *checks, *power, spread,
              question="How often does it see a difference where there is none?", method=how, scale=scale),
        study("factorial", "What does each part do?", Answer("The φ encoding brings +0.92 dB."), *effects,
              question="What do the parts contribute?", method=how, scale=scale),
        study("bandwidth", "The golden ratio, or bandwidth?", Answer("2^k with the same reach brings +0.93 dB."),
              *gains, *(effect(name, "nerf", gain, 0.15, note="100 px") for name, (gain,) in rivals.items()),
              question="Is it φ, or how far its frequencies reach?", method=how, scale=scale),
    ]  # fmt: skip


def judged(what: str, values: dict[str, float], high: float | None = None, **more: Any) -> list[Check]:
    """Return a check per subject against one limit; a name `owner:subject` gives an owner other than `ours`."""
    rows = [(owner or "ours", name, value) for key, value in values.items() for owner, _, name in [key.rpartition(":")]]
    return [check(what, value, high=high, subject=name, owner=owner, **more) for owner, name, value in rows]


def _stability(failing: bool) -> list[StudyRecord]:
    q1 = judged("largest relative error", {"midpoint": 2.1e-7, "linear_in_tau": 1.8e-7, "paper:listing4": 1.0,
                                           "usual:log_space": 1.0}, 1e-6)  # fmt: skip
    q1 += [*judged("the same over 10^6 bins", {"midpoint": 1.3e-7}, 1e-6),
           Check("half precision is refused", None, subject="harness", status="pass")]  # fmt: skip
    taus = [10.0**power for power in range(-8, 3)]
    midpoint, listing4, log_space = lines(
        "Rounding in float32", 1, ("τ of the ray", "relative error of colour"), taus,
        lambda tau, floor, loses: min(1.0, floor / tau) if loses and tau < 1 else floor,
        {"midpoint": (1e-7, False), "listing4": (3e-8, True), "log_space": (6e-8, True)},
    )  # fmt: skip
    zeros = replace(midpoint, y=[*midpoint.y[:-3], 0.0, 0.0, 0.0])
    gaps = replace(log_space, y=[math.nan, math.inf, *log_space.y[2:]])
    q2 = judged("distance from the declared order", {"midpoint": 0.02, "paper:listing4": 0.03}, 0.15)
    q2.append(Check("", None, why="no last bin", subject="listing4", owner="paper", status="not_applicable"))
    fitted = Table("orders", 2, "Fitted orders", ["rule", "declared", "ramp"], [["midpoint", 2, math.nan]])
    truncation = lines("ramp, against samples", 2, ("bins", "error of colour"), [8.0, 16.0, 32.0],
                       lambda bins, order: (8 / bins) ** order, {"midpoint": (2,), "left_point": (1,)},
                       band=0.3)  # fmt: skip
    q3 = judged("error of the gradient", {"midpoint": 1.2e-6, "usual:log_space": math.nan}, 5e-6, why="σ = 0 once")
    slopes = lines("Gradient of a ray", 3, ("τ of a bin", "error of the gradient"), taus,
                   lambda tau, slope: max(1e-7, slope * tau), {"midpoint": (0.0,), "torch.expm1": (0.2,)})  # fmt: skip
    a2 = judged("largest change of a pixel", {"nerf": 0.0, "nerf_matched": 0.0, "paper:qnerf": 0.31}, 2e-6)
    a2 += judged("after a reload", {"harness": 3e-4 if failing else 3e-7}, 2e-6)
    s3 = [Check("", None, why="no shared library of LLVM 16 or newer", subject="volpath", status="not_available"),
          *judged("largest |z| of 64 rays", {"midpoint": 1.9}, 4.0)]  # fmt: skip
    ladder = lines("Ladder of frequency", 9, ("frequency", "explained share"), [1.0, 2.0, 4.0],
                   lambda rung, slope: max(0.0, 1 - slope * rung / 10), {"nerf": (0.4,), "qnerf": (0.9,)},
                   log="x")  # fmt: skip
    rungs = Table("ladders", 9, "First rung on which a method breaks", ["ladder", "nerf"], [["frequency", None]])
    l1 = Check("rung on which it breaks", 4.0, subject="nerf", status="pass")
    return [
        study("Q1", "Homogeneous ray", *q1, zeros, listing4, gaps, bar="relative error ≤ 1e-6"),
        study("Q2", "Order of convergence", *q2, *truncation, fitted, bar="fitted order within ±0.15"),
        study("Q3", "Gradients of a ray", *q3, *slopes, bar="≤ 5e-6 of the largest gradient"),
        study("A2", "Chunks", *a2, bar="≤ 2e-6"),
        study("S3", "Fog", *s3, bar="≤ 1e-4; |z| < 4"),
        study("L1", "Ladders", l1, *ladder, rungs, bar="recorded"),
    ]


def _speed() -> list[StudyRecord]:
    figure = partial(check, owner="machine")
    profile: list[list[str | float | None]] = [["products", 210.4, 71.2, "bfloat16"], ["optimiser", 9, None, "Adam"]]
    scores = dict(zip((10.0, 30.0, 100.0, 300.0), (15.0, 18.1, 20.2, 22.0), strict=True))
    findings: dict[int, list[Finding]] = {
        1: [
            figure("Dense step, plain float32", 30_120.0, unit="samples/s", spread=(29_870.0, 30_410.0), repeats=5,
                   id="training.plain.rate"),
            figure("Same step against plain", 7.418, 10.0, unit="×", why="medians", spread=(7.11, 7.63), repeats=5,
                   id="training.dense.ratio"),
        ],
        2: [
            figure("Share in steady state", 66.1, 65.0, unit="%", spread=(63.9, 67.0), repeats=5, id="matrix.share"),
            Table("profile", 2, "Where the time of one step goes", ["part", "ms", "share (%)", "note"], profile),
        ],
        3: [
            figure("chair: sooner by", 19.8, 15.0, unit="×", id="target.chair.ratio"),
            figure("ship: sooner by", None, 15.0, unit="×", why="plain never reached 22 dB", id="target.ship.ratio"),
            *lines("PSNR against training seconds, chair", 3, ("training seconds", "PSNR of test pixels (dB)"),
                   [*scores], lambda x, ahead: scores[x] + ahead, {"plain": (0.0,), "reduced settings": (2.0,)},
                   log="x"),
        ],
        7: [figure("llvm_ad_rgb against scalar_rgb", None, 2.0, unit="×", why="no LLVM 16 or newer", id="truth.llvm")],
        8: [
            figure("Peak at `reduced`", 1.42, high=2.0, unit="GB", id="memory.reduced"),
            figure("Growth with 4 × the images", 0.31, high=0.1, unit="GB", id="memory.images"),
        ],
        11: [
            *lines("Rays a step", 11, ("rays a step", "seconds a step"), [256.0, 512.0], lambda rays: rays / 1e4,
                   {"this code": ()}, band=0.1),
            Series("Nothing", 11, "empty", "x", "y", [], []),
        ],
    }  # fmt: skip
    return [StudyRecord(QUESTIONS[str(item)].info, findings=some, seconds=61.2) for item, some in findings.items()]


def hit(place: str, ratio: float, method: str = "nerf", spread: float = 1.1) -> Check:
    """Return a hit with a range of `spread` in both directions."""
    target = 50.0 if place.startswith("disk") else 1000.0
    low, high = ratio / spread, ratio * spread
    status = "pass" if low >= target else "fail" if high < target else "inconclusive"
    return Check(
        f"rendering against a hit of {place}", ratio, low=target, unit="×", why="30.9 µs against 59.4 ms on chair",
        subject=method, owner="machine", status=status, spread=(low, high), repeats=100, id=f"hit.{place}.{method}",
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


def serving_studies(**changes: list[Finding] | None) -> list[StudyRecord]:
    """Return the studies; `changes` replace the findings of a study, or leave it out if None."""
    ratios = {"memory.0": 3000.0, "memory.1": 1050.0, "disk.warm": 70.0, "disk.cold": 30.0}
    findings: dict[str, list[Finding] | None] = {
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
            earlier("whole", 4),
            earlier("attended", 6, "pass"),
            Check("raster order against attention", 1.5, unit="×", owner="machine", spread=(1.2, 1.9), repeats=6,
                  id="sooner.attended"),
        ],
        "priorities": [Answer("The priorities sum to 1.618, not to 1."), phi(0)],
        **changes,
    }  # fmt: skip
    return [
        study(name, name.capitalize(), *some, question=f"Does {name} hold?", method="Timed in turn.")
        for name, some in findings.items()
        if some is not None
    ]


def fake_serving(settings: dict[str, Any] | None = None, **changes: list[Finding] | None) -> Studies:
    """Return the record with changed findings and additional settings."""
    settings = {**SETTINGS["serving"], **(settings or {})}
    return fake_studies("serving", settings=settings, studies=serving_studies(**changes))


def _frontier() -> list[StudyRecord]:
    means = Table("over_scenes", 0, "PSNR over scenes, dB", ["family", "4 core s"], [["nerf", "20.46 ± 1.58"]])
    errors = lines("Error against core seconds of training, all scenes", 0, ("core seconds of training", ERROR),
                   [4.0, 60.0], lambda x, first: first / x, {"nerf": (0.4,), "splats": (0.16,)}, band=0.2)  # fmt: skip
    grown = effect("planes_phi", "planes_same_ends", 0.4, budget="core_seconds")
    return [
        StudyRecord(STUDIES["error_against_time"].info, "8 scenes", [Answer("Splats lead."), *errors, means], 3000.0),
        StudyRecord(STUDIES["phi"].info, "8 scenes", [Answer("φ changes planes by +0.40 dB."), grown], 700.0),
    ]


VOCABULARY = {"owner", "status", "scene", "budget"}
"""Fields of findings that hold known words only."""


def hostile(record: Studies, word: str) -> Studies:
    """Return `record` with `word` in all its texts."""

    def spoiled(value: Any) -> Any:
        match value:
            case str():
                return f"{word} {value}"
            case list():
                return [spoiled(each) for each in value]
            case dict():
                return {key: spoiled(each) for key, each in value.items()}
            case StudyRecord() | StudyInfo() | Answer() | Check() | Effect() | Series() | Table():
                texts = set(value.__struct_fields__) - VOCABULARY
                return replace(value, **{name: spoiled(getattr(value, name)) for name in texts})
        return value

    provenance = {word: word, "processor": word, "device": word}
    return replace(record, studies=spoiled(record.studies), provenance=provenance, settings={word: [word]})


if __name__ == "__main__":
    for name in SETTINGS:
        write_fake_studies(Path(sys.argv[1]), name)
