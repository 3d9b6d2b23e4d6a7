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

from harness.records.study import PICTURES_FOLDER, Check, Picture, Series, Studies, StudyInfo, StudyRecord, Table, check
from tests.reports.fake_shelf import lines, shelf, write_shelf

METHODS = ("nerf", "nerf_matched", "qnerf", "qnerf_theorem", "qnerf_listing4")
OWNERS: dict[str, Any] = {
    "listing4": "paper", "phi": "paper", "running_product": "usual", "log_space": "usual", "left_point": "usual",
    "torch.expm1": "usual", "two": "usual", "unclipped, × 1e9": "usual",
}  # fmt: skip
"""Subject → the owner of its form; of methods, those of the paper are."""


def case(name: str, title: str, bar: str, *outcomes: Check, **more: Any) -> StudyRecord:
    facts = {"input": f"what is put into {name}", "danger": f"the danger of {name}", "bar": bar,
             "reference": "40 digits of mpmath, or a closed form"}  # fmt: skip
    findings = [*outcomes, *(finding for kind in more.values() for finding in kind)]
    return StudyRecord(StudyInfo(name, title, facts=facts), findings=findings, seconds=12.3)


def judged(what: str, values: dict[str, float | None], high: float | None = None, **more: Any) -> list[Check]:
    """The figure of each subject against one limit."""
    owners = {subject: OWNERS.get(subject, "paper" if subject.startswith("q") else "ours") for subject in values}
    return [
        check(what, value, high=high, subject=subject, **{"owner": owners[subject], **more})
        for subject, value in values.items()
    ]


def fake_stability(with_failure: bool = True, with_charts: bool = True, **changes: Any) -> Studies:
    """With `with_failure` one check of ours fails, as in no good run; charts take most of the time of a page."""
    studies = [*_quadrature(), *_encodings(), *_amplifier(with_failure), *_training(), *_scenes(), *_others()]
    if not with_charts:
        studies = [
            replace(study, findings=[each for each in study.findings if not isinstance(each, Series)])
            for study in studies
        ]
    return shelf("stability", studies, {"methods": list(METHODS), "quick": False}, changes)


def _quadrature() -> list[StudyRecord]:
    relative = "largest relative error of colour, opacity and transmittance"
    worst = {"midpoint": 2.1e-7, "linear_in_tau": 1.8e-7, "listing4": 1.0, "running_product": 2.7e-3, "log_space": 1.0}
    q1 = judged(relative, worst, 1e-6) + judged("the same over 10^6 bins", {"midpoint": 1.3e-7}, 1e-6)
    q1.append(Check("half precision is refused", None, subject="harness", status="pass"))
    orders = {"midpoint": 0.02, "linear_in_tau": 0.04, "listing4": 0.03, "left_point": 0.01}
    q2 = judged("distance from the order that it declares", orders, 0.15)
    q3 = judged("error of the gradient, of the largest", {"midpoint": 1.2e-6, "linear_in_tau": 2.3e-6}, 5e-6)
    q3 += judged("error of the gradient", {"log_space": math.nan}, 5e-6, why="σ = 0 in one sample")
    q3 += judged("error of the gradient", {"torch.expm1": 16.0}, 5e-6, why="exp(x) − 1 + 1 in float32")
    q4 = judged("error of colour", {"linear_in_tau": 1.6e-5}, 1e-4, why="τ of a bin up to 1000")
    q4.append(
        Check("", None, why="its last bin is 1e10 long", subject="listing4", owner="paper", status="not_applicable")
    )
    q6 = judged("relative error of opacity", {"midpoint": 2e-8}, 1e-6)
    q6 += judged("relative error of opacity", {"listing4": 2.5e7}, 1e-6, why="opaque, where 4e-8 is")
    q8 = [Check("far < near, far = ∞ and unsorted are refused, ray named", None, subject="harness", status="pass")]
    q8 += judged("largest |opacity|", {"listing4": 53.6}, 1.0)
    rows: list[list[str | float | None]] = [["midpoint", 2, 1.98, 2.01, 1.99], ["left_point", 1, 1.01, 0.99, 1.0],
                                            ["listing4", 0, 0.0, 0.01, math.nan]]  # fmt: skip
    columns = ["rule", "declared", "ramp", "exponential", "Gaussian"]
    fitted = Table("orders", 2, "Fitted orders", columns, rows)
    taus = [10.0**power for power in range(-8, 3)]
    slopes = lines("Gradient of a ray", 3, ("τ of a bin", "error of the gradient"), taus,
                   lambda tau, slope: max(1e-7, slope * tau * (tau >= 1)),
                   {"midpoint": (0.0,), "torch.expm1": (1 / 6,)})  # fmt: skip
    return [
        case("Q1", "Homogeneous ray", "relative error ≤ 1e-6; half precision refused", *q1, series=_rounding()),
        case("Q2", "Order of convergence", "fitted order within ±0.15", *q2, series=_truncation(), tables=[fitted]),
        case("Q3", "Gradients of a ray", "≤ 5e-6 of the largest gradient", *q3, series=slopes),
        case("Q4", "Stiff rays", "linear in τ ≤ 1e-4", *q4),
        case("Q6", "Almost nothing", "relative error ≤ 1e-6", *q6),
        case("Q8", "Intervals that are none", "refused, with the ray named", *q8),
    ]


