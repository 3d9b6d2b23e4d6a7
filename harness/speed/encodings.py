"""Question 5: bands of the encoding from the bands below them, against a sine and a cosine for each."""

from collections.abc import Iterator

import torch
from torch import Tensor

from baselines.numerics.encoding import PHI, encode, fourier_features, frequency_ladder
from harness.speed.situation import Situation
from harness.speed.timing import interleaved, measured, quotients
from harness.speed_record import Measurement

ITEM = 5
POINTS = 65536
"""Of a step of the paper."""


def measure(situation: Situation) -> Iterator[Measurement]:
    points = 512 if situation.quick else POINTS
    x = 2.0 * torch.rand(points, 3, generator=torch.Generator().manual_seed(0)) - 1.0
    x = x.to(situation.device)
    for name, base in (("phi", PHI), ("base2", 2.0)):
        for bands in (10, 4):
            yield from _compare(situation, name, base, bands, x)


def _compare(situation: Situation, name: str, base: float, bands: int, x: Tensor) -> Iterator[Measurement]:
    ladder = frequency_ladder(base, bands).to(x.device)
    seconds = interleaved(
        {
            "direct": lambda: fourier_features(x, ladder),
            "sines": lambda: encode(x, base, bands, recurrence=False),
            "recurrence": lambda: encode(x, base, bands, recurrence=True),
        },
        situation.repeats(9),
        situation.synchronise,
        0.01 if situation.quick else 0.1,
    )
    symbol = "φ^k" if name == "phi" else "2^k"
    id, what = f"encoding.{name}.{bands}", f"{symbol}, L = {bands}"
    detail = f"{len(x)} points of 3 axes, float32, {situation.threads} threads"
    yield measured(
        f"{id}.ratio",
        ITEM,
        f"Encoding {what}, recurrence against direct sines and cosines",
        quotients(seconds["direct"], seconds["recurrence"]),
        "×",
        target=3.0 if (name, bands) == ("phi", 10) and situation.device.type == "cpu" else None,
        detail=detail,
    )
    yield measured(
        f"{id}.sines.ratio",
        ITEM,
        f"Encoding {what}, `encode` without recurrence against direct",
        quotients(seconds["direct"], seconds["sines"]),
        "×",
        detail=detail,
    )
    for side, features in (
        ("direct", fourier_features(x, ladder)),
        ("recurrence", encode(x, base, bands, recurrence=True)),
    ):
        yield measured(
            f"{id}.{side}.error",
            ITEM,
            f"Largest error of {what} against float64, {side}",
            [largest_error(features, x, base, bands)],
            "",
            detail=f"{len(x)} random points in [−1, 1]³",
        )


def largest_error(features: Tensor, x: Tensor, base: float, bands: int) -> float:
    """Absolute, against sines and cosines in float64 of the very same float32 coordinates."""
    ladder = torch.tensor([base**k for k in range(bands)], dtype=torch.float64, device=x.device)
    return float((features.double() - fourier_features(x.double(), ladder)).abs().max())
