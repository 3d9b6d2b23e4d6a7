"""E1 and E2: how exact an encoding is inside its box, and what it makes of positions that are none."""

import math
from collections.abc import Iterator

import mpmath
import torch
from torch import Tensor

from baselines.numerics.encoding import PHI, REACH, checked_positions, encode, fourier_features, frequency_ladder
from harness.chart_record import Table
from harness.seeds import generator_for
from harness.stability.situation import Finding, Situation
from harness.stability_record import judged

DIGITS = 60
BARS = {("2^k", 10): 1.2e-4, ("φ^k", 10): 2.5e-5, ("2^k", 14): 1.9e-3, ("φ^k", 14): 1.6e-4}
"""(ladder, bands) → largest error in float32; measured 1.0e-4, 2.2e-5, 1.7e-3, 1.1e-4."""
SINE_BARS = {**BARS, ("φ^k", 10): 1.2e-5}
"""Of a sine of its own for each band. At ten bands of φ ours follow from those below (`encode`), which takes less time
and doubles the error: 2.2e-5 against 1.1e-5, the worst of any float."""
BASES = {"2^k": 2.0, "φ^k": PHI}


def true_waves(x: Tensor, base: float, band: int) -> Tensor:
    """[points, 2] in float64: sine and cosine of base^band π x, from 60 digits of the float that x is."""
    with mpmath.workdps(DIGITS):
        exact_base = (1 + mpmath.sqrt(5)) / 2 if base == PHI else mpmath.mpf(base)
        angles = [exact_base**band * mpmath.pi * mpmath.mpf(value) for value in x.double().tolist()]
        return torch.tensor([[float(mpmath.sin(a)), float(mpmath.cos(a))] for a in angles], dtype=torch.float64)


def band_of(features: Tensor, band: int) -> Tensor:
    """[points, 2] of a one-dimensional encoding [points, 1 + 2 bands]."""
    return features[:, 1 + 2 * band : 3 + 2 * band].double()


def top_frequency(situation: Situation) -> Iterator[Finding]:
    """E1: the top band at L = 10 and 14: as every field computes it, as Listing 1 does, and in reduced precision."""
    generator = generator_for("stability", "E1")
    points = 2.0 * torch.rand(300 if situation.quick else 3000, generator=generator) - 1.0
    x = torch.cat([points, torch.tensor([1.0, -1.0, 0.0, 0.99999994, 0.9594049, 0.83292031])])
    for ladder, base in BASES.items():
        for bands in (10, 14):
            truth = true_waves(x, base, bands - 1)
            bar = BARS[ladder, bands]

            def error(waves: Tensor, truth: Tensor = truth) -> float:
                return float((waves - truth).abs().max())

            what = f"largest error of band {bands - 1}"
            name = f"{ladder}, L = {bands}"
            frequency = frequency_ladder(base, bands)[-1]
            sines = torch.stack([torch.sin(frequency * math.pi * x), torch.cos(frequency * math.pi * x)], dim=-1)
            printed = error(sines.double())
            traded = bar > SINE_BARS[ladder, bands]
            why = f"traded for time: sines as printed are off by {printed:.2g}" if traded else ""
            yield judged("E1", name, "ours", error(band_of(encode(x.unsqueeze(-1), base, bands), bands - 1)), bar,
                         what=what, why=why)  # fmt: skip
            yield judged("E1", f"{name}, as printed", "paper" if base == PHI else "usual", printed,
                         SINE_BARS[ladder, bands], what=what)  # fmt: skip
            for dtype in (torch.bfloat16, torch.float16):
                low = x.to(dtype) * (math.pi * frequency).to(dtype)
                waves = torch.stack([torch.sin(low), torch.cos(low)], dim=-1)
                yield judged("E1", f"{name}, {str(dtype).removeprefix('torch.')}", "usual", error(waves.double()), bar,
                             what=what, why="autocast around the encoding; ours refuses it")  # fmt: skip


POSITIONS = (0.0, 1e-45, -1e-38, 1e-10, 1e-4, 1.0, 1.00009, 1e2, 1e4, 1e38, math.inf, math.nan)


def positions(situation: Situation) -> Iterator[Finding]:
    """E2: ten bands of base 2 at each position, behind the check and without it."""
    del situation
    rows: list[list[str | float | None]] = []
    worst_inside, wrong = 0.0, []
    worst: dict[str, tuple[float, float]] = {"2^k": (0.0, 0.0), "φ^k": (0.0, 0.0)}
    not_finite: dict[str, list[str]] = {"2^k": [], "φ^k": []}
    for value in POSITIONS:
        x = torch.tensor([[value]])
        inside = abs(value) <= REACH
        try:
            checked_positions(x)
            refused = False
        except ValueError:
            refused = True
        if refused == inside:
            wrong.append(f"{value:g}")
        row: list[str | float | None] = [f"{value:g}", "refused" if refused else "encoded"]
        for ladder, base in BASES.items():
            error = largest_error(fourier_features(x, frequency_ladder(base, 10)), value, base)
            row.append(error if math.isfinite(error) else "not finite")
            if math.isfinite(error):
                worst[ladder] = max(worst[ladder], (error, value))
            else:
                not_finite[ladder].append(f"{value:g}")
            if inside:
                worst_inside = max(worst_inside, largest_error(encode(x, base, 10), value, base))
        rows.append(row)
    yield judged("E2", "checked", "ours", len(wrong), 0, what=f"positions refused within ±{REACH:g} or accepted beyond",
                 why=", ".join(wrong))  # fmt: skip
    yield judged("E2", "inside the box", "ours", worst_inside, BARS["2^k", 10], what="largest error of any band")
    for ladder, (error, where) in worst.items():
        yield judged("E2", f"{ladder}, unchecked", "paper" if ladder == "φ^k" else "usual", error, BARS["2^k", 10],
                     what="largest error of any band, of the positions whose features are finite",
                     why=f"at x = {where:g}; not finite at {', '.join(not_finite[ladder])}")  # fmt: skip
    yield Table("positions", 8, "Error of an unchecked encoding at a position, L = 10",
                ["position", "checked", "2^k", "φ^k"], rows)  # fmt: skip


def largest_error(features: Tensor, value: float, base: float) -> float:
    """Over ten bands; NaN where a feature or the position is not finite."""
    if not math.isfinite(value) or not bool(torch.isfinite(features).all()):
        return math.nan
    x = torch.tensor([value])
    return max(float((band_of(features, band) - true_waves(x, base, band)).abs().max()) for band in range(10))
