"""A made-up stability run with every kind of finding: ours that passes and one that fails, properties of the paper's
and of the usual forms, what is not applicable or not available, lines with zeros and gaps, tables, pictures.

python -m tests.reports.fake_stability OUT    writes OUT/stability.json and its pictures
"""

import math
import sys
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
from msgspec.structs import replace

from harness.records.study import (
    PICTURES_FOLDER,
    SHELVES,
    Check,
    Picture,
    Series,
    Studies,
    StudyInfo,
    StudyRecord,
    Table,
    check,
    write_studies,
)  # fmt: skip
from tests.reports.fake_lines import lines

PROVENANCE: dict[str, Any] = {"commit": "0123456789ab", "python": "3.11.2", "cores": 2, "packages": {"torch": "2.15.0"}}
METHODS = ("nerf", "nerf_matched", "qnerf", "qnerf_theorem", "qnerf_listing4")
RULES = {"midpoint": "ours", "linear_in_tau": "ours", "listing4": "paper", "running_product": "usual",
         "log_space": "usual"}  # fmt: skip


def case(name: str, title: str, bar: str, *outcomes: Check, **more: Any) -> StudyRecord:
    facts = {"input": f"what is put into {name}", "danger": f"the danger of {name}", "bar": bar,
             "reference": "40 digits of mpmath, or a closed form"}  # fmt: skip
    findings = [*outcomes, *(one for kind in more.values() for one in kind)]
    return StudyRecord(StudyInfo(name, title, facts=facts), findings=findings, seconds=12.3)


def fake_stability(with_failure: bool = True, with_charts: bool = True, **changes: Any) -> Studies:
    """With `with_failure` one check of ours fails, as in no good run; charts take most of the time of a page."""
    cases = [*_quadrature(), *_encodings(), *_amplifier(with_failure), *_training(), *_scenes(), *_others()]
    parts: dict[str, Any] = {
        "provenance": PROVENANCE,
        "settings": {"methods": list(METHODS), "quick": False},
        "studies": cases if with_charts else [without_lines(one) for one in cases],
        "finished": True,
    }
    return Studies(**{"shelf": "stability", **parts, **changes})


def without_lines(one: StudyRecord) -> StudyRecord:
    return replace(one, findings=[finding for finding in one.findings if not isinstance(finding, Series)])


def _quadrature() -> list[StudyRecord]:
    worst = {"midpoint": 2.1e-7, "linear_in_tau": 1.8e-7, "listing4": 1.0, "running_product": 2.7e-3, "log_space": 1.0}
    relative = "largest relative error of colour, opacity and transmittance"
    q1 = [check(relative, worst[rule], high=1e-6, subject=rule, owner=RULES[rule]) for rule in RULES]
    q1.append(check("the same over 10^6 bins", 1.3e-7, high=1e-6, subject="midpoint"))
    q1.append(Check("half precision is refused", None, subject="harness", status="pass"))
    orders = {"midpoint": 0.02, "linear_in_tau": 0.04, "listing4": 0.03, "left_point": 0.01}
    q2 = [
        check("distance from the order that it declares", off, high=0.15, subject=rule, owner=RULES.get(rule, "usual"))
        for rule, off in orders.items()
    ]
    q3 = [
        check("error of the gradient, of the largest", 1.2e-6, high=5e-6, subject="midpoint"),
        check("error of the gradient, of the largest", 2.3e-6, high=5e-6, subject="linear_in_tau"),
        check(
            "error of the gradient", math.nan, high=5e-6, why="σ = 0 in one sample", subject="log_space", owner="usual"
        ),
        check(
            "error of the gradient",
            16.0,
            high=5e-6,
            why="exp(x) − 1 + 1 in float32",
            subject="torch.expm1",
            owner="usual",
        ),
    ]
    q4 = [
        check("error of colour", 1.6e-5, high=1e-4, why="τ of a bin up to 1000", subject="linear_in_tau"),
        Check("", None, why="its last bin is 1e10 long", subject="listing4", owner="paper", status="not_applicable"),
    ]
    q6 = [
        check("relative error of opacity", 2e-8, high=1e-6, subject="midpoint"),
        check(
            "relative error of opacity",
            2.5e7,
            high=1e-6,
            why="opaque, where 4e-8 is",
            subject="listing4",
            owner="paper",
        ),
    ]
    q8 = [Check("far < near, far = ∞ and unsorted are refused, ray named", None, subject="harness", status="pass"),
          check("largest |opacity|", 53.6, high=1.0, subject="listing4", owner="paper")]  # fmt: skip
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
    axes = ("τ of a bin", "error of the gradient")
    grows = {"midpoint": (0.0,), "torch.expm1": (1 / 6,)}
    return lines("Gradient of a ray", 3, axes, taus, lambda tau, slope: max(1e-7, slope * tau * (tau >= 1)), grows)


