"""A made-up stability run with every kind of finding: ours that passes and one that fails, properties of the paper's
and of the usual forms, what is not applicable or not available, lines with zeros and gaps, tables, pictures.

python -m tests.reports.fake_stability OUT    writes OUT/stability.json and its pictures
"""

import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np

from harness.records.charts import Series, Table
from harness.records.stability_record import (
    PICTURES_FOLDER,
    STABILITY_FILE,
    CaseInfo,
    CaseRecord,
    Outcome,
    Picture,
    StabilityRecord,
    judged,
    write_stability,
)

PROVENANCE: dict[str, Any] = {"commit": "0123456789ab", "python": "3.11.2", "cores": 2, "packages": {"torch": "2.15.0"}}
METHODS = ("nerf", "nerf_matched", "qnerf", "qnerf_theorem", "qnerf_listing4")
RULES = {"midpoint": "ours", "linear_in_tau": "ours", "listing4": "paper", "running_product": "usual",
         "log_space": "usual"}  # fmt: skip


def case(name: str, title: str, bar: str, *outcomes: Outcome, **more: Any) -> CaseRecord:
    info = CaseInfo(
        name, title, f"what is put into {name}", f"the danger of {name}", "40 digits of mpmath, or a closed form", bar
    )
    return CaseRecord(info, list(outcomes), seconds=12.3, **more)


def fake_stability(with_failure: bool = True, with_charts: bool = True, **changes: Any) -> StabilityRecord:
    """With `with_failure` one check of ours fails, as in no good run; charts take most of the time of a page."""
    cases = [*_quadrature(), *_encodings(), *_amplifier(with_failure), *_training(), *_scenes(), *_others()]
    parts: dict[str, Any] = {
        "provenance": PROVENANCE,
        "settings": {"methods": list(METHODS), "quick": False},
        "cases": cases if with_charts else [replace(one, series=[]) for one in cases],
        "finished": True,
    }
    return StabilityRecord(**{**parts, **changes})


def _quadrature() -> list[CaseRecord]:
    worst = {"midpoint": 2.1e-7, "linear_in_tau": 1.8e-7, "listing4": 1.0, "running_product": 2.7e-3, "log_space": 1.0}
    relative = "largest relative error of colour, opacity and transmittance"
    q1 = [judged("Q1", rule, RULES[rule], worst[rule], 1e-6, what=relative) for rule in RULES]
    q1.append(judged("Q1", "midpoint", "ours", 1.3e-7, 1e-6, what="the same over 10^6 bins"))
    q1.append(Outcome("Q1", "harness", "ours", "pass", what="half precision is refused"))
    orders = {"midpoint": 0.02, "linear_in_tau": 0.04, "listing4": 0.03, "left_point": 0.01}
    q2 = [
        judged("Q2", rule, RULES.get(rule, "usual"), off, 0.15, what="distance from the order that it declares")
        for rule, off in orders.items()
    ]
    q3 = [
        judged("Q3", "midpoint", "ours", 1.2e-6, 5e-6, what="error of the gradient, of the largest"),
        judged("Q3", "linear_in_tau", "ours", 2.3e-6, 5e-6, what="error of the gradient, of the largest"),
        judged("Q3", "log_space", "usual", math.nan, 5e-6, what="error of the gradient", why="σ = 0 in one sample"),
        judged("Q3", "torch.expm1", "usual", 16.0, 5e-6, what="error of the gradient", why="exp(x) − 1 + 1 in float32"),
    ]
    q4 = [judged("Q4", "linear_in_tau", "ours", 1.6e-5, 1e-4, what="error of colour", why="τ of a bin up to 1000"),
          Outcome("Q4", "listing4", "paper", "not_applicable", why="its last bin is 1e10 long")]  # fmt: skip
    q6 = [judged("Q6", "midpoint", "ours", 2e-8, 1e-6, what="relative error of opacity"),
          judged("Q6", "listing4", "paper", 2.5e7, 1e-6, what="relative error of opacity",
                 why="opaque, where 4e-8 is")]  # fmt: skip
    q8 = [Outcome("Q8", "harness", "ours", "pass", what="far < near, far = ∞ and unsorted are refused, ray named"),
          judged("Q8", "listing4", "paper", 53.6, 1.0, what="largest |opacity|")]  # fmt: skip
    return [
        case("Q1", "Homogeneous ray", "relative error ≤ 1e-6; half precision refused", *q1, series=_rounding()),
        case("Q2", "Order of convergence", "fitted order within ±0.15", *q2, series=_truncation(), tables=[_orders()]),
        case("Q3", "Gradients of a ray", "≤ 5e-6 of the largest gradient", *q3, series=_gradients()),
        case("Q4", "Stiff rays", "linear in τ ≤ 1e-4", *q4),
        case("Q6", "Almost nothing", "relative error ≤ 1e-6", *q6),
        case("Q8", "Intervals that are none", "refused, with the ray named", *q8),
    ]


