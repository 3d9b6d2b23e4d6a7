"""E3: distant points that an encoding cannot tell apart, and gratings on frequencies that favour no ladder."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor

from baselines.numerics.encoding import PHI, fourier_features, frequency_ladder
from harness.chart_record import Series, Table
from harness.seeds import generator_for
from harness.stability.situation import Finding, Situation
from harness.stability_record import Whose, judged

RATIOS: dict[str, tuple[float, Whose]] = {"2": (2.0, "usual"), "φ": (PHI, "paper"), "1.65": (1.65, "ours")}
"""Ratio of a ladder, and whose it is. The third is the control: neither a Pisot number nor an integer."""
DISTANCES = (2.0 * PHI / math.sqrt(5.0), 2.0 / math.sqrt(5.0), 1.0)
"""φ^k is within φ^−k of the Lucas number L_k, and L_k √5 / 2 = φ^k + …: cos(π φ^k d) returns to 1 at these."""
BURST = 0.05
"""Standard deviation of the burst's envelope."""


def kernel(base: float, bands: int, distance: Float[Tensor, " points"]) -> Float[Tensor, " points"]:
    """mean_k cos(π f_k d): the inner product of two encoded points at that distance, 1 at d = 0."""
    f = frequency_ladder(base, bands, torch.float64)
    return torch.cos(math.pi * f * distance.double().unsqueeze(-1)).mean(dim=-1)


def ghosts(situation: Situation) -> Iterator[Finding]:
    """E3: the kernel of each ladder, what a trained network puts into a gap, and neutral gratings."""
    d = torch.linspace(0.0, 2.0, 801, dtype=torch.float64)
    for bands in (10, 14):
        for name, (base, _) in RATIOS.items():
            yield Series(
                f"Likeness of two points, L = {bands}", 8, f"ratio {name}", "distance", "mean of cos(π f d)",
                d.tolist(), kernel(base, bands, d).tolist(), log_x=False, log_y=False,
            )  # fmt: skip
    rows: list[list[str | float | None]] = []
    for name, (base, whose_it_is) in RATIOS.items():
        gaps = [ghost(base, 14, distance, situation.quick) for distance in DISTANCES]
        found = [gap.share for gap in gaps]
        rows.append([f"ratio {name}", *found])
        worst = max(found, key=abs)
        yield judged(
            "E3", f"ratio {name}, L = 14", whose_it_is, abs(worst), GHOST_BAR,
            what="share of the burst that appears in a gap never seen, the worst of three distances",
            why=f"at distance {DISTANCES[found.index(worst)]:.4g}",
        )  # fmt: skip
        for distance, gap in zip(DISTANCES, gaps, strict=True):
            yield _across(distance, f"ratio {name}", gap.offset, gap.predicted)
            if base == PHI:
                yield _across(distance, "the burst, moved by that distance", gap.offset, gap.burst)
    columns = ["ladder, L = 14", *(f"at {distance:.4g}" for distance in DISTANCES)]
    yield Table("ghosts", 8, "Share of a burst that a trained network shows in a gap at a distance", columns, rows)
    yield from _gratings(situation.quick)


GHOST_BAR = 0.1
"""Measured: 0.05 for the control, and up to 0.07 at distances where a ladder has no lobe."""


def burst(x: Tensor, centre: float) -> Tensor:
    """A short wave packet of 8 frequencies between 6 and 60 cycles on [−1, 1], with fixed phases."""
    generator = generator_for("stability", "burst")
    cycles = 6.0 * 10.0 ** torch.rand(8, generator=generator)
    phases = 2.0 * math.pi * torch.rand(8, generator=generator)
    offset = (x - centre).unsqueeze(-1)
    waves = torch.cos(math.pi * cycles * offset + phases).sum(dim=-1) / 2.0
    return waves * torch.exp(-0.5 * ((x - centre) / BURST) ** 2)


@dataclass(frozen=True)
class Gap:
    """What networks say of a gap that they never saw, where nothing is."""

    share: float
    """⟨prediction, burst⟩ / ⟨burst, burst⟩."""
    offset: Float[Tensor, " places"]
    """From the middle of the gap."""
    predicted: Float[Tensor, " places"]
    """Mean over networks; the truth is 0."""
    burst: Float[Tensor, " places"]
    """What a perfect ghost would be."""