def _encodings() -> list[StudyRecord]:
    e1 = [
        check("error of the top frequency", 9e-5, high=1.2e-4, subject="two"),
        check("error of the top frequency", 1e-5, high=1.2e-5, subject="phi", owner="paper"),
    ]
    e3 = [
        check("share of the burst seen in the gap", 0.208, high=0.03, subject="two", owner="usual"),
        check(
            "share of the burst seen in the gap",
            0.235,
            high=0.03,
            why="φ is a Pisot number",
            subject="phi",
            owner="paper",
        ),
        check("share of the burst seen in the gap", 0.011, high=0.03, subject="ratio 1.65"),
    ]
    distances = [0.02 * step for step in range(1, 101)]
    lobes = lines(
        "Kernel of an encoding", 8, ("distance", "mean of cos(π f d)"), distances,
        lambda d, base: sum(math.cos(math.pi * base**k * d) for k in range(10)) / 10,
        {"two": (2.0,), "phi": (1.618,), "ratio 1.65": (1.65,)}, log="",
    )  # fmt: skip
    return [
        case("E1", "Top frequency of an encoding", "≤ 1.2e-4 for 2^k, ≤ 1.2e-5 for φ^k", *e1),
        case("E3", "Ghosts and neutral gratings", "control ≤ 0.03", *e3, series=lobes),
    ]


def _amplifier(with_failure: bool) -> list[StudyRecord]:
    differences = dict(zip(METHODS, (0.0, 0.0, 0.31, 2e-7, 0.33), strict=True))
    a2 = [
        check(
            "largest change of a pixel",
            value,
            high=2e-6,
            subject=method,
            owner="paper" if method.startswith("q") else "ours",
        )
        for method, value in differences.items()
    ]
    a2.append(check("after a reload", 3e-4 if with_failure else 3e-7, high=2e-6, subject="harness"))
    a4 = [
        check(
            "opacity of one unit of matter",
            value,
            low=0.999,
            subject=method,
            owner="paper" if method.startswith("q") else "ours",
        )
        for method, value in zip(METHODS, (1.0, 1.0, 0.632, 0.632, 0.95), strict=True)
    ]
    scales = [0.1, 0.3, 1.0, 3.0, 10.0]
    reach = lines(
        "Opacity of one unit of matter", 5, ("scale of the scene", "opacity"), scales,
        lambda scale, solid: solid or 1 - math.exp(-scale), {"nerf": (1.0,), "qnerf": (0.0,)}, log="x",
    )  # fmt: skip
    steps = [50.0 * 2**k for k in range(6)]
    dead = lines(
        "Dead share of the amplifier", 6, ("training step", "share of samples"), steps,
        lambda step, rate: min(0.9, 0.05 * rate * math.log2(step / 50)),
        {"qnerf": (1.0,), "qnerf_theorem": (2.4,), "qnerf_listing4": (3.1,)}, log="x",
    )  # fmt: skip
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


def _training() -> list[StudyRecord]:
    o2 = [
        check("until within 10 %", 41.0, high=200.0, unit="steps", subject="clipped, × 1e9"),
        check("until half the step size", 33424.0, high=200.0, unit="steps", subject="unclipped, × 1e9", owner="usual"),
    ]
    steps = [float(step) for step in range(0, 400, 10)]
    spikes = lines(
        "Loss after a spike of 1e9", 11, ("steps after the spike", "loss"), steps,
        lambda step, height, after: 0.02 + height * math.exp(-step / after),
        {"no spike": (0.0, 1.0), "clipped": (0.4, 30.0), "unclipped": (0.4, 1e4)}, log="y",
    )  # fmt: skip
    layers = [float(layer) for layer in range(1, 9)]
    names = {
        f"{dtype}, {part}": (lost,)
        for dtype, lost in (("bfloat16", 2.0), ("float16", 1.0))
        for part in ("mean", "worst")
    }
    digits = lines(
        "nerf, trained",
        7,
        ("layer", "digits lost"),
        layers,
        lambda layer, lost: lost * (1 + 0.2 * layer),
        names,
        log="",
    )
    return [case("O2", "One spike", "back within 10 % in 200 steps", *o2, series=spikes),
            case("O3", "Digits lost by layer", "recorded", series=digits)]  # fmt: skip


