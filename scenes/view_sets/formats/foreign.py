"""The choice of a reader by path, the tiny-NeRF format, and the defaults of the Blender format."""

import io
import math
import tokenize
import zipfile
import zlib
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import numpy as np

from scenes.files.errors import InputError, short
from scenes.view_sets.formats import captures, nerfstudio
from scenes.view_sets.formats.nerfstudio import read_nerfstudio
from scenes.view_sets.formats.transforms import Frames, Listing, lists_nothing, read_listing, transforms_file
from scenes.view_sets.images import header
from scenes.view_sets.manifest import NAME as MANIFEST
from scenes.view_sets.pixels import straight_at, straight_from_premultiplied
from scenes.view_sets.source import FEWEST, Region, Source, nine_to_one, region_in
from scenes.view_sets.viewpoints import SPLITS, check_field_of_view, rigid

TRAINED = 100
NEAR, FAR = 2.0, 6.0
LARGEST_BYTES = 1 << 30
"""The largest size of one array, unpacked: 100 views of 800 × 800 are 0.77 GB."""
LARGEST_PIXELS = 1 << 22
"""The largest size of one image: 2048 × 2048."""
LARGEST_SMALL = 1 << 22
_PROBLEMS = (
    OSError, ValueError, zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, SyntaxError,
    TypeError, MemoryError, tokenize.TokenError,
)  # fmt: skip
"""The errors of reading a damaged archive; the last ones come from numpy, which parses a header as Python."""


def _array(file: Path, name: str, limit: int = LARGEST_SMALL) -> np.ndarray:
    """Raises `InputError` for an array that is missing, damaged, pickled, beyond the limit or not of finite numbers."""
    where = f"{file}: {name}"
    try:
        with zipfile.ZipFile(file) as archive, archive.open(f"{name}.npy") as stream:
            major, _ = np.lib.format.read_magic(stream)
            read = np.lib.format.read_array_header_1_0 if major == 1 else np.lib.format.read_array_header_2_0
            length = stream.read(2 if major == 1 else 4)
            if (header_size := int.from_bytes(length, "little")) > LARGEST_SMALL:
                raise InputError(f"{where} has a header of {header_size} bytes; get the file again")
            shape, fortran, dtype = read(io.BytesIO(length + stream.read(header_size)))
            if dtype.kind not in "fiu" or fortran:
                raise InputError(f"{where} holds {dtype}{' in Fortran order' * fortran}; save plain numbers")
            size = math.prod(shape) * dtype.itemsize
            if any(type(length) is not int or length < 0 for length in shape) or size > limit:
                raise InputError(f"{where} is {shape} of {dtype}, more than {limit} bytes; make it smaller")
            data = stream.read(size)
    except InputError:
        raise
    except KeyError as error:
        raise InputError(f"{file}: holds no array {name!r}; a tiny-NeRF file has images, poses and focal") from error
    except _PROBLEMS as error:
        raise InputError(f"{where} cannot be read ({short(error, 120)}); get the file again") from error
    if len(data) != size:
        raise InputError(f"{where} is cut off; get the file again")
    values = np.frombuffer(data, dtype=dtype).reshape(shape)
    if not np.isfinite(values).all():
        raise InputError(f"{where} holds NaN or infinity; give finite numbers")
    return values


def _numbers(file: Path, name: str) -> list[float]:
    numbers: list[float] = _array(file, name).astype(np.float64).ravel().tolist()
    return numbers


