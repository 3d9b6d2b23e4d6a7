"""Pictures of the test views by another program: found in a folder, matched to the views, read.

Known are the folders that 3D Gaussian Splatting (`test/ours_30000/renders/00000.png`), nerfstudio
(`test/rgb/r_0.jpg`), instant-ngp (`r_0.png`), nerfbaselines (`color/r_0.png`) and NeRF's own code
(`testset_200000/000.png`) write; in all of them the views are in the order of `transforms_test.json`.
"""

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

import numpy as np

from scenes.files.errors import InputError
from scenes.view_sets.images import display_image, pictures
from scenes.view_sets.pixels import resized

OTHER_FOLDERS = ("gt", "gt-rgb", "gt-color", "depth", "accumulation", "normal", "normals", "alpha", "train", "val")
"""The folders next to the renders, which are not searched."""


def pictures_in(folder: Path) -> list[Path]:
    """Return the pictures of a folder, or else of the only subfolder with pictures; raises `InputError`."""
    if not folder.is_dir():
        raise InputError(f"{folder}: is not a folder; give the one with the rendered test views")
    if here := pictures(folder):
        return here
    below = sorted({place for place in folder.rglob("*") if place.is_dir() and pictures(place)})
    below = [place for place in below if not set(place.relative_to(folder).parts) & set(OTHER_FOLDERS)]
    if len(below) != 1:
        shown = ", ".join(place.relative_to(folder).as_posix() for place in below[:5])
        raise InputError(f"{folder}: {'has pictures in ' + shown if below else 'has no picture'}; name one folder")
    return pictures(below[0])


def of_views(files: Sequence[Path], names: Sequence[str]) -> list[Path]:
    """Return the picture of each view: by the last part of its name, or else by number if there are equally many.

    Raises `InputError` for a view without a picture, or with two.
    """
    if twice := [stem for stem, many in Counter(file.stem for file in files).items() if many > 1]:
        raise InputError(f"{files[0].parent}: has two pictures called {twice[0]}; keep one")
    by_stem, stems = {file.stem: file for file in files}, [PurePosixPath(name).name for name in names]
    lacking = [stem for stem in stems if stem not in by_stem]
    if not lacking and len(set(stems)) == len(stems):
        return [by_stem[stem] for stem in stems]
    numbers = {int(digits[0]): file for file in files if (digits := re.search(r"\d+$", file.stem))}
    if len(numbers) == len(files) == len(names) and len(lacking) == len(names):
        return [numbers[number] for number in sorted(numbers)]
    missing = f"none is called {lacking[0]}" if lacking else f"names repeat, such as {stems[0]}"
    raise InputError(
        f"{files[0].parent}: {len(files)} pictures for {len(names)} test views, and {missing}; "
        "give a picture of each view, named like the view or numbered in the order of transforms_test.json"
    )


def read_picture(file: Path, width: int) -> np.ndarray:
    """Read display colour, float32 [h, width, 3], or with straight alpha [h, width, 4], averaging areas. Raises
    `InputError` for anything but colour, for a picture that is narrower, and as `display_image`.
    """
    pixels = display_image(file)
    if pixels.shape[2] not in (3, 4):
        raise InputError(f"{file}: has {pixels.shape[2]} channels; save red, green and blue, perhaps with alpha")
    if pixels.shape[1] < width:
        raise InputError(f"{file}: {pixels.shape[1]} pixels wide; choose --resolution {pixels.shape[1]} or less")
    return resized(pixels, width)
