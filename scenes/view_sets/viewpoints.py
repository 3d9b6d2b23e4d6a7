"""The cameras of a view set: the measured distribution of the NeRF synthetic set.

Every camera is 4.0311 from the origin, looks at it, and has no roll. Training and validation views are random with
a fixed seed per split; the test views are one spiral, the same in every scene.
"""

import math
from typing import Literal

import numpy as np

from scenes.files.errors import InputError

Split = Literal["train", "val", "test"]
SPLITS: tuple[Split, ...] = ("train", "val", "test")

Z_AXIS = np.array([0.0, 0.0, 1.0])
FOV_X_RADIANS = 0.6911112070083618
LEAST_FIELD_OF_VIEW, MOST_FIELD_OF_VIEW = math.radians(0.1), math.radians(175.0)
"""Beyond these an angle in degrees or a focal length in widths was given; a circular fisheye's pinhole has 171°."""
RADIUS = float(np.hypot(4.0, 0.5))
TILT = float(np.arctan2(0.5, 4.0))
"""The elevation of the original rig at rest (7.125°), by which random elevations are raised."""
VIEW_COUNTS: dict[Split, int] = {"train": 100, "val": 100, "test": 200}
_SEEDS: dict[Split, int] = {"train": 20200819, "val": 20200820, "test": 0}


def camera_to_world(
    split: Split, view_from: Literal["hemisphere", "sphere"] = "hemisphere", count: int | None = None
) -> np.ndarray:
    """Return `count` evenly spread poses of a split, or all of them, float64 [count, 4, 4]; raises `InputError` as
    `evenly_spread`.
    """
    poses = all_poses(split, view_from)
    return poses if count is None else poses[evenly_spread(count, poses, f"{split} views")]


def all_poses(split: Split, view_from: Literal["hemisphere", "sphere"] = "hemisphere") -> np.ndarray:
    """Return all poses of a split, float64 [100 or 200, 4, 4], OpenGL axes."""
    count = VIEW_COUNTS[split]
    if split == "test":
        k = np.arange(count)
        azimuth = np.pi / 2 + np.radians(3.6) * k
        elevation = TILT + 0.35 * (1 + np.cos(2 * np.pi * np.maximum(k - 1, 0) / count))
    else:
        generator = np.random.default_rng(_SEEDS[split])
        azimuth = generator.uniform(0.0, 2 * np.pi, count)
        elevation = np.arcsin(generator.uniform(-1.0, 1.0, count))
        if view_from == "hemisphere":
            elevation = np.abs(elevation)
        elevation += TILT
        past_pole = elevation > np.pi / 2
        elevation = np.where(past_pole, np.pi - elevation, elevation)
        azimuth = np.where(past_pole, azimuth + np.pi, azimuth)
    return poses_on_sphere(azimuth, elevation)


def poses_on_sphere(azimuth: np.ndarray, elevation: np.ndarray, radius: float = RADIUS) -> np.ndarray:
    """Return cameras [n, 4, 4] on a sphere about the origin, looking at it, z up, also at a pole; radians [n]."""
    sin_a, cos_a, sin_e, cos_e = np.sin(azimuth), np.cos(azimuth), np.sin(elevation), np.cos(elevation)
    zero = np.zeros_like(sin_a)
    right = np.stack([-sin_a, cos_a, zero], axis=-1)
    up = np.stack([-sin_e * cos_a, -sin_e * sin_a, cos_e], axis=-1)
    backward = np.stack([cos_e * cos_a, cos_e * sin_a, sin_e], axis=-1)
    poses = np.zeros((len(sin_a), 4, 4))
    poses[:, :3] = np.stack([right, up, backward, radius * backward], axis=-1)
    poses[:, 3, 3] = 1.0
    return poses