def _rounding() -> list[Series]:
    def error(tau: float, floor: float, loses: bool) -> float:
        return min(1.0, floor / tau) if loses and tau < 1 else floor * (1 + 0.1 * math.sin(math.log(tau)))

    taus, axes = [10.0**power for power in range(-8, 9)], ("τ of the ray", "relative error of colour")
    rules = {"midpoint": (1e-7, False), "linear_in_tau": (5e-8, False), "listing4": (3e-8, True),
             "running_product": (4e-8, True), "log_space": (6e-8, True)}  # fmt: skip
    midpoint, *others, log_space = lines("Rounding in float32", 1, axes, taus, error, rules)
    zeros = replace(midpoint, y=[*midpoint.y[:-3], 0.0, 0.0, 0.0])
    gaps = replace(log_space, y=[math.nan, math.inf, *log_space.y[2:]])
    half = {"midpoint": (1e-3, False), "listing4": (4e-3, True)}
    return [zeros, *others, gaps, *lines("Rounding in bfloat16", 1, axes, taus, error, half)]


def _truncation() -> list[Series]:
    bins, series = [8.0 * 2**k for k in range(10)], []
    for profile, size in (("ramp, τ = 100", 0.02), ("homogeneous, τ = 1000", 3.0)):
        for rule, order in (("midpoint", 2), ("left_point", 1), ("listing4", 0), ("linear_in_tau", 2.2)):
            errors = [size * (1 + order) * (8 / n) ** order for n in bins]
            low, high = [0.7 * error for error in errors], [1.4 * error for error in errors]
            seconds = [2e-6 * n * (1 + order / 5) for n in bins]
            series.append(Series(f"{profile}, against samples", 2, rule, "bins", "error of colour", bins, errors))
            axes = (f"{profile}, against time", 2, rule, "seconds", "error of colour")
            series.append(Series(*axes, seconds, errors, low, high))
    return series


def _encodings() -> list[StudyRecord]:
    e1 = judged("error of the top frequency", {"two": 9e-5}, 1.2e-4, owner="ours")
    e1 += judged("error of the top frequency", {"phi": 1e-5}, 1.2e-5)
    e3 = judged("share of the burst seen in the gap", {"two": 0.208, "phi": 0.235, "ratio 1.65": 0.011}, 0.03)
    lobes = lines(
        "Kernel of an encoding", 8, ("distance", "mean of cos(π f d)"), [0.02 * step for step in range(1, 101)],
        lambda d, base: sum(math.cos(math.pi * base**k * d) for k in range(10)) / 10,
        {"two": (2.0,), "phi": (1.618,), "ratio 1.65": (1.65,)}, log="",
    )  # fmt: skip
    return [
        case("E1", "Top frequency of an encoding", "≤ 1.2e-4 for 2^k, ≤ 1.2e-5 for φ^k", *e1),
        case("E3", "Ghosts and neutral gratings", "control ≤ 0.03", *e3, series=lobes),
    ]


