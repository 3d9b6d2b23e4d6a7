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

    @property
    def scenes(self) -> tuple[str, ...]:
        return tuple(f"{self.name}_{number}" for number in range(1, len(self.values) + 1))


_ALL = (
    Ladder("frequency", "Finer and finer texture", "cycles around the ball", (2, 5, 11, 21, 42)),
    Ladder("thinness", "Thinner and thinner wires", "pixels of width at 40 pixels", (4.0, 2.0, 1.0, 0.5, 0.25)),
    Ladder("density", "Denser and denser fog", "optical depth along the diameter", (0.5, 2.0, 8.0, 32.0, 128.0)),
    Ladder("dynamic_range", "A brighter and brighter lamp", "lamp : floor, radiance", (20.0, 1e2, 1e3, 1e4, 1e6)),
    Ladder("scale", "The same scene in other units", "scale of the description", (1.0, 1e-2, 1e2, 1e-4, 1e4)),
)
LADDERS: dict[str, Ladder] = {ladder.name: ladder for ladder in _ALL}
