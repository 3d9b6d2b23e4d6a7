"""Pictures side by side, each below its name, and an animation of them."""

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from scenes.files.atomic import write_atomically

SMALLEST = 200
"""The minimum width of a picture; narrower ones are enlarged by an integer, so that every pixel stays a square."""
MARGIN = 8
HEADER = 24
GREY = 235
"""The level behind the panels, so that a picture over white has an edge."""
LARGEST = 16383
"""The maximum side of a WebP image in pixels."""


def size_of(count: int, width: int, height: int) -> tuple[int, int]:
    """Return width and height of `count` pictures side by side."""
    scale = _enlargement(width)
    return count * width * scale + (count + 1) * MARGIN, HEADER + height * scale + MARGIN


def _enlargement(width: int) -> int:
    return max(1, -(-SMALLEST // width))


def side_by_side(pictures: dict[str, np.ndarray]) -> np.ndarray:
    """Put pictures uint8 [h, w, 3], all of one size, from left to right: returns uint8 [H, W, 3] of `size_of`."""
    from PIL import Image, ImageDraw, ImageFont

    height, width = next(iter(pictures.values())).shape[:2]
    scale = _enlargement(width)
    sheet = Image.new("RGB", size_of(len(pictures), width, height), (GREY, GREY, GREY))
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(14)
    for number, (name, picture) in enumerate(pictures.items()):
        left = MARGIN + number * (width * scale + MARGIN)
        sheet.paste(Image.fromarray(picture.repeat(scale, axis=0).repeat(scale, axis=1)), (left, HEADER))
        text = name
        while len(name) > 1 and font.getlength(text) > width * scale:
            name = name[:-1]
            text = f"{name}…"
        draw.text((left + width * scale // 2, HEADER // 2), text, fill=(20, 20, 20), font=font, anchor="mm")
    return np.asarray(sheet)


def write_animation(file: Path, pictures: Iterator[np.ndarray], count: int, fps: int) -> int:
    """Write `count` frames uint8 [h, w, 3], of which few are held at a time, as an animated WebP that loops; returns
    its size in bytes. Raises `OSError`.

    It is lossless, so that no artefact of a codec is taken for one of a method. Of Pillow's lossless formats WebP is
    the smallest: 40 frames of lego at 400 × 200 take 499 kB, 662 kB as APNG.
    """
    from PIL import Image

    film = Image.fromarray(next(pictures))

    def show(number: int) -> None:
        if number:
            film.paste(Image.fromarray(next(pictures)))

    vars(film).update(n_frames=count, seek=show)  # Pillow asks for the frames of such a picture one after the other
    encoded = io.BytesIO()
    # in a lossless file `quality` is the effort of the compressor
    options = {"lossless": True, "quality": 50, "method": 4}
    film.save(encoded, "WEBP", save_all=True, duration=round(1000 / fps), loop=0, **options)
    write_atomically(file, encoded.getvalue())
    return len(encoded.getvalue())
