"""The requests of a page, checked, and the camera that they describe: one that circles a point, z up.

A malformed request is refused with a sentence. Angles in radians, lengths in scene units.
"""

import json
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from harness.training.batches import Camera
from harness.viewer.attended import Attention
from scenes.view_sets.viewpoints import poses_on_sphere

STEEPEST = math.radians(89.9)
"""The steepest elevation: right above its target a camera has no upright."""
MARGIN = 1e-3
"""The share of the box's half diagonal that is kept free before and behind it."""


@dataclass(frozen=True)
class Orbit:
    """The place of a camera that looks at `target`, without roll.

    Raises `ValueError` for a number that is not finite, and for a distance that is not positive.
    """

    target: tuple[float, float, float]
    azimuth: float
    """The angle counterclockwise from x, seen from above."""
    elevation: float
    distance: float

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (*self.target, self.azimuth, self.elevation, self.distance))):
            raise ValueError("a camera is given by finite numbers")
        if self.distance <= 0.0:
            raise ValueError(f"distance {self.distance}: a camera stands away from what it looks at")

    def pose(self) -> np.ndarray:
        """Return camera to world [4, 4], OpenGL axes; elevations beyond the poles are taken to be just below them."""
        elevation = min(max(self.elevation, -STEEPEST), STEEPEST)
        pose = poses_on_sphere(np.array([self.azimuth]), np.array([elevation]), self.distance)[0]
        pose[:3, 3] += self.target
        return pose


def orbit_of(camera_to_world: np.ndarray, centre: np.ndarray) -> Orbit:
    """Return the orbit that continues from a pose without a jump: about the point of its optical axis next to `centre`
    [3].

    Roll is not part of an orbit. A camera that looks away from `centre` gets a target as far before it.
    """
    eye, backward = camera_to_world[:3, 3], camera_to_world[:3, 2] / np.linalg.norm(camera_to_world[:3, 2])
    away = float(np.linalg.norm(eye - centre))
    along = float(backward @ (eye - centre))
    distance = along if along > 0.1 * away else max(away, 1e-3)
    x, y, z = (eye - distance * backward).tolist()
    flat = math.hypot(backward[0], backward[1])
    return Orbit((x, y, z), math.atan2(backward[1], backward[0]), math.atan2(float(backward[2]), flat), distance)


def covering(camera: Camera, bounds: np.ndarray) -> Camera:
    """Return the same camera with near and far moved apart, as necessary, until they hold the complete box [2, 3]."""
    lower, upper = np.asarray(bounds, dtype=np.float64)
    radius = (1.0 + MARGIN) * 0.5 * float(np.linalg.norm(upper - lower))
    distance = float(np.linalg.norm(camera.camera_to_world[:3, 3] - 0.5 * (lower + upper)))
    near, far = max(0.0, distance - radius), distance + radius
    if camera.near <= near and far <= camera.far:
        return camera
    return replace(camera, near=min(camera.near, near), far=max(camera.far, far))


LARGEST_BODY = 4096
"""The largest body in bytes."""
LARGEST_WIDTH = 1024
"""The largest width in pixels."""
FARTHEST = 1000.0
"""The largest coordinate and distance in scene units."""
NEAREST = 1e-3
MOST_METHODS = 8
LARGEST_NUMBER = 2**53
"""The number up to which a page counts exactly."""


class BadRequest(ValueError):
    """A request that a page would not send; the message says what to send instead."""


@dataclass(frozen=True)
class ViewRequest:
    """A request for a view of methods of a scene."""

    client: str
    """The page; its newest request is the only one that is still rendered."""
    generation: int
    scene: str
    methods: tuple[str, ...]
    place: int | Orbit
    """A test view's number, or the camera's place."""
    attention: Attention
    width: int | None
    """The width in pixels; None for the views' own."""


def parsed(body: bytes) -> ViewRequest:
    """Parse a request; raises `BadRequest` unless it is valid in every detail; names are not looked up here."""
    needed = {"client", "generation", "scene", "methods", "place", "attention"}
    data = _only(_json(body), "the request", needed, {"width"})
    methods = data["methods"]
    if not isinstance(methods, list) or not 1 <= len(set(map(str, methods))) == len(methods) <= MOST_METHODS:
        raise BadRequest(f"methods: give 1 to {MOST_METHODS} different names")
    attention = _only(data["attention"], "attention", {"kind", "row", "column"}, set())
    try:
        attended = Attention(
            _text(attention["kind"], "kind"),
            _number(attention["row"], "row"),
            _number(attention["column"], "column"),
        )
        place = _place(data["place"])
    except BadRequest:
        raise
    except ValueError as mistake:
        raise BadRequest(str(mistake)) from mistake
    return ViewRequest(
        client=_text(data["client"], "client"),
        generation=_whole(data["generation"], "generation", 0, LARGEST_NUMBER),
        scene=_text(data["scene"], "scene"),
        methods=tuple(_text(name, "methods") for name in methods),
        place=place,
        attention=attended,
        width=None if data.get("width") is None else _whole(data["width"], "width", 8, LARGEST_WIDTH),
    )


def view_number(text: str | None) -> int:
    """Return the number of a test view, from the address; raises `BadRequest`."""
    if text is None or not text.isascii() or not text.isdigit() or len(text) > 6:
        raise BadRequest("view: give the number of a test view")
    return int(text)


def _place(data: Any) -> int | Orbit:
    if isinstance(data, dict) and set(data) == {"view"}:
        return _whole(data["view"], "view", 0, LARGEST_NUMBER)
    place = _only(data, "place", {"azimuth", "elevation", "distance", "target"}, set())
    target = place["target"]
    if not isinstance(target, list) or len(target) != 3:
        raise BadRequest("target: give three numbers")
    x, y, z = (_number(one, "target", FARTHEST) for one in target)
    distance = _number(place["distance"], "distance", FARTHEST)
    if distance < NEAREST:
        raise BadRequest(f"distance: must lie between {NEAREST:g} and {FARTHEST:g} scene units")
    return Orbit((x, y, z), _number(place["azimuth"], "azimuth"), _number(place["elevation"], "elevation"), distance)


def _json(body: bytes) -> Any:
    def refuse(name: str) -> None:
        raise BadRequest(f"the request: {name} is not a number that can be shown")

    if len(body) > LARGEST_BODY:
        raise BadRequest(f"the request has {len(body)} bytes, at most {LARGEST_BODY} are read")
    try:
        return json.loads(body, parse_constant=refuse)
    except BadRequest:
        raise
    except (ValueError, RecursionError) as error:
        raise BadRequest("the request is not JSON") from error


def _only(data: Any, what: str, needed: set[str], allowed: set[str]) -> dict[str, Any]:
    if not isinstance(data, dict) or not needed <= set(data) <= needed | allowed:
        raise BadRequest(f"{what}: give {' '.join(sorted(needed))}, and nothing else")
    return data


def _text(value: Any, what: str) -> str:
    if not isinstance(value, str) or not 1 <= len(value) <= 200:
        raise BadRequest(f"{what}: give a name of 1 to 200 characters")
    return value


def _number(value: Any, what: str, largest: float = 1e6) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= largest:
        raise BadRequest(f"{what}: give a finite number, at most {largest:g} in size")
    return float(value)


def _whole(value: Any, what: str, least: int, most: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise BadRequest(f"{what}: give a whole number from {least} to {most}")
    return value
