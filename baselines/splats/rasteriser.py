"""The projection of Gaussians to a camera, their compositing front to back, and the gradient of both, compiled for the
processor (Kerbl et al. 2023, arXiv 2308.04079, without its tiles).

One Gaussian after the other visits the rays that it covers: what a ray has let through so far fits in the cache, and no
list of Gaussians is made for a tile. Rays may be any of one camera; they are sorted into rows of small cells, so that a
Gaussian finds its own without looking at the others, and those of a row one after the other, so that the processor
works on several at once: a loop over them has no branch. Every sum runs in one fixed order, which depends on how many
that are. All that is compiled stands in this file: numba's cache would not see a change elsewhere.
"""

import itertools
import math
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, no_type_check

import numpy as np
import torch
from numba import njit, types
from numba.extending import overload
from numpy.polynomial import Chebyshev, Polynomial
from torch import Tensor
from torch.autograd.function import once_differentiable

FAINTEST = 1.0 / 255.0
"""The opacity below which a Gaussian is not drawn on a ray."""
MOST_OPAQUE = 0.99
LET_THROUGH = 1e-4
"""The transmittance below which nothing more is drawn on a ray."""
NEAREST = 1e-3
"""The depth, in halves of the box's longest side, below which a Gaussian is not drawn."""
COLUMNS = {"position": 3, "log_scale": 3, "rotation": 4, "opacity": 1, "colour": 3}
"""The learnt numbers of a Gaussian, in this order, before the harmonics of red, green and blue above degree 0: position
and scale in halves of the box's longest side, a quaternion of any length, the logit of the opacity.
"""
OPACITY, COLOUR, HARMONICS = 10, 11, 14
"""The columns at which these begin."""
ONE, HALF, TWO = np.float32(1.0), np.float32(0.5), np.float32(2.0)
Y0, Y1 = (np.float32(c / math.sqrt(math.pi)) for c in (0.5, math.sqrt(0.75)))
Y2, Y20 = (np.float32(c * math.sqrt(x / math.pi)) for c, x in ((0.5, 15.0), (0.25, 5.0)))
"""The factors of the real spherical harmonics of degree 0, 1 and 2, and of the one of degree 2 that is round."""
CLAMP, END, MOST_FAINT = np.float32(MOST_OPAQUE), np.float32(LET_THROUGH), np.float32(1.0 / FAINTEST)


