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
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def area_average(image: Pixels, width: int) -> NDArray[np.float64]:
    """Resize [h, w, channels] to [floor(h · width / w), width, channels], each pixel the mean of its area; float64.
    Integers count as `fractions`.

    Pixels stay square and the optical axis central: a fraction of a row is cut off evenly above and below.
    """
    height, old_width = image.shape[:2]
    scale = old_width / width
    new_height = max(1, int(height / scale + 1e-9))
    rows = area_weights(height, new_height, min(scale, height / new_height))
    columns = area_weights(old_width, width, scale)
    by_columns = np.moveaxis(_weighted(rows, image), 1, 0)
    return np.moveaxis(_weighted(columns, by_columns), 0, 1)


def _weighted(weights: NDArray[np.float64], values: Pixels) -> NDArray[np.float64]:
    """Return `weights` [new, old] times values [old, …], which reads each value about once: rows have few weights."""
    flat = values.reshape(len(values), -1)
    result = np.empty((len(weights), flat.shape[1]))
    for row, shares in enumerate(weights):
        (covered,) = np.nonzero(shares)
        part = slice(covered[0], covered[-1] + 1)
        # of a photograph only these rows are held as floats
        result[row] = shares[part] @ fractions(flat[part]).astype(np.float64)
    return result.reshape(len(weights), *values.shape[1:])


def area_average_straight(rgba: np.ndarray, width: int) -> np.ndarray:
    """Resize straight RGBA, float32, with encoded colours weighted by their alpha: over white, the mean over white."""
    premultiplied = np.concatenate([rgba[..., :3] * rgba[..., 3:], rgba[..., 3:]], axis=-1)
    return straight_from_premultiplied(area_average(premultiplied, width)).clip(0.0, 1.0).astype(np.float32)


def fractions(levels: np.ndarray) -> np.ndarray:
    """Return integers as fractions of their largest, float32 as OpenImageIO computes them; floats as they are."""
    if levels.dtype.kind != "u":
        return levels
    return np.asarray(levels * np.float32(1.0 / np.iinfo(levels.dtype).max), dtype=np.float32)


def resized(levels: np.ndarray, width: int) -> np.ndarray:
    """Return display colour, opaque or straight [h, w, 3 or 4], integers or floats, as float32 at `width` pixels."""
    if width == levels.shape[1]:
        return fractions(levels).astype(np.float32, copy=False)
    if levels.shape[2] == 4:
        return area_average_straight(fractions(levels), width)
    return area_average(levels, width).astype(np.float32)


def straight_at(levels: np.ndarray, width: int | None = None) -> np.ndarray:
    """Return straight RGBA, float32, as `resized` does; without alpha it is opaque, `width` defaults to its own."""
    image = resized(levels, width or levels.shape[1])
    covered = np.ones((*image.shape[:2], 4 - image.shape[2]), dtype=np.float32)
    return np.concatenate([image, covered], axis=-1)


def area_average_hits(values: np.ndarray, coverage: np.ndarray, width: int) -> np.ndarray:
    """Average values [h, w, channels] over the places where `coverage` [h, w] > 0; 0 where there are none."""
    weighted = np.concatenate([values * coverage[..., None], coverage[..., None]], axis=-1)
    mean = area_average(weighted, width)
    total = mean[..., -1:]
    return np.where(total > 0, mean[..., :-1] / np.where(total > 0, total, 1.0), 0.0).astype(np.float32)
