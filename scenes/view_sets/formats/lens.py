"""The camera model of all formats: a lens, perhaps distorted, whose pictures are resampled to a centred pinhole."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.polynomial.polynomial import polyval
from scipy.ndimage import map_coordinates

from scenes.files.errors import InputError
from scenes.view_sets.images import display_levels, header
from scenes.view_sets.pixels import resized, straight_at, straight_from_premultiplied
from scenes.view_sets.viewpoints import check_field_of_view

MODELS = {
    0: ("SIMPLE_PINHOLE", ("f", "cx", "cy")),
    1: ("PINHOLE", ("fx", "fy", "cx", "cy")),
    2: ("SIMPLE_RADIAL", ("f", "cx", "cy", "k1")),
    3: ("RADIAL", ("f", "cx", "cy", "k1", "k2")),
    4: ("OPENCV", ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")),
    5: ("OPENCV_FISHEYE", ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")),
    6: ("FULL_OPENCV", ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
    7: ("FOV", ("fx", "fy", "cx", "cy", "omega")),
    8: ("SIMPLE_RADIAL_FISHEYE", ("f", "cx", "cy", "k1")),
    9: ("RADIAL_FISHEYE", ("f", "cx", "cy", "k1", "k2")),
    10: ("THIN_PRISM_FISHEYE", ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "sx1", "sy1")),
}
"""COLMAP's number of a model → its name and parameters."""
NAMES = tuple(name for name, _ in MODELS.values())
SAME = 1e-4
"""The distance in pixels below which two lenses show the same picture."""
LEAST_CENTRED, CENTRED = 0.1, 0.5
"""The share of a picture about its axis below which the numbers of a lens are those of another size, or may be."""
LONGEST, SHORTEST = 16.0, 0.25
"""The range of the search for a pinhole, in focal lengths of its lenses."""
SUPERSAMPLED = 2
"""The pixels of a resampled picture, per pixel of its reduced size along each axis."""
SHRUNK = 1.5
"""The reduction from which areas are averaged before a picture is resampled, which looks at four pixels only."""