def read_tiny_nerf(file: Path) -> Source:
    """Read a tiny-NeRF file. Raises `InputError`, naming file, array and remedy, for invalid data."""
    images, cameras = _array(file, "images", LARGEST_BYTES), _array(file, "poses").astype(np.float64)
    if len(images.shape) != 4 or images.shape[3] not in (3, 4) or 0 in images.shape:
        raise InputError(f"{file}: images is {images.shape}; it must be [views, height, width, 3]")
    count, height, width, _ = images.shape
    if height * width > LARGEST_PIXELS:
        raise InputError(f"{file}: images of {width} × {height} pixels; no more than {LARGEST_PIXELS} are read")
    if cameras.shape != (count, 4, 4):
        raise InputError(f"{file}: poses is {cameras.shape}; it must be {(count, 4, 4)}, a camera for each image")
    focal = _numbers(file, "focal")
    if len(focal) != 1 or not focal[0] > 0:
        raise InputError(f"{file}: focal must be one positive number of pixels")
    fov = 2 * math.atan(0.5 * width / focal[0])
    check_field_of_view(fov, f"{file}: focal {focal[0]}")
    cameras, rounded = rigid(cameras, [f"{file}: pose {number}" for number in range(count)])
    with zipfile.ZipFile(file) as archive:
        names = {name.removesuffix(".npy") for name in archive.namelist()}
    splits, notes = _splits(file, names, count)
    notes += rounded
    alpha = _array(file, "alpha", LARGEST_BYTES) if "alpha" in names else None
    if alpha is not None and alpha.shape != images.shape[:3]:
        raise InputError(f"{file}: alpha is {alpha.shape}; it must be {images.shape[:3]}, as the images are")
    if alpha is None and images.shape[3] == 3:
        notes.append(f"{file.name} has no alpha: its images count as fully opaque, background included.")
    if "distances" not in names:
        notes.append(f"Near {NEAR:g} and far {FAR:g} as in the notebook; --near and --far override them.")
    if "bounds" not in names:
        notes.append("Bounds are derived from the cameras; --bounds overrides them.")
    # names in the archive, as files of a folder would be named
    frames = Frames(fov, [file.resolve() / "images" / str(number) for number in range(count)], cameras)
    largest = 255.0 if images.dtype.kind in "iu" else 1.0

    def pixels(name: Path, new_width: int | None) -> np.ndarray:
        number = int(name.name)
        colour = images[number].astype(np.float64) / largest
        if colour.min() < -1e-6 or colour.max() > 1 + 1e-6:
            raise InputError(
                f"{file}: image {number} has values {colour.min():.3g} … {colour.max():.3g}; they must lie in 0 … 1"
            )
        rgba = colour if colour.shape[2] == 4 else np.concatenate([colour, np.ones((height, width, 1))], axis=-1)
        if alpha is not None:
            covered = np.clip(alpha[number].astype(np.float64), 0.0, 1.0)[..., None]
            rgba = straight_from_premultiplied(np.concatenate([rgba[..., :3], covered], axis=-1))
        return straight_at(np.clip(rgba, 0.0, 1.0).astype(np.float32), new_width)

    return Source(
        name=file.stem,
        frames=lambda split: frames.of(splits[split]) if splits.get(split) else None,
        pixels=pixels,
        size=lambda name: (height, width),
        region=_region(file, names),
        notes=tuple(notes),
    )


def write_tiny_nerf(
    file: Path, rgba: Iterable[np.ndarray], camera_to_world: np.ndarray, focal: float, train: int, region: Region
) -> None:
    """Write straight images [h, w, 4], one per pose [n, 4, 4], the `train` training views first; colour is over black,
    as the notebook renders it.
    """
    pairs = [(image[..., :3] * image[..., 3:], image[..., 3]) for image in rgba]
    arrays = {} if region.bounds is None else {"bounds": np.array(region.bounds)}
    arrays |= {
        "images": np.array([colour for colour, _ in pairs], dtype=np.float32),
        "poses": camera_to_world,
        "focal": np.array(focal),
        "alpha": np.array([alpha for _, alpha in pairs], dtype=np.float32),
        "i_train": np.arange(train),
        "i_test": np.arange(train, len(camera_to_world)),
        "distances": np.array([region.near or NEAR, region.far or FAR]),
    }
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w") as target:
                np.lib.format.write_array(target, array, allow_pickle=False)


def _splits(file: Path, names: set[str], count: int) -> tuple[dict[str, list[int]], list[str]]:
    if {"i_train", "i_test"} <= names:
        splits = {name: _indices(file, f"i_{name}", count) for name in ("train", "test")}
        if set(splits["train"]) & set(splits["test"]):
            raise InputError(f"{file}: i_train and i_test share views; a score on them would mean nothing")
        return splits, []
    if count > TRAINED:
        note = f"The first {TRAINED} images train, as in the notebook; the other {count - TRAINED} test."
        return {"train": list(range(TRAINED)), "test": list(range(TRAINED, count))}, [note]
    train, test = nine_to_one(count, file, "give ten or more")
    return {"train": train, "test": test}, [
        f"{len(train)} of {count} images, evenly spread, train and the others test."
    ]


