"""Checked requests of a page, and the camera that they describe, which orbits a point, z up.

A malformed request is refused with a sentence. Angles in radians, lengths in scene units.
"""

import json
import math
import re
from dataclasses import replace
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from harness.training.batches import Camera
from harness.viewer.attended import Attention
from scenes.files.errors import printable
from scenes.view_sets.viewpoints import poses_on_sphere

LARGEST_BODY = 4096
"""In bytes."""
LARGEST_WIDTH = 1024
"""In pixels."""
FARTHEST, NEAREST = 1e9, 1e-9
"""The largest coordinate and distance, and the smallest distance, of a scene in any unit: float32 has their squares."""
MOST_METHODS = 8
LARGEST_NUMBER = 2**53
"""The number up to which a page counts exactly."""
STEEPEST = math.radians(89.9)
"""The steepest elevation: a camera vertically above its target has no upright direction."""
MARGIN = 1e-3
"""The margin around the box, as a share of its half diagonal."""


Name = Annotated[str, Meta(min_length=1, max_length=200)]
Number = Annotated[int, Meta(ge=0, le=LARGEST_NUMBER)]
Angle = Annotated[float, Meta(ge=-1e6, le=1e6)]
Coordinate = Annotated[float, Meta(ge=-FARTHEST, le=FARTHEST)]


class Orbit(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    target: tuple[Coordinate, Coordinate, Coordinate]
    azimuth: Angle
    """The angle counterclockwise from x, seen from above."""
    elevation: Angle
    distance: Annotated[float, Meta(ge=NEAREST, le=FARTHEST)]

    def pose(self) -> np.ndarray:
        """Return camera to world [4, 4], OpenGL axes; the elevation is clamped to `STEEPEST`."""
        elevation = min(max(self.elevation, -STEEPEST), STEEPEST)
        pose: np.ndarray = poses_on_sphere(np.array([self.azimuth]), np.array([elevation]), self.distance)[0]
        pose[:3, 3] += self.target
        return pose


def orbit_of(camera_to_world: np.ndarray, centre: np.ndarray) -> Orbit:
    """Return the orbit with the given pose, without its roll; the target is the point of its optical axis nearest to
    `centre` [3]. A camera that looks away from `centre` gets a target as far in front of it.
    """
    eye, backward = camera_to_world[:3, 3], camera_to_world[:3, 2] / np.linalg.norm(camera_to_world[:3, 2])
    away = float(np.linalg.norm(eye - centre))
    along = float(backward @ (eye - centre))
    distance = along if along > 0.1 * away else max(away, 1e-3)
    x, y, z = (eye - distance * backward).tolist()
    flat = math.hypot(backward[0], backward[1])
    return Orbit((x, y, z), math.atan2(backward[1], backward[0]), math.atan2(float(backward[2]), flat), distance)


def covering(camera: Camera, bounds: np.ndarray) -> Camera:
    """Return the camera with near and far moved apart, if necessary, so that they enclose the box [2, 3]."""
    lower, upper = np.asarray(bounds, dtype=np.float64)
    radius = (1.0 + MARGIN) * 0.5 * float(np.linalg.norm(upper - lower))
    distance = float(np.linalg.norm(camera.camera_to_world[:3, 3] - 0.5 * (lower + upper)))
    near, far = max(0.0, distance - radius), distance + radius
    if camera.near <= near and far <= camera.far:
        return camera
    return replace(camera, near=min(camera.near, near), far=max(camera.far, far))


class BadRequest(ValueError):
    """A request that a page would not send; the message begins with the faulty part, and says what to send instead."""

    def __init__(self, why: str, status: int = 400) -> None:
        super().__init__(why)
        self.status = status


class ViewRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    client: Name
    """The page; only its newest request is rendered to the end."""
    generation: Number
    scene: Name
    methods: Annotated[tuple[Name, ...], Meta(min_length=1, max_length=MOST_METHODS)]
    place: Number | Orbit
    """A test view's number, which a page sends as `{"view": number}`, or the camera's orbit."""
    attention: Attention
    width: Annotated[int, Meta(ge=8, le=LARGEST_WIDTH)] | None = None
    """The width in pixels; None for that of the views."""


def parsed(body: bytes) -> ViewRequest:
    """Parse a request; raises `BadRequest` if it is invalid. Names are not looked up here."""
    if len(body) > LARGEST_BODY:
        raise BadRequest(f"the request has {len(body)} bytes, at most {LARGEST_BODY} are read")
    try:
        data = json.loads(body, parse_constant=_refused)
    except (ValueError, RecursionError) as error:
        raise BadRequest(f"the request is not JSON: {str(error)[:100]}") from error
    place = data.get("place") if isinstance(data, dict) else None
    if isinstance(place, dict) and set(place) == {"view"}:
        data["place"] = place["view"]
    try:
        request = msgspec.convert(data, ViewRequest)
    except msgspec.ValidationError as error:
        what, _, path = str(error).partition(" - at ")
        names = re.findall(r"[a-z_]+", path) or ["the request"]
        raise BadRequest(f"{names[-1]}: {printable(what)}") from error
    except UnicodeEncodeError as error:
        raise BadRequest("the request holds a lone surrogate, half of a character; send complete ones") from error
    if len(set(request.methods)) < len(request.methods):
        raise BadRequest("methods: give different names")
    return request


def view_number(text: str | None) -> int:
    """Parse the number of a test view in the address; raises `BadRequest`."""
    if text is None or not text.isascii() or not text.isdigit() or len(text) > 6:
        raise BadRequest("view: give the number of a test view")
    return int(text)


def _refused(name: str) -> None:
    raise ValueError(f"{name} is not a number that can be shown")