@dataclass(frozen=True)
class Lens:
    """A lens as COLMAP and OpenCV define it; lengths in pixels, the corner of the first pixel is (0, 0)."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    radial: tuple[float, ...] = ()
    """k1, k2, …: the factor 1 + k1 r² + k2 r⁴ + …, of a fisheye in powers of the angle from its axis."""
    divisor: tuple[float, ...] = ()
    """k4, k5, k6 of FULL_OPENCV, by whose factor it is divided."""
    tangential: tuple[float, float] = (0.0, 0.0)
    """p1, p2."""
    prism: tuple[float, float] = (0.0, 0.0)
    """sx1, sy1 of THIN_PRISM_FISHEYE: the shift per r²."""
    omega: float = 0.0
    """ω of FOV, in radians: r becomes atan(2 r tan(ω / 2)) / ω."""
    is_fisheye: bool = False

    @staticmethod
    def of(model: str, width: int, height: int, values: Mapping[str, float]) -> "Lens":
        """Return the lens of a model in `NAMES` with its parameters by name; missing ones of distortion are 0.

        Only FULL_OPENCV has a divisor; nerfstudio's OPENCV continues the factor with k3 and k4.
        """
        k = tuple(values.get(f"k{number}", 0.0) for number in range(1, 7))
        parts = (k[:3], k[3:]) if model == "FULL_OPENCV" else (k[:4], ())
        radial, divisor = (part if any(part) else () for part in parts)
        fx, fy = (values[name] for name in (("f", "f") if "f" in values else ("fx", "fy")))
        tangential, prism = ((values.get(x, 0.0), values.get(y, 0.0)) for x, y in (("p1", "p2"), ("sx1", "sy1")))
        omega, is_fisheye = values.get("omega", 0.0), "FISHEYE" in model
        cx, cy = values["cx"], values["cy"]
        lens = Lens(width, height, fx, fy, cx, cy, radial, divisor, tangential, prism, omega, is_fisheye)
        is_distorted = any((radial, divisor, omega, *tangential, *prism))
        if max(abs(cx - width / 2 + 0.5), abs(cy - height / 2 + 0.5)) < SAME and not is_distorted:
            # (w − 1) / 2 is the centre if pixels are counted from the middle of the first one
            return replace(lens, cx=width / 2, cy=height / 2)
        return lens

    @staticmethod
    def pinhole(width: int, height: int, focal: float) -> "Lens":
        return Lens(width, height, focal, focal, width / 2, height / 2)

    @property
    def fov_x_radians(self) -> float:
        """The horizontal field of view without distortion, about a centred axis."""
        return 2.0 * math.atan(0.5 * self.width / self.fx)

    @property
    def centred(self) -> float:
        """The share of the picture of the largest part whose middle is the axis; 0 or less if the axis lies outside."""
        across, down = (2.0 * min(at, side - at) / side for at, side in ((self.cx, self.width), (self.cy, self.height)))
        return min(across, down, across * down)

    @property
    def told(self) -> str:
        """The lens in words."""
        distortion = (*self.radial, *self.divisor, *self.tangential, *self.prism, self.omega)
        numbers = " ".join(f"{number:.6g}" for number in distortion if number)
        return f"a lens of {self.width} × {self.height} pixels, focal length {self.fx:.6g}, distortion {numbers}"

    def scaled(self, width: int, height: int) -> "Lens":
        """Return the lens of the same pictures at another size."""
        across, down = width / self.width, height / self.height
        fx, fy, cx, cy = self.fx * across, self.fy * down, self.cx * across, self.cy * down
        return replace(self, width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy)

    def seen_at(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return column and row in the picture of directions (x, y, 1) in the camera's frame, y down."""
        projected = self._projected(x * x + y * y)
        x, y = x * projected, y * projected
        square = x * x + y * y
        factor, (p1, p2), (sx1, sy1) = self._factor(square), self.tangential, self.prism
        column = x * factor + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x) + sx1 * square
        row = y * factor + 2.0 * p2 * x * y + p1 * (square + 2.0 * y * y) + sy1 * square
        return self.fx * column + self.cx, self.fy * row + self.cy

    def _projected(self, square: np.ndarray) -> np.ndarray:
        """Return the factor of the projection for directions of tan² = `square`; 1 for a perspective one."""
        scale = 1.0 if self.is_fisheye else 2.0 * math.tan(0.5 * self.omega)
        if scale == 0.0:
            return np.ones_like(square)
        tangent = np.maximum(np.sqrt(square), 1e-9)
        return np.asarray(np.arctan(scale * tangent) / ((1.0 if self.is_fisheye else self.omega) * tangent))

    def _factor(self, square: np.ndarray) -> np.ndarray:
        return np.asarray(polyval(square, (1.0, *self.radial)) / polyval(square, (1.0, *self.divisor)))

    def holds(self, pinhole: "Lens") -> bool:
        """Return whether a pinhole sees nothing outside this lens's picture, and no direction twice."""
        x, y = _outline(pinhole)
        column, row = self.seen_at(x, y)
        inside = (column >= 0) & (column <= self.width) & (row >= 0) & (row <= self.height)
        tangent = np.linspace(0.0, np.hypot(x, y).max(), 65)
        radius = tangent * self._projected(tangent * tangent)
        return bool(inside.all() and (np.diff(radius * self._factor(radius * radius)) > 0.0).all())

    def shows(self, pinhole: "Lens") -> bool:
        """Return whether the picture of this lens is that of the pinhole, pixel by pixel."""
        if (self.width, self.height) != (pinhole.width, pinhole.height):
            return False
        x, y = (np.concatenate([0.5 * part, part]) for part in _outline(pinhole))
        both = np.stack(self.seen_at(x, y)) - np.stack(pinhole.seen_at(x, y))
        return bool(np.abs(both).max() < SAME)

    def kept(self, pinhole: "Lens") -> float:
        """Return the share of this lens's picture that a pinhole in it shows."""
        column, row = self.seen_at(*_outline(pinhole))
        area = 0.5 * abs(np.dot(column, np.roll(row, 1)) - np.dot(row, np.roll(column, 1)))
        return float(area / (self.width * self.height))


