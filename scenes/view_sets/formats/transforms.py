"""Listings of views and cameras, read and checked: `transforms_{split}.json`, the Blender format of the field, and
`transforms.json` of nerfstudio and instant-ngp, with one reader for both.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct, ValidationError, convert, structs

from scenes.files.errors import InputError
from scenes.view_sets.viewpoints import check_field_of_view, check_poses

LARGEST_FILE = 50 * 1024 * 1024
SUFFIXES = (".png", ".jpg", ".jpeg")
"""The suffixes tried in turn if a frame's path has none."""
SAME_FOCAL = 1e-4
"""The relative difference below which views have one focal length: 0.04 pixels at the edge of 800."""
BOTH_FOCAL = 0.01
"""The relative difference below which two values of one focal length agree."""
CAMERA_MODELS = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "PERSPECTIVE")
"""The models that are pinholes without distortion parameters."""
_LENS_ZERO = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "p3", "p4")

Number = Annotated[float, Meta(gt=-1e30, lt=1e30)]
Pixels = Annotated[float, Meta(gt=1e-6, lt=1e9)]
Row = tuple[Number, Number, Number, Number]


class Camera(Struct, frozen=True, kw_only=True):
    """The keys of other trainers for a camera; null is the same as a missing key."""

    camera_model: str | None = None
    camera_angle_x: Number | None = None
    camera_angle_y: Number | None = None
    w: Pixels | None = None
    h: Pixels | None = None
    fl_x: Pixels | None = None
    fl_y: Pixels | None = None
    cx: Number | None = None
    cy: Number | None = None
    k1: Number | None = None
    k2: Number | None = None
    k3: Number | None = None
    k4: Number | None = None
    k5: Number | None = None
    k6: Number | None = None
    p1: Number | None = None
    p2: Number | None = None
    p3: Number | None = None
    p4: Number | None = None
    distortion_params: list[Number] | None = None
    is_orthographic: object = None
    is_fisheye: object = None
    mask_path: object = None


class Frame(Camera, frozen=True, kw_only=True):
    file_path: str
    transform_matrix: tuple[Row, Row, Row, Row]


class ViewRegion(Struct, frozen=True):
    bounds: list[Number] | None = None
    near: Number | None = None
    far: Number | None = None


class Document(Camera, frozen=True, kw_only=True):
    """A file of either format; keys at the top level hold for all views."""

    frames: Annotated[list[Frame], Meta(min_length=1)]
    train_filenames: list[str] | None = None
    val_filenames: list[str] | None = None
    test_filenames: list[str] | None = None
    view_region: ViewRegion | None = None


@dataclass(frozen=True)
class Frames:
    """The views that a file lists, or those of one split."""

    fov_x_radians: float
    files: list[Path]
    """The image files, existing, inside the folder."""
    camera_to_world: np.ndarray
    """The poses, float64 [n, 4, 4], OpenGL axes, rigid."""

    def of(self, chosen: list[int] | np.ndarray) -> "Frames":
        return Frames(self.fov_x_radians, [self.files[i] for i in chosen], self.camera_to_world[chosen])


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
    """Read a listing of one split; errors as in `read_listing`."""
    return read_listing(transforms_file(folder, split), by_angle=True)[1]


