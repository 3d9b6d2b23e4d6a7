"""The unit of length: brings a description of any size and place to unit scale about the origin.

Mitsuba moves the origin of a secondary ray off its surface by 8.9e-5 (1 + |p|), an absolute length. Measured on a
scene with close neighbours: 1 % too bright at scale 1e-3 or 1e3 away from the origin, 9 % at 1e-4 or 1e4. So a
description far from unit scale is normalised before it is rendered, and refused if it would be rendered as it is.
"""

from dataclasses import dataclass

import numpy as np

from scenes.files.errors import InputError
from scenes.modelling.placement import VISIBLE_RADIUS
from scenes.modelling.scene import Description, Scene

FRAMED = (0.1, 10.0)
"""The range of half the longest side that suits cameras 4 units away; anything else is normalised."""
SOUND = (1e-2, 1e2)
"""The range of half the longest side that Mitsuba renders without a visible bias (0.14 % at 1e-2)."""
FARTHEST = 1e2
"""The largest distance from the origin without a visible bias."""
LARGEST_RATIO = 102.0
"""The largest ratio of 1 + |p| to half the longest side without a visible bias: that of a unit, `FARTHEST` away."""
LARGEST_HALF = 1e4
"""The largest half of the longest side: cameras that see all of it stand within the far plane of `scenes.rendering`."""

_UNIT_BOXES = {
    "cube": ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)),
    "rectangle": ((-1.0, -1.0, 0.0), (1.0, 1.0, 0.0)),
    "disk": ((-1.0, -1.0, 0.0), (1.0, 1.0, 0.0)),
}
SHAPES = frozenset({"mesh", "sphere", "cylinder", *_UNIT_BOXES})
INFINITE = frozenset({"constant", "envmap", "directional"})
"""The lights that are invariant under uniform scaling and translation."""


@dataclass(frozen=True)
class Similarity:
    """The map x → scale · x + shift, which keeps angles, and so the transport of light."""

    scale: float
    shift: tuple[float, float, float]

    @property
    def matrix(self) -> np.ndarray:
        result = np.diag([self.scale, self.scale, self.scale, 1.0])
        result[:3, 3] = self.shift
        return result

    @property
    def inverse(self) -> "Similarity":
        x, y, z = (-value / self.scale for value in self.shift)
        return Similarity(1.0 / self.scale, (x, y, z))

    def points(self, x: np.ndarray) -> np.ndarray:
        return np.asarray(x * self.scale + self.shift)

    def applied(self, description: Description) -> Description:
        """Return the same scene in the other unit; raises `InputError` for entries that cannot be transformed here."""
        return {name: self._entry(name, entry) for name, entry in description.items()}

    def _entry(self, name: str, entry: object) -> object:
        if not isinstance(entry, dict) or entry.get("type") in INFINITE:
            return entry
        _known(name, entry)
        inner = {key: self._inside(value) for key, value in entry.items()}
        if entry["type"] == "mesh":
            moved = np.asarray(entry["vertices"], dtype=np.float64) * self.scale + self.shift
            return {**inner, "vertices": moved.astype(np.float32)}
        return {**inner, "to_world": self.matrix @ np.asarray(entry.get("to_world", np.eye(4)), dtype=np.float64)}

    def _inside(self, value: object) -> object:
        """Transform the lengths and inverse lengths inside a shape's entry: the density of media, heights of bumps."""
        if not isinstance(value, dict):
            return value
        changed = {key: self._inside(inner) for key, inner in value.items()}
        kind = value.get("type")
        if kind in ("homogeneous", "heterogeneous"):
            changed["scale"] = value.get("scale", 1.0) / self.scale
        elif kind == "bumpmap":
            changed["scale"] = value.get("scale", 1.0) * self.scale
        elif kind == "gridvolume":
            changed["to_world"] = self.matrix @ np.asarray(value.get("to_world", np.eye(4)), dtype=np.float64)
        return changed


def box_of(description: Description) -> np.ndarray | None:
    """Return the corners [2, 3] of the smallest box around the description's shapes; None without shapes. Raises
    `InputError` for a shape whose size is not known here, or is not finite.
    """
    shapes = [
        (name, entry)
        for name, entry in description.items()
        if isinstance(entry, dict) and entry.get("type") not in INFINITE
    ]
    corners = np.array([_box(name, entry) for name, entry in shapes])
    return np.array([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)]) if shapes else None


def to_unit(box: np.ndarray) -> Similarity:
    """Bring that box's centre to the origin and half its longest side to 1. Raises `InputError` for a point."""
    half = float((box[1] - box[0]).max()) / 2
    if not half > 0:
        raise InputError(f"everything lies in one point, {box[0].tolist()}: give the shapes an extent")
    x, y, z = (-float(value) / half for value in (box[0] + box[1]) / 2)
    return Similarity(1.0 / half, (x, y, z))