def _outline(pinhole: Lens) -> tuple[np.ndarray, np.ndarray]:
    """Return directions (x, y, 1) along the edge of a pinhole's picture, once around."""
    side = np.linspace(-1.0, 1.0, 65)[:-1]
    edge = np.ones_like(side)
    x, y = np.concatenate([side, edge, -side, -edge]), np.concatenate([-edge, side, edge, -side])
    return 0.5 * pinhole.width / pinhole.fx * x, 0.5 * pinhole.height / pinhole.fy * y


def common_pinhole(lenses: Iterable[Lens], where: str) -> Lens:
    """Return the widest centred pinhole with square pixels whose picture lies in the pictures of all lenses. Its size
    is that of the lenses, the smallest width and height if they differ; it is the lens itself where all are one such
    pinhole.

    Raises `InputError`, which names `where`, if there is none.
    """
    several = list(dict.fromkeys(lenses))
    width, height = min(lens.width for lens in several), min(lens.height for lens in several)
    for lens in several:
        pinhole = Lens.pinhole(width, height, lens.fx * width / lens.width)
        if all(other.shows(pinhole) for other in several):
            break
    else:
        focals = [focal for lens in several for focal in (lens.fx, lens.fy)]
        narrow, wide = LONGEST * max(focals), SHORTEST * min(focals)
        if (worst := min(several, key=lambda lens: lens.centred)).centred < LEAST_CENTRED:
            raise InputError(f"{where}: {_off_centre(worst)}")
        if unfit := [lens for lens in several if not lens.holds(Lens.pinhole(width, height, narrow))]:
            raise InputError(f"{where}: no pinhole fits into {unfit[0].told}; correct it or undistort the pictures")
        for _ in range(60):
            middle = 0.5 * (narrow + wide)
            fits = all(lens.holds(Lens.pinhole(width, height, middle)) for lens in several)
            narrow, wide = (middle, wide) if fits else (narrow, middle)
        pinhole = Lens.pinhole(width, height, narrow)
    check_field_of_view(pinhole.fov_x_radians, f"{where}: focal length {pinhole.fx:.6g} at {width} pixels")
    return pinhole


def _off_centre(lens: Lens) -> str:
    return (
        f"the axis at cx {lens.cx:.6g}, cy {lens.cy:.6g} is far from the middle of {lens.width} × {lens.height} "
        "pixels; size, focal length, cx and cy must be those of the same copies of the pictures"
    )


def resampling_note(lenses: Iterable[Lens], pinhole: Lens) -> list[str]:
    """Return what the user must know of the resampling, if there is any."""
    several = list(dict.fromkeys(lenses))
    if all(lens.shows(pinhole) for lens in several):
        return []
    least = 100.0 * min(lens.kept(pinhole) for lens in several)
    angles = (math.degrees(2.0 * math.atan(0.5 * size / pinhole.fx)) for size in (pinhole.width, pinhole.height))
    notes = [
        f"Distortion, off-centre axes and different lenses are undone: pictures are resampled to one pinhole of "
        f"{pinhole.fx:.6g} pixels at {pinhole.width}, {' × '.join(f'{angle:.1f}°' for angle in angles)}, which shows "
        f"{least:.0f} % of a picture at least."
    ]
    worst = min(several, key=lambda lens: lens.centred)
    return [*notes, f"{_off_centre(worst).capitalize()}."] if worst.centred < CENTRED else notes