def look_at(origin: np.ndarray, target: np.ndarray, up: np.ndarray = Z_AXIS) -> np.ndarray:
    """Return the camera [4, 4], OpenGL axes, that stands at `origin` [3], looks at `target` [3] and keeps `up` [3]
    upright.

    Raises `InputError` for numbers that are not finite, an origin on the target, and an `up` of length 0 or along the
    view: for all of these Mitsuba's look_at gives a matrix with which it renders a clean background.
    """
    o, at, upright = (np.asarray(vector, dtype=np.float64) for vector in (origin, target, up))
    for name, vector in (("origin", o), ("target", at), ("up", upright)):
        if vector.shape != (3,) or not np.isfinite(vector).all():
            raise InputError(f"look_at: {name} is {vector.tolist()}; give three finite numbers")
    distance = float(np.linalg.norm(o - at))
    if distance <= 1e-9 * max(1.0, float(np.abs([o, at]).max())):
        raise InputError(f"look_at: the camera stands on its target, {at.tolist()}; move one of them")
    backward = (o - at) / distance
    length = float(np.linalg.norm(upright))
    right = np.cross(upright, backward)
    if length == 0 or np.linalg.norm(right) < 1e-6 * length:
        raise InputError(f"look_at: up {upright.tolist()} lies along the view; choose another direction for up")
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(backward, right), backward, o], axis=-1)
    return pose


def check_field_of_view(radians: float, where: str) -> None:
    """Raise `InputError` unless it lies between `LEAST_FIELD_OF_VIEW` and `MOST_FIELD_OF_VIEW`; `where` names its
    source.
    """
    if not LEAST_FIELD_OF_VIEW <= radians <= MOST_FIELD_OF_VIEW:
        raise InputError(
            f"{where}: the field of view is {math.degrees(radians):g}°; it must lie between 0.1° and 175°: give an "
            "angle in radians, a focal length in pixels of the pictures"
        )


def repeated(poses: np.ndarray) -> list[tuple[int, int]]:
    """Return pairs (first, later) of cameras [n, 4, 4] with equal position and view to within 1e-6."""
    first: dict[bytes, int] = {}
    pairs = []
    for number, pose in enumerate(poses):
        key = (np.round(pose, 6) + 0.0).tobytes()  # −0 becomes +0
        if first.setdefault(key, number) != number:
            pairs.append((first[key], number))
    return pairs


