"""Listings of views and cameras, read and checked: `transforms_{split}.json`, the Blender format of the field, and
`transforms.json` of nerfstudio and instant-ngp, with one reader for both.
"""

import json
import math
import posixpath
import unicodedata
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct, ValidationError, convert, structs

from scenes.files.errors import InputError, shown
from scenes.files.json_object import each_key_once
from scenes.view_sets.formats.lens import MODELS, Lens, common_pinhole, read_through, resampling_note, seen_size
from scenes.view_sets.images import header
from scenes.view_sets.viewpoints import check_field_of_view, rigid

LARGEST_FILE = 50 * 1024 * 1024
SUFFIXES = (".png", ".jpg", ".jpeg", ".webp")
"""The suffixes tried in turn if a frame's path has none."""
SAME_FOCAL = 1e-4
"""The relative difference below which a value that is given twice is one value."""
IMAGES = "images"
PIXEL = 1.0
"""The deviation at a picture's edge, in pixels, above which two values of one focal length contradict each other."""
PERSPECTIVE = ("PERSPECTIVE", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV")
"""The models whose parameters have the meaning of OPENCV's."""
NAMED = tuple(name for name, parameters in MODELS.values() if not {"omega", "sx1"} & set(parameters))
"""The models whose parameters have keys in these files."""

Number = Annotated[float, Meta(gt=-1e30, lt=1e30)]
Pixels = Annotated[float, Meta(gt=1e-6, lt=1e9)]
Row = tuple[Number, Number, Number, Number]

DISTORTION = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "p3", "p4")
LISTED = ("k1", "k2", "k3", "k4", "p1", "p2")


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
    time: Number | None = None
    transform_matrix: Annotated[list[Row], Meta(min_length=3, max_length=4)]


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
    fov_x_radians: float
    """The horizontal field of view of the pinhole that all views have, after resampling where a lens is none."""
    files: list[Path]
    """The image files, existing, inside the folder."""
    camera_to_world: np.ndarray
    """The poses, float64 [n, 4, 4], OpenGL axes, rigid."""

    def of(self, chosen: list[int] | np.ndarray) -> "Frames":
        return Frames(self.fov_x_radians, [self.files[i] for i in chosen], self.camera_to_world[chosen])


@dataclass(frozen=True)
class Listing:
    document: Document
    frames: Frames
    lenses: dict[Path, Lens | None]
    """File → its lens; None: only an angle is given, which holds for pictures of any size."""
    pinhole: Lens | None
    notes: list[str]
    """What was assumed, one sentence each."""

    def read(self, file: Path, channels: int, width: int | None) -> np.ndarray:
        """Return straight RGBA of one of the frames' files as `read_through` does."""
        return read_through(file, self.lenses[file], self.pinhole, channels, width)

    def size(self, file: Path) -> tuple[int, int]:
        return seen_size(file, self.lenses[file], self.pinhole)


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
    return read_listing(transforms_file(folder, split)).frames


def lists_nothing(file: Path) -> bool:
    """Return whether a listing has no frames, as some programs write for a split without views."""
    content = read_json(file)
    return isinstance(content, dict) and content.get("frames") == []


def read_listing(file: Path) -> Listing:
    """Read a file and check it: every image exists inside the folder and is listed once, and a pinhole fits into all
    lenses.

    Raises `InputError` that names the file, the value and the remedy.
    """
    try:
        document = convert(read_json(file), Document, strict=False)  # some programs write numbers as text
    except ValidationError as error:
        raise InputError(
            f"{file}: {error}; it must hold finite numbers, and frames, each with file_path and transform_matrix, "
            "three or four rows of four"
        ) from error
    shared = {key: value for key in Camera.__struct_fields__ if (value := getattr(document, key)) is not None}
    own = [key for key in shared if _differ_in_all([getattr(frame, key) for frame in document.frames], shared[key])]
    notes = [f"{' '.join(own)}: given for all frames and for each frame; those of the frames decide."] if own else []
    shared = {key: value for key, value in shared.items() if key not in own}
    cameras: dict[Path, Camera] = {}
    lenses: dict[Path, Lens | None] = {}
    for number, frame in enumerate(document.frames):
        where = f"{file}: frame {number}"
        image = image_file(file.parent, frame.file_path, where)
        if image in cameras:
            raise InputError(f"{where} names {image}, as a frame before it does; list each image once")
        for key, value in shared.items():
            if not _same(own := getattr(frame, key), value):
                raise InputError(f"{where}: {key} is {shown(own)}, and {shown(value)} for all frames; keep one of them")
        cameras[image] = structs.replace(frame, **shared)
        lenses[image], assumed = _lens(cameras[image], image, where)
        notes += assumed
    fov, pinhole = _common(list(cameras.values()), list(lenses.values()), file)
    if pinhole is not None:
        notes += resampling_note(filter(None, lenses.values()), pinhole)
    names = [f"{file}: frame {i} ({frame.file_path})" for i, frame in enumerate(document.frames)]
    matrices = [[*frame.transform_matrix, (0.0, 0.0, 0.0, 1.0)][:4] for frame in document.frames]
    poses, rounded = rigid(np.array(matrices, dtype=np.float64), names)
    notes += rounded
    if len({frame.time for frame in document.frames}) > 1:
        notes.append("Frames have different times: they are read as one scene that does not move.")
    return Listing(document, Frames(fov, list(cameras), poses), lenses, pinhole, list(dict.fromkeys(notes)))