def _rounding() -> list[Series]:
    taus = [10.0**power for power in range(-8, 9)]
    lines = {
        "float32": {"midpoint": 1e-7, "linear_in_tau": 5e-8, "listing4": 3e-8, "running_product": 4e-8,
                    "log_space": 6e-8, "left_point": 9e-8, "trapezoid": 7e-8, "telescoped": 2e-8},
        "bfloat16": {"midpoint": 1e-3, "listing4": 4e-3},
        "float64": {"midpoint": 2e-16, "listing4": 2.5e-9},
    }  # fmt: skip
    found = []
    for dtype, rules in lines.items():
        for place, (rule, floor) in enumerate(rules.items()):
            loses = rule not in ("midpoint", "linear_in_tau", "trapezoid")
            errors = [min(1.0, floor / tau) if loses and tau < 1 else floor * (1 + 0.4 * math.sin(place + i))
                      for i, tau in enumerate(taus)]  # fmt: skip
            if rule == "midpoint":
                errors[-3:] = [0.0, 0.0, 0.0]
            if rule == "log_space":
                errors[:2] = [math.nan, math.inf]
            found.append(
                Series(f"Rounding in {dtype}", 1, rule, "τ of the ray", "relative error of colour", taus, errors)
            )
    return found


def _truncation() -> list[Series]:
    bins = [8.0 * 2**k for k in range(10)]
    found = []
    for profile, size in (("ramp, τ = 100", 0.02), ("homogeneous, τ = 1000", 3.0)):
        for rule, order in (("midpoint", 2), ("left_point", 1), ("listing4", 0), ("linear_in_tau", 2.2)):
            errors = [size * (1 + order) * (8 / n) ** order for n in bins]
            low, high = [0.7 * one for one in errors], [1.4 * one for one in errors]
            found.append(Series(f"{profile}, against samples", 2, rule, "bins", "error of colour", bins, errors))
            found.append(
                Series(f"{profile}, against time", 2, rule, "seconds", "error of colour",
                       [2e-6 * n * (1 + order / 5) for n in bins], errors, low, high)
            )  # fmt: skip
    return found


def _orders() -> Table:
    rows: list[list[str | float | None]] = [
        ["midpoint", 2, 1.98, 2.01, 1.99],
        ["left_point", 1, 1.01, 0.99, 1.0],
        ["listing4", 0, 0.0, 0.01, math.nan],
    ]
    return Table("orders", 2, "Fitted orders", ["rule", "declared", "ramp", "exponential", "Gaussian"], rows)


def _gradients() -> list[Series]:
    taus = [10.0**power for power in range(-8, 3)]
    return [
        Series("Gradient of a ray", 3, "midpoint", "τ of a bin", "error of the gradient", taus, [1e-7] * len(taus)),
        Series("Gradient of a ray", 3, "torch.expm1", "τ of a bin", "error of the gradient", taus,
               [1e-7 if tau < 1 else tau / 6 for tau in taus]),
    ]  # fmt: skip


def _encodings() -> list[CaseRecord]:
    e1 = [
        judged("E1", "two", "ours", 9e-5, 1.2e-4, what="error of the top frequency"),
        judged("E1", "phi", "paper", 1e-5, 1.2e-5, what="error of the top frequency"),
    ]
    e3 = [
        judged("E3", "two", "usual", 0.208, 0.03, what="share of the burst seen in the gap"),
        judged("E3", "phi", "paper", 0.235, 0.03, what="share of the burst seen in the gap", why="φ is a Pisot number"),
        judged("E3", "ratio 1.65", "ours", 0.011, 0.03, what="share of the burst seen in the gap"),
    ]
    distances = [0.02 * step for step in range(1, 101)]
    lobes = [
        Series("Kernel of an encoding", 8, name, "distance", "mean of cos(π f d)", distances,
               [sum(math.cos(math.pi * base**k * d) for k in range(10)) / 10 for d in distances],
               log_x=False, log_y=False)
        for name, base in (("two", 2.0), ("phi", 1.618), ("ratio 1.65", 1.65))
    ]  # fmt: skip
    return [
        case("E1", "Top frequency of an encoding", "≤ 1.2e-4 for 2^k, ≤ 1.2e-5 for φ^k", *e1),
        case("E3", "Ghosts and neutral gratings", "control ≤ 0.03", *e3, series=lobes),
    ]


