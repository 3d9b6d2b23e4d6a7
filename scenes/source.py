"""What a reader of posed images gives, whatever the format: `scenes.foreign` finds the reader of a path."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenes.errors import InputError
from scenes.transforms import Frames


@dataclass(frozen=True)
class Region:
    """Where what is seen lies; None: not said. Raises `InputError` for a box or distances that are none."""

    bounds: tuple[float, ...] | None = None
    """Lower corner, then upper corner: six numbers."""
    near: float | None = None
    far: float | None = None

    def __post_init__(self) -> None:
        if self.bounds is not None:
            box = self.bounds
            if len(box) != 6 or not all(map(math.isfinite, box)) or any(box[i] >= box[i + 3] for i in range(3)):
                raise InputError(f"bounds {list(box)}: give two finite corners, x y z each, the lower one first")
        near, far = (0.0 if self.near is None else self.near), (math.inf if self.far is None else self.far)
        zero = self.near is not None and near <= 0
        if zero or not near < far or math.isinf(near) or (self.far is not None and math.isinf(far)) or math.isnan(far):
            raise InputError(f"near {self.near} and far {self.far}: distances must be positive, near the smaller one")

    @property
    def box(self) -> np.ndarray | None:
        """float64 [2, 3]."""
        return None if self.bounds is None else np.array(self.bounds, dtype=np.float64).reshape(2, 3)

    def over(self, other: "Region") -> "Region":
        """What is said here, else what `other` says."""
        return Region(
            other.bounds if self.bounds is None else self.bounds,
            other.near if self.near is None else self.near,
            other.far if self.far is None else self.far,
        )


@dataclass(frozen=True)
class Source:
    """Posed images of somebody: poses are read, pixels not yet."""

    name: str
    frames: Callable[[str], Frames | None]
    """All views of a split, or None where it need not be there; raises `InputError` for what cannot be trusted."""
    pixels: Callable[[Path], np.ndarray]
    """Straight RGBA float32 [h, w, 4] of one of the frames' files; raises `InputError`."""
    region: Region
    """As the format says it; what it leaves open is found from the cameras (`scenes.region`)."""
    notes: tuple[str, ...] = ()
    """What was assumed, a sentence each: whoever trains on it should know."""