def _common(cameras: list[Camera], lenses: list[Lens | None], file: Path) -> tuple[float, Lens | None]:
    """Return the horizontal field of view that all views have, and the pinhole of their lenses if they have any."""
    if known := [lens for lens in lenses if lens is not None]:
        if len(known) < len(lenses):
            raise InputError(f"{file}: frame {lenses.index(None)} has no fl_x, as others have; give all fl_x, w and h")
        pinhole = common_pinhole(known, str(file))
        return pinhole.fov_x_radians, pinhole
    first, *others = (camera.camera_angle_x or 0.0 for camera in cameras)
    for number, angle in enumerate(others, 1):
        if abs(math.tan(angle / 2) - math.tan(first / 2)) > SAME_FOCAL * math.tan(first / 2):
            raise InputError(
                f"{file}: frame {number} has another angle than frame 0 ({angle:.6g} and {first:.6g} rad); give fl_x, "
                "w and h of each frame"
            )
    return first, None


def _differ_in_all(each: list[object], value: object) -> bool:
    """Return whether every frame has a value of its own, not always that which its file gives for all."""
    return None not in each and not all(_same(own, value) for own in each)


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
        return json.loads(text, parse_constant=_refuse, object_pairs_hook=each_key_once)
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


def image_file(folder: Path, path: str, where: str) -> Path:
    """Return the existing file of a frame's path, whose suffix may be missing, differ in case, or be that of the
    picture from which a cut-out of the same name was made.

    Raises `InputError` if it leads out of the folder, also by a link.
    """
    if not path or "\0" in path:
        raise InputError(f"{where}: file_path is {shown(path)}; it must be a path inside {folder}")
    root = folder.resolve()
    relative = posixpath.normpath(path.replace("\\", "/"))
    for place in (root, folder.absolute()):  # a folder that is itself reached by a link
        relative = relative.removeprefix(f"{place.as_posix()}/")
    if relative.startswith("/") or ":" in relative.split("/")[0] or ".." in relative.split("/"):
        raise InputError(f"{where}: file_path {shown(path)} leaves the folder; paths must stay inside {folder}")
    named = root / relative
    places = [named]
    if relative.startswith(f"{IMAGES}/") and not (root / IMAGES).is_dir():  # as in COLMAP's names, too
        places += [place / relative.removeprefix(f"{IMAGES}/") for place in (root, *smaller_copies(root))]
    complete = [place for place in places if place.suffix.lower() in SUFFIXES]
    try:
        file = _found([*places, *(place.with_name(place.name + suffix) for place in places for suffix in SUFFIXES)])
        file = file or _found([place.with_suffix(suffix) for place in complete for suffix in SUFFIXES])
    except (OSError, ValueError) as error:  # a name too long, a loop of links
        raise InputError(f"{where}: file_path {shown(path)} cannot be followed ({error})") from error
    if file is None:
        raise InputError(f"{where}: no image {named} (nor with {' '.join(SUFFIXES)}); restore it or drop the frame")
    if not file.is_relative_to(root):
        raise InputError(f"{where}: file_path {shown(path)} is a link out of the folder, to {file}; copy it in")
    return file


def smaller_copies(folder: Path) -> list[Path]:
    """Return the folders `images_2`, `images_4`, … of smaller copies of pictures, the largest pictures first."""
    places = {place: place.name.removeprefix(f"{IMAGES}_") for place in folder.glob(f"{IMAGES}_*") if place.is_dir()}
    return sorted((place for place, factor in places.items() if factor.isdecimal()), key=lambda each: int(places[each]))


def _found(candidates: list[Path]) -> Path | None:
    """Return the first candidate that is there, else the only file next to them that has one's name apart from case and
    encoding of accents.
    """
    if file := next((file for file in candidates if file.is_file()), None):
        return file.resolve()
    names = {unicodedata.normalize("NFC", candidate.name).lower() for candidate in candidates}
    folders = {candidate.parent for candidate in candidates if candidate.parent.is_dir()}
    neighbours = (file for folder in folders for file in folder.iterdir())
    matches = [
        file for file in neighbours if unicodedata.normalize("NFC", file.name).lower() in names and file.is_file()
    ]
    return matches[0].resolve() if len(matches) == 1 else None