def _scenes() -> list[StudyRecord]:
    owners = {method: "paper" if method.startswith("q") else "ours" for method in METHODS}
    s1 = [check("MSE of a white scene", 3e-6, high=1e-5, subject=name, owner=owner) for name, owner in owners.items()]
    s3 = [Check("", None, why="no shared library of LLVM 16 or newer", subject="volpath", status="not_available"),
          check("largest |z| of 64 rays", 1.9, high=4.0, subject="midpoint")]  # fmt: skip
    return [
        case("S1", "Nothing to see", "MSE ≤ 1e-5, opacity outside ≤ 1e-2", *s1),
        case("S3", "Fog", "≤ 1e-4; |z| < 4", *s3),
    ]


def _explained(rung: float, slope: float) -> float:
    return max(0.0, 1 - slope * rung / 10)


def _others() -> list[StudyRecord]:
    rungs = [1.0, 2.0, 4.0, 8.0, 16.0]
    slopes = dict(zip(METHODS, ((0.4,), (0.5,), (0.9,), (0.6,), (1.1,)), strict=True))
    ladders = [
        found
        for name in ("frequency", "thinness", "density")
        for found in lines(f"Ladder of {name}", 9, (name, "explained share"), rungs, _explained, slopes, log="x")
    ]
    table = Table("ladders", 9, "First rung on which a method breaks", ["ladder", *METHODS],
                  [["frequency", 16, 8, 4, None, 4], ["thinness", 16, 16, 8, 8, 4]])  # fmt: skip
    l1 = [Check("rung on which it breaks, frequency", 4.0 + place, subject=method, status="pass")
          for place, method in enumerate(METHODS)]  # fmt: skip
    c1 = [Check("NaN, singular, up along the view: refused", None, subject="harness", status="pass")]
    r1 = [check("largest |z|", 2.2, high=4.0, subject="volpath"),
          check("error of values", 9e-7, high=5e-6, subject="Dr.Jit")]  # fmt: skip
    return [
        case("C1", "Cameras that are none", "refused before rendering", *c1),
        case("R1", "An independent reference", "|z| < 4; values ≤ 5e-6", *r1),
        case("L1", "Ladders", "recorded", *l1, series=ladders, tables=[table]),
    ]


def write_fake_stability(folder: Path, record: Studies | None = None, pictures: bool = True) -> Path:
    """`folder` with a stability.json in it and the pictures that it names."""
    (folder / PICTURES_FOLDER).mkdir(parents=True, exist_ok=True)
    write_studies(folder / SHELVES["stability"], record or fake_stability())
    y, x = np.mgrid[0:64, 0:64] / 64
    whole = np.stack([x, y, 0.5 + 0.5 * np.sin(20 * x * y)], -1)
    chunked = np.clip(
        whole + 0.3 * ((np.arange(64 * 64).reshape(64, 64, 1) // 16) % 3 == 0) * (y[..., None] > 0.4), 0, 1
    )
    for name, picture in {"whole": whole, "chunks": chunked, "difference": 4 * (chunked - whole)}.items():
        if pictures:
            matplotlib.image.imsave(folder / PICTURES_FOLDER / f"{name}.png", np.clip(picture, 0, 1).astype(np.float32))
    return folder


def hostile(record: Studies, word: str) -> Studies:
    """`record` with `word` wherever it holds text of its own."""

    def spoiled(one: StudyRecord) -> StudyRecord:
        facts = dict.fromkeys(("input", "danger", "reference", "bar"), word)
        findings = [
            *(replace(o, subject=f"{word} {o.subject}", unit=word, what=word, why=word) for o in one.checks),
            *(replace(s, panel=word, name=f"{word} {s.name}", x_label=word, y_label=word) for s in one.series),
            *(Table(word, t.item, word, [word for _ in t.columns], [[word for _ in t.columns]]) for t in one.tables),
            *(replace(p, title=word, caption=word) for p in one.pictures),
        ]
        return StudyRecord(StudyInfo(f"{word} {one.info.id}", word, facts=facts), findings=findings)

    studies = [spoiled(one) for one in record.studies]
    return replace(record, studies=studies, provenance={word: word}, settings={word: [word]})


if __name__ == "__main__":
    write_fake_stability(Path(sys.argv[1]))
