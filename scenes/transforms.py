"""`transforms_{split}.json`, the Blender format of the field, written as it is and read with suspicion."""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scenes.errors import InputError
from scenes.viewpoints import check_field_of_view, check_poses

LARGEST_FILE = 50 * 1024 * 1024
SUFFIXES = (".png", ".jpg", ".jpeg")
"""Tried in turn where a frame's path has no suffix."""


@dataclass(frozen=True)
class Frames:
    """One split as its file lists it."""

    fov_x_radians: float
    files: list[Path]
    """Image files, existing, inside the folder."""
    camera_to_world: np.ndarray
    """float64 [n, 4, 4], OpenGL axes, rigid."""


def transforms_file(folder: Path, split: str) -> Path:
    return folder / f"transforms_{split}.json"


def write_transforms(file: Path, fov_x_radians: float, paths: list[str], camera_to_world: np.ndarray) -> None:
    """`paths` are relative to the file's folder, without suffix, such as `./train/r_0`."""
    frames = [
        {"file_path": path, "rotation": 2 * math.pi / len(paths), "transform_matrix": pose.tolist()}
        for path, pose in zip(paths, camera_to_world, strict=True)
    ]
    file.write_text(json.dumps({"camera_angle_x": fov_x_radians, "frames": frames}, indent=4), encoding="utf-8")


def read_transforms(folder: Path, split: str) -> Frames:
    """Raises `InputError` that names the file, the value and the remedy for anything that cannot be trusted."""
    file = transforms_file(folder, split)
    data = read_json(file)
    if not isinstance(data, dict):
        raise InputError(f"{file}: holds {_shown(data)}; it must be an object with camera_angle_x and frames")
    fov = _number(data.get("camera_angle_x"), f"{file}: camera_angle_x")
    check_field_of_view(fov, f"{file}: camera_angle_x (in radians)")
    frames = data.get("frames")
    if not isinstance(frames, list) or not frames:
        raise InputError(f"{file}: frames is {_shown(frames)}; it must list at least one view")
    _check_lens(data, file)
    files: list[Path] = []
    poses = np.empty((len(frames), 4, 4))
    names = []
    for number, frame in enumerate(frames):
        where = f"{file}: frame {number}"
        if not isinstance(frame, dict):
            raise InputError(f"{where} is {_shown(frame)}; it must be an object with file_path and transform_matrix")
        _check_lens(frame, where)
        files.append(_image_file(folder, frame.get("file_path"), where))
        poses[number] = _matrix(frame.get("transform_matrix"), where)
        names.append(f"{where} ({frame['file_path']})")
    check_poses(poses, names)
    listed: dict[Path, int] = {}
    for number, image in enumerate(files):
        if listed.setdefault(image, number) != number:
            raise InputError(f"{file}: frames {listed[image]} and {number} both name {image}; list each image once")
    return Frames(fov, files, poses)


def read_json(file: Path) -> Any:
    """Strict JSON: no NaN or Infinity, no more than 50 MB. Raises `InputError` that names the file."""
    if not file.is_file():
        raise InputError(f"{file}: missing; a view set needs it (the format is that of the NeRF synthetic scenes)")
    try:
        size = file.stat().st_size
        if size > LARGEST_FILE:
            raise InputError(f"{file}: {size} bytes; a view set's JSON has no more than {LARGEST_FILE}")
        return json.loads(file.read_text(encoding="utf-8-sig"), parse_constant=_refuse)
    except (ValueError, RecursionError) as error:  # UnicodeDecodeError and JSONDecodeError are ValueErrors
        if isinstance(error, InputError):
            raise
        reason = "nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise InputError(f"{file}: not valid JSON ({reason})") from error
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror})") from error


def _refuse(constant: str) -> float:
    raise ValueError(f"{constant} is not a number; give a finite one")


def _number(value: Any, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{what} is {_shown(value)}; it must be a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise InputError(f"{what} is {_shown(value)}; it must be finite")
    return number


def _matrix(value: Any, where: str) -> np.ndarray:
    rows_right = isinstance(value, list) and len(value) == 4
    if not rows_right or not all(isinstance(row, list) and len(row) == 4 for row in value):
        raise InputError(f"{where}: transform_matrix is {_shown(value)}; it must be four rows of four numbers")
    return np.array(
        [[_number(x, f"{where}: transform_matrix[{i}][{j}]") for j, x in enumerate(row)] for i, row in enumerate(value)]
    )


def _image_file(folder: Path, value: Any, where: str) -> Path:
    """The existing file that a frame's path means; refuses whatever leads out of the folder, by links as well."""
    if not isinstance(value, str) or not value or "\0" in value:
        raise InputError(f"{where}: file_path is {_shown(value)}; it must be a path inside {folder}")
    relative = value.replace("\\", "/")
    if relative.startswith("/") or ":" in relative.split("/")[0] or ".." in relative.split("/"):
        raise InputError(f"{where}: file_path {_shown(value)} leaves the folder; paths must stay inside {folder}")
    root = folder.resolve()
    named = root / relative
    candidates = [named, *(named.with_name(named.name + suffix) for suffix in SUFFIXES)]
    try:
        found = next((file for file in candidates if file.is_file()), None)
        resolved = found.resolve() if found else None
    except (OSError, ValueError) as error:  # a name too long, a loop of links
        raise InputError(f"{where}: file_path {_shown(value)} cannot be followed ({error})") from error
    if resolved is None:
        raise InputError(f"{where}: no image {named} (nor with {' '.join(SUFFIXES)}); restore it or drop the frame")
    if not resolved.is_relative_to(root):
        raise InputError(f"{where}: file_path {_shown(value)} is a link out of the folder, to {resolved}; copy it in")
    return resolved


_LENS_ZERO = ("k1", "k2", "k3", "k4", "p1", "p2")


def _check_lens(entry: dict[str, Any], where: Path | str) -> None:
    """Raises `InputError` where other trainers' keys say that the camera is not our pinhole."""
    for key in _LENS_ZERO:
        if key in entry and abs(_number(entry[key], f"{where}: {key}")) > 1e-9:
            raise InputError(f"{where}: {key} is {entry[key]}; lens distortion is not supported: undistort the images")
    for centre, size in (("cx", "w"), ("cy", "h")):
        if centre in entry and size in entry:
            off = _number(entry[centre], f"{where}: {centre}") - _number(entry[size], f"{where}: {size}") / 2
            if abs(off) > 0.51:  # some write the centre of the middle pixel
                raise InputError(
                    f"{where}: {centre} is {off:+.2f} px off the centre; off-centre lenses are not supported"
                )
    if "fl_x" in entry and "fl_y" in entry:
        x, y = (_number(entry[key], f"{where}: {key}") for key in ("fl_x", "fl_y"))
        if abs(x - y) > 1e-3 * abs(x):
            raise InputError(f"{where}: fl_x {x} and fl_y {y} differ; pixels must be square: resample the images")


def _shown(value: Any) -> str:
    if value is None:
        return "missing"
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "…"
