"""Path → reader: which of the field's formats posed images are in."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from scenes import nerfstudio
from scenes.errors import InputError
from scenes.images import read_image
from scenes.nerfstudio import read_nerfstudio
from scenes.source import Region, Source
from scenes.tiny_nerf import read_tiny_nerf
from scenes.transforms import Frames, read_transforms, transforms_file
from scenes.viewpoints import SPLITS

BLENDER_REGION = Region((-1.5, -1.5, -1.5, 1.5, 1.5, 1.5), 2.0, 6.0)
"""The field's habit for the NeRF synthetic scenes; the format itself says nothing."""

KNOWN = (
    "a view set is a folder with transforms_train.json (Blender format) or "
    f"{nerfstudio.NAME} (nerfstudio), or a tiny-NeRF .npz file"
)


def source_of(path: Path) -> Source:
    """The reader for a folder in the Blender format, one with `transforms.json`, or a tiny-NeRF file.

    Raises `InputError` for a path that is none of these, and where what was found there cannot be trusted.
    """
    return READERS[format_of(path)](path)


def check_listed(path: Path) -> None:
    """Reads which views there are and where their cameras stand, but no image. Raises `InputError` as `source_of`."""
    source = source_of(path)
    for split in SPLITS:
        source.frames(split)


def format_of(path: Path) -> str:
    """A key of `READERS`, by names alone: nothing is opened. Raises `InputError` for a path that is no view set."""
    if path.is_dir():
        if any(transforms_file(path, split).exists() for split in ("train", "test")):
            return "Blender"
        if (path / nerfstudio.NAME).is_file():
            return "nerfstudio"
        raise InputError(f"{path}: no view set; {KNOWN}")
    if not path.exists():
        raise InputError(f"{path}: no such folder; {KNOWN}")
    if path.name == nerfstudio.NAME:
        return "nerfstudio"
    if path.suffix.lower() == ".npz":
        return "tiny NeRF"
    raise InputError(f"{path}: not a view set; name a folder, a {nerfstudio.NAME} or an .npz file")


def read_blender(folder: Path) -> Source:
    """The three files of the Blender format; `val` need not be there."""

    def frames(split: str) -> Frames | None:
        missing = split == "val" and not transforms_file(folder, split).exists()
        return None if missing else read_transforms(folder, split)

    return Source(folder.resolve().name, frames, _rgba, BLENDER_REGION)


READERS: dict[str, Callable[[Path], Source]] = {
    "Blender": read_blender,
    "nerfstudio": lambda path: read_nerfstudio(path if path.is_dir() else path.parent),
    "tiny NeRF": read_tiny_nerf,
}
"""By format."""


def _rgba(file: Path) -> np.ndarray:
    pixels = read_image(file)
    if pixels.shape[2] == 2:
        pixels = pixels[..., [0, 0, 0, 1]]
    if pixels.shape[2] != 4:
        raise InputError(
            f"{file}: {pixels.shape[2]} channels, no alpha; views must be RGBA, because what is not covered is not to "
            f"be learnt: save them as PNG with an alpha channel, or list them in a {nerfstudio.NAME}, where images "
            "without alpha count as wholly covered"
        )
    return pixels
