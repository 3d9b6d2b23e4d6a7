"""`transforms.json` of nerfstudio and instant-ngp: one file for all splits, intrinsics in pixels.

Reading rules are those of nerfstudio's `nerfstudio_dataparser.py` (version 1.1.5, with its default options) as far as
they concern which view belongs to which split: `train_filenames`, `val_filenames` and `test_filenames`, else evenly
spread nine tenths of the views, sorted by path, for training. Poses are taken as they are written, not turned or
scaled; `applied_transform`, `aabb_scale`, `scale`, `offset` and depth maps change nothing here.
"""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from scenes.files.errors import InputError
from scenes.view_sets.images import read_image
from scenes.view_sets.source import Region, Source
from scenes.view_sets.transforms import (
    Frames,
    check_lens,
    image_file,
    matrix_of,
    number_of,
    pixels_of,
    read_json,
    shown,
)
from scenes.view_sets.viewpoints import SPLITS, check_field_of_view, check_poses

NAME = "transforms.json"
TRAIN_SHARE = 0.9
REGION = "view_region"
"""The key of our own, which others ignore: `bounds` (six numbers), `near`, `far`."""
SAME_FOCAL = 1e-4
"""The relative difference between views below which they have one lens: 0.04 pixels at the edge of 800."""
Listed = dict[str, list[str]]


def write_nerfstudio(
    file: Path, views: dict[str, tuple[list[str], np.ndarray]], size: tuple[int, int], focal: float, region: Region
) -> None:
    """Write `transforms.json`.

    `views` maps split → paths of images relative to the file's folder, with suffix, and poses [n, 4, 4]; `size` is
    width and height, `focal` in pixels. Without a `val`, the test views are named for it: nerfstudio wants all three.
    """
    width, height = size
    listed = {split: paths for split, (paths, _) in views.items() if paths}
    frames = [
        {"file_path": path, "transform_matrix": pose.tolist()}
        for paths, poses in views.values()
        for path, pose in zip(paths, poses, strict=True)
    ]
    content = {
        "camera_model": "OPENCV",
        "w": width,
        "h": height,
        "fl_x": focal,
        "fl_y": focal,
        "cx": width / 2,
        "cy": height / 2,
        "k1": 0.0,
        "k2": 0.0,
        "p1": 0.0,
        "p2": 0.0,
        # the object stands upright already, about the origin
        "orientation_override": "none",
        "aabb_scale": _aabb_scale(region),
        **{f"{split}_filenames": listed.get(split, listed.get("test", listed.get("train", []))) for split in SPLITS},
        REGION: {"bounds": region.bounds, "near": region.near, "far": region.far},
        "frames": frames,
    }
    file.write_text(json.dumps(content, indent=1, allow_nan=False), encoding="utf-8")


def _aabb_scale(region: Region) -> int:
    """Return the scale for instant-ngp, which maps x to 0.33 x + 0.5: the power of two, up to 128, whose box holds
    everything seen.
    """
    farthest = max((abs(value) for value in region.bounds), default=1.0) if region.bounds else 1.0
    return next((scale for scale in (1, 2, 4, 8, 16, 32, 64) if 0.33 * farthest <= scale / 2), 128)


def read_nerfstudio(folder: Path) -> Source:
    """Read the folder's `transforms.json`. Raises `InputError`, naming file, value and remedy, for anything that cannot
    be trusted or is not a pinhole of square pixels with the optical axis in the middle.
    """
    file = folder / NAME
    data = read_json(file)
    if not isinstance(data, dict):
        raise InputError(f"{file}: holds {shown(data)}; it must be an object with fl_x and frames")
    frames = data.get("frames")
    if not isinstance(frames, list) or not frames:
        raise InputError(f"{file}: frames is {shown(frames)}; it must list at least one view")
    angles, files, poses = [], [], np.empty((len(frames), 4, 4))
    shapes: dict[Path, float | None] = {}
    for number, frame in enumerate(frames):
        where = f"{file}: frame {number}"
        if not isinstance(frame, dict):
            raise InputError(f"{where} is {shown(frame)}; it must be an object with file_path and transform_matrix")
        # keys at the top hold for all views, as in nerfstudio
        camera = {**frame, **{key: value for key, value in data.items() if key != "frames"}}
        image = image_file(folder, frame.get("file_path"), where)
        if image in shapes:
            raise InputError(f"{where} names {image}, as a frame before it does; list each image once")
        angle, shapes[image] = _lens(camera, where)
        angles.append(angle)
        files.append(image)
        poses[number] = matrix_of(frame.get("transform_matrix"), where)
    fov = angles[0]
    for number, angle in enumerate(angles):
        if abs(math.tan(angle / 2) - math.tan(fov / 2)) > SAME_FOCAL * math.tan(fov / 2):
            raise InputError(
                f"{file}: frame {number} has another focal length than frame 0 (fields of view {angle:.6g} and "
                f"{fov:.6g} rad); one lens is supported: export the views of one camera"
            )
    check_poses(poses, [f"{file}: frame {number} ({frame['file_path']})" for number, frame in enumerate(frames)])
    chosen, notes = _splits(data, folder, file, files)
    opaque = _pixels(files[0], None).shape[2] == 3
    if opaque:
        notes.append(
            f"{files[0].name} has no alpha: images without alpha count as wholly covered, background included."
        )
    region = _region(data, file)
    if region.bounds is None:
        notes.append("Bounds, near and far are found from the cameras; --bounds, --near and --far say better.")
    return Source(
        name=folder.resolve().name,
        frames=lambda split: (
            Frames(fov, [files[i] for i in chosen[split]], poses[chosen[split]]) if chosen.get(split) else None
        ),
        pixels=lambda image: with_alpha(_pixels(image, shapes[image])),
        region=region,
        notes=tuple(notes),
    )