def _amplifier(with_failure: bool) -> list[StudyRecord]:
    differences = dict(zip(METHODS, (0.0, 0.0, 0.31, 2e-7, 0.33), strict=True))
    a2 = judged("largest change of a pixel", differences, 2e-6)
    a2 += judged("after a reload", {"harness": 3e-4 if with_failure else 3e-7}, 2e-6)
    opacities = dict(zip(METHODS, (1.0, 1.0, 0.632, 0.632, 0.95), strict=True))
    a4 = judged("opacity of one unit of matter", opacities, low=0.999)
    scales, steps = [0.1, 0.3, 1.0, 3.0, 10.0], [50.0 * 2**k for k in range(6)]
    reach = lines("Opacity of one unit of matter", 5, ("scale of the scene", "opacity"), scales,
                  lambda scale, solid: solid or 1 - math.exp(-scale), {"nerf": (1.0,), "qnerf": (0.0,)},
                  log="x")  # fmt: skip
    dead = lines("Dead share of the amplifier", 6, ("training step", "share of samples"), steps,
                 lambda step, rate: min(0.9, 0.05 * rate * math.log2(step / 50)),
                 {"qnerf": (1.0,), "qnerf_theorem": (2.4,), "qnerf_listing4": (3.1,)}, log="x")  # fmt: skip
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
    o2 = judged("until within 10 %", {"clipped, × 1e9": 41.0}, 200.0, unit="steps")
    o2 += judged("until half the step size", {"unclipped, × 1e9": 33424.0}, 200.0, unit="steps")
    spikes = lines("Loss after a spike of 1e9", 11, ("steps after the spike", "loss"), [10.0 * k for k in range(40)],
                   lambda step, height, after: 0.02 + height * math.exp(-step / after),
                   {"no spike": (0.0, 1.0), "clipped": (0.4, 30.0), "unclipped": (0.4, 1e4)}, log="y")  # fmt: skip
    kinds = {"bfloat16, mean": (2.0,), "bfloat16, worst": (2.0,), "float16, mean": (1.0,), "float16, worst": (1.0,)}
    digits = lines("nerf, trained", 7, ("layer", "digits lost"), [float(layer) for layer in range(1, 9)],
                   lambda layer, lost: lost * (1 + 0.2 * layer), kinds, log="")  # fmt: skip
    return [case("O2", "One spike", "back within 10 % in 200 steps", *o2, series=spikes),
            case("O3", "Digits lost by layer", "recorded", series=digits)]  # fmt: skip


def _scenes() -> list[StudyRecord]:
    s1 = judged("MSE of a white scene", dict.fromkeys(METHODS, 3e-6), 1e-5)
    s3 = [Check("", None, why="no shared library of LLVM 16 or newer", subject="volpath", status="not_available")]
    s3 += judged("largest |z| of 64 rays", {"midpoint": 1.9}, 4.0)
    return [
        case("S1", "Nothing to see", "MSE ≤ 1e-5, opacity outside ≤ 1e-2", *s1),
        case("S3", "Fog", "≤ 1e-4; |z| < 4", *s3),
    ]


def _others() -> list[StudyRecord]:
    slopes = dict(zip(METHODS, ((0.4,), (0.5,), (0.9,), (0.6,), (1.1,)), strict=True))
    ladders = [
        line
        for name in ("frequency", "thinness", "density")
        for line in lines(f"Ladder of {name}", 9, (name, "explained share"), [1.0, 2.0, 4.0, 8.0, 16.0],
                          lambda rung, slope: max(0.0, 1 - slope * rung / 10), slopes, log="x")
    ]  # fmt: skip
    table = Table("ladders", 9, "First rung on which a method breaks", ["ladder", *METHODS],
                  [["frequency", 16, 8, 4, None, 4], ["thinness", 16, 16, 8, 8, 4]])  # fmt: skip
    l1 = [Check("rung on which it breaks, frequency", 4.0 + place, subject=method, status="pass")
          for place, method in enumerate(METHODS)]  # fmt: skip
    c1 = [Check("NaN, singular, up along the view: refused", None, subject="harness", status="pass")]
    r1 = judged("largest |z|", {"volpath": 2.2}, 4.0) + judged("error of values", {"Dr.Jit": 9e-7}, 5e-6)
    return [
        case("C1", "Cameras that are none", "refused before rendering", *c1),
        case("R1", "An independent reference", "|z| < 4; values ≤ 5e-6", *r1),
        case("L1", "Ladders", "recorded", *l1, series=ladders, tables=[table]),
    ]


def write_fake_stability(folder: Path, record: Studies | None = None) -> Path:
    """`folder` with a stability.json in it and the pictures that it names."""
    (folder / PICTURES_FOLDER).mkdir(parents=True, exist_ok=True)
    y, x = np.mgrid[0:64, 0:64] / 64
    whole = np.stack([x, y, 0.5 + 0.5 * np.sin(20 * x * y)], -1)
    chunked = np.clip(
        whole + 0.3 * ((np.arange(64 * 64).reshape(64, 64, 1) // 16) % 3 == 0) * (y[..., None] > 0.4), 0, 1
    )
    for name, picture in {"whole": whole, "chunks": chunked, "difference": 4 * (chunked - whole)}.items():
        matplotlib.image.imsave(folder / PICTURES_FOLDER / f"{name}.png", np.clip(picture, 0, 1).astype(np.float32))
    return write_shelf(folder, record or fake_stability())


if __name__ == "__main__":
    write_fake_stability(Path(sys.argv[1]))
