"""A view set written in the format of another trainer, from any readable format.

PNGs with alpha are copied byte for byte; other images are encoded again. Depth, normals and float colour are dropped.
"""

import os
from pathlib import Path

import numpy as np

from scenes.files.atomic import replacing
from scenes.files.errors import InputError
from scenes.view_sets.formats.foreign import LARGEST_BYTES, source_of, write_tiny_nerf
from scenes.view_sets.formats.nerfstudio import NAME, write_nerfstudio
from scenes.view_sets.formats.transforms import Frames, transforms_file, write_transforms
from scenes.view_sets.images import display_image, write_png
from scenes.view_sets.manifest import NAME as MANIFEST
from scenes.view_sets.manifest import check_all
from scenes.view_sets.source import Region, completed
from scenes.view_sets.view_set import region_of
from scenes.view_sets.viewpoints import SPLITS


def export(path: Path, form: str, out: Path) -> list[str]:
    """Write the view set at `path` to `out`, a new folder, or a new file for `npz`; return notes for its reader. Raises
    `InputError` for an unreadable or damaged view set, an `out` that exists or cannot be written, and too many images
    for one `.npz`; nothing is left then.
    """
    if os.path.lexists(out):
        raise InputError(f"--out {out}: exists already; name a new {'file' if form == 'npz' else 'folder'}")
    if form == "npz" and out.suffix != ".npz":
        raise InputError(f"--out {out}: a tiny-NeRF file ends in .npz")
    try:
        with replacing(out) as temporary:
            return _write(path, form, temporary)
    except OSError as error:
        raise InputError(f"--out {out}: cannot be written ({error.strerror}); choose another place") from error


def _write(path: Path, form: str, out: Path) -> list[str]:
    source = source_of(path)
    manifest = check_all(path) if path.is_dir() and (path / MANIFEST).exists() else {}
    empty = manifest.get("empty_splits", [])
    views: dict[str, Frames] = {
        split: frames for split in SPLITS if split not in empty and (frames := source.frames(split)) is not None
    }
    first = next(iter(views.values()))
    height, width = source.size(first.files[0])
    box, near, far = completed(region_of(source, manifest, path), source, first.fov_x_radians, (height, width), path)
    region = Region(tuple(box.ravel().tolist()), near, far)
    focal = float(0.5 * width / np.tan(0.5 * first.fov_x_radians))

    def pixels(file: Path) -> np.ndarray:
        """Raise `InputError` for an image that is damaged or of another size, rather than pass the fault on."""
        image = source.pixels(file, None)
        if image.shape[:2] != (height, width):
            raise InputError(f"{file}: not {width} × {height} pixels, as the others are; give all images one size")
        return image

    notes = [*source.notes]
    if form == "npz":
        scored = [views[split] for split in ("train", "test") if split in views]
        poses = np.concatenate([frames.camera_to_world for frames in scored])
        if (size := 12 * len(poses) * height * width) > LARGEST_BYTES:
            raise InputError(
                f"--format npz: the images take {size} bytes, more than {LARGEST_BYTES}; choose nerfstudio"
            )
        train = len(views["train"].files) if "train" in views else 0
        write_tiny_nerf(out, (pixels(file) for frames in scored for file in frames.files), poses, focal, train, region)
        return [*notes, *(["A tiny-NeRF file has no val views: they are not exported."] if "val" in views else [])]
    out.mkdir()
    names = {split: [f"{split}/r_{number}" for number in range(len(views[split].files))] for split in views}
    for split, frames in views.items():
        (out / split).mkdir()
        for name, file in zip(names[split], frames.files, strict=True):
            image = pixels(file)
            stored = file.read_bytes() if file.suffix.lower() == ".png" else b""
            # bit depth and colour type of 8-bit RGBA in a PNG's header; a lens may have been undone
            if stored[24:26] == b"\x08\x06" and np.array_equal(image, display_image(file, as_stored=True)):
                (out / f"{name}.png").write_bytes(stored)
            else:
                write_png(out / f"{name}.png", image)
    if form == "nerfstudio":
        listed = {s: ([f"{name}.png" for name in names[s]], frames.camera_to_world) for s, frames in views.items()}
        write_nerfstudio(out / NAME, listed, (width, height), focal, region)
        return notes
    # all three listings: other readers require a `val`, even if they do not use it
    stand_in = "test" if "test" in views else "train"
    for split in SPLITS:
        given = split if split in views else stand_in
        paths, frames = [f"./{name}" for name in names[given]], views[given]
        write_transforms(transforms_file(out, split), frames.fov_x_radians, paths, frames.camera_to_world)
        if split not in views:
            notes.append(f"There are no {split} views: transforms_{split}.json lists the {stand_in} views.")
    return notes
