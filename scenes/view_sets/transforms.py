"""`transforms_{split}.json`, the Blender format of the field, written as it is and read with suspicion."""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scenes.files.errors import InputError
from scenes.view_sets.viewpoints import check_field_of_view, check_poses

LARGEST_FILE = 50 * 1024 * 1024
SUFFIXES = (".png", ".jpg", ".jpeg")
"""The suffixes tried in turn if a frame's path has none."""


@dataclass(frozen=True)
class Frames:
    """A split as its file lists it."""

    fov_x_radians: float
    files: list[Path]
    """The image files, existing, inside the folder."""
    camera_to_world: np.ndarray
    """The poses, float64 [n, 4, 4], OpenGL axes, rigid."""


def transforms_file(folder: Path, split: str) -> Path:
    return folder / f"transforms_{split}.json"


def write_transforms(file: Path, fov_x_radians: float, paths: list[str], camera_to_world: np.ndarray) -> None:
    """Write a listing; `paths` are relative to the file's folder, without suffix, such as `./train/r_0`."""
    frames = [
        {"file_path": path, "rotation": 2 * math.pi / len(paths), "transform_matrix": pose.tolist()}
        for path, pose in zip(paths, camera_to_world, strict=True)
    ]
    file.write_text(json.dumps({"camera_angle_x": fov_x_radians, "frames": frames}, indent=4), encoding="utf-8")


def read_transforms(folder: Path, split: str) -> Frames:
    """Read a listing. Raises `InputError` that names the file, the value and the remedy for data that cannot be
    trusted.
    """
    file = transforms_file(folder, split)
    data = read_json(file)
    if not isinstance(data, dict):
        raise InputError(f"{file}: holds {shown(data)}; it must be an object with camera_angle_x and frames")
    fov = number_of(data.get("camera_angle_x"), f"{file}: camera_angle_x")
    check_field_of_view(fov, f"{file}: camera_angle_x (in radians)")
    frames = data.get("frames")
    if not isinstance(frames, list) or not frames:
        raise InputError(f"{file}: frames is {shown(frames)}; it must list at least one view")
    check_lens(data, file, fov)
    files: list[Path] = []
    poses = np.empty((len(frames), 4, 4))
    names = []
    for number, frame in enumerate(frames):
        where = f"{file}: frame {number}"
        if not isinstance(frame, dict):
            raise InputError(f"{where} is {shown(frame)}; it must be an object with file_path and transform_matrix")
        check_lens(frame, where, fov)
        files.append(image_file(folder, frame.get("file_path"), where))
        poses[number] = matrix_of(frame.get("transform_matrix"), where)
        names.append(f"{where} ({frame['file_path']})")
    check_poses(poses, names)
    listed: dict[Path, int] = {}
    for number, image in enumerate(files):
        if listed.setdefault(image, number) != number:
            raise InputError(f"{file}: frames {listed[image]} and {number} both name {image}; list each image once")
    return Frames(fov, files, poses)


def read_json(file: Path) -> Any:
    """Read strict JSON: no NaN or Infinity, no more than 50 MB. Raises `InputError` that names the file."""
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


def number_of(value: Any, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{what} is {shown(value)}; it must be a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise InputError(f"{what} is {shown(value)}; it must be finite")
    return number


def pixels_of(value: Any, what: str) -> float:
    number = number_of(value, what)
    if not 1e-6 < number < 1e9:
        raise InputError(f"{what} is {shown(value)}; it must be a positive number of pixels")
    return number


def matrix_of(value: Any, where: str) -> np.ndarray:
    rows_right = isinstance(value, list) and len(value) == 4
    if not rows_right or not all(isinstance(row, list) and len(row) == 4 for row in value):
        raise InputError(f"{where}: transform_matrix is {shown(value)}; it must be four rows of four numbers")
    return np.array(
        [
            [number_of(x, f"{where}: transform_matrix[{i}][{j}]") for j, x in enumerate(row)]
            for i, row in enumerate(value)
        ]
    )


def image_file(folder: Path, value: Any, where: str) -> Path:
    """Return the existing file that a frame's path means; refuses anything that leads out of the folder, by links as
    well.
    """
    if not isinstance(value, str) or not value or "\0" in value:
        raise InputError(f"{where}: file_path is {shown(value)}; it must be a path inside {folder}")
    relative = value.replace("\\", "/")
    if relative.startswith("/") or ":" in relative.split("/")[0] or ".." in relative.split("/"):
        raise InputError(f"{where}: file_path {shown(value)} leaves the folder; paths must stay inside {folder}")
    root = folder.resolve()
    named = root / relative
    candidates = [named, *(named.with_name(named.name + suffix) for suffix in SUFFIXES)]
    try:
        found = next((file for file in candidates if file.is_file()), None)
        resolved = found.resolve() if found else None
    except (OSError, ValueError) as error:  # a name too long, a loop of links
        raise InputError(f"{where}: file_path {shown(value)} cannot be followed ({error})") from error
    if resolved is None:
        raise InputError(f"{where}: no image {named} (nor with {' '.join(SUFFIXES)}); restore it or drop the frame")
    if not resolved.is_relative_to(root):
        raise InputError(f"{where}: file_path {shown(value)} is a link out of the folder, to {resolved}; copy it in")
    return resolved


_LENS_ZERO = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "p3", "p4")
_LENS_NO = ("is_orthographic", "is_fisheye")
CAMERA_MODELS = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "PERSPECTIVE")
"""The models that are a pinhole if no distortion is given."""


