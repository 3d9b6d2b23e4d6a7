"""Pictures side by side, each with its name above it, and an animation of them."""

import io
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from scenes.files.atomic import write_atomically

if TYPE_CHECKING:
    from PIL.ImageFont import FreeTypeFont, ImageFont

SMALLEST = 200
"""The width below which pictures are enlarged by an integer to at least this: every pixel stays a square."""
MARGIN = 8
HEADER = 24
GREY = 235
"""The level behind the panels, so that one over white has an edge."""
LARGEST = 16383
"""The most pixels along a side of a WebP image."""


def enlargement(width: int) -> int:
    return max(1, -(-SMALLEST // width))


def size_of(count: int, width: int, height: int) -> tuple[int, int]:
    """Return width and height of `count` pictures side by side."""
    scale = enlargement(width)
    return count * width * scale + (count + 1) * MARGIN, HEADER + height * scale + MARGIN


def side_by_side(pictures: dict[str, np.ndarray]) -> np.ndarray:
    """Put name → uint8 [h, w, 3], all of one size, from left to right: returns uint8 [H, W, 3] of `size_of`."""
    from PIL import Image, ImageDraw

    height, width = next(iter(pictures.values())).shape[:2]
    scale = enlargement(width)
    total = size_of(len(pictures), width, height)
    sheet = np.full((total[1], total[0], 3), GREY, dtype=np.uint8)
    lefts = [MARGIN + number * (width * scale + MARGIN) for number in range(len(pictures))]
    for left, picture in zip(lefts, pictures.values(), strict=True):
        enlarged = picture.repeat(scale, axis=0).repeat(scale, axis=1)
        sheet[HEADER : HEADER + height * scale, left : left + width * scale] = enlarged
    image = Image.fromarray(sheet)
    draw = ImageDraw.Draw(image)
    for left, name in zip(lefts, pictures, strict=True):
        text, font = _fitting(name, width * scale)
        draw.text((left + width * scale // 2, HEADER // 2), text, fill=(20, 20, 20), font=font, anchor="mm")
    return np.asarray(image)


def write_animation(file: Path, pictures: Iterable[np.ndarray], fps: int) -> int:
    """Write frames uint8 [h, w, 3] as an animated WebP that loops; returns its bytes. Raises `OSError`.

    It is lossless, as a comparison must not show artefacts of a codec as those of a method. Of the lossless animations
    that Pillow writes WebP is the smaller one: 499 kB against 662 kB as APNG for 40 frames of lego at 400 × 200, and
    143 kB at quality 80, which is off by 2.6 levels (root mean square). Consecutive equal frames are one that stays
    longer.
    """
    from PIL import Image

    first, *others = (Image.fromarray(picture) for picture in pictures)
    encoded = io.BytesIO()
    first.save(
        encoded,
        "WEBP",
        save_all=True,
        append_images=others,
        duration=round(1000 / fps),
        loop=0,
        lossless=True,
        quality=50,  # in a lossless file the effort of the compressor
        method=4,
    )
    write_atomically(file, encoded.getvalue())
    return len(encoded.getvalue())


def _fitting(name: str, width: int) -> "tuple[str, FreeTypeFont | ImageFont]":
    """Return the name in the largest letters that fit, shortened if even small ones do not."""
    from PIL import ImageFont

    for size in range(15, 9, -1):
        font = ImageFont.load_default(size)
        if font.getlength(name) <= width:
            return name, font
    while len(name) > 1 and font.getlength(f"{name}…") > width:
        name = name[:-1]
    return f"{name}…", font
