"""A method as a composition of named parts: what differs between two methods is visible on one screen."""

from dataclasses import dataclass

from baselines.numerics.encoding import PHI, matched_bands


@dataclass(frozen=True)
class Parts:
    """The parts of a NeRF-like method; an ablation is `dataclasses.replace` of one of them.

    encoding    "base2" (2^k), "phi" (φ^k, Eq. 2) or "base2_matched" (2^k only as far as φ^(L−1) reaches)
    amplifier   a name in `baselines.amplifiers.AMPLIFIERS`
    skip        "half" (after layer depth/2, the standard) or "phi" (after layer ⌊φ·depth/2⌋, Eq. 5, Listing 3)
    quadrature  a name in `baselines.numerics.quadrature.QUADRATURES`
    """

    encoding: str = "base2"
    amplifier: str = "none"
    skip: str = "half"
    quadrature: str = "midpoint"


ENCODING_BASE = {"base2": 2.0, "base2_matched": 2.0, "phi": PHI}


def encoding_bands(encoding: str, bands: int) -> int:
    """Number of frequencies of an encoding where the paper has `bands` of them."""
    return matched_bands(PHI, bands) if encoding == "base2_matched" else bands


def skip_layer(skip: str, depth: int) -> int:
    """Index of the layer after which the encoded position is concatenated; it feeds the next layer or the heads."""
    layer = {"half": depth // 2, "phi": int(PHI * depth / 2)}[skip]
    return min(layer, depth - 1)
