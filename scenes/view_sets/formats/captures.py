"""Captures with a camera: a reconstruction by COLMAP (`sparse/0`, binary or text), and LLFF's `poses_bounds.npy`.

Both hold out every eighth view by name for testing, as 3D Gaussian Splatting, mip-NeRF 360 and LLFF's loaders do.
Poses are used unchanged, neither rotated nor scaled.
"""

import math
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from scenes.files.errors import InputError, short, shown
from scenes.view_sets.formats.lens import (
    MODELS,
    NAMES,
    Lens,
    common_pinhole,
    looked_into,
    read_through,
    resampling_note,
    seen_size,
)
from scenes.view_sets.formats.transforms import IMAGES, Frames, image_file, smaller_copies
from scenes.view_sets.images import pictures
from scenes.view_sets.source import Region, Source
from scenes.view_sets.viewpoints import rigid

LLFF = "poses_bounds.npy"
LARGEST_BYTES = 1 << 30
HELD_OUT = 8
MOST_RANGE = 20.0
"""The ratio of the farthest to the nearest depth above which a scene counts as unbounded."""
LEAST_POINTS = 50
OUTLIERS = 0.5
"""The percentage of points on each side that bounds exclude."""
MARGIN = 0.05
"""The share of its size by which a box of points is widened on each side."""
OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


def sparse_folder(path: Path) -> Path | None:
    """Return the folder of COLMAP's reconstruction under `path`, if there is one; of several, the first by number."""
    places = [path]
    for root in (path / "colmap" / "sparse", path / "sparse"):
        models = (model for model in root.glob("*") if model.name.isdecimal())
        places[:0] = [*sorted(models, key=lambda model: int(model.name)), root]
    return next((place for place in places for end in ("bin", "txt") if (place / f"cameras.{end}").is_file()), None)


@dataclass(frozen=True)
class _Posed:
    name: str
    camera: int
    camera_to_world: np.ndarray


def read_colmap(path: Path, sparse: Path) -> Source:
    """Read a reconstruction and the folder `images` of `path`; distortion is undone.

    Raises `InputError` for invalid data, for fisheye lenses, and, unless bounds are given, for an unbounded scene.
    """
    end = "bin" if (sparse / "cameras.bin").is_file() else "txt"
    tables = {name: sparse / f"{name}.{end}" for name in ("cameras", "images", "points3D")}
    with _undamaged(tables["cameras"]):
        lenses = dict(_cameras(tables["cameras"]))
    with _undamaged(tables["images"]):
        posed = sorted(_images(tables["images"]), key=lambda image: image.name)
    with _undamaged(tables["points3D"]):
        points = _points(tables["points3D"])
    if not posed:
        raise InputError(f"{tables['images']}: lists no image; name a folder whose reconstruction has cameras")
    if unknown := next((image for image in posed if image.camera not in lenses), None):
        raise InputError(f"{tables['images']}: {shown(unknown.name)} has camera {unknown.camera}, which is not listed")
    names = [image.name for image in posed]
    if twice := next((first for first, second in pairwise(names) if first == second), None):
        raise InputError(f"{tables['images']}: lists {shown(twice)} twice; keep one")
    folder, notes = _pictures_of(path)
    files = [image_file(folder, image.name, f"{tables['images']}: {shown(image.name)}") for image in posed]
    poses, rounded = rigid(
        np.array([image.camera_to_world for image in posed]), [f"{tables['images']}: {shown(name)}" for name in names]
    )
    depths = np.zeros(0)  # in front of a camera, or negative behind it
    if len(points) >= LEAST_POINTS:
        depths = np.concatenate([(pose[:3, 3] - points) @ pose[:3, 2] for pose in poses])
    of_file = dict(zip(files, (lenses[image.camera] for image in posed), strict=True))
    if len(of_file) < len(files):
        again = next(file for number, file in enumerate(files) if file in files[:number])
        raise InputError(f"{tables['images']}: two names are those of {again}; keep one")
    return _capture(path, of_file, poses, depths, _around(points), [*notes, *rounded], str(tables["cameras"]))


@contextmanager
def _undamaged(file: Path, part: str = "the file") -> Iterator[None]:
    try:
        yield
    except InputError:
        raise
    except (struct.error, ValueError, IndexError, OverflowError) as error:
        raise InputError(f"{file}: {part} is damaged or cut off; export the model again") from error


def _pictures_of(path: Path) -> tuple[Path, list[str]]:
    """Return the folder of the pictures, and a note if it is one of the smaller copies that are kept next to it."""
    if (folder := path / IMAGES).is_dir():
        return folder, []
    if not (smaller := smaller_copies(path)):
        raise InputError(f"{folder}: no such folder (nor {IMAGES}_2, …); put the images of the cameras there")
    folder = smaller[0]
    return folder, [f"There is no folder {IMAGES}: {folder.name} is read."]