def read_listing(file: Path, by_angle: bool = False) -> tuple[Document, Frames, list[Camera]]:
    """Read a file and check it: every image exists inside the folder, is listed once, and all have one pinhole with
    square pixels. If a file gives both, `by_angle` takes the camera's angle instead of its focal length.

    Raises `InputError` that names the file, the value and the remedy.
    """
    try:
        document = convert(read_json(file), Document)
    except ValidationError as error:
        raise InputError(
            f"{file}: {error}; it must hold finite numbers, and frames, each with file_path and transform_matrix, four "
            "rows of four"
        ) from error
    shared = {key: value for key in Camera.__struct_fields__ if (value := getattr(document, key)) is not None}
    cameras: dict[Path, Camera] = {}
    angles = []
    for number, frame in enumerate(document.frames):
        where = f"{file}: frame {number}"
        image = image_file(file.parent, frame.file_path, where)
        if image in cameras:
            raise InputError(f"{where} names {image}, as a frame before it does; list each image once")
        for key, value in shared.items():
            if not _same(own := getattr(frame, key), value):
                raise InputError(f"{where}: {key} is {shown(own)}, and {shown(value)} for all frames; keep one of them")
        cameras[image] = structs.replace(frame, **shared)
        angles.append(_field_of_view(cameras[image], where, by_angle))
        _check_lens(cameras[image], where, angles[-1])
        if abs(math.tan(angles[-1] / 2) - math.tan(angles[0] / 2)) > SAME_FOCAL * math.tan(angles[0] / 2):
            raise InputError(
                f"{where} has another focal length than frame 0 (fields of view {angles[-1]:.6g} and {angles[0]:.6g} "
                "rad); one lens is supported: export the views of one camera"
            )
    poses = np.array([frame.transform_matrix for frame in document.frames], dtype=np.float64)
    check_poses(poses, [f"{file}: frame {i} ({frame.file_path})" for i, frame in enumerate(document.frames)])
    return document, Frames(angles[0], list(cameras), poses), list(cameras.values())


def _same(own: object, value: object) -> bool:
    """Return whether the value of a frame is missing, or the value that its file gives for all frames."""
    if isinstance(own, float) and isinstance(value, float):
        return abs(own - value) <= SAME_FOCAL * abs(value)
    return own is None or own == value


def read_json(file: Path) -> Any:
    """Read strict JSON: no NaN or Infinity, no more than 50 MB. Raises `InputError` that names the file."""
    if not file.is_file():
        raise InputError(f"{file}: missing; a view set needs it (the format is that of the NeRF synthetic scenes)")
    try:
        if (size := file.stat().st_size) > LARGEST_FILE:
            raise InputError(f"{file}: {size} bytes; a view set's JSON has no more than {LARGEST_FILE}")
        text = file.read_text(encoding="utf-8-sig")
        return json.loads(text, parse_constant=_refuse, object_pairs_hook=_each_key_once)
    except InputError:
        raise
    except RecursionError as error:
        raise InputError(f"{file}: not valid JSON (nested too deeply)") from error
    except ValueError as error:  # UnicodeDecodeError and JSONDecodeError as well
        raise InputError(f"{file}: not valid JSON ({error})") from error
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror})") from error


def _refuse(constant: str) -> float:
    raise ValueError(f"{constant} is not a number; give a finite one")


def _each_key_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content: dict[str, Any] = {}
    for key, value in pairs:
        if key in content:
            raise ValueError(f"{shown(key)} is given twice; keep one of them")
        content[key] = value
    return content


def image_file(folder: Path, path: str, where: str) -> Path:
    """Return the existing file of a frame's path; raises `InputError` if it leads out of the folder, also by a link."""
    if not path or "\0" in path:
        raise InputError(f"{where}: file_path is {shown(path)}; it must be a path inside {folder}")
    relative = path.replace("\\", "/")
    if relative.startswith("/") or ":" in relative.split("/")[0] or ".." in relative.split("/"):
        raise InputError(f"{where}: file_path {shown(path)} leaves the folder; paths must stay inside {folder}")
    root = folder.resolve()
    named = root / relative
    try:
        candidates = [named, *(named.with_name(named.name + suffix) for suffix in SUFFIXES)]
        file = next((file.resolve() for file in candidates if file.is_file()), None)
    except (OSError, ValueError) as error:  # a name too long, a loop of links
        raise InputError(f"{where}: file_path {shown(path)} cannot be followed ({error})") from error
    if file is None:
        raise InputError(f"{where}: no image {named} (nor with {' '.join(SUFFIXES)}); restore it or drop the frame")
    if not file.is_relative_to(root):
        raise InputError(f"{where}: file_path {shown(path)} is a link out of the folder, to {file}; copy it in")
    return file


