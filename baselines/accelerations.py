"""What makes training and rendering cheaper. Each entry can be switched off by its name and changes no result beyond a
bound that its tests state; the two that do change what is summed (grid, precision) are settings of their own.
"""

from dataclasses import dataclass, fields, replace


@dataclass(frozen=True)
class Accelerations:
    """All on by default, for every method to which they can apply."""

    fused: bool = True
    """The field's forward and backward pass are written out by hand, in cache-sized blocks of points."""
    recurrence: bool = True
    """Bands of the encoding follow from the bands below them, where that is as accurate as a sine of its own."""
    grid: bool = True
    """Empty space is skipped by an occupancy grid (`GridSettings` says how)."""
    clipping: bool = True
    """Rays are cut to the scene's box, and those that miss it are not sampled."""
    early_stop: bool = True
    """Rendering without gradients leaves a ray once it is opaque (not where density depends on the call)."""
    directions: bool = True
    """Scenes that look the same from all sides get no view direction."""

    def without(self, names: tuple[str, ...]) -> "Accelerations":
        """The named ones switched off; raises `ValueError` naming the known ones."""
        known = [one.name for one in fields(self)]
        unknown = [name for name in names if name not in known]
        if unknown:
            raise ValueError(f"unknown {' '.join(map(repr, unknown))}; known: {' '.join(known)}")
        return replace(self, **dict.fromkeys(names, False))


EVERY_ACCELERATION = Accelerations()
NO_ACCELERATION = Accelerations(*(False for _ in fields(Accelerations)))
