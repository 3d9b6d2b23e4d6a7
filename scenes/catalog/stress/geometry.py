"""Rays against simple shapes, in closed form; float64, all rays at once. Distances are inf where nothing is met."""

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.float64]
ORIGIN = np.zeros(3)


def ball(o: Numbers, d: Numbers, centre: Numbers | tuple[float, ...], radius: float) -> tuple[Numbers, Numbers]:
    """Return the distances [rays] at which lines enter and leave a ball, negative behind the origin."""
    to = o - np.asarray(centre, dtype=np.float64)
    along = (to * d).sum(-1)
    # the distance from the line, not |to|² − along², which cancels far away
    square = radius**2 - ((to - along[..., None] * d) ** 2).sum(-1)
    half = np.sqrt(np.maximum(square, 0.0))
    met = square > 0
    return np.where(met, -along - half, np.inf), np.where(met, -along + half, np.inf)


def first_ball(o: Numbers, d: Numbers, centre: Numbers | tuple[float, ...], radius: float) -> Numbers:
    """Return the distance [rays] to a ball from outside."""
    enter, _ = ball(o, d, centre, radius)
    return np.where(enter > 0, enter, np.inf)


def square(o: Numbers, d: Numbers, height: float, half: float) -> Numbers:
    """Return the distance [rays] to the level square |x|, |y| ≤ half at z = height."""
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (height - o[..., 2]) / d[..., 2]
        inside = (np.abs(o[..., :2] + t[..., None] * d[..., :2]) <= half).all(-1)
    return np.where(inside & (t > 0) & np.isfinite(t), t, np.inf)


def tube(o: Numbers, d: Numbers, start: Numbers, end: Numbers, radius: float) -> Numbers:
    """Return the distance [rays] to a round tube without caps, its inside included."""
    length = float(np.linalg.norm(end - start))
    axis = (end - start) / length
    to = o - start
    across_d = d - (d @ axis)[..., None] * axis
    across_o = to - (to @ axis)[..., None] * axis
    a = (across_d**2).sum(-1)
    parallel = a < 1e-24
    a = np.where(parallel, 1.0, a)
    b = (across_o * across_d).sum(-1)
    inside = radius**2 - ((across_o - (b / a)[..., None] * across_d) ** 2).sum(-1)
    half = np.sqrt(np.maximum(inside, 0.0) / a)
    best = np.full(o.shape[:-1], np.inf)
    for t in (-b / a + half, -b / a - half):
        along = (to + t[..., None] * d) @ axis
        best = np.where((inside > 0) & ~parallel & (t > 0) & (along >= 0) & (along <= length), t, best)
    return best


def at(o: Numbers, d: Numbers, t: Numbers) -> Numbers:
    """Return points [rays, 3]; the origin where the distance is not finite."""
    return o + np.where(np.isfinite(t), t, 0.0)[..., None] * d


def ball_texture(pixels: Numbers, normal: Numbers) -> Numbers:
    """Look up pixels [h, w, 3] wrapped around a ball as Mitsuba does it, the first row at +z, not interpolated."""
    u = np.arctan2(normal[..., 1], normal[..., 0]) / (2 * np.pi) % 1.0
    return _texture(pixels, u, np.arccos(np.clip(normal[..., 2], -1.0, 1.0)) / np.pi)


def square_texture(pixels: Numbers, points: Numbers, half: float) -> Numbers:
    """Look up pixels [h, w, 3] laid on the level square, the first row at −y, not interpolated."""
    return _texture(pixels, points[..., 0] / (2 * half) + 0.5, points[..., 1] / (2 * half) + 0.5)


def _texture(pixels: Numbers, u: Numbers, v: Numbers) -> Numbers:
    height, width = pixels.shape[:2]
    row = np.clip((v * height).astype(int), 0, height - 1)
    column = np.clip((u * width).astype(int), 0, width - 1)
    return np.asarray(pixels[row, column], dtype=np.float64)