def normalised(scene: Scene) -> tuple[Description, Similarity | None]:
    """Return the description at unit scale about the origin, and the applied similarity; None if none was needed."""
    description = scene.build()
    entries = {name: entry for name, entry in description.items() if isinstance(entry, dict)}
    box = box_of({name: entry for name, entry in entries.items() if entry.get("type") in SHAPES})
    if box is None or _within(box, FRAMED, FRAMED[1]):
        return description, None
    # only now every entry must be of a kind that can be moved
    box = box_of(description)
    assert box is not None
    change = to_unit(box)
    return change.applied(description), change


def fitted(scene: Scene) -> tuple[Description, Similarity | None]:
    """Normalise a user's scene so that every camera sees all of it, unless the size of a shape is unknown here:
    `scenes.rendering.writer` then checks Mitsuba's box.
    """
    description, change = normalised(scene)
    try:
        box = box_of(description)
    except InputError:
        return description, change
    if change is not None or box is None or np.linalg.norm(np.abs(box).max(axis=0)) <= VISIBLE_RADIUS:
        return description, change
    half = 0.5 * float(np.linalg.norm(box[1] - box[0]))
    x, y, z = (-float(value) * VISIBLE_RADIUS / half for value in box.mean(axis=0))
    fit = Similarity(VISIBLE_RADIUS / half, (x, y, z))
    return fit.applied(description), fit


def check_scale(box: np.ndarray) -> None:
    """Raise `InputError` if rendering the geometry in that box [2, 3] as it is would be biased."""
    if not _within(box, SOUND, FARTHEST):
        half, away = _measures(box)
        raise InputError(
            f"the scene is {2 * half:.3g} units long and {away:.3g} from the origin: Mitsuba's ray epsilon makes such "
            "images too bright (9 % at scale 1e-4 or 1e4 away); bring it to unit scale with scenes.modelling.normalise "
            f"(half its longest side {SOUND[0]:g} to {SOUND[1]:g}, centre within {FARTHEST:g})"
        )


def check_unit(box: np.ndarray) -> None:
    """Raise `InputError` if rendering the geometry in that box [2, 3] would be biased, with cameras about it in its own
    unit: the ray epsilon grows with the distance from the origin, so only its ratio to the size matters.
    """
    half, away = _measures(box)
    if not (half > 0 and (1.0 + away + half) / half <= LARGEST_RATIO and half <= LARGEST_HALF):
        raise InputError(
            f"the scene is {2 * half:.3g} units long and {away:.3g} from the origin: Mitsuba's ray epsilon, 9e-5 times "
            "1 + the distance from the origin, makes such images too bright; move its shapes and lights to the origin, "
            "and scale them to about a unit, by <translate> and <scale> in their to_world"
        )


def _within(box: np.ndarray, sizes: tuple[float, float], farthest: float) -> bool:
    half, away = _measures(box)
    return sizes[0] <= half <= sizes[1] and away <= farthest


def _measures(box: np.ndarray) -> tuple[float, float]:
    return float((box[1] - box[0]).max()) / 2, float(np.linalg.norm((box[0] + box[1]) / 2))


def _known(name: str, entry: Description) -> None:
    if entry.get("type") not in SHAPES:
        raise InputError(
            f"{name}: the size of a {entry.get('type')!r} is not known to scenes.modelling.normalise; describe the "
            f"scene at unit scale, or with {' '.join(sorted(SHAPES))}"
        )


def _box(name: str, entry: Description) -> tuple[np.ndarray, np.ndarray]:
    _known(name, entry)
    kind = entry["type"]
    if kind == "mesh":
        points = np.asarray(entry["vertices"], dtype=np.float64)
        low, high = points.min(axis=0), points.max(axis=0)
    else:
        matrix = np.asarray(entry.get("to_world", np.eye(4)), dtype=np.float64)
        linear, shift = matrix[:3, :3], matrix[:3, 3]
        if kind == "sphere":
            centre = linear @ np.asarray(entry.get("center", [0.0, 0.0, 0.0]), dtype=np.float64) + shift
            reach = entry.get("radius", 1.0) * np.linalg.norm(linear, axis=1)
            low, high = centre - reach, centre + reach
        elif kind == "cylinder":
            ends = [np.asarray(entry.get(key, other), float) for key, other in (("p0", [0, 0, 0]), ("p1", [0, 0, 1]))]
            points = np.array([linear @ end + shift for end in ends])
            axis = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
            # a disc's extent along a world axis: the length of that row without its part along the disc's normal
            reach = entry.get("radius", 1.0) * np.linalg.norm(linear - np.outer(linear @ axis, axis), axis=1)
            low, high = points.min(axis=0) - reach, points.max(axis=0) + reach
        else:
            corners = np.array(np.meshgrid(*np.array(_UNIT_BOXES[kind]).T)).reshape(3, -1).T
            points = corners @ linear.T + shift
            low, high = points.min(axis=0), points.max(axis=0)
    if not np.isfinite([low, high]).all():
        raise InputError(f"{name}: its extent is {low.tolist()} to {high.tolist()}; give finite numbers")
    return low, high