def _amplifier(with_failure: bool) -> list[CaseRecord]:
    differences = dict(zip(METHODS, (0.0, 0.0, 0.31, 2e-7, 0.33), strict=True))
    a2 = [
        judged(
            "A2", method, "paper" if method.startswith("q") else "ours", value, 2e-6, what="largest change of a pixel"
        )
        for method, value in differences.items()
    ]
    a2.append(judged("A2", "harness", "ours", 3e-4 if with_failure else 3e-7, 2e-6, what="after a reload"))
    a4 = [
        judged("A4", method, "paper" if method.startswith("q") else "ours", value, 0.999, sense="at_least",
               what="opacity of one unit of matter")
        for method, value in zip(METHODS, (1.0, 1.0, 0.632, 0.632, 0.95), strict=True)
    ]  # fmt: skip
    scales = [0.1, 0.3, 1.0, 3.0, 10.0]
    reach = [
        Series("Opacity of one unit of matter", 5, name, "scale of the scene", "opacity", scales,
               [cap if cap == 1 else 1 - math.exp(-scale) for scale in scales], log_y=False)
        for name, cap in (("nerf", 1.0), ("qnerf", 0.0))
    ]  # fmt: skip
    steps = [50.0 * 2**k for k in range(6)]
    dead = [
        Series("Dead share of the amplifier", 6, name, "training step", "share of samples", steps,
               [min(0.9, 0.05 * rate * k) for k in range(6)], log_y=False)
        for name, rate in (("qnerf", 1.0), ("qnerf_theorem", 2.4), ("qnerf_listing4", 3.1))
    ]  # fmt: skip
    pictures = [
        Picture(4, "One view, one call", "qnerf, contrasted weights", f"{PICTURES_FOLDER}/whole.png"),
        Picture(4, "The same in calls of 16 rays", "largest change of a pixel 0.31", f"{PICTURES_FOLDER}/chunks.png"),
        Picture(4, "Difference × 4", "black: none", f"{PICTURES_FOLDER}/difference.png"),
        Picture(4, "A picture that is gone", "its file was deleted", f"{PICTURES_FOLDER}/gone.png"),
    ]
    return [
        case("A2", "One view, many calls", "≤ 2e-6", *a2, pictures=pictures),
        case("A4", "A solid slab", "reachable opacity ≥ 0.999", *a4, series=[*reach, *dead]),
    ]


def _training() -> list[CaseRecord]:
    o2 = [
        judged("O2", "clipped, × 1e9", "ours", 41.0, 200.0, unit="steps", what="until within 10 %"),
        judged("O2", "unclipped, × 1e9", "usual", 33424.0, 200.0, unit="steps", what="until half the step size"),
    ]
    steps = [float(step) for step in range(0, 400, 10)]
    spikes = [
        Series("Loss after a spike of 1e9", 11, name, "steps after the spike", "loss", steps,
               [0.02 + height * math.exp(-step / after) for step in steps], log_x=False)
        for name, height, after in (("no spike", 0.0, 1.0), ("clipped", 0.4, 30.0), ("unclipped", 0.4, 1e4))
    ]  # fmt: skip
    layers = [float(layer) for layer in range(1, 9)]
    digits = [
        Series("nerf, trained", 7, f"{dtype}, {part}", "layer", "digits lost", layers,
               [lost * (1 + 0.2 * layer) for layer in layers], log_x=False, log_y=False)
        for dtype, lost in (("bfloat16", 2.0), ("float16", 1.0)) for part in ("mean", "worst")
    ]  # fmt: skip
    return [case("O2", "One spike", "back within 10 % in 200 steps", *o2, series=spikes),
            case("O3", "Digits lost by layer", "recorded", series=digits)]  # fmt: skip