def _capture(
    path: Path, lenses: dict[Path, Lens], poses: np.ndarray, depths: np.ndarray, bounds: tuple[float, ...] | None,
    notes: list[str], where: str,
) -> Source:  # fmt: skip
    """Return the source of views, file → lens, in the order of their names; `depths` [n] are those of the points that
    they see, `where` names the file of the lenses.
    """
    pinhole = common_pinhole(lenses.values(), where)
    frames = Frames(pinhole.fov_x_radians, list(lenses), poses)
    count = len(frames.files)
    test = list(range(0, count, HELD_OUT))
    train = [number for number in range(count) if number % HELD_OUT]
    if not train:
        raise InputError(f"{path}: {count} view is too few to hold one out for testing; give two or more")
    notes = [f"Every eighth view by name, {len(test)} of {count}, is a test view; the others train.", *notes]
    notes += resampling_note(lenses.values(), pinhole)
    channels, of_pictures = looked_into(frames.files)
    notes += of_pictures
    unbounded = ""
    if channels == 4:
        bounds = None  # silhouettes bound the object better than points do
    else:
        near, far = np.percentile(depths[depths > 0], [1.0, 99.0]) if (depths > 0).any() else (1.0, 1.0)
        if far > MOST_RANGE * near:
            bounds = None
            unbounded = f"depths from {near:.3g} to {far:.3g} are an unbounded scene, which no box holds"
    if bounds is not None:
        notes.append("Bounds are those of the reconstructed points; --bounds overrides them.")
    return Source(
        name=path.resolve().name,
        frames=lambda split: frames.of(train if split == "train" else test) if split in ("train", "test") else None,
        pixels=lambda file, width: read_through(file, lenses[file], pinhole, channels, width),
        size=lambda file: seen_size(file, lenses[file], pinhole),
        region=Region(bounds),
        notes=tuple(notes),
        bounds_assumed=True,
        unbounded=unbounded,
    )


def _around(points: np.ndarray) -> tuple[float, ...] | None:
    if len(points) < LEAST_POINTS:
        return None
    lower, upper = np.percentile(points, [OUTLIERS, 100.0 - OUTLIERS], axis=0)
    wider = MARGIN * (upper - lower)
    return tuple(np.concatenate([lower - wider, upper + wider]).tolist())


def _bytes(file: Path) -> bytes:
    if not file.is_file():
        raise InputError(f"{file}: missing; export the complete model: cameras, images and points3D")
    if (size := file.stat().st_size) > LARGEST_BYTES:
        raise InputError(f"{file}: {size} bytes; no more than {LARGEST_BYTES} are read")
    return file.read_bytes()


def _lines(file: Path) -> Iterator[tuple[str, str]]:
    """Yield the name for messages and the text of each line that is not a comment."""
    for number, line in enumerate(_bytes(file).decode("utf-8-sig").splitlines(), 1):
        if (text := line.strip()) and not text.startswith("#"):
            yield f"line {number}, {shown(text)},", text


def _cameras(file: Path) -> Iterator[tuple[int, Lens]]:
    if file.suffix == ".txt":
        for where, line in _lines(file):
            with _undamaged(file, where):
                number, model, *words = line.split()
                width, height, *values = map(float, words)
                if width % 1 or height % 1:
                    raise ValueError("a size is not a number of pixels")
                lens = _lens(file, int(number), model, int(width), int(height), values)
            yield int(number), lens
        return
    data = _bytes(file)
    (count,), at = struct.unpack_from("<Q", data), 8
    for _ in range(count):
        number, model, width, height = struct.unpack_from("<iiQQ", data, at)
        name, parameters = MODELS.get(model, (str(model), ()))
        numbers = struct.unpack_from(f"<{len(parameters)}d", data, at + 24)
        yield number, _lens(file, number, name, width, height, numbers)
        at += 24 + 8 * len(parameters)


def _lens(file: Path, number: int, model: str, width: int, height: int, numbers: Sequence[float]) -> Lens:
    where = f"{file}: camera {number}"
    parameters = next((parameters for name, parameters in MODELS.values() if name == model), None)
    if parameters is None:
        raise InputError(
            f"{where} is {shown(model)}; {' '.join(NAMES)} are read: undistort with COLMAP's image_undistorter"
        )
    lens = Lens.of(model, width, height, dict(zip(parameters, numbers, strict=True)))
    if not all(map(math.isfinite, numbers)) or min(width, height, lens.fx, lens.fy) <= 0:
        raise InputError(f"{where} has size {width} × {height} and parameters {list(numbers)}; export the model again")
    return lens


