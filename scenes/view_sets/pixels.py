"""Arithmetic on stored pixels: the sRGB transfer, alpha, and resizing by area averaging.

Arrays are `[..., channels]`; *linear*, *display*, *straight* and *premultiplied* are defined in CONVENTIONS.md.
"""

import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.floating]


def encode_srgb(linear: Pixels) -> Pixels:
    """Encode linear light 0 … 1 as display value (IEC 61966-2-1); values outside 0 … 1 are clipped first."""
    x = np.clip(linear, 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 0.0031308) ** (1 / 2.4) - 0.055)


def decode_srgb(display: Pixels) -> Pixels:
    """Decode display value 0 … 1 to linear light; the inverse of `encode_srgb`."""
    x = np.clip(display, 0.0, 1.0)
    return np.where(x <= 0.04045, x / 12.92, ((np.maximum(x, 0.04045) + 0.055) / 1.055) ** 2.4)


def straight_from_premultiplied(rgba: np.ndarray) -> np.ndarray:
    """Divide colour by alpha; colour is 0 where alpha is 0."""
    alpha = rgba[..., 3:]
    colour = np.where(alpha > 0, rgba[..., :3] / np.where(alpha > 0, alpha, 1.0), 0.0)
    return np.concatenate([colour, alpha], axis=-1)


def display_from_linear(rgba: np.ndarray) -> np.ndarray:
    """Map premultiplied linear RGBA to straight display RGBA in 0 … 1, as a PNG holds it; float32.

    Light brighter than white is clipped; so is colour without coverage, which straight alpha cannot hold.
    """
    straight = straight_from_premultiplied(rgba)
    alpha = np.clip(straight[..., 3:], 0.0, 1.0)
    return np.concatenate([encode_srgb(straight[..., :3]), alpha], axis=-1).astype(np.float32)


def over_white(display: Pixels) -> Pixels:
    """Put straight display RGBA over white, `colour * alpha + (1 − alpha)`; returns display RGB."""
    alpha = display[..., 3:]
    return display[..., :3] * alpha + (1 - alpha)


def area_weights(size: int, new_size: int, scale: float) -> NDArray[np.float64]:
    """Return a row-stochastic matrix [new_size, size]: each new pixel is the mean of the `scale` old pixels it covers.

    The new pixels are centred on the old ones: where `new_size * scale < size` both margins are cut evenly.
    """
    start = (size - new_size * scale) / 2 + np.arange(new_size)[:, None] * scale
    pixel = np.arange(size)
    covered = np.minimum(start + scale, pixel + 1) - np.maximum(start, pixel)
    weights = np.clip(covered, 0.0, None)
    shares: NDArray[np.float64] = weights / weights.sum(axis=1, keepdims=True)
    return shares


def area_average(image: Pixels, width: int) -> NDArray[np.float64]:
    """Resize [h, w, channels] to [floor(h · width / w), width, channels], each pixel the mean of its area; float64.

    Pixels stay square and the optical axis stays in the centre: a remaining fraction of a new row is cut off evenly
    above and below.
    """
    height, old_width = image.shape[:2]
    scale = old_width / width
    new_height = max(1, int(height / scale + 1e-9))
    rows = area_weights(height, new_height, min(scale, height / new_height))
    columns = area_weights(old_width, width, scale)
    mean: NDArray[np.float64] = np.einsum("ih,hwc,jw->ijc", rows, image.astype(np.float64), columns, optimize=True)
    return mean


def area_average_straight(rgba: np.ndarray, width: int) -> np.ndarray:
    """Resize straight RGBA with colours weighted by their alpha, so colour without coverage has no effect; float32.

    Encoded values are averaged, as usual in the field: the result over white is the mean over white.
    """
    premultiplied = np.concatenate([rgba[..., :3] * rgba[..., 3:], rgba[..., 3:]], axis=-1)
    return straight_from_premultiplied(area_average(premultiplied, width)).clip(0.0, 1.0).astype(np.float32)


def area_average_hits(values: np.ndarray, coverage: np.ndarray, width: int) -> np.ndarray:
    """Average values [h, w, channels] over the places where `coverage` [h, w] > 0; 0 where there are none."""
    weighted = np.concatenate([values * coverage[..., None], coverage[..., None]], axis=-1)
    mean = area_average(weighted, width)
    total = mean[..., -1:]
    return np.where(total > 0, mean[..., :-1] / np.where(total > 0, total, 1.0), 0.0).astype(np.float32)
