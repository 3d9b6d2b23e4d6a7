"""E1 to E3: how exact an encoding is, what it returns outside the box, which points it cannot distinguish."""

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import mpmath
import torch
from jaxtyping import Float
from torch import Tensor

from baselines.numerics.encoding import PHI, REACH, checked_positions, encode, fourier_features, frequency_ladder
from harness.plan.seeds import generator_for
from harness.records.study import Owner, Series, Table, check
from harness.studies.framework import Found, Rows
from harness.studies.stability.stability_context import StabilityContext, error_of, worst_of

DIGITS = 60
BARS = {("2^k", 10): 1.2e-4, ("2^k", 14): 1.9e-3, ("φ^k", 10): 1.2e-5, ("φ^k", 14): 1.6e-4}
"""(ladder, bands) → largest error in float32."""
BASES = {"2^k": 2.0, "φ^k": PHI}
OWNERS: dict[str, Owner] = {"2^k": "usual", "φ^k": "paper"}


def true_waves(x: Tensor, base: float, band: int) -> Tensor:
    """Return sine and cosine of base^band π x [points, 2], computed in 60 digits from the float x."""
    with mpmath.workdps(DIGITS):
        exact_base = (1 + mpmath.sqrt(5)) / 2 if base == PHI else mpmath.mpf(base)
        angles = [exact_base**band * mpmath.pi * mpmath.mpf(value) for value in x.double().tolist()]
        return torch.tensor([[float(mpmath.sin(a)), float(mpmath.cos(a))] for a in angles], dtype=torch.float64)


def _waves(angles: Tensor) -> Tensor:
    return torch.stack([torch.sin(angles), torch.cos(angles)], dim=-1).double()


def band_of(features: Tensor, band: int) -> Tensor:
    """Return the band [points, 2] of a one-dimensional encoding [points, 1 + 2 bands]."""
    return features[:, 1 + 2 * band : 3 + 2 * band].double()


def top_frequency(context: StabilityContext) -> Iterator[Found]:
    generator = generator_for("stability", "E1")
    points = 2.0 * torch.rand(300 if context.quick else 3000, generator=generator) - 1.0
    x = torch.cat([points, torch.tensor([1.0, -1.0, 0.0, 0.99999994, 0.9594049, 0.83292031])])
    for (ladder, bands), bar in BARS.items():
        base = BASES[ladder]
        truth = true_waves(x, base, bands - 1)
        frequency = frequency_ladder(base, bands)[-1]
        waves = {
            "": band_of(encode(x.unsqueeze(-1), base, bands), bands - 1),
            "as printed": _waves(frequency * math.pi * x),
        }
        for dtype in (torch.bfloat16, torch.float16):
            low = x.to(dtype) * (math.pi * frequency).to(dtype)
            waves[str(dtype).removeprefix("torch.")] = _waves(low)
        errors = {name: float((wave - truth).abs().max()) for name, wave in waves.items()}
        what, subject = f"largest error of band {bands - 1}", f"{ladder}, L = {bands}"
        yield check(what, errors.pop(""), high=bar, subject=subject)
        error = errors.pop("as printed")
        yield check(what, error, high=bar, subject=f"{subject}, as printed", owner=OWNERS[ladder])
        for name, error in errors.items():
            why = "autocast around the encoding; this harness refuses it"
            yield check(what, error, high=bar, why=why, subject=f"{subject}, {name}", owner="usual")


POSITIONS = (0.0, 1e-45, -1e-38, 1e-10, 1e-4, 1.0, 1.00009, 1e2, 1e4, 1e38, math.inf, math.nan)


def positions(context: StabilityContext) -> Iterator[Found]:
    bar = BARS["2^k", 10]
    places = {value: torch.tensor([[value]]) for value in POSITIONS}
    inside = {value for value in POSITIONS if abs(value) <= REACH}
    accepted = {value for value, x in places.items() if error_of(ValueError, checked_positions, x) is None}
    wrong = [f"{value:g}" for value in inside ^ accepted]
    what = f"positions refused within ±{REACH:g} or accepted beyond"
    yield check(what, len(wrong), high=0, why=", ".join(wrong), subject="checked")
    worst = worst_of(largest_error(encode(places[x], base, 10), x, base) for x in inside for base in BASES.values())
    yield check("largest error of any band", worst, high=bar, subject="inside the box")
    for ladder, base in BASES.items():
        frequencies = frequency_ladder(base, 10)
        errors = {value: largest_error(fourier_features(x, frequencies), value, base) for value, x in places.items()}
        not_finite = ", ".join(f"{value:g}" for value, error in errors.items() if not math.isfinite(error))
        worst, where = max((error, value) for value, error in errors.items() if math.isfinite(error))
        what = "largest error of any band, of the positions whose features are finite"
        why = f"at x = {where:g}; not finite at {not_finite}"
        yield check(what, worst, high=bar, why=why, subject=f"{ladder}, unchecked", owner=OWNERS[ladder])