def _indices(file: Path, name: str, count: int) -> list[int]:
    values = _numbers(file, name)
    if len(set(values)) != len(values) or any(value % 1 for value in values):
        raise InputError(f"{file}: {name} must list each view once, by its number")
    if not values or min(values) < 0 or max(values) >= count:
        raise InputError(f"{file}: {name} must name views from 0 to {count - 1}, at least one")
    return sorted(int(value) for value in values)


def _region(file: Path, names: set[str]) -> Region:
    distances = _numbers(file, "distances") if "distances" in names else [NEAR, FAR]
    if len(distances) != 2:
        raise InputError(f"{file}: distances must be two numbers, near and far")
    return region_in(file, tuple(_numbers(file, "bounds")) if "bounds" in names else None, *distances)


BLENDER_REGION = Region((-1.5, -1.5, -1.5, 1.5, 1.5, 1.5), 2.0, 6.0)
"""The field's convention for the NeRF synthetic scenes; the format itself has none."""

KNOWN = (
    f"a view set is a folder with transforms_train.json (Blender format), {nerfstudio.NAME} (nerfstudio), sparse/0 "
    f"(COLMAP) or {captures.LLFF} (LLFF), or a tiny-NeRF .npz file"
)


def read_blender(folder: Path) -> Source:
    """Return the source of a folder in the Blender format. The listings of a set with a manifest are read when they are
    needed; of others, an empty one is a missing one, and test views that are not listed are found as by nerfstudio.
    """

    @cache
    def listing(split: str) -> Listing:
        return read_listing(transforms_file(folder, split))

    def frames(split: str) -> Frames | None:
        if split in chosen:
            return chosen[split]
        return None if split == "val" and split not in there else listing(split).frames

    def of(file: Path) -> Listing:
        return next(known for split in there if file in (known := listing(split)).lenses)

    def pixels(file: Path, width: int | None) -> np.ndarray:
        channels = header(file).channels
        if channels not in (2, 4):
            raise InputError(
                f"{file}: {channels} channels, no alpha; views must be RGBA, because alpha excludes the background "
                f"from training: save them as PNG with an alpha channel, or list them in a {nerfstudio.NAME}, where "
                "images without alpha count as fully opaque"
            )
        return of(file).read(file, channels, width)

    there = [split for split in SPLITS if transforms_file(folder, split).exists()]
    chosen: dict[str, Frames | None] = {}
    notes: list[str] = []
    if not (folder / MANIFEST).exists():
        there = [split for split in there if split == "train" or not lists_nothing(transforms_file(folder, split))]
        notes += dict.fromkeys(note for split in there for note in listing(split).notes)
        if there == ["train", "val"]:
            chosen = {"val": None, "test": listing("val").frames}
            notes.append("There are no test views: the val views are the test views.")
        elif there == ["train"] and len((views := listing("train").frames).files) >= FEWEST:
            train, test = nine_to_one(len(views.files), folder, "list test views")
            chosen = {"train": views.of(train), "test": views.of(test)}
            split = f"{len(train)} of {len(views.files)} views, evenly spread, train, the others test"
            notes.append(f"There are no test views: {split}.")
    name = folder.resolve().name
    return Source(
        name, frames, pixels, lambda file: of(file).size(file), BLENDER_REGION, tuple(notes), bounds_assumed=True
    )


def source_of(path: Path) -> Source:
    """Return the reader of a path (`KNOWN`); raises `InputError` for any other path, and for invalid contents."""
    if path.is_dir():
        if any(transforms_file(path, split).exists() for split in ("train", "test")):
            return read_blender(path)
        if (path / nerfstudio.NAME).is_file():
            return read_nerfstudio(path)
        if (sparse := captures.sparse_folder(path)) is not None:
            return captures.read_colmap(path, sparse)
        if (path / captures.LLFF).is_file():
            return captures.read_llff(path)
        raise InputError(f"{path}: not a view set; {KNOWN}")
    if not path.exists():
        raise InputError(f"{path}: no such folder; {KNOWN}")
    if path.name == nerfstudio.NAME:
        return read_nerfstudio(path.parent)
    if path.suffix.lower() == ".npz":
        return read_tiny_nerf(path)
    raise InputError(f"{path}: not a view set; name a folder, a {nerfstudio.NAME} or an .npz file")