def check_lens(entry: dict[str, Any], where: Path | str, fov_x_radians: float) -> None:
    """Raise `InputError` if other trainers' keys say that the camera is not our pinhole, or if their values cannot be
    checked. A key that is null says nothing.
    """
    said = {key: value for key, value in entry.items() if value is not None}
    if "camera_model" in said and said["camera_model"] not in CAMERA_MODELS:
        raise InputError(
            f"{where}: camera_model is {shown(said['camera_model'])}; only {' '.join(CAMERA_MODELS)} are read: "
            "undistort the images to a pinhole (COLMAP's image_undistorter)"
        )
    for key in _LENS_NO:
        if said.get(key):
            raise InputError(f"{where}: {key} is {shown(said[key])}; only pinholes are supported: undistort the images")
    given = said.get("distortion_params", [])
    if not isinstance(given, list):
        raise InputError(f"{where}: distortion_params is {shown(given)}; it must be a list of numbers")
    distortion = {f"distortion_params[{i}]": value for i, value in enumerate(given)}
    for key, value in {**{key: said[key] for key in _LENS_ZERO if key in said}, **distortion}.items():
        if abs(number_of(value, f"{where}: {key}")) > 1e-9:
            raise InputError(f"{where}: {key} is {value}; lens distortion is not supported: undistort the images")
    lens: dict[str, float] = {
        key: pixels_of(said[key], f"{where}: {key}") for key in ("w", "h", "fl_x", "fl_y") if key in said
    }
    for centre, size in (("cx", "w"), ("cy", "h")):
        if centre not in said:
            continue
        if size not in lens:
            raise InputError(f"{where}: {centre} without {size}; give {size}, the pixels that {centre} is meant for")
        off = number_of(said[centre], f"{where}: {centre}") - lens[size] / 2
        if abs(off) > 0.51:  # some write the centre of the middle pixel
            raise InputError(f"{where}: {centre} is {off:+.2f} px off the centre; off-centre lenses are not supported")
    _check_square(lens, said.get("camera_angle_y"), fov_x_radians, where)


def _check_square(lens: dict[str, float], angle_y: Any, fov_x_radians: float, where: Path | str) -> None:
    """Raise `InputError` if the vertical and the horizontal values do not make square pixels."""
    if "fl_y" in lens:
        if "fl_x" not in lens:
            raise InputError(f"{where}: fl_y without fl_x; give both, or camera_angle_x alone")
        if abs(lens["fl_x"] - lens["fl_y"]) > 1e-3 * abs(lens["fl_x"]):
            raise InputError(
                f"{where}: fl_x {lens['fl_x']} and fl_y {lens['fl_y']} differ; pixels must be square: "
                "resample the images"
            )
    if angle_y is not None:
        if not {"w", "h"} <= set(lens):
            raise InputError(f"{where}: camera_angle_y without w and h; give both, or leave it out: pixels are square")
        angle = number_of(angle_y, f"{where}: camera_angle_y")
        check_field_of_view(angle, f"{where}: camera_angle_y (in radians)")
        expected = math.tan(fov_x_radians / 2) * lens["h"] / lens["w"]
        if abs(math.tan(angle / 2) - expected) > 1e-3 * expected:
            raise InputError(
                f"{where}: camera_angle_y is {angle:.6g}, of square pixels it is {2 * math.atan(expected):.6g}; pixels "
                "must be square: resample the images"
            )


def shown(value: Any) -> str:
    if value is None:
        return "missing or null"
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "…"
