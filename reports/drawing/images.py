"""Pictures of the page as base64 PNGs, reduced in size if there are many of them."""

import base64
import io
from pathlib import Path
from typing import Literal

import matplotlib.image
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

Picture = NDArray[np.float64]
"""A picture `[height, width, 3]`, display colour, 0 … 1."""


def delta_e(truth: Picture, render: Picture) -> NDArray[np.float64]:
    """Return CIEDE2000 at every pixel, D65. Importing colour-science takes seconds, so it happens here."""
    import colour

    white = colour.CCS_ILLUMINANTS["CIE 1931 2 Degree Standard Observer"]["D65"]
    labs = [colour.XYZ_to_Lab(colour.sRGB_to_XYZ(picture), white) for picture in (truth, render)]
    return np.asarray(colour.delta_E(*labs, method="CIE 2000"))


def smaller(picture: Picture, side: int) -> Picture:
    """Average over complete blocks until no side is longer than `side`."""
    block = max(1, -(-max(picture.shape[:2]) // side))
    height, width = (length // block * block for length in picture.shape[:2])
    blocks = picture[:height, :width].reshape(height // block, block, width // block, block, -1)
    return np.asarray(blocks.mean(axis=(1, 3)))


BYTES_PER_PIXEL = 2.6
SIZES = (400, 320, 256, 200, 160, 128, 100, 64)


def side_for(pictures: int, budget: int) -> int:
    """Return the longest side at which so many pictures stay within a budget of bytes."""
    fitting = (side for side in SIZES if pictures * side * side * BYTES_PER_PIXEL <= budget)
    return next(fitting, SIZES[-1])


def data_uri(picture: Picture, kind: Literal["png", "jpeg"] = "png", **options: int) -> str:
    """Return a picture file in base64, for an `<img>` that needs no other file; the options are its encoder's."""
    buffer = io.BytesIO()
    eight_bit = np.round(255 * np.clip(picture, 0, 1)).astype(np.uint8)
    matplotlib.image.imsave(buffer, np.ascontiguousarray(eight_bit), format=kind, pil_kwargs=options or None)
    return f"data:image/{kind};base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}"


def save(figure: Figure, path: Path) -> None:
    """Save a figure as a PNG on white, cropped to its content."""
    FigureCanvasAgg(figure)
    figure.patch.set_visible(True)
    figure.savefig(path, dpi=130, facecolor="white", bbox_inches="tight", pad_inches=0.12)