def _lens(camera: Camera, image: Path, where: str) -> tuple[Lens | None, list[str]]:
    """Return the lens that a frame's keys describe, None if they give only an angle, and what was assumed.

    As with other readers, fl_x decides before camera_angle_x, and pixels are square where only one focal length is
    given. Redundant keys are compared with it.
    """
    if camera.mask_path is not None:
        raise InputError(
            f"{where}: mask_path is {shown(camera.mask_path)}; pixels cannot be left out of training: save the mask as "
            "the image's alpha channel where it cuts out an object, or remove mask_path to use every pixel"
        )
    model = _model(camera, where)
    values = _distortion(camera, model, where)
    angle = camera.camera_angle_x
    if angle is not None:
        check_field_of_view(angle, f"{where}: camera_angle_x (in radians)")
    if camera.fl_x is None and angle is None:
        raise InputError(f"{where}: neither camera_angle_x nor fl_x is given; give the camera's angle in radians")
    if camera.fl_x is None and camera.fl_y is not None:
        raise InputError(f"{where}: fl_y without fl_x; give both, or only camera_angle_x")
    if not any(values.values()) and (camera.fl_x, camera.cx, camera.cy, camera.camera_angle_y) == (None,) * 4:
        return None, []
    width, height = round(camera.w or header(image).width), round(camera.h or header(image).height)
    if min(width, height) < 1:
        raise InputError(
            f"{where}: w is {shown(camera.w)} and h {shown(camera.h)}; give the size in pixels, or neither"
        )
    fx = camera.fl_x
    if fx is None:
        assert angle is not None
        fx = 0.5 * width / math.tan(angle / 2)
    fy = camera.fl_y or fx
    cx, cy = (size / 2 if axis is None else axis for size, axis in ((width, camera.cx), (height, camera.cy)))
    lens = Lens.of(model, width, height, values | {"fx": fx, "fy": fy, "cx": cx, "cy": cy})
    return lens, _redundant(camera, (fx, fy), (width, height), where)


def _model(camera: Camera, where: str) -> str:
    if _holds(camera.is_orthographic):
        raise InputError(
            f"{where}: is_orthographic is {shown(camera.is_orthographic)}; only central projections are read"
        )
    if _holds(camera.is_fisheye):
        return "OPENCV_FISHEYE"
    name = (camera.camera_model or "OPENCV").upper()
    if name in PERSPECTIVE:
        return "OPENCV"
    if name not in NAMED:
        raise InputError(
            f"{where}: camera_model is {shown(camera.camera_model)}; {' '.join(NAMED)} are read: undistort the images "
            "to a pinhole (COLMAP's image_undistorter)"
        )
    return name


def _holds(flag: object) -> bool:
    """Return whether a flag is set, also as text."""
    return bool(flag) and str(flag).lower() not in ("false", "0", "no")


def _distortion(camera: Camera, model: str, where: str) -> dict[str, float]:
    values = {key: getattr(camera, key) or 0.0 for key in DISTORTION}
    if listed := camera.distortion_params:
        if len(listed) > len(LISTED) and any(listed[len(LISTED) :]):
            raise InputError(f"{where}: distortion_params has {len(listed)} numbers; {' '.join(LISTED)} are read")
        for key, value in zip(LISTED, listed, strict=False):
            if values[key] and abs(values[key] - value) > 1e-9:
                raise InputError(f"{where}: {key} is {values[key]}, and {value} in distortion_params; correct one")
            values[key] = value
    highest = 6 if model == "FULL_OPENCV" else 4
    for key in (*(f"k{number}" for number in range(highest + 1, 7)), "p3", "p4"):
        if abs(values[key]) > 1e-9:
            raise InputError(f"{where}: {key} is {values[key]}, which {model} does not have; undistort")
    return values


def _redundant(camera: Camera, focal: tuple[float, float], size: tuple[int, int], where: str) -> list[str]:
    """Compare the angles that are given with the focal lengths in pixels that decide; return notes.

    Raises `InputError` if an angle contradicts them by more than `PIXEL` at the edge, except for two that add-ons of
    Blender write: the angle of the longer side as that of x, and that of the sensor's height as that of y.
    """
    notes = []
    for axis, angle in enumerate((camera.camera_angle_x, camera.camera_angle_y)):
        if angle is None:
            continue
        name = f"camera_angle_{'xy'[axis]}"
        check_field_of_view(angle, f"{where}: {name} (in radians)")
        half = 0.5 * size[axis]
        if abs(half - focal[axis] * math.tan(angle / 2)) <= PIXEL:
            continue
        expected = 2 * math.atan(half / focal[axis])
        told = focal[axis] * math.tan(angle / 2)
        is_longer = abs(0.5 * max(size) - told) <= PIXEL
        is_sensor = abs(0.75 * size[1] - told) <= PIXEL  # Blender's, of 36 × 24 mm, where its height decides
        if camera.fl_x is not None and (axis == 1 or is_longer or is_sensor):
            of = "the longer side" if is_longer else "something else, perhaps of the sensor"
            notes.append(
                f"{name} is {angle:.6g}, where focal length and size give {expected:.6g}: it is the angle of {of}, and "
                "fl_x, w and h decide."
            )
            continue
        given = "fl_x and w say" if axis == 0 else "of square pixels it is"
        raise InputError(f"{where}: {name} is {angle:.6g}, and {given} {expected:.6g}; correct one of them")
    return notes
