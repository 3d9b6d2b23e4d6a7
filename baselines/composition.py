"""A method as a composition of named parts: the difference between two methods is visible on one screen."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

from torch import Tensor
from torch.nn.functional import huber_loss, l1_loss, relu, silu, softplus

from baselines.contract import Box, NetworkSize
from baselines.numerics.encoding import PHI, matched_bands

DENSITY_SCALE = 25.0
"""The unit of density of methods whose unit is not searched (`baselines.methods.chosen`), per half of the longest side
of the box: ordinary weights reach a solid surface (Alpha Invariance, arXiv 2404.02155).
"""
START = 0.3
"""The density of a fresh field of such a method, per the same length: thin fog, which light passes through."""


@dataclass(frozen=True)
class Parts:
    """The parts of a NeRF-like method; an ablation is `dataclasses.replace` of one of them.

    encoding    a name in `LADDERS`: "base2" (2^k), "phi" (φ^k, Eq. 2), …
    coordinates the unit of what is encoded: "box", normalised by the scene's box and times π (Listing 1), or "scene",
                scene units without π, as the released code of NeRF encodes positions and directions
    amplifier   a name in `baselines.amplifiers.AMPLIFIERS`
    skip        a name in `SKIPS`: "half" (the standard) or "phi" (Eq. 5, Listing 3)
    activation  a name in `ACTIVATIONS`: "relu" (Table 1), …, after every hidden layer
    depth, width    layers and units of the density network; None: those that the run gives all networks
    loss        a name in `LOSSES`: "squared" (the original NeRF; the paper names none), …
    learning_rate, last_learning_rate, decay, warm_up_steps     its schedule; None: that of the run
    precision   that of its matrix multiplications; None: that of the run
    quadrature  a name in `baselines.numerics.quadrature.QUADRATURES`
    sees_direction  whether colour may depend on the view direction
    density_scale   density σ where the amplifier gives 1: the unit of density. It is a slope for softplus, and for
                    the sigmoid of Listing 2 also an upper limit
    density_per     the length that density is counted per: "box", half of the longest side of the scene's box, so that
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
    loss: str = "squared"
    learning_rate: float | None = None
    last_learning_rate: float | None = None
    decay: str | None = None
    warm_up_steps: int | None = None
    precision: str | None = None
    quadrature: str = "midpoint"
    sees_direction: bool = True
    density_scale: float = DENSITY_SCALE
    density_per: Literal["box", "scene"] = "box"
    start: float | None = START

    def size(self, given: NetworkSize) -> NetworkSize:
        """Return the size of its networks, where a run gives all networks the size `given`."""
        return replace(given, **self._given("depth", "width"))

    @property
    def own_training(self) -> dict[str, Any]:
        """Return its loss, and its schedule and precision if they are not the run's, by name."""
        return ({} if self.loss == Parts.loss else {"loss": self.loss}) | self.settings

    @property
    def settings(self) -> dict[str, Any]:
        """Return the settings that replace those of the run, under their names in `TrainSettings`."""
        return self._given("learning_rate", "last_learning_rate", "decay", "warm_up_steps", "precision")

    def _given(self, *names: str) -> dict[str, Any]:
        return {name: value for name in names if (value := getattr(self, name)) is not None}

    @property
    def start_in_units(self) -> float | None:
        """Return the start in the unit of density, as an amplifier takes it; None without a shift."""
        return None if self.start is None else self.start / self.density_scale

    def density_unit(self, box: Box) -> float:
        """Return the density in 1 / scene unit where the amplifier gives 1."""
        return self.density_scale / (box.half_extent if self.density_per == "box" else 1.0)


@dataclass(frozen=True)
class Ladder:
    """The frequencies f_k = base^k of an encoding."""

    base: float
    bands: Callable[[int], int] = lambda bands: bands
    """Map the paper's number of frequencies to that of the encoding."""


def reaching(base: float, bands: int) -> int:
    """Return the number of bands of base^k whose top frequency is nearest to 2^(bands − 1): 14 for φ, bands = 10."""
    return 1 + round((bands - 1) * math.log(2.0, base))


LADDERS: dict[str, Ladder] = {
    "base2": Ladder(2.0),
    "base2_matched": Ladder(2.0, lambda bands: matched_bands(PHI, bands)),
    "phi": Ladder(PHI),
    "phi_matched": Ladder(PHI, lambda bands: reaching(PHI, bands)),
    "base1.65": Ladder(1.65),
    "none": Ladder(2.0, lambda bands: 0),
}
"""base2_matched reaches no further than φ^(L−1), phi_matched as far as 2^(L−1). base1.65 is the control of the golden
ratio: it reaches about as far as φ. none has only the raw coordinates, for positions and directions.
"""


SKIPS: dict[str, Callable[[int], int]] = {
    "half": lambda depth: depth // 2,
    "phi": lambda depth: int(PHI * depth / 2),
}
"""Map depth to the layer after which the encoded position is concatenated: depth/2, ⌊φ·depth/2⌋."""


ACTIVATIONS: dict[str, Callable[[Tensor], Tensor]] = {"relu": relu, "silu": silu, "softplus": softplus}


def squared(rendered: Tensor, truth: Tensor) -> Tensor:
    return ((rendered - truth) ** 2).mean()


def huber(rendered: Tensor, truth: Tensor) -> Tensor:
    """Return the mean of Huber's loss, which is squared up to an error of 0.1 and linear beyond."""
    return huber_loss(rendered, truth, delta=0.1)


LOSSES: dict[str, Callable[[Tensor, Tensor], Tensor]] = {"squared": squared, "absolute": l1_loss, "huber": huber}
"""The losses of rendered and true display colours [rays, 3] by name."""


def skip_layer(skip: str, depth: int) -> int:
    return min(SKIPS[skip](depth), depth - 1)