def looked_into(files: Sequence[Path]) -> tuple[int, list[str]]:
    """Return the channels of the first picture, and what the user must know of all: no alpha, EXIF orientations."""
    headers = [header(file) for file in files]
    notes = []
    if headers[0].channels == 3:
        notes.append("Images without alpha count as fully opaque, background included.")
    if turned := [(file, head.orientation) for file, head in zip(files, headers, strict=True) if head.orientation > 1]:
        file, orientation = turned[0]
        notes.append(
            f"{len(turned)} of {len(files)} pictures have an EXIF orientation ({file.name}: {orientation}): pixels are "
            "used as they are stored, as by COLMAP, nerfstudio and instant-ngp."
        )
    return headers[0].channels, notes


def seen_size(file: Path, lens: Lens | None, pinhole: Lens | None) -> tuple[int, int]:
    """Return height and width of what `read_through` returns without a `width`; errors as in `read_through`."""
    stored = header(file)
    return _seen(file, (stored.height, stored.width), lens, pinhole)


def _seen(file: Path, stored: tuple[int, ...], lens: Lens | None, pinhole: Lens | None) -> tuple[int, int]:
    height, width = stored
    if lens is None or pinhole is None:
        return height, width
    if abs(height - width * lens.height / lens.width) > max(1.0, lens.height / lens.width):  # rounding in either side
        remedy = "give the pictures that the cameras are meant for, or resized copies of the complete pictures"
        if header(file).orientation > 4:
            remedy = "a viewer turns it by its EXIF orientation: save it so if the cameras are meant for that"
        raise InputError(f"{file}: {width} × {height} pixels, its camera has {lens.width} × {lens.height}; {remedy}")
    if lens.shows(pinhole):
        return height, width
    share = width / lens.width
    return round(share * pinhole.height), round(share * pinhole.width)


def read_through(file: Path, lens: Lens | None, pinhole: Lens | None, channels: int, width: int | None) -> np.ndarray:
    """Return straight RGBA, float32 [h, w, 4], of a lens's picture at any size, resampled to the common pinhole, at
    `width` pixels (default: as `seen_size`). A lens that is None shows the pinhole.

    Raises `InputError` if the sides do not have the lens's ratio, and as `display_levels`.
    """
    levels = display_levels(file, channels)
    _, seen = _seen(file, levels.shape[:2], lens, pinhole)
    if lens is None or pinhole is None or lens.shows(pinhole):
        return straight_at(levels, width)
    # no finer than the result needs, as all pixels of a photograph take seconds
    stored = levels.shape[1]
    finer = stored if width is None else min(stored, round(stored * SUPERSAMPLED * width / seen))
    return straight_at(as_pinhole(resized(levels, finer), lens, pinhole), width)


def as_pinhole(image: np.ndarray, lens: Lens, pinhole: Lens) -> np.ndarray:
    """Resample an opaque or straight image, float32 [h, w, 3 or 4], linearly, with both lenses scaled to its size."""
    if lens.shows(pinhole):
        return image
    share = image.shape[1] / lens.width
    goal = pinhole.scaled(round(share * pinhole.width), round(share * pinhole.height))
    if (reduction := share * lens.fx / goal.fx) > SHRUNK:
        image = resized(image, round(image.shape[1] / reduction))
    places = _places(lens.scaled(image.shape[1], image.shape[0]), goal)
    if image.shape[2] == 4:
        image = np.concatenate([image[..., :3] * image[..., 3:], image[..., 3:]], axis=-1)
    parts = [map_coordinates(part, places, order=1, mode="nearest") for part in np.moveaxis(image, -1, 0)]
    seen = np.stack(parts, axis=-1)
    return (straight_from_premultiplied(seen) if len(parts) == 4 else seen).clip(0.0, 1.0).astype(np.float32)


@lru_cache(maxsize=8)
def _places(lens: Lens, pinhole: Lens) -> np.ndarray:
    """Return row and column [2, h, w] in a lens's picture of each pixel of a pinhole's, counted from pixel centres."""
    column, row = np.meshgrid(np.arange(pinhole.width) + 0.5, np.arange(pinhole.height) + 0.5)
    at, down = lens.seen_at((column - pinhole.cx) / pinhole.fx, (row - pinhole.cy) / pinhole.fy)
    return np.stack([down - 0.5, at - 0.5])
