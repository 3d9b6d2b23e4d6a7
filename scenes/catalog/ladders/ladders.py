"""Ladders: one difficulty in five rungs, from a scene that any radiance field can learn to a scene that none can.

Rung i of ladder `name` is the scene `name_i`, built by one parametric function (`scenes.catalog.ladders.rungs`).
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Ladder:
    name: str
    title: str
    unit: str
    values: tuple[float, ...]
    """The values, one per rung, the easiest first."""
    hard: str

    @property
    def scenes(self) -> tuple[str, ...]:
        return tuple(f"{self.name}_{number}" for number in range(1, len(self.values) + 1))


_ALL = (
    Ladder("frequency", "Finer and finer texture", "cycles around the ball", (2, 5, 11, 21, 42),
           "near 43 cycles a period is two pixels wide at 40 pixels, and narrower towards the rim"),
    Ladder("thinness", "Thinner and thinner wires", "pixels of width at 40 pixels", (4.0, 2.0, 1.0, 0.5, 0.25),
           "rays through pixel centres miss what is thinner than a pixel, though every pixel knows its share"),
    Ladder("density", "Denser and denser fog", "optical depth along the diameter", (0.5, 2.0, 8.0, 32.0, 128.0),
           "the smooth cloud becomes a wall: density grows without bound, its gradient vanishes inside"),
    Ladder("dynamic_range", "A brighter and brighter lamp", "lamp : floor, radiance", (20.0, 1e2, 1e3, 1e4, 1e6),
           "in display colour little, because what is brighter than white is clipped for all: only the lamp's rim "
           "widens, where a pixel that it covers by a millionth is white; linear light shows what is lost"),
    Ladder("scale", "The same scene in other units", "scale of the description", (1.0, 1e-2, 1e2, 1e-4, 1e4),
           "nothing, once it is normalised: a control, on which a method that breaks depends on the unit of length"),
)  # fmt: skip
LADDERS: dict[str, Ladder] = {ladder.name: ladder for ladder in _ALL}