def _scenes() -> list[CaseRecord]:
    s1 = [judged("S1", method, "paper" if method.startswith("q") else "ours", 3e-6, 1e-5, what="MSE of a white scene")
          for method in METHODS]  # fmt: skip
    s3 = [Outcome("S3", "volpath", "ours", "not_available", why="no shared library of LLVM 16 or newer"),
          judged("S3", "midpoint", "ours", 1.9, 4.0, what="largest |z| of 64 rays")]  # fmt: skip
    return [
        case("S1", "Nothing to see", "MSE ≤ 1e-5, opacity outside ≤ 1e-2", *s1),
        case("S3", "Fog", "≤ 1e-4; |z| < 4", *s3),
    ]


def _others() -> list[CaseRecord]:
    rungs = [1.0, 2.0, 4.0, 8.0, 16.0]
    ladders = [
        Series(f"Ladder of {name}", 9, method, name, "explained share", rungs,
               [max(0.0, 1 - slope * rung / 10) for rung in rungs], log_y=False)
        for name in ("frequency", "thinness", "density")
        for method, slope in zip(METHODS, (0.4, 0.5, 0.9, 0.6, 1.1), strict=True)
    ]  # fmt: skip
    table = Table("ladders", 9, "First rung on which a method breaks", ["ladder", *METHODS],
                  [["frequency", 16, 8, 4, None, 4], ["thinness", 16, 16, 8, 8, 4]])  # fmt: skip
    l1 = [Outcome("L1", method, "ours", "pass", 4.0 + place, what="rung on which it breaks, frequency")
          for place, method in enumerate(METHODS)]  # fmt: skip
    c1 = [Outcome("C1", "harness", "ours", "pass", what="NaN, singular, up along the view: refused")]
    r1 = [judged("R1", "volpath", "ours", 2.2, 4.0, what="largest |z|"),
          judged("R1", "Dr.Jit", "ours", 9e-7, 5e-6, what="error of values")]  # fmt: skip
    return [
        case("C1", "Cameras that are none", "refused before rendering", *c1),
        case("R1", "An independent reference", "|z| < 4; values ≤ 5e-6", *r1),
        case("L1", "Ladders", "recorded", *l1, series=ladders, tables=[table]),
    ]


def write_fake_stability(folder: Path, record: StabilityRecord | None = None, pictures: bool = True) -> Path:
    """`folder` with a stability.json in it and the pictures that it names."""
    (folder / PICTURES_FOLDER).mkdir(parents=True, exist_ok=True)
    write_stability(folder / STABILITY_FILE, record or fake_stability())
    y, x = np.mgrid[0:64, 0:64] / 64
    whole = np.stack([x, y, 0.5 + 0.5 * np.sin(20 * x * y)], -1)
    chunked = np.clip(
        whole + 0.3 * ((np.arange(64 * 64).reshape(64, 64, 1) // 16) % 3 == 0) * (y[..., None] > 0.4), 0, 1
    )
    for name, picture in {"whole": whole, "chunks": chunked, "difference": 4 * (chunked - whole)}.items():
        if pictures:
            matplotlib.image.imsave(folder / PICTURES_FOLDER / f"{name}.png", np.clip(picture, 0, 1).astype(np.float32))
    return folder


def hostile(record: StabilityRecord, word: str) -> StabilityRecord:
    """`record` with `word` wherever it holds text of its own."""

    def spoiled(one: CaseRecord) -> CaseRecord:
        name = f"{word} {one.info.id}"
        words = {"case": name, "unit": word, "what": word, "why": word}
        return CaseRecord(
            CaseInfo(*[name, *[word] * 5]),
            [replace(o, subject=f"{word} {o.subject}", **words) for o in one.outcomes],
            [replace(s, panel=word, name=f"{word} {s.name}", x_label=word, y_label=word) for s in one.series],
            [Table(word, t.item, word, [word for _ in t.columns], [[word for _ in t.columns]]) for t in one.tables],
            [replace(p, title=word, caption=word) for p in one.pictures],
        )  # fmt: skip

    return replace(
        record, cases=[spoiled(one) for one in record.cases], provenance={word: word}, settings={word: [word]}
    )


if __name__ == "__main__":
    write_fake_stability(Path(sys.argv[1]))