def _across(distance: float, name: str, offset: Tensor, values: Tensor) -> Series:
    return Series(
        f"A gap never seen, {distance:.4g} from a burst, L = 14 (the truth is 0)", 8, name, "distance from its middle",
        "prediction", offset[::3].tolist(), values[::3].tolist(), log_x=False, log_y=False,
    )  # fmt: skip


def ghost(base: float, bands: int, distance: float, quick: bool) -> Gap:
    """In a gap of ±3 widths at `distance` from the burst, unseen in training, where everything but the burst is 0."""
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
    asked: Float[Tensor, " places"],
    steps: int,
) -> Float[Tensor, "networks places"]:
    """What networks of two hidden layers of 64, each trained on its own `values` at `seen`, say at `asked`."""
    f = frequency_ladder(base, bands)
    inputs, places = (fourier_features(x.unsqueeze(-1), f) for x in (seen, asked))
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
        # a sum over networks: none sees the others
        ((network(inputs) - values) ** 2).mean(dim=-1).sum().backward()
        optimiser.step()
    with torch.no_grad():
        return network(places)


GRATINGS = (27.0, 37.0, 61.0, 100.0, 175.0, 284.0)
"""Cycles on [−1, 1]. At 160 = 128 + 32 base 2 would be five times better than at 99 or 230: a product of two of its
waves."""
POINTS = 512
"""Seen at random: 256 cycles are the Nyquist limit of as many evenly spread ones."""
LADDERS: dict[str, tuple[float, int]] = {
    "2, L = 10": (2.0, 10),
    "2, L = 7": (2.0, 7),
    "φ, L = 10": (PHI, 10),
    "φ, L = 14": (PHI, 14),
    "1.65, L = 13": (1.65, 13),
}


def nearest_member(cycles: float) -> float:
    """Relative distance of a grating to the nearest frequency of any ladder, or sum or difference of two of them.

    f_k π x has f_k cycles on [−1, 1].
    """
    ladders = [[0.0, *(base**k for k in range(20))] for base in {base for base, _ in LADDERS.values()}]
    made = {abs(one + sign * two) for ladder in ladders for one in ladder for two in ladder for sign in (1.0, -1.0)}
    return min(abs(cycles / frequency - 1.0) for frequency in made if frequency > 0.1)


def _gratings(quick: bool) -> Iterator[Finding]:
    closest = min(nearest_member(cycles) for cycles in GRATINGS)
    yield judged("E3", "gratings", "ours", closest, 0.01, sense="at_least",
                 what="relative distance of a grating to what a ladder or two of its members make")  # fmt: skip
    generator = generator_for("stability", "gratings")
    seen = 2.0 * torch.rand(POINTS, generator=generator) - 1.0
    asked = 2.0 * torch.rand(2 * POINTS, generator=generator) - 1.0
    cycles = torch.tensor(GRATINGS).unsqueeze(-1)
    rows: list[list[str | float | None]] = []
    for name, (base, bands) in LADDERS.items():
        truths = [torch.sin(math.pi * cycles * x + 0.7) for x in (asked, seen)]
        found = fitted(base, bands, seen, truths[1], torch.cat([asked, seen]), 5 if quick else 600)
        errors = [
            ((part - truth) ** 2).mean(dim=-1).sqrt().tolist()
            for part, truth in zip(found.split([len(asked), len(seen)], dim=-1), truths, strict=True)
        ]
        rows.append([name, *(f"{test:.2g} / {train:.2g}" for test, train in zip(*errors, strict=True))])
        yield Series(
            "Neutral gratings: error at places not seen", 8, name, "cycles on [−1, 1]", "RMSE (the signal has 0.71)",
            list(GRATINGS), errors[0], log_y=False,
        )  # fmt: skip
    columns = ["ladder", *(f"{cycles:g} cycles" for cycles in GRATINGS)]
    yield Table("gratings", 8, f"RMSE test / train of a grating learnt from {POINTS} points (256 cycles: Nyquist)",
                columns, rows)  # fmt: skip