def with_alpha(pixels: np.ndarray) -> np.ndarray:
    """Return RGB [h, w, 3] as fully opaque RGBA; RGBA as it is."""
    if pixels.shape[2] == 4:
        return pixels
    return np.concatenate([pixels, np.ones((*pixels.shape[:2], 1), dtype=pixels.dtype)], axis=-1)


def _lens(camera: dict[str, Any], where: str) -> tuple[float, float | None]:
    """Return the horizontal field of view in radians, and height over width if it is given."""
    if camera.get("mask_path") is not None:
        raise InputError(
            f"{where}: mask_path is {shown(camera['mask_path'])}; pixels cannot be left out of training: save the mask "
            "as the image's alpha channel where it cuts out an object, or remove mask_path to use every pixel"
        )
    size = {
        key: pixels_of(camera[key], f"{where}: {key}")
        for key in ("w", "h", "fl_x", "fl_y")
        if camera.get(key) is not None
    }
    width, height = size.get("w"), size.get("h")
    if "fl_x" in size:
        if width is None:
            raise InputError(f"{where}: fl_x without w; give the width in pixels that the focal length is meant for")
        angle = 2 * math.atan(0.5 * width / size["fl_x"])
    else:
        angle = number_of(camera.get("camera_angle_x"), f"{where}: without fl_x, camera_angle_x")
    check_field_of_view(angle, f"{where}: camera_angle_x or fl_x")
    check_lens(camera, where, angle)
    return angle, height / width if width and height else None


def _pixels(image: Path, shape: float | None) -> np.ndarray:
    """Return pixels, float32 [h, w, 3 or 4]."""
    pixels = read_image(image)
    height, width, channels = pixels.shape
    if channels not in (3, 4):
        raise InputError(f"{image}: {channels} channels; views must be RGB or RGBA: save them so")
    if shape is not None and abs(height - shape * width) > max(1.0, shape):  # a pixel of rounding in either side
        raise InputError(
            f"{image}: {width} × {height} pixels, but {NAME} says h / w = {shape:.4g}; give w and h of these "
            "images, or resized copies of the whole pictures"
        )
    return pixels


def _splits(
    data: dict[str, Any], folder: Path, file: Path, files: list[Path]
) -> tuple[dict[str, list[int]], list[str]]:
    """Return split → indices of its views, and the assumptions made."""
    numbers = {image: number for number, image in enumerate(files)}
    named: dict[str, list[int]] = {}
    for split in SPLITS:
        key = f"{split}_filenames"
        if data.get(key) is None:
            continue
        if not isinstance(data[key], list):
            raise InputError(f"{file}: {key} is {shown(data[key])}; it must list file_path values")
        found = [image_file(folder, one, f"{file}: {key}") for one in data[key]]
        if unknown := [image for image in found if image not in numbers]:
            raise InputError(f"{file}: {key} names {unknown[0]}, which no frame has; list the frame or drop the name")
        named[split] = sorted({numbers[image] for image in found})
    if not named:
        return _shared_out(file, files)
    notes = []
    if named.get("val") and named.get("val") == named.get("test"):
        del named["val"]
    if not named.get("test") and named.get("val"):
        named["test"] = named.pop("val")
        notes.append(f"{NAME} names no test views: its val views are the test views.")
    for split in ("train", "test"):
        if not named.get(split):
            raise InputError(f"{file}: {split}_filenames is missing or empty while others are given; list its views")
    return named, notes


def _shared_out(file: Path, files: list[Path]) -> tuple[dict[str, list[int]], list[str]]:
    """Return training views evenly spread over the sorted paths, the rest for testing."""
    count = len(files)
    train = math.ceil(count * TRAIN_SHARE)
    if train == count:
        raise InputError(
            f"{file}: {count} views without train_filenames and test_filenames; list them, ten views or more are "
            "shared out nine to one"
        )
    order = sorted(range(count), key=lambda number: files[number])
    chosen = set(np.linspace(0, count - 1, train, dtype=int).tolist())
    splits = {
        "train": [order[i] for i in range(count) if i in chosen],
        "test": [order[i] for i in range(count) if i not in chosen],
    }
    note = (
        f"{NAME} names no splits: {train} of {count} views, evenly spread, train, the others test (nerfstudio's rule)."
    )
    return splits, [note]


def _region(data: dict[str, Any], file: Path) -> Region:
    said = data.get(REGION)
    if said is None:
        return Region()
    if not isinstance(said, dict):
        raise InputError(f"{file}: {REGION} is {shown(said)}; it must be an object with bounds, near and far")
    bounds = said.get("bounds")
    if bounds is not None and not isinstance(bounds, list):
        raise InputError(f"{file}: {REGION}: bounds is {shown(bounds)}; it must be six numbers")
    near, far = (None if said.get(k) is None else number_of(said[k], f"{file}: {REGION}: {k}") for k in ("near", "far"))
    box = None if bounds is None else tuple(number_of(value, f"{file}: {REGION}: bounds") for value in bounds)
    try:
        return Region(box, near, far)
    except InputError as error:
        raise InputError(f"{file}: {REGION}: {error}") from error
