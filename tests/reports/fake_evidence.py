"""A made-up evidence record with every kind of finding: checks that hold and one that fails, effects with every
verdict, one without an interval, lines, tables, a study without effects.

python -m tests.reports.fake_evidence OUT    writes OUT/evidence.json
"""

import math
import sys
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from harness.records.study import Answer, Effect, Finding, Studies, StudyInfo, StudyRecord, Table, check
from harness.records.verdict import OPEN, verdict_of
from tests.reports.fake_shelf import lines, shelf, write_shelf

SCENES = ("lego", "ficus", "hotdog")
PARTS = {"φ encoding": 0.92, "amplifier": -2.61, "φ skip": -0.04, "φ encoding × amplifier": -0.31,
         "φ encoding × φ skip": 0.05, "amplifier × φ skip": -0.02, "all three": 0.11}  # fmt: skip
INTEREST = {"psnr": 0.2, "ssim": 0.005}


def effect(
    name: str, against: str, scene: str, difference: float, half: float, budget: Any = "steps", metric: str = "psnr",
    unpaired: int = 0, family: int = 16, note: str = "",
) -> Effect:  # fmt: skip
    """With an interval of ± `half` alone and three times that together, judged as the harness does."""
    low, high = difference - 3 * half, difference + 3 * half
    verdict = OPEN if unpaired else verdict_of((low, high), INTEREST[metric])
    alone = (round(difference - half, 4), round(difference + half, 4))
    return Effect(
        name, against, scene, metric, budget, round(difference, 4), alone, (round(low, 4), round(high, 4)), family,
        verdict, round(4.2 * half, 3), 9, unpaired, note,
    )  # fmt: skip


def fake_evidence(with_failure: bool = True, with_charts: bool = True, **changes: Any) -> Studies:
    """With `with_failure` a check fails, as in no good run; charts take most of the time of a page."""
    studies = [_calibration(with_failure, with_charts), _factorial(), _bandwidth(with_charts), _rendering(with_charts)]
    settings = {"quick": False, "device": "cpu", "smallest_of_interest": INTEREST}
    return shelf("evidence", studies, settings, changes)


def study(info: StudyInfo, scale: str, answers: list[str], *findings: list[Any], seconds: float = 0.0) -> StudyRecord:
    listed: list[Finding] = [*map(Answer, answers), *(finding for kind in findings for finding in kind)]
    return StudyRecord(info, scale, listed, seconds)


def _calibration(with_failure: bool, with_charts: bool) -> StudyRecord:
    info = StudyInfo(
        "calibration",
        "Is the comparer calibrated?",
        "How often does it see a difference where there is none, and how often does it miss one that is there?",
        "NeRF against NeRF with other seeds, in real training runs, and in simulated comparisons drawn from the "
        "spreads that those runs show; then once more with an effect planted.",
    )
    checks = [
        check("share of simulated A/A comparisons that are called better or worse", 0.024, high=0.05,
              why="of 4000, drawn from the spread of 8 scenes and 6 seeds"),
        check("share of real A/A comparisons that are called better or worse", 0.081 if with_failure else 0.031,
              high=0.05, why="15 pairs of seeds on 8 scenes"),
        check("share of planted effects that are found", 0.846, low=0.8,
              why="each as large as the smallest detectable one that its comparison prints"),
    ]  # fmt: skip
    power = lines(
        "Power: how often a planted effect is found", 0, ("planted effect / smallest detectable", "share found"),
        [0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5],
        lambda size, exponent: (1 / (1 + math.exp(-6.5 * (size - 0.74)))) ** exponent,
        {"a single scene, 3 seeds": (1.0,), "8 scenes × 3 seeds": (0.9,)}, log="",
    )  # fmt: skip
    power = [
        replace(line, low=[max(y - 0.03, 0) for y in line.y], high=[min(y + 0.03, 1) for y in line.y]) for line in power
    ]
    return study(
        info,
        "chair, drums, ficus, hotdog, lego, materials, mic, ship; 6 seeds; 300 steps; 100 training views of 100 px",
        ["Where there is no difference it sees one in 2.4 % of 4000 comparisons, and an effect of the printed smallest "
         "detectable size is found in 84.6 %.",
         "Between two seeds of NeRF, test PSNR spreads by 0.21 dB on hotdog and by 1.32 dB on drums."],
        checks,
        power if with_charts else [],
        [Table("spread", 0, "Spread between seeds", ["scene", "SD (dB)", "range (dB)"],
               [["hotdog", 0.21, 0.52], ["drums", 1.32, 3.11], ["mic", None, None]])],
        seconds=203.0,
    )  # fmt: skip