def evenly_spread(count: int, poses: np.ndarray, what: str = "views") -> np.ndarray:
    """Return increasing indices [count] of cameras [n, 4, 4] spread evenly over *azimuth*; raises `InputError` unless
    0 ≤ count ≤ n. Every k-th view of the test spiral would be wrong: every 25th of 200 has only four azimuths. Up to
    half of the spiral, all azimuths differ; an odd count alternates between its two turns.
    """
    if not 0 <= count <= len(poses):
        raise InputError(f"{count} {what} were asked for; choose 0 to {len(poses)}, the number that exists")
    return np.sort(by_azimuth(poses)[np.arange(count) * len(poses) // max(count, 1)])


def by_azimuth(poses: np.ndarray) -> np.ndarray:
    """Return the indices [n] of cameras [n, 4, 4] ordered by azimuth about the z axis; ties stay in order."""
    azimuth = np.degrees(np.arctan2(poses[:, 1, 3], poses[:, 0, 3])) % 360.0
    # rounded, so that equal azimuths one turn apart are a tie in spite of rounding errors
    return np.argsort(np.round(azimuth, 6) % 360.0, kind="stable")


ROUNDED = 0.012
"""The maximum deviation from a rotation that is taken for rounding, to three decimals or nearly to two."""
EXACT = 1e-5
"""The deviation from a rotation that single precision leaves."""


def rigid(poses: np.ndarray, names: list[str]) -> tuple[np.ndarray, list[str]]:
    """Return the poses [n, 4, 4] as the readers of the field take them, and notes on what was changed: a matrix whose
    last number is not 1 is divided by it, or if only its last row is scaled, that is ignored; a rounded rotation is
    replaced by the nearest one.

    Raises `InputError` as `check_poses`, but only for a deviation above `ROUNDED`.
    """
    poses, notes = poses.copy(), []
    last = poses[:, 3, 3]
    scaled = (
        (np.abs(poses[:, 3, :3]).max(axis=1) == 0.0) & (last > 0.0) & (last != 1.0) & np.isfinite(poses).all((1, 2))
    )
    if scaled.any():
        size = np.cbrt(np.abs(np.linalg.det(poses[scaled, :3, :3])))
        divided = np.abs(size - last[scaled]) <= ROUNDED * last[scaled]
        poses[scaled] /= np.where(divided, last[scaled], 1.0)[:, None, None]
        poses[scaled, 3, 3] = 1.0
        notes.append(
            f"{int(scaled.sum())} of {len(poses)} camera matrices have a last number other than 1: it is undone."
        )
    notes += _without_scale(poses)
    check_poses(poses, names, ROUNDED)
    rotation = poses[:, :3, :3]
    off = np.abs(np.swapaxes(rotation, 1, 2) @ rotation - np.eye(3)).max(axis=(1, 2))
    if (rounded := off > EXACT).any():
        left, _, right = np.linalg.svd(rotation[rounded])
        poses[rounded, :3, :3] = left @ right
        notes.append(
            f"{int(rounded.sum())} of {len(poses)} camera matrices are off by up to {off.max():.2g} from a rotation, "
            "as if rounded: the nearest rotation is taken."
        )
    return poses, notes


def _without_scale(poses: np.ndarray) -> list[str]:
    """Undo a camera object's own uniform scale, as Blender writes it: it does not move the camera. Return a note."""
    axes = np.where(np.isfinite(poses[:, :3, :3]), poses[:, :3, :3], 0.0)
    with np.errstate(over="ignore", invalid="ignore"):
        gram = np.swapaxes(axes, 1, 2) @ axes
        square = np.trace(gram, axis1=1, axis2=2) / 3.0
        is_uniform = np.abs(gram - square[:, None, None] * np.eye(3)).max(axis=(1, 2)) <= ROUNDED * square
        scaled = is_uniform & (np.abs(square - 1.0) > ROUNDED) & (square > 1e-12) & (np.linalg.det(axes) > 0.0)
    if not scaled.any():
        return []
    poses[scaled, :3, :3] /= np.sqrt(square[scaled])[:, None, None]
    return [f"{int(scaled.sum())} of {len(poses)} cameras have a scale of their own: it is undone."]


def check_poses(poses: np.ndarray, names: list[str], tolerance: float = 1e-3) -> None:
    """Raise `InputError`, naming the view, unless every [4, 4] is finite and rigid up to `tolerance`: for a NaN Mitsuba
    renders a clean background without any message.
    """
    for pose, name in zip(poses, names, strict=True):
        if not np.isfinite(pose).all():
            raise InputError(f"{name}: its camera matrix holds NaN or infinity; give finite numbers")
        rotation = pose[:3, :3]
        if np.abs(pose[3] - [0, 0, 0, 1]).max() > 1e-6:
            raise InputError(f"{name}: the last row of its camera matrix is {pose[3].tolist()}; it must be 0 0 0 1")
        if np.abs(rotation).max() > 1e100:  # whose square would be infinite
            raise InputError(f"{name}: its camera matrix is not a rotation: it holds {np.abs(rotation).max():.3g}")
        off = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
        if off > tolerance or np.linalg.det(rotation) < 0:
            raise InputError(
                f"{name}: its camera matrix is not a rotation and a translation (off by {off:.3g}, determinant "
                f"{np.linalg.det(rotation):.3g}); scaled, mirrored and singular matrices cannot be rendered"
            )
        if np.abs(pose[:3, 3]).max() > 1e4:
            raise InputError(
                f"{name}: its camera stands at {pose[:3, 3].tolist()}; beyond 10 000 scene units single precision "
                "no longer resolves the object: scale the scene to a few units"
            )
