"""The scenes of the ladders: one function per ladder, value → scene."""

from collections.abc import Callable

from scenes.catalog.ladders.ladders import LADDERS
from scenes.catalog.stress.fog import fog
from scenes.catalog.stress.light import hdr
from scenes.catalog.stress.patterns import chequers
from scenes.catalog.stress.plain import textured_ball
from scenes.catalog.stress.scales import described_as
from scenes.catalog.stress.wires import pixel_size, wires
from scenes.modelling.normalise import Similarity
from scenes.modelling.scene import Scene

RESOLUTION = 40
"""The width in pixels of the views that the ladders are meant for."""


def frequency(name: str, cycles: float) -> Scene:
    """Make a chequered ball with `cycles` cycles around it, and half of that from pole to pole."""
    pixels = chequers(int(cycles), int(2 * cycles), (0.92, 0.75, 0.25), (0.08, 0.15, 0.45))
    return textured_ball(name, f"A chequered ball, {cycles:g} cycles around it", pixels)


def thinness(name: str, width: float) -> Scene:
    title = f"A cage of black wires {width:g} pixels thin at {RESOLUTION} pixels"
    return wires(name, title, width * pixel_size(RESOLUTION))


def scale(name: str, unit: float) -> Scene:
    title = f"The unit scene described at scale {unit:g}, normalised"
    return described_as(name, title, Similarity(unit, (0.0, 0.0, 0.0)))


BUILDERS: dict[str, Callable[[str, float], Scene]] = {
    "frequency": frequency,
    "thinness": thinness,
    "density": lambda name, tau: fog(name, f"Black fog of optical depth {tau:g} along its diameter", tau),
    "dynamic_range": lambda name, ratio: hdr(
        name, f"A lamp {ratio:g} times as bright as the floor that it lights", ratio
    ),
    "scale": scale,
}
SCENES: list[Scene] = [
    BUILDERS[ladder.name](rung, value)
    for ladder in LADDERS.values()
    for rung, value in zip(ladder.scenes, ladder.values, strict=True)
]
