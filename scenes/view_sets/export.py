"""A view set written as other trainers read it: from any format that can be read to any that can be written.

PNGs with alpha are copied byte for byte; other images are written anew. Depth, normals and float colour are dropped.
"""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from scenes.files.atomic import replacing
from scenes.files.errors import InputError
from scenes.view_sets.foreign import LARGEST_BYTES, source_of, write_tiny_nerf
from scenes.view_sets.images import write_png
from scenes.view_sets.manifest import NAME as MANIFEST
from scenes.view_sets.manifest import check_all
from scenes.view_sets.nerfstudio import NAME, write_nerfstudio
from scenes.view_sets.source import Region, Source, completed
from scenes.view_sets.transforms import Frames, transforms_file, write_transforms
from scenes.view_sets.view_set import region_of
from scenes.view_sets.viewpoints import SPLITS


def export(path: Path, form: str, out: Path) -> list[str]:
    """Write the view set at `path` to `out`, a new folder, or a new file for `npz`. Returns notes for its reader.

    Raises `InputError` for a view set that cannot be read or is not as it was rendered, an `out` that is there already
    or cannot be written, and for more images than fit one `.npz`. Nothing is left of what could not be finished: it is
    written beside `out`, then renamed.
    """
    if os.path.lexists(out):
        raise InputError(f"--out {out}: is there already; name a new {'file' if form == 'npz' else 'folder'}")
    if form == "npz" and out.suffix != ".npz":
        raise InputError(f"--out {out}: a tiny-NeRF file ends in .npz")
    try:
        with replacing(out) as beside:
            return _write(path, form, beside)
    except OSError as error:
        raise InputError(f"--out {out}: cannot be written ({error.strerror}); choose another place") from error


def _write(path: Path, form: str, out: Path) -> list[str]:
    source = source_of(path)
    manifest = check_all(path) if path.is_dir() and (path / MANIFEST).exists() else {}
    empty = manifest.get("empty_splits", [])
    found: dict[str, Frames] = {
        split: frames for split in SPLITS if split not in empty and (frames := source.frames(split)) is not None
    }
    first = next(iter(found.values()))
    height, width = source.pixels(first.files[0]).shape[:2]
    box, near, far = completed(region_of(source, manifest, path), source, first.fov_x_radians, (height, width), path)
    region = Region(tuple(box.ravel().tolist()), near, far)
    focal = 0.5 * width / np.tan(0.5 * first.fov_x_radians)
    if form == "npz":
        return [*source.notes, *_npz(out, source, found, (height, width), float(focal), region)]
    out.mkdir()
    names = {split: _images(out, split, source, frames, (height, width)) for split, frames in found.items()}
    if form == "nerfstudio":
        views = {s: ([f"{name}.png" for name in names[s]], frames.camera_to_world) for s, frames in found.items()}
        write_nerfstudio(out / NAME, views, (width, height), float(focal), region)
        return [*source.notes]
    return [*source.notes, *_blender(out, found, names)]


def _pixels(source: Source, file: Path, size: tuple[int, int]) -> np.ndarray:
    """Return the pixels; raises `InputError` for an image that is damaged or of another size than the first, rather
    than pass the fault on.
    """
    pixels = source.pixels(file)
    if pixels.shape[:2] != size:
        raise InputError(f"{file}: not {size[1]} × {size[0]} pixels, as the others are; give all one size")
    return pixels


def _images(out: Path, split: str, source: Source, frames: Frames, size: tuple[int, int]) -> list[str]:
    """Write the views of a split; returns their paths inside `out`, without suffix."""
    (out / split).mkdir()
    names = [f"{split}/r_{number}" for number in range(len(frames.files))]
    for name, file in zip(names, frames.files, strict=True):
        target = out / f"{name}.png"
        pixels = _pixels(source, file, size)
        if file.suffix.lower() == ".png" and _has_alpha(file):
            shutil.copyfile(file, target)
        else:
            write_png(target, pixels)
    return names


def _has_alpha(file: Path) -> bool:
    """Return whether a complete PNG holds 8-bit RGBA: the header's bit depth and colour type."""
    with file.open("rb") as handle:
        return handle.read(26)[24:26] == b"\x08\x06"


def _blender(out: Path, found: dict[str, Frames], names: dict[str, list[str]]) -> list[str]:
    """Write all three listings: other readers want a `val` whether anybody validates or not."""
    stand_in = "test" if "test" in found else "train"
    for split in SPLITS:
        given = split if split in found else stand_in
        paths = [f"./{name}" for name in names[given]]
        write_transforms(transforms_file(out, split), found[given].fov_x_radians, paths, found[given].camera_to_world)
    missing = [split for split in SPLITS if split not in found]
    return [f"There are no {split} views: transforms_{split}.json lists the {stand_in} views." for split in missing]


def _npz(
    out: Path, source: Source, found: dict[str, Frames], size: tuple[int, int], focal: float, region: Region
) -> list[str]:
    splits = [split for split in ("train", "test") if split in found]
    poses = np.concatenate([found[split].camera_to_world for split in splits])
    if (total := 12 * len(poses) * size[0] * size[1]) > LARGEST_BYTES:
        raise InputError(f"--format npz: the images take {total} bytes, more than {LARGEST_BYTES}; choose nerfstudio")

    def images() -> Iterator[np.ndarray]:
        for split in splits:
            for file in found[split].files:
                yield _pixels(source, file, size)

    train = len(found["train"].files) if "train" in found else 0
    write_tiny_nerf(out, images(), poses, focal, train, region)
    return ["A tiny-NeRF file has no val views: they stay behind."] if "val" in found else []
