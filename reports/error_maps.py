"""Two pictures → how much they differ in colour, for captions; maps of it are drawn in the browser."""

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.float64]
"""`[height, width, 3]`, display colour, 0 … 1."""


def delta_e(truth: Picture, render: Picture) -> NDArray[np.float64]:
    """CIEDE2000 at every pixel, D65. Importing colour-science takes seconds, so it happens here."""
    import colour

    white = colour.CCS_ILLUMINANTS["CIE 1931 2 Degree Standard Observer"]["D65"]
    labs = [colour.XYZ_to_Lab(colour.sRGB_to_XYZ(picture), white) for picture in (truth, render)]
    return np.asarray(colour.delta_E(*labs, method="CIE 2000"))


def smaller(picture: Picture, side: int) -> Picture:
    """Averaged over whole blocks until no side is longer than `side`."""
    block = max(1, -(-max(picture.shape[:2]) // side))
    height, width = (length // block * block for length in picture.shape[:2])
    blocks = picture[:height, :width].reshape(height // block, block, width // block, block, -1)
    return blocks.mean(axis=(1, 3))