def largest_error(features: Tensor, value: float, base: float) -> float:
    """Return the largest error over ten bands; NaN if a feature or the position is not finite."""
    if not math.isfinite(value) or not bool(torch.isfinite(features).all()):
        return math.nan
    x = torch.tensor([value])
    return max(float((band_of(features, band) - true_waves(x, base, band)).abs().max()) for band in range(10))


RATIOS: dict[str, tuple[float, Owner]] = {"2": (2.0, "usual"), "φ": (PHI, "paper"), "1.65": (1.65, "ours")}
"""The ratio of a ladder and its owner. The third is the control: neither a Pisot number nor an integer."""
DISTANCES = (2.0 * PHI / math.sqrt(5.0), 2.0 / math.sqrt(5.0), 1.0)
"""The distances of possible ghosts: φ^k is near the Lucas number L_k, so that cos(π φ^k d) returns to 1 there."""
BURST = 0.05
"""The standard deviation of the burst's envelope."""
GHOST_BAR = 0.1


def kernel(base: float, bands: int, distance: Float[Tensor, " points"]) -> Float[Tensor, " points"]:
    """Return mean_k cos(π f_k d): the inner product of two encoded points at that distance, 1 at d = 0."""
    f = frequency_ladder(base, bands, torch.float64)
    return torch.cos(math.pi * f * distance.double().unsqueeze(-1)).mean(dim=-1)


def _straight(panel: str, name: str, x_label: str, y_label: str, x: Tensor, y: Tensor) -> Series:
    return Series(panel, 8, name, x_label, y_label, x.tolist(), y.tolist(), log_x=False, log_y=False)


def ghosts(context: StabilityContext) -> Iterator[Found]:
    d = torch.linspace(0.0, 2.0, 801, dtype=torch.float64)
    for bands in (10, 14):
        for name, (base, _) in RATIOS.items():
            panel, label = f"Likeness of two points, L = {bands}", "mean of cos(π f d)"
            yield _straight(panel, f"ratio {name}", "distance", label, d, kernel(base, bands, d))
    for name, (base, owner) in RATIOS.items():
        gaps = {distance: ghost(base, 14, distance, context.quick) for distance in DISTANCES}
        shares = {distance: abs(gap.share) for distance, gap in gaps.items()}
        where = max(shares, key=lambda distance: shares[distance])
        what = "share of the burst that appears in an unseen gap, the worst of three distances"
        why, subject = f"at distance {where:.4g}", f"ratio {name}, L = 14"
        yield check(what, shares[where], high=GHOST_BAR, why=why, subject=subject, owner=owner)
        for distance, gap in gaps.items():
            panel = f"An unseen gap, {distance:.4g} from a burst, L = 14 (the truth is 0)"
            lines = {f"ratio {name}": gap.predicted}
            if base == PHI:
                lines["the burst, moved by that distance"] = gap.burst
            for line, values in lines.items():
                yield _straight(panel, line, "distance from its middle", "prediction", gap.offset[::3], values[::3])
    yield from _gratings(context.quick)


def burst(x: Tensor, centre: float) -> Tensor:
    """Return a short wave packet of 8 frequencies between 6 and 60 cycles on [−1, 1], with fixed phases."""
    generator = generator_for("stability", "burst")
    cycles = 6.0 * 10.0 ** torch.rand(8, generator=generator)
    phases = 2.0 * math.pi * torch.rand(8, generator=generator)
    offset = (x - centre).unsqueeze(-1)
    waves = torch.cos(math.pi * cycles * offset + phases).sum(dim=-1) / 2.0
    return waves * torch.exp(-0.5 * ((x - centre) / BURST) ** 2)


class Gap(NamedTuple):
    """The prediction of networks in an unseen gap, in which the truth is 0, at [places]."""

    share: float
    """The share ⟨prediction, burst⟩ / ⟨burst, burst⟩."""
    offset: Tensor
    predicted: Tensor
    burst: Tensor
    """The prediction of a perfect ghost."""