@dataclass(frozen=True, eq=False)
class RayCells:
    """Points of a plane, those of one cell of a regular grid side by side, about one in each."""

    order: np.ndarray
    """The place of each sorted point among those given, int [points]."""
    back: np.ndarray
    """The inverse of `order`."""
    at: np.ndarray
    """The sorted points [2, points]."""
    start: np.ndarray
    """The first point of each cell, row by row, and the end, int [rows · columns + 1]."""
    rows: int
    columns: int
    lower: np.ndarray
    size: np.ndarray
    """The lower corner of the grid and the sides of a cell [2]."""

    @staticmethod
    def of(points: np.ndarray) -> "RayCells":
        """Sort `points` [points, 2]."""
        points = np.ascontiguousarray(points.T)  # numpy is slow along a long first axis
        lower, upper = points.min(axis=1), points.max(axis=1)
        extent = np.maximum(upper - lower, 1e-12)
        square = (math.sqrt(points.shape[1] * extent[i] / extent[1 - i]) for i in range(2))
        columns, rows = (min(max(1, round(count)), points.shape[1]) for count in square)  # points may lie in a line
        size = (extent / (columns, rows)).astype(points.dtype)
        order, back = (np.empty(points.shape[1], np.int64) for _ in range(2))
        at, start = np.empty_like(points), np.zeros(rows * columns + 1, np.int64)
        _sort(points, lower, size, columns, order, back, at, start)
        return RayCells(order, back, at, start, rows, columns, lower, size)

    def bands(self, count: int) -> list[tuple[int, int]]:
        """Return at most `count` ranges of rows."""
        ends = [self.rows * i // count for i in range(count + 1)]
        return [(low, high) for low, high in itertools.pairwise(ends) if low < high]


@njit(cache=True, error_model="numpy", nogil=True)
@no_type_check
def _sort(
    points: np.ndarray, lower: np.ndarray, size: np.ndarray, columns: int,
    order: np.ndarray, back: np.ndarray, at: np.ndarray, start: np.ndarray,
) -> None:  # fmt: skip
    """Fill the arrays of `RayCells`; points of one cell stay in their order."""
    cells, rows = np.empty(points.shape[1], np.int64), (start.shape[0] - 1) // columns
    for point in range(points.shape[1]):
        column = min(np.int64((points[0, point] - lower[0]) / size[0]), columns - 1)
        row = min(np.int64((points[1, point] - lower[1]) / size[1]), rows - 1)
        cells[point] = row * columns + column
        start[cells[point] + 1] += 1
    for cell in range(start.shape[0] - 1):
        start[cell + 1] += start[cell]
    free = start.copy()
    for point in range(points.shape[1]):
        place = free[cells[point]]
        free[cells[point]] += 1
        order[place], back[point] = point, place
        at[0, place], at[1, place] = points[0, point], points[1, point]


@njit(inline="always")
@no_type_check
def _rotate(v: np.ndarray, turn: np.ndarray) -> float:
    """Fill `turn` [3, 3] with the rotation of a Gaussian, and return the length of its quaternion."""
    length = math.sqrt(v[6] * v[6] + v[7] * v[7] + v[8] * v[8] + v[9] * v[9])
    w, x, y, z = v[6] / length, v[7] / length, v[8] / length, v[9] / length
    turn[0, 0], turn[0, 1], turn[0, 2] = ONE - TWO * (y * y + z * z), TWO * (x * y - w * z), TWO * (x * z + w * y)
    turn[1, 0], turn[1, 1], turn[1, 2] = TWO * (x * y + w * z), ONE - TWO * (x * x + z * z), TWO * (y * z - w * x)
    turn[2, 0], turn[2, 1], turn[2, 2] = TWO * (x * z - w * y), TWO * (y * z + w * x), ONE - TWO * (x * x + y * y)
    return length


@njit(inline="always")
@no_type_check
def _fill_harmonics(x: float, y: float, z: float, out: np.ndarray) -> None:
    """Fill `out` with the real spherical harmonics of a unit direction above degree 0: none, 3 or 8 of them."""
    if out.shape[0] > 0:
        out[0], out[1], out[2] = Y1 * y, Y1 * z, Y1 * x
    if out.shape[0] > 3:
        out[3], out[4], out[6] = Y2 * x * y, Y2 * y * z, Y2 * x * z
        out[5] = Y20 * (np.float32(3.0) * z * z - ONE)
        out[7] = HALF * Y2 * (x * x - y * y)


@njit(inline="always")
@no_type_check
def _flatten(
    v: np.ndarray, origin: np.ndarray, axes: np.ndarray, turn: np.ndarray, flat: np.ndarray, deep: np.ndarray
) -> tuple[float, float, float, float]:
    """Project one Gaussian: fill `turn`, its axes in the picture `flat` [3, 2] and their depths `deep` [3]. Return
    where it is seen, its depth along the axis, and the length of its quaternion.
    """
    px, py, pz = v[0] - origin[0], v[1] - origin[1], v[2] - origin[2]
    z = px * axes[0, 2] + py * axes[1, 2] + pz * axes[2, 2]
    a = (px * axes[0, 0] + py * axes[1, 0] + pz * axes[2, 0]) / z
    b = (px * axes[0, 1] + py * axes[1, 1] + pz * axes[2, 1]) / z
    length = _rotate(v, turn)
    for j in range(3):
        scale = math.exp(v[3 + j])
        deep[j] = scale * (turn[0, j] * axes[0, 2] + turn[1, j] * axes[1, 2] + turn[2, j] * axes[2, 2])
        right = scale * (turn[0, j] * axes[0, 0] + turn[1, j] * axes[1, 0] + turn[2, j] * axes[2, 0])
        down = scale * (turn[0, j] * axes[0, 1] + turn[1, j] * axes[1, 1] + turn[2, j] * axes[2, 1])
        # Eq. 5 of Kerbl et al.: the projection to first order about the middle
        flat[j, 0], flat[j, 1] = (right - a * deep[j]) / z, (down - b * deep[j]) / z
    return a, b, z, length


@njit(cache=True, error_model="numpy", nogil=True)
@no_type_check
def _project(
    values: np.ndarray, order: np.ndarray, origin: np.ndarray, axes: np.ndarray, widened: float,
    shapes: np.ndarray, halves: np.ndarray, colours: np.ndarray,
) -> None:  # fmt: skip
    """Fill a row of `shapes`, `halves` and `colours` (`_forward`) for each Gaussian of `order`, a row of `values`
    (`COLUMNS`); `widened` is a standard deviation in space.
    """
    kind = values.dtype
    turn, flat, deep = np.empty((3, 3), kind), np.empty((3, 2), kind), np.empty(3, kind)
    terms = (values.shape[1] - HARMONICS) // 3
    toward = np.empty(terms, kind)
    for place in range(order.shape[0]):
        v = values[order[place]]
        a, b, z, _ = _flatten(v, origin, axes, turn, flat, deep)
        wide = (widened / z) * (widened / z)
        xx, xy, yy = wide * (ONE + a * a), wide * a * b, wide * (ONE + b * b)
        for j in range(3):
            xx += flat[j, 0] * flat[j, 0]
            xy += flat[j, 0] * flat[j, 1]
            yy += flat[j, 1] * flat[j, 1]
        determinant = xx * yy - xy * xy
        opacity = ONE / (ONE + math.exp(-v[OPACITY]))
        shapes[place, 0], shapes[place, 1] = a, b
        shapes[place, 2], shapes[place, 3], shapes[place, 4] = yy / determinant, -xy / determinant, xx / determinant
        shapes[place, 5] = opacity
        reach = math.sqrt(max(TWO * math.log(MOST_FAINT * opacity), 0.0))
        halves[place, 0], halves[place, 1] = reach * math.sqrt(xx), reach * math.sqrt(yy)
        px, py, pz = v[0] - origin[0], v[1] - origin[1], v[2] - origin[2]
        distance = math.sqrt(px * px + py * py + pz * pz)
        _fill_harmonics(px / distance, py / distance, pz / distance, toward)
        for c in range(3):
            colour = HALF + Y0 * v[COLOUR + c]
            for t in range(terms):
                colour += toward[t] * v[HARMONICS + c * terms + t]
            colours[place, c] = max(colour, 0.0)
        colours[place, 3] = distance


@njit(cache=True, error_model="numpy", nogil=True)
@no_type_check
def _project_back(
    values: np.ndarray, order: np.ndarray, origin: np.ndarray, axes: np.ndarray, widened: float,
    shapes: np.ndarray, colours: np.ndarray, to_shapes: np.ndarray, to_colours: np.ndarray, to_values: np.ndarray,
) -> None:  # fmt: skip
    """Fill the rows `order` of `to_values` with the gradient of `_project`."""
    kind = values.dtype
    turn, flat, deep = np.empty((3, 3), kind), np.empty((3, 2), kind), np.empty(3, kind)
    to_turn, to_axis = np.empty((3, 3), kind), np.empty(3, kind)
    terms = (values.shape[1] - HARMONICS) // 3
    toward = np.empty(terms, kind)
    for place in range(order.shape[0]):
        v, to = values[order[place]], to_values[order[place]]
        a, b, z, length = _flatten(v, origin, axes, turn, flat, deep)
        wide = (widened / z) * (widened / z)
        # K of the covariance C is its inverse: dC = −K dK K
        p, q, r = shapes[place, 2], shapes[place, 3], shapes[place, 4]
        to_p, to_q, to_r = to_shapes[place, 2], HALF * to_shapes[place, 3], to_shapes[place, 4]
        to_xx = -(p * p * to_p + TWO * p * q * to_q + q * q * to_r)
        to_yy = -(q * q * to_p + TWO * q * r * to_q + r * r * to_r)
        to_xy = -TWO * (p * q * to_p + (p * r + q * q) * to_q + q * r * to_r)
        to_wide = to_xx * (ONE + a * a) + to_yy * (ONE + b * b) + to_xy * a * b
        to_a = to_shapes[place, 0] + wide * (TWO * to_xx * a + to_xy * b)
        to_b = to_shapes[place, 1] + wide * (TWO * to_yy * b + to_xy * a)
        to_z = -TWO * wide * to_wide / z
        for j in range(3):
            to_right = (TWO * to_xx * flat[j, 0] + to_xy * flat[j, 1]) / z
            to_down = (TWO * to_yy * flat[j, 1] + to_xy * flat[j, 0]) / z
            to_deep = -(a * to_right + b * to_down)
            to_a -= to_right * deep[j]
            to_b -= to_down * deep[j]
            to_z -= to_right * flat[j, 0] + to_down * flat[j, 1]
            scale = math.exp(v[3 + j])
            to_scale = np.float32(0.0)
            for i in range(3):
                along = to_right * axes[i, 0] + to_down * axes[i, 1] + to_deep * axes[i, 2]
                to_turn[i, j] = scale * along
                to_scale += scale * along * turn[i, j]
            to[3 + j] = to_scale
        to_z -= (to_a * a + to_b * b) / z
        distance = colours[place, 3]
        for i in range(3):
            away = (v[i] - origin[i]) / distance
            seen = (to_a * axes[i, 0] + to_b * axes[i, 1]) / z + to_z * axes[i, 2]
            to[i] = seen + to_colours[place, 3] * away
            to_axis[i] = away
        w, x, y, z = v[6] / length, v[7] / length, v[8] / length, v[9] / length
        g = to_turn
        to_w = TWO * (z * (g[1, 0] - g[0, 1]) + y * (g[0, 2] - g[2, 0]) + x * (g[2, 1] - g[1, 2]))
        to_x = TWO * (y * (g[0, 1] + g[1, 0]) + z * (g[0, 2] + g[2, 0]) + w * (g[2, 1] - g[1, 2]))
        to_x -= TWO * TWO * x * (g[1, 1] + g[2, 2])
        to_y = TWO * (x * (g[0, 1] + g[1, 0]) + z * (g[1, 2] + g[2, 1]) + w * (g[0, 2] - g[2, 0]))
        to_y -= TWO * TWO * y * (g[0, 0] + g[2, 2])
        to_q = TWO * (x * (g[0, 2] + g[2, 0]) + y * (g[1, 2] + g[2, 1]) + w * (g[1, 0] - g[0, 1]))
        to_q -= TWO * TWO * z * (g[0, 0] + g[1, 1])
        along = to_w * w + to_x * x + to_y * y + to_q * z
        to[6], to[7] = (to_w - w * along) / length, (to_x - x * along) / length
        to[8], to[9] = (to_y - y * along) / length, (to_q - z * along) / length
        opacity = shapes[place, 5]
        to[OPACITY] = to_shapes[place, 5] * opacity * (ONE - opacity)
        _fill_harmonics(to_axis[0], to_axis[1], to_axis[2], toward)
        for c in range(3):
            seen = to_colours[place, c] if colours[place, c] > 0.0 else np.float32(0.0)
            to[COLOUR + c] = Y0 * seen
            for t in range(terms):
                to[HARMONICS + c * terms + t] = toward[t] * seen


@njit(inline="always")
@no_type_check
def _covered(centre: float, half: float, lower: float, size: float, count: int) -> tuple[int, int]:
    """Return the first and the last of `count` cells that centre ± half reaches; the first is beyond the last if it
    reaches none.
    """
    first, last = math.floor((centre - half - lower) / size), math.floor((centre + half - lower) / size)
    return max(np.int64(first), 0), min(np.int64(last), count - 1)


FALL = tuple(
    np.float32(c)
    for c in Chebyshev.interpolate(lambda x: np.exp(-x), 6, domain=[0.0, 0.695]).convert(kind=Polynomial).coef
)
EIGHTH, NOTHING = np.float32(0.125), np.float32(0.0)


@no_type_check
def _falloff(power):  # numba compares its signature with those of the two below
    """Return e^−power, in float32 by a polynomial to the eighth power, within 5e-7 up to log 255, beyond which nothing
    is drawn: a loop around the library's function is not computed several at a time.
    """
    raise NotImplementedError("compiled code alone calls it")


@overload(_falloff, inline="always")
@no_type_check
def _falloff_of(power):
    @no_type_check
    def exact(power):
        return math.exp(-power)

    @no_type_check
    def polynomial(power):
        x = power * EIGHTH
        fall = FALL[0] + x * (FALL[1] + x * (FALL[2] + x * (FALL[3] + x * (FALL[4] + x * (FALL[5] + x * FALL[6])))))
        fall = fall * fall
        fall = fall * fall
        return fall * fall

    return polynomial if power == types.float32 else exact


@njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract", "arcp"})
@no_type_check
def _forward(
    at: np.ndarray, start: np.ndarray, columns: int, lower: np.ndarray, size: np.ndarray, band: tuple[int, int],
    shapes: np.ndarray, halves: np.ndarray, colours: np.ndarray,
    out: np.ndarray, through: np.ndarray, last: np.ndarray,
) -> int:  # fmt: skip
    """Draw Gaussians `shapes` [n, 6] (centre, inverse covariance xx xy yy, opacity), of bounding boxes `halves` [n, 2]
    and `colours` [n, 4] (the last one is depth), over the rows `band`. Adds to `out` [4, rays]; `through` [rays] holds
    the transmittance, `last` [rays] the last Gaussian drawn. Returns how often one was drawn on a ray.
    """
    drawn, row_of = 0, np.empty(at.shape[1], at.dtype)
    for g in range(shapes.shape[0]):
        cx, cy, xx, xy, yy, opacity = shapes[g]
        red, green, blue, depth = colours[g]
        faintest = math.log(np.float32(255.0) * opacity)
        row, end = _covered(cy, halves[g, 1], lower[1], size[1], band[1])
        left, right = _covered(cx, halves[g, 0], lower[0], size[0], columns)
        if left > right:
            continue
        for r in range(max(row, band[0]), end + 1):
            some = slice(start[r * columns + left], start[r * columns + right + 1])
            x, y, let, final = at[0, some], at[1, some], through[some], last[some]
            weight = row_of[: x.shape[0]]
            for i in range(x.shape[0]):
                dx, dy = x[i] - cx, y[i] - cy
                power = HALF * (xx * dx * dx + yy * dy * dy) + xy * dx * dy
                alpha = min(opacity * _falloff(power), CLAMP)
                weight[i] = NOTHING if power > faintest else alpha
            for i in range(x.shape[0]):
                alpha = NOTHING if let[i] < END else weight[i]
                weight[i] = alpha * let[i]
                let[i] *= ONE - alpha
            _add(out[0, some], weight, red)
            _add(out[1, some], weight, green)
            _add(out[2, some], weight, blue)
            _add(out[3, some], weight, depth)
            for i in range(x.shape[0]):
                is_drawn = weight[i] != NOTHING
                final[i] = np.int32(g) if is_drawn else final[i]
                drawn += np.int64(is_drawn)
    return drawn


@njit(inline="always")
@no_type_check
def _add(total: np.ndarray, weight: np.ndarray, value: float) -> None:
    for i in range(total.shape[0]):
        total[i] += weight[i] * value


@njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract", "arcp", "reassoc"})
@no_type_check
def _backward(
    at: np.ndarray, start: np.ndarray, columns: int, rows: int, lower: np.ndarray, size: np.ndarray,
    shapes: np.ndarray, halves: np.ndarray, colours: np.ndarray,
    through: np.ndarray, behind: np.ndarray, last: np.ndarray, gradient: np.ndarray,
    to_shapes: np.ndarray, to_colours: np.ndarray,
) -> None:  # fmt: skip
    """Undo `_forward` from back to front. `gradient` [4, rays] is that of its `out`, `behind` [rays] that of the
    transmittance, times it; both `through` and `behind` are used up.
    """
    kind, longest = at.dtype, at.shape[1]
    alphas, shares, weights = np.empty(longest, kind), np.empty(longest, kind), np.empty(longest, kind)
    owns, slopes = np.empty(longest, kind), np.empty(longest, kind)
    for g in range(shapes.shape[0] - 1, -1, -1):
        cx, cy, xx, xy, yy, opacity = shapes[g]
        red, green, blue, depth = colours[g]
        faintest = math.log(np.float32(255.0) * opacity)
        row, end = _covered(cy, halves[g, 1], lower[1], size[1], rows)
        left, right = _covered(cx, halves[g, 0], lower[0], size[0], columns)
        if left > right:
            continue
        to_cx = to_cy = to_xx = to_xy = to_yy = to_opacity = c0 = c1 = c2 = c3 = opacity * NOTHING
        for r in range(row, end + 1):
            some = slice(start[r * columns + left], start[r * columns + right + 1])
            x, y, let, rest, final = at[0, some], at[1, some], through[some], behind[some], last[some]
            g0, g1, g2, g3 = gradient[0, some], gradient[1, some], gradient[2, some], gradient[3, some]
            alpha, share, weight = alphas[: x.shape[0]], shares[: x.shape[0]], weights[: x.shape[0]]
            own, to_alpha = owns[: x.shape[0]], slopes[: x.shape[0]]
            for i in range(x.shape[0]):
                dx, dy = x[i] - cx, y[i] - cy
                power = HALF * (xx * dx * dx + yy * dy * dy) + xy * dx * dy
                fall = _falloff(power)
                fall = NOTHING if (power > faintest) | (g > final[i]) else fall
                alpha[i] = min(opacity * fall, CLAMP)
                share[i] = fall if opacity * fall < CLAMP else NOTHING  # an opacity at its limit has no slope
            # a loop that writes no more than it needs to is computed several rays at once
            for i in range(x.shape[0]):
                let[i] /= ONE - alpha[i]
                weight[i] = alpha[i] * let[i]
            for i in range(x.shape[0]):
                own[i] = red * g0[i] + green * g1[i] + blue * g2[i] + depth * g3[i]
            for i in range(x.shape[0]):
                to_alpha[i] = let[i] * own[i] - rest[i] / (ONE - alpha[i])
            for i in range(x.shape[0]):
                rest[i] += weight[i] * own[i]
            for i in range(x.shape[0]):
                c0 += weight[i] * g0[i]
                c1 += weight[i] * g1[i]
                c2 += weight[i] * g2[i]
                c3 += weight[i] * g3[i]
            for i in range(x.shape[0]):
                dx, dy = x[i] - cx, y[i] - cy
                to_opacity += share[i] * to_alpha[i]
                to_power = -opacity * share[i] * to_alpha[i]
                to_xx += HALF * dx * dx * to_power
                to_xy += dx * dy * to_power
                to_yy += HALF * dy * dy * to_power
                to_cx -= (xx * dx + xy * dy) * to_power
                to_cy -= (yy * dy + xy * dx) * to_power
        to_shapes[g, 0], to_shapes[g, 1], to_shapes[g, 2] = to_cx, to_cy, to_xx
        to_shapes[g, 3], to_shapes[g, 4], to_shapes[g, 5] = to_xy, to_yy, to_opacity
        to_colours[g, 0], to_colours[g, 1], to_colours[g, 2], to_colours[g, 3] = c0, c1, c2, c3


@njit(cache=True, error_model="numpy", nogil=True)
@no_type_check
def add_densities(
    x: np.ndarray, middle: np.ndarray, whitened: np.ndarray, peak: np.ndarray, far: np.ndarray, total: np.ndarray
) -> None:
    """Add to `total` [points] what Gaussians up to `far` [n] away from their `middle` [n, 3] have of `peak` [n]."""
    for g in range(middle.shape[0]):
        for p in range(x.shape[0]):
            dx, dy, dz = x[p, 0] - middle[g, 0], x[p, 1] - middle[g, 1], x[p, 2] - middle[g, 2]
            if abs(dx) < far[g] and abs(dy) < far[g] and abs(dz) < far[g]:
                square = np.float32(0.0)
                for axis in range(3):
                    along = whitened[g, axis, 0] * dx + whitened[g, axis, 1] * dy + whitened[g, axis, 2] * dz
                    square += along * along
                total[p] += peak[g] * math.exp(-HALF * square)


class Drawn(torch.autograd.Function):
    """Colour and depth [rays, 4] without a background, transmittance [rays], and the number of times that a Gaussian
    was drawn on a ray; differentiable once in the Gaussians. The direction from which a Gaussian is seen counts as
    given.
    """

    @staticmethod
    def forward(
        ctx: Any, rays: RayCells, camera: tuple[np.ndarray, np.ndarray], widened: float, values: Tensor
    ) -> tuple[Tensor, Tensor, int]:
        given, (origin, axes) = values.detach().numpy(), camera
        kind, count = given.dtype, rays.at.shape[1]
        depth = (given[:, :3] - origin) @ axes[:, 2]
        order = np.argsort(depth, kind="stable")
        order = order[np.searchsorted(depth[order], NEAREST) :]
        shapes, halves, colours = (np.empty((len(order), size), kind) for size in (6, 2, 4))
        _project(given, order, origin, axes, widened, shapes, halves, colours)
        out, through = np.zeros((4, count), kind), np.ones(count, kind)
        last = np.full(count, -1, np.int32)
        place = rays.at, rays.start, rays.columns, rays.lower, rays.size

        def draw(band: tuple[int, int]) -> int:
            return int(_forward(*place, band, shapes, halves, colours, out, through, last))

        drawn = sum(_at_once(draw, rays.bands(torch.get_num_threads())))
        ctx.save_for_backward(values, *map(torch.from_numpy, (order, shapes, halves, colours, through, last)))
        ctx.rays, ctx.camera, ctx.widened = rays, camera, widened
        return torch.from_numpy(out[:, rays.back]).T, torch.from_numpy(through[rays.back]), drawn

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, to_out: Tensor, to_through: Tensor, _: Any) -> tuple[Tensor | None, ...]:
        values, order, shapes, halves, colours, through, last = (tensor.numpy() for tensor in ctx.saved_tensors)
        rays = ctx.rays
        to_shapes, to_colours = np.zeros_like(shapes), np.zeros_like(colours)
        _backward(
            rays.at, rays.start, rays.columns, rays.rows, rays.lower, rays.size, shapes, halves, colours,
            through.copy(), through * to_through.numpy()[rays.order], last, to_out.numpy().T[:, rays.order],
            to_shapes, to_colours,
        )  # fmt: skip
        to_values = np.zeros_like(values)
        camera = *ctx.camera, ctx.widened
        _project_back(values, order, *camera, shapes, colours, to_shapes, to_colours, to_values)
        return None, None, None, torch.from_numpy(to_values)


def _at_once(draw: Callable[[tuple[int, int]], int], bands: list[tuple[int, int]]) -> Iterable[int]:
    if len(bands) == 1:
        return map(draw, bands)
    with ThreadPoolExecutor(len(bands)) as pool:
        return list(pool.map(draw, bands))
