"""A method as a composition of named parts: the difference between two methods is visible on one screen."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

from torch import Tensor
from torch.nn.functional import relu, silu, softplus

from baselines.contract import Box, NetworkSize
from baselines.numerics.encoding import PHI, matched_bands

DENSITY_SCALE = 25.0
"""The unit of density of what is not searched (`baselines.methods.chosen`), per half of the longest side of the box: a
solid surface is within reach of ordinary weights. How density must scale with the unit of length is the subject of
Alpha Invariance (arXiv 2404.02155).
"""
START = 0.3
"""The density of a fresh field of what is not searched, per the same length: thin fog, which light reaches through."""


@dataclass(frozen=True)
class Parts:
    """The parts of a NeRF-like method; an ablation is `dataclasses.replace` of one of them.

    encoding    a name in `LADDERS`: "base2" (2^k), "phi" (φ^k, Eq. 2), …
    coordinates the unit of what is encoded: "box", normalised by the scene's box and times π (Listing 1), or "scene",
                scene units without π, as the released code of NeRF encodes positions and directions
    amplifier   a name in `baselines.amplifiers.AMPLIFIERS`
    skip        a name in `SKIPS`: "half" (the standard) or "phi" (Eq. 5, Listing 3)
    activation  a name in `ACTIVATIONS`: "relu" (Table 1), …, behind every hidden layer
    depth, width    layers and units of the density network; None: those that the run gives all networks
    quadrature  a name in `baselines.numerics.quadrature.QUADRATURES`
    sees_direction  whether colour may depend on the view direction
    density_scale   density σ where the amplifier gives 1: the unit of density. It is a slope for softplus, and for
                    the sigmoid of Listing 2 a ceiling too
    density_per     the length that this density is per: "box", half of the longest side of the scene's box, so that
                    no result depends on the unit in which poses are written, or "scene", one unit of the poses
    start           density of a fresh field, per the same length: a shift of the network's raw output. None: no
                    shift, as the paper's listings print it
    """

    encoding: str = "base2"
    coordinates: Literal["box", "scene"] = "box"
    amplifier: str = "none"
    skip: str = "half"
    activation: str = "relu"
    depth: int | None = None
    width: int | None = None
    quadrature: str = "midpoint"
    sees_direction: bool = True
    density_scale: float = DENSITY_SCALE
    density_per: Literal["box", "scene"] = "box"
    start: float | None = START

    def size(self, given: NetworkSize) -> NetworkSize:
        """Return the size of the networks, where a run gives all networks this one."""
        own = {"depth": self.depth, "width": self.width}
        return replace(given, **{name: value for name, value in own.items() if value is not None})

    @property
    def start_in_units(self) -> float | None:
        """Return the start in the unit of density, as an amplifier takes it; None without a shift."""
        return None if self.start is None else self.start / self.density_scale

    def density_unit(self, box: Box) -> float:
        """The density in 1 / scene unit where the amplifier gives 1."""
        return self.density_scale / (box.half_extent if self.density_per == "box" else 1.0)


@dataclass(frozen=True)
class Ladder:
    """The frequencies f_k = base^k of an encoding, and how many of them are used where the paper has `bands`."""

    base: float
    bands: Callable[[int], int] = lambda bands: bands


def reaching(base: float, bands: int) -> int:
    """Return how many bands base^k come nearest to the top frequency 2^(bands − 1): 14 for φ where 2^k has 10."""
    return 1 + round((bands - 1) * math.log(2.0, base))


LADDERS: dict[str, Ladder] = {
    "base2": Ladder(2.0),
    "base2_matched": Ladder(2.0, lambda bands: matched_bands(PHI, bands)),
    "phi": Ladder(PHI),
    "phi_matched": Ladder(PHI, lambda bands: reaching(PHI, bands)),
    "base1.65": Ladder(1.65),
    "none": Ladder(2.0, lambda bands: 0),
}
"""The encodings by name.

base2_matched reaches no further than φ^(L−1), phi_matched as far as 2^(L−1); base1.65 has nothing golden about it
and reaches about as far as φ; none uses raw coordinates alone, for positions and directions.
"""


def encoding_bands(encoding: str, bands: int) -> int:
    """Return the number of frequencies of an encoding where the paper has `bands` of them."""
    return LADDERS[encoding].bands(bands)


SKIPS: dict[str, Callable[[int], int]] = {
    "half": lambda depth: depth // 2,
    "phi": lambda depth: int(PHI * depth / 2),
}
"""Map depth to the layer after which the encoded position is concatenated: depth/2, ⌊φ·depth/2⌋."""


ACTIVATIONS: dict[str, Callable[[Tensor], Tensor]] = {"relu": relu, "silu": silu, "softplus": softplus}
"""The functions between two layers of a network by name."""


def skip_layer(skip: str, depth: int) -> int:
    """Return the index of the layer behind which the encoded position enters again."""
    return min(SKIPS[skip](depth), depth - 1)