def _field_of_view(camera: Camera, where: str, by_angle: bool) -> float:
    """Return the horizontal field of view in radians."""
    angle = camera.camera_angle_x
    if camera.fl_x is not None and not (by_angle and angle is not None):
        if camera.w is None:
            raise InputError(f"{where}: fl_x without w; give the width in pixels that the focal length is meant for")
        by_length = 2 * math.atan(0.5 * camera.w / camera.fl_x)
        if angle is not None and abs(math.tan(angle / 2) - math.tan(by_length / 2)) > BOTH_FOCAL * math.tan(
            by_length / 2
        ):
            raise InputError(
                f"{where}: camera_angle_x is {angle:.6g}, and fl_x and w say {by_length:.6g}; correct one of them"
            )
        angle = by_length
    if angle is None:
        raise InputError(f"{where}: neither camera_angle_x nor fl_x is given; give the camera's angle in radians")
    check_field_of_view(angle, f"{where}: camera_angle_x (in radians) or fl_x")
    return angle


def _check_lens(camera: Camera, where: str, fov_x_radians: float) -> None:
    """Raise `InputError` if the keys describe any camera but a centred pinhole with square pixels."""
    if camera.camera_model not in (None, *CAMERA_MODELS):
        raise InputError(
            f"{where}: camera_model is {shown(camera.camera_model)}; only {' '.join(CAMERA_MODELS)} are read: "
            "undistort the images to a pinhole (COLMAP's image_undistorter)"
        )
    for key in ("is_orthographic", "is_fisheye"):
        if getattr(camera, key):
            raise InputError(f"{where}: {key} is True; only pinholes are supported: undistort the images")
    distortion = {key: getattr(camera, key) for key in _LENS_ZERO}
    distortion |= {f"distortion_params[{i}]": value for i, value in enumerate(camera.distortion_params or [])}
    for key, value in distortion.items():
        if abs(value or 0.0) > 1e-9:
            raise InputError(f"{where}: {key} is {value}; lens distortion is not supported: undistort the images")
    for centre, size in (("cx", "w"), ("cy", "h")):
        if (middle := getattr(camera, centre)) is None:
            continue
        if (length := getattr(camera, size)) is None:
            raise InputError(f"{where}: {centre} without {size}; give {size}, the pixels that {centre} is meant for")
        off = middle - length / 2
        if abs(off) > 0.51:  # some programs write the centre of the middle pixel
            raise InputError(f"{where}: {centre} is {off:+.2f} px off the centre; off-centre lenses are not supported")
    if camera.fl_y is not None:
        if camera.fl_x is None:
            raise InputError(f"{where}: fl_y without fl_x; give both, or only camera_angle_x")
        if abs(camera.fl_x - camera.fl_y) > 1e-3 * abs(camera.fl_x):
            raise InputError(
                f"{where}: fl_x {camera.fl_x} and fl_y {camera.fl_y} differ; pixels must be square: resample the images"
            )
    if (angle := camera.camera_angle_y) is not None:
        if camera.w is None or camera.h is None:
            raise InputError(f"{where}: camera_angle_y without w and h; give both, or leave it out: pixels are square")
        check_field_of_view(angle, f"{where}: camera_angle_y (in radians)")
        expected = math.tan(fov_x_radians / 2) * camera.h / camera.w
        if abs(math.tan(angle / 2) - expected) > 1e-3 * expected:
            raise InputError(
                f"{where}: camera_angle_y is {angle:.6g}, of square pixels it is {2 * math.atan(expected):.6g}; pixels "
                "must be square: resample the images"
            )


def shown(value: object) -> str:
    """Return a value for a message, cut if it is long."""
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "…"
