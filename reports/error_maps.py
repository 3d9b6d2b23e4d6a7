"""Two pictures → a picture of where they differ."""

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.float64]
"""`[height, width, 3]`, display colour, 0 … 1."""

AMPLIFIED = 4.0
DELTA_E_WHITE = 20.0
"""ΔE₀₀ that the map draws in its brightest tone."""


def absolute_error(truth: Picture, render: Picture) -> Picture:
    """|render − truth| × 4 on black: the colour says which channel is off."""
    return np.clip(AMPLIFIED * np.abs(render - truth), 0.0, 1.0)


def delta_e(truth: Picture, render: Picture) -> NDArray[np.float64]:
    """CIEDE2000 at every pixel, D65. Importing colour-science takes seconds, so it happens here."""
    import colour

    white = colour.CCS_ILLUMINANTS["CIE 1931 2 Degree Standard Observer"]["D65"]
    labs = [colour.XYZ_to_Lab(colour.sRGB_to_XYZ(picture), white) for picture in (truth, render)]
    return np.asarray(colour.delta_E(*labs, method="CIE 2000"))


def delta_e_map(differences: NDArray[np.float64]) -> Picture:
    """ΔE₀₀ from 0 to 20 in the tones of magma."""
    import matplotlib

    return np.asarray(matplotlib.colormaps["magma"](np.clip(differences / DELTA_E_WHITE, 0, 1)))[..., :3]


def smaller(picture: Picture, side: int) -> Picture:
    """Averaged over whole blocks until no side is longer than `side`."""
    block = max(1, -(-max(picture.shape[:2]) // side))
    height, width = (length // block * block for length in picture.shape[:2])
    blocks = picture[:height, :width].reshape(height // block, block, width // block, block, -1)
    return blocks.mean(axis=(1, 3))