def ghost(base: float, bands: int, distance: float, quick: bool) -> Gap:
    """Return the prediction in an unseen gap of ±3 widths at `distance` from the single burst."""
    centre = -0.5 * distance
    seen = 2.0 * torch.rand(1024, generator=generator_for("stability", "ghost")) - 1.0
    seen = seen[(seen - (centre + distance)).abs() > 3.0 * BURST]
    gap = centre + distance + torch.linspace(-3.0 * BURST, 3.0 * BURST, 301)
    networks = 2 if quick else 4
    there = burst(gap, centre + distance)
    predicted = fitted(base, bands, seen, burst(seen, centre).expand(networks, -1), gap, 5 if quick else 400)
    share = float((predicted @ there).mean() / (there @ there))
    return Gap(share, gap - (centre + distance), predicted.mean(dim=0), there)


def fitted(
    base: float,
    bands: int,
    seen: Float[Tensor, " points"],
    values: Float[Tensor, "networks points"],
    places: Float[Tensor, " places"],
    steps: int,
) -> Float[Tensor, "networks places"]:
    """Train networks of two hidden layers of 64, each on its `values` at `seen`; return their outputs at `places`."""
    f = frequency_ladder(base, bands)
    inputs, queries = (fourier_features(x.unsqueeze(-1), f) for x in (seen, places))
    networks, widths = len(values), [inputs.shape[1], 64, 64, 1]
    generator = generator_for("stability", "networks")
    weights = [
        ((2.0 * torch.rand(networks, a, b, generator=generator) - 1.0) * (6.0 / (a + b)) ** 0.5).requires_grad_()
        for a, b in pairwise(widths)
    ]
    biases = [torch.zeros(networks, 1, b, requires_grad=True) for b in widths[1:]]

    def network(x: Tensor) -> Tensor:
        h = x.expand(networks, -1, -1)
        for index, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
            h = torch.baddbmm(bias, h, weight)
            h = torch.relu(h) if index < 2 else h
        return h[..., 0]

    optimiser = torch.optim.Adam([*weights, *biases], lr=5e-3, fused=True)
    for step in range(steps):
        for group in optimiser.param_groups:
            group["lr"] = 5e-3 * 0.02 ** (step / steps)
        optimiser.zero_grad()
        # a sum over networks keeps them independent
        ((network(inputs) - values) ** 2).mean(dim=-1).sum().backward()
        optimiser.step()
    with torch.no_grad():
        return network(queries)


GRATINGS = (27.0, 37.0, 61.0, 100.0, 175.0, 284.0)
"""Cycles on [−1, 1]; none is a sum of two frequencies of a ladder, whose product of waves would fit it."""
POINTS = 512
"""The number of random training points; 256 cycles are the Nyquist limit of 512 evenly spread points."""
LADDERS: dict[str, tuple[float, int]] = {
    "2, L = 10": (2.0, 10),
    "2, L = 7": (2.0, 7),
    "φ, L = 10": (PHI, 10),
    "φ, L = 14": (PHI, 14),
    "1.65, L = 13": (1.65, 13),
}


def _gratings(quick: bool) -> Iterator[Found]:
    generator = generator_for("stability", "gratings")
    seen = 2.0 * torch.rand(POINTS, generator=generator) - 1.0
    unseen = 2.0 * torch.rand(2 * POINTS, generator=generator) - 1.0
    cycles = torch.tensor(GRATINGS).unsqueeze(-1)
    truth_unseen, truth_seen = (torch.sin(math.pi * cycles * x + 0.7) for x in (unseen, seen))
    panel, label = "Neutral gratings: error at unseen places", "RMSE (the signal has 0.71)"
    rows: Rows = []
    for name, (base, bands) in LADDERS.items():
        learnt = fitted(base, bands, seen, truth_seen, torch.cat([unseen, seen]), 5 if quick else 600)
        parts = zip(learnt.split([len(unseen), len(seen)], dim=-1), (truth_unseen, truth_seen), strict=True)
        test, train = (((part - truth) ** 2).mean(dim=-1).sqrt().tolist() for part, truth in parts)
        rows.append([name, *(f"{a:.2g} / {b:.2g}" for a, b in zip(test, train, strict=True))])
        yield Series(panel, 8, name, "cycles on [−1, 1]", label, list(GRATINGS), test, log_y=False)
    columns = ["ladder", *(f"{cycles:g} cycles" for cycles in GRATINGS)]
    title = f"RMSE test / train of a grating learnt from {POINTS} points (256 cycles: Nyquist)"
    yield Table("gratings", 8, title, columns, rows)