def _images(file: Path) -> Iterator[_Posed]:
    if file.suffix == ".txt":
        follows_image = False
        for where, line in _lines(file):
            # the points of an image, which may have none and no line
            if follows_image and _are_numbers(line.split()):
                follows_image = False
                continue
            with _undamaged(file, where):
                *words, name = line.split(maxsplit=9)
                posed = _pose(file, name, int(words[8]), [float(word) for word in words[1:8]])
            yield posed
            follows_image = True
        return
    data = _bytes(file)
    (count,), at = struct.unpack_from("<Q", data), 8
    for _ in range(count):
        *numbers, camera = struct.unpack_from("<7di", data, at + 4)
        at += 4 + 56 + 4
        end = data.index(b"\0", at)
        yield _pose(file, data[at:end].decode("utf-8"), camera, numbers)
        (points,) = struct.unpack_from("<Q", data, end + 1)
        at = end + 9 + 24 * points
    if at > len(data):
        raise ValueError("the last image is cut off")


def _are_numbers(words: list[str]) -> bool:
    with suppress(ValueError):
        return len(list(map(float, words))) % 3 == 0
    return False


def _pose(file: Path, name: str, camera: int, numbers: list[float]) -> _Posed:
    """Return an image from a quaternion w x y z and a translation, world to camera, in OpenCV's axes."""
    w, x, y, z, *translation = numbers
    if not all(map(math.isfinite, numbers)) or not math.hypot(w, x, y, z) > 0:
        raise InputError(f"{file}: the pose of {shown(name)} is {numbers}; export the model again")
    rotation = Rotation.from_quat([x, y, z, w]).as_matrix().T
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, -rotation @ np.array(translation)
    return _Posed(name, camera, pose @ OPENGL)


def _points(file: Path) -> np.ndarray:
    if not file.is_file():
        return np.zeros((0, 3))
    if file.suffix == ".txt":
        points = []
        for where, line in _lines(file):
            with _undamaged(file, where):
                points.append([float(word) for word in line.split()[1:4]])
    else:
        data, points = _bytes(file), []
        (count,), at = struct.unpack_from("<Q", data), 8
        for _ in range(count):
            points.append(list(struct.unpack_from("<3d", data, at + 8)))
            (track,) = struct.unpack_from("<Q", data, at + 43)
            at += 51 + 8 * track
        if at > len(data):
            raise ValueError("the last point is cut off")
    table = np.array(points, dtype=np.float64).reshape(-1, 3)
    if not np.isfinite(table).all():
        raise InputError(f"{file}: a point is NaN or infinite; export the model again")
    return table


def read_llff(path: Path) -> Source:
    """Read LLFF's `poses_bounds.npy` and the folder `images`; errors as in `read_colmap`."""
    file = path / LLFF
    try:
        rows = np.load(file, allow_pickle=False, mmap_mode="r")
        if not isinstance(rows, np.ndarray):
            raise ValueError("an archive of several arrays")
        rows = np.array(rows, dtype=np.float64) if rows.nbytes <= LARGEST_BYTES else np.zeros(0)
    except (OSError, ValueError, EOFError, TypeError, SyntaxError) as error:
        raise InputError(f"{file}: cannot be read ({short(error, 120)}); make it again") from error
    if rows.ndim != 2 or rows.shape[1] != 17 or not len(rows) or not np.isfinite(rows).all():
        raise InputError(f"{file}: is {rows.shape}; it must be finite numbers [views, 17]")
    folder, notes = _pictures_of(path)
    files = pictures(folder)
    if len(files) != len(rows):
        raise InputError(f"{folder}: has {len(files)} images, {LLFF} {len(rows)} poses; give one image per pose")
    matrices, depths = rows[:, :15].reshape(-1, 3, 5), rows[:, 15:]
    height, width, focal = matrices[:, :, 4].T
    if min(height.min(), width.min()) < 1 or focal.min() <= 0:
        raise InputError(f"{file}: sizes and focal lengths must be positive; make it again")
    if not (depths > 0).all() or not (depths[:, 0] < depths[:, 1]).all():
        raise InputError(f"{file}: depths must be positive, the near one first; make it again")
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    # LLFF's axes are down, right, backwards
    poses[:, :3, 0], poses[:, :3, 1] = matrices[:, :, 1], -matrices[:, :, 0]
    poses[:, :3, 2], poses[:, :3, 3] = matrices[:, :, 2], matrices[:, :, 3]
    poses, rounded = rigid(poses, [f"{file}: row {number}" for number in range(len(rows))])
    half = 0.5 * np.stack([width / focal, height / focal, -2.0 * np.ones_like(focal)], axis=1)
    signs = np.array([[x, y, 1.0] for x in (-1.0, 1.0) for y in (-1.0, 1.0)])
    rays = np.einsum("nij,ncj->nci", poses[:, :3, :3], half[:, None] * signs)[:, None]
    ends = poses[:, None, None, :3, 3] + depths[:, :, None, None] * rays
    bounds = tuple(np.concatenate([ends.min(axis=(0, 1, 2)), ends.max(axis=(0, 1, 2))]).tolist())
    lenses = [Lens.pinhole(round(w), round(h), f) for w, h, f in zip(width, height, focal, strict=True)]
    of_file = dict(zip(files, lenses, strict=True))
    return _capture(path, of_file, poses, depths.ravel(), bounds, [*notes, *rounded], str(file))
