"""Power laws: how fast an error falls with samples, or a cost grows with size."""

from collections.abc import Sequence

import numpy as np


def fitted_power(x: Sequence[float], y: Sequence[float]) -> tuple[float, float]:
    """Return slope and height of the line fitted to log y over log x."""
    slope, height = np.polyfit(np.log(x), np.log(y), 1)
    return float(slope), float(height)