def _factorial() -> StudyRecord:
    info = StudyInfo(
        "factorial",
        "What does each part do?",
        "What do the φ encoding, the amplifier and the φ skip contribute, alone and together?",
        "All eight combinations of the three parts, under both readings of the amplifier.",
    )
    effects = []
    for budget, loss in (("steps", 0.0), ("seconds", 0.06)):
        for reading, scale in (("Listing 2", 1.0), ("Eq. 4", 0.12)):
            for place, scene in enumerate(("all", *SCENES)):
                for name, size in PARTS.items():
                    half = 0.09 + 0.03 * place + 0.04 * abs(size)
                    moved = size * (scale if "amplifier" in name else 1) + 0.05 * math.sin(place + len(name)) - loss
                    effects.append(effect(name, "", scene, moved, half, budget, note=reading, family=28))
    effects += [
        effect(name, "", "all", 0.01 * size, 0.003, metric="ssim", note="Listing 2", family=28)
        for name, size in PARTS.items()
    ]
    effects.append(effect("qnerf", "nerf", "all", -1.9, 3.4, unpaired=2, family=28))
    effects.append(Effect("qnerf", "nerf", "lego", "psnr", "seconds", None, None, None, 28, OPEN, None, 0, 3))
    return study(
        info,
        "lego, ficus, hotdog; 3 seeds; 500 steps; 100 training views of 100 px",
        ["The φ encoding brings +0.92 dB; the amplifier of Listing 2 costs 2.6 dB, that of Eq. 4 nothing to speak of."],
        effects,
        [Table("table4", 0, "Rows of Table 4", ["row", "PSNR (dB)", "the paper", "SSIM"],
               [["Baseline NeRF", 24.31, 32.5, 0.871], ["+ φ-Encoding", 25.12, 33.2, 0.884],
                ["+ Amplifier", "diverged", 33.8, None]])],
        seconds=540.0,
    )  # fmt: skip


def _bandwidth(with_charts: bool) -> StudyRecord:
    info = StudyInfo(
        "bandwidth",
        "The golden ratio, or bandwidth?",
        "Is what the φ encoding changes owed to φ, or to how far its frequencies reach?",
        "φ with NeRF's reach, another base with φ's reach, and 2^k with φ's reach, beside both, at three resolutions.",
    )
    rivals = {"nerf_phi_encoding": (0.9, 0.55, 0.21), "nerf_base165": (0.88, 0.6, 0.24),
              "nerf_matched": (0.93, 0.5, 0.2), "nerf_phi_far": (0.08, 0.02, -0.05)}  # fmt: skip
    pixels, gain = [100.0, 200.0, 400.0], "difference in test PSNR (dB)"
    steps = [125.0, 250.0, 500.0, 1000.0]
    series = lines("Difference from nerf over resolution", 0, ("pixels across", gain), pixels,
                   lambda size, *gains: gains[pixels.index(size)], rivals, log="x")  # fmt: skip
    series += lines("Difference from nerf along training, 100 px", 0, ("training step", gain),
                    steps, lambda step, *gains: gains[0] * (1 + 50 / step), rivals, log="x")  # fmt: skip
    effects = [
        effect(name, "nerf", "all", gains[place], 0.15, note=f"{size:.0f} px", family=12)
        for name, gains in rivals.items()
        for place, size in enumerate(pixels)
    ]
    return study(
        info,
        "lego, chair; 3 seeds; 1000 steps; at 100, 200 and 400 px",
        ["What φ brings at 100 px, 2^k with the same reach brings too: +0.90 and +0.93 dB."],
        effects,
        series if with_charts else [],
        seconds=1100.0,
    )


def _rendering(with_charts: bool) -> StudyRecord:
    info = StudyInfo(
        "rendering",
        "Error against time of rendering",
        "Which quadrature rule and which sampler reach an error first?",
        "One trained field, rendered with every rule and sampler at growing numbers of samples.",
    )
    rules = {"midpoint, even": (0.4, 1.0), "linear in τ, even": (0.3, 2.0), "listing4, even": (0.6, 0.5)}
    axes, times = ("milliseconds a frame", "RMSE in linear light"), [2.0**k for k in range(3, 10)]
    series = lines("Error over time a frame", 0, axes, times, lambda time, gain, order: gain * time**-order, rules)
    answers = ["At 10 ms a frame the rule that is linear in τ has the smallest error."]
    return study(info, "lego; 100 px", answers, series if with_charts else [], seconds=81.0)


def write_fake_evidence(out: Path, record: Studies | None = None) -> Path:
    """Write the record under `out`, and return `out`."""
    return write_shelf(out, record or fake_evidence())


if __name__ == "__main__":
    write_fake_evidence(Path(sys.argv[1]))
