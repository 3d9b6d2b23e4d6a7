"""The projection of Gaussians to a camera, their compositing front to back, and the gradient of both, compiled for the
processor (Kerbl et al. 2023, arXiv 2308.04079, without its tiles).

One Gaussian after the other visits the rays that it covers: the transmittances of all rays fit in the cache, and no
list of Gaussians is made for a tile. The rays may be any rays of one camera. They are sorted into rows of small cells,
so that a Gaussian finds its rays without a search. Their numbers are first copied side by side: a Gaussian covers a few
rays in each of several rows, too few for the processor to work on several at once. Every sum runs in a fixed order.
All compiled code that calls other compiled code is in this file, as numba's cache would not see a change elsewhere.
"""

import math
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple, no_type_check

import numpy as np
import torch
from numba import njit, types
from numba.extending import overload
from numpy.polynomial import Chebyshev, Polynomial
from torch import Tensor
from torch.autograd.function import once_differentiable

from baselines.splats.ray_cells import RayCells

FAINTEST = 1.0 / 255.0
"""The opacity below which a Gaussian is not drawn on a ray."""
MOST_OPAQUE = 0.99
LET_THROUGH = 1e-4
"""The transmittance below which no further Gaussian is drawn on a ray."""
NEAREST = 1e-3
"""The smallest near plane, in halves of the box's longest side."""
COLUMNS = {"position": 3, "log_scale": 3, "rotation": 4, "opacity": 1, "colour": 3}
"""The learnt numbers of a Gaussian, in this order, before the harmonics of red, green and blue above degree 0: position
and scale in halves of the box's longest side, a quaternion of any length, the logit of the opacity.
"""
OPACITY, COLOUR, HARMONICS = 10, 11, 14
ONE, HALF, TWO = np.float32(1.0), np.float32(0.5), np.float32(2.0)
Y0, Y1 = (np.float32(c / math.sqrt(math.pi)) for c in (0.5, math.sqrt(0.75)))
Y2, Y20 = (np.float32(c * math.sqrt(x / math.pi)) for c, x in ((0.5, 15.0), (0.25, 5.0)))
Y30, Y31 = (np.float32(c * math.sqrt(x / math.pi)) for c, x in ((0.25, 7.0), (0.25, 10.5)))
Y32, Y33 = (np.float32(c * math.sqrt(x / math.pi)) for c, x in ((0.25, 105.0), (0.25, 17.5)))
"""The factors of the real spherical harmonics of degree 0 to 3; a second digit is the order, where they differ."""
SLANT = np.float32(2.0)
"""The largest slope x/z and y/z at which the projection is linearised. To first order a Gaussian next to the camera
covers the whole picture; the reference implementation limits the slope to 1.3 times that of the picture's edge.
"""
CLAMP, END, MOST_FAINT = np.float32(MOST_OPAQUE), np.float32(LET_THROUGH), np.float32(1.0 / FAINTEST)


class Eye(NamedTuple):
    """A camera, and how it blurs what it sees. Lengths are in halves of the box's longest side."""

    origin: np.ndarray
    axes: np.ndarray
    """The directions right, down and forward as columns [3, 3]."""
    widened: float
    """The standard deviation by which each Gaussian is widened in space."""
    blurred: float = 0.0
    """The variance by which each is blurred in the plane at distance 1."""
    nearest: float = NEAREST
    """The depth below which a Gaussian is not drawn."""


class Projected(NamedTuple):
    """Gaussians projected to a camera, front to back."""

    shapes: np.ndarray
    """The centre x, y in the picture, the conic (inverse covariance) xx, xy, yy, and the opacity [n, 6]."""
    halves: np.ndarray
    """The half extents of the bounding boxes [n, 2]."""
    colours: np.ndarray
    """Red, green, blue, and depth [n, 4]."""


@njit(inline="always")
@no_type_check
def _rotate(row: np.ndarray, turn: np.ndarray) -> float:
    """Fill `turn` [3, 3] with the rotation of a Gaussian, and return the length of its quaternion."""
    length = math.sqrt(row[6] * row[6] + row[7] * row[7] + row[8] * row[8] + row[9] * row[9])
    w, x, y, z = row[6] / length, row[7] / length, row[8] / length, row[9] / length
    turn[0, 0], turn[0, 1], turn[0, 2] = ONE - TWO * (y * y + z * z), TWO * (x * y - w * z), TWO * (x * z + w * y)
    turn[1, 0], turn[1, 1], turn[1, 2] = TWO * (x * y + w * z), ONE - TWO * (x * x + z * z), TWO * (y * z - w * x)
    turn[2, 0], turn[2, 1], turn[2, 2] = TWO * (x * z - w * y), TWO * (y * z + w * x), ONE - TWO * (x * x + y * y)
    return length


@njit(inline="always")
@no_type_check
def _fill_harmonics(x: float, y: float, z: float, out: np.ndarray) -> None:
    """Fill `out` with the real spherical harmonics of a unit direction above degree 0: none, 3, 8 or 15 of them."""
    if out.shape[0] > 0:
        out[0], out[1], out[2] = Y1 * y, Y1 * z, Y1 * x
    if out.shape[0] > 3:
        out[3], out[4], out[6] = Y2 * x * y, Y2 * y * z, Y2 * x * z
        out[5] = Y20 * (np.float32(3.0) * z * z - ONE)
        out[7] = HALF * Y2 * (x * x - y * y)
    if out.shape[0] > 8:
        three, five = np.float32(3.0), np.float32(5.0)
        out[8], out[14] = Y33 * y * (three * x * x - y * y), Y33 * x * (x * x - three * y * y)
        out[9], out[13] = TWO * Y32 * x * y * z, Y32 * z * (x * x - y * y)
        out[10], out[12] = Y31 * y * (five * z * z - ONE), Y31 * x * (five * z * z - ONE)
        out[11] = Y30 * z * (five * z * z - three)


@njit(inline="always")
@no_type_check
def _limited(slope: float) -> float:
    return min(max(slope, -SLANT), SLANT)


@njit(inline="always")
@no_type_check
def _flatten(
    row: np.ndarray, origin: np.ndarray, axes: np.ndarray, turn: np.ndarray, flat: np.ndarray, deep: np.ndarray
) -> tuple[float, float, float, float]:
    """Project one Gaussian: fill `turn`, its axes in the picture `flat` [3, 2] and their depths `deep` [3]. Return its
    two coordinates in the picture, its depth along the axis, and the length of its quaternion.
    """
    px, py, pz = row[0] - origin[0], row[1] - origin[1], row[2] - origin[2]
    z = px * axes[0, 2] + py * axes[1, 2] + pz * axes[2, 2]
    a = (px * axes[0, 0] + py * axes[1, 0] + pz * axes[2, 0]) / z
    b = (px * axes[0, 1] + py * axes[1, 1] + pz * axes[2, 1]) / z
    length = _rotate(row, turn)
    for j in range(3):
        scale = math.exp(row[3 + j])
        deep[j] = scale * (turn[0, j] * axes[0, 2] + turn[1, j] * axes[1, 2] + turn[2, j] * axes[2, 2])
        right = scale * (turn[0, j] * axes[0, 0] + turn[1, j] * axes[1, 0] + turn[2, j] * axes[2, 0])
        down = scale * (turn[0, j] * axes[0, 1] + turn[1, j] * axes[1, 1] + turn[2, j] * axes[2, 1])
        # Eq. 5 of Kerbl et al.: the projection to first order about the centre
        flat[j, 0], flat[j, 1] = (right - _limited(a) * deep[j]) / z, (down - _limited(b) * deep[j]) / z
    return a, b, z, length


@njit(cache=True, error_model="numpy", nogil=True)
@no_type_check
def _project(values: np.ndarray, order: np.ndarray, eye: Eye, projected: Projected) -> None:
    """Fill a row of `projected` for each Gaussian of `order`, a row of `values` (`COLUMNS`)."""
    origin, axes, widened = eye.origin, eye.axes, eye.widened
    shapes, halves, colours = projected.shapes, projected.halves, projected.colours
    kind = values.dtype
    turn, flat, deep = np.empty((3, 3), kind), np.empty((3, 2), kind), np.empty(3, kind)
    terms = (values.shape[1] - HARMONICS) // 3
    toward = np.empty(terms, kind)
    for place in range(order.shape[0]):
        row = values[order[place]]
        a, b, z, _ = _flatten(row, origin, axes, turn, flat, deep)
        wide, p, q = (widened / z) * (widened / z), _limited(a), _limited(b)
        xx, xy, yy = wide * (ONE + p * p) + eye.blurred, wide * p * q, wide * (ONE + q * q) + eye.blurred
        for j in range(3):
            xx += flat[j, 0] * flat[j, 0]
            xy += flat[j, 0] * flat[j, 1]
            yy += flat[j, 1] * flat[j, 1]
        determinant = xx * yy - xy * xy
        opacity = ONE / (ONE + math.exp(-row[OPACITY]))
        shapes[place, 0], shapes[place, 1] = a, b
        shapes[place, 2], shapes[place, 3], shapes[place, 4] = yy / determinant, -xy / determinant, xx / determinant
        shapes[place, 5] = opacity
        reach = math.sqrt(max(TWO * math.log(MOST_FAINT * opacity), 0.0))
        halves[place, 0], halves[place, 1] = reach * math.sqrt(xx), reach * math.sqrt(yy)
        px, py, pz = row[0] - origin[0], row[1] - origin[1], row[2] - origin[2]
        distance = math.sqrt(px * px + py * py + pz * pz)
        _fill_harmonics(px / distance, py / distance, pz / distance, toward)
        for c in range(3):
            colour = HALF + Y0 * row[COLOUR + c]
            for t in range(terms):
                colour += toward[t] * row[HARMONICS + c * terms + t]
            colours[place, c] = max(colour, 0.0)
        colours[place, 3] = distance


@njit(inline="always")
@no_type_check
def _rotate_back(row: np.ndarray, length: float, v_turn: np.ndarray, v_row: np.ndarray) -> None:
    w, x, y, z = row[6] / length, row[7] / length, row[8] / length, row[9] / length
    g = v_turn
    v_quat_w = TWO * (z * (g[1, 0] - g[0, 1]) + y * (g[0, 2] - g[2, 0]) + x * (g[2, 1] - g[1, 2]))
    v_quat_x = TWO * (y * (g[0, 1] + g[1, 0]) + z * (g[0, 2] + g[2, 0]) + w * (g[2, 1] - g[1, 2]))
    v_quat_x -= TWO * TWO * x * (g[1, 1] + g[2, 2])
    v_quat_y = TWO * (x * (g[0, 1] + g[1, 0]) + z * (g[1, 2] + g[2, 1]) + w * (g[0, 2] - g[2, 0]))
    v_quat_y -= TWO * TWO * y * (g[0, 0] + g[2, 2])
    v_quat_z = TWO * (x * (g[0, 2] + g[2, 0]) + y * (g[1, 2] + g[2, 1]) + w * (g[1, 0] - g[0, 1]))
    v_quat_z -= TWO * TWO * z * (g[0, 0] + g[1, 1])
    along = v_quat_w * w + v_quat_x * x + v_quat_y * y + v_quat_z * z
    v_row[6], v_row[7] = (v_quat_w - w * along) / length, (v_quat_x - x * along) / length
    v_row[8], v_row[9] = (v_quat_y - y * along) / length, (v_quat_z - z * along) / length


@njit(cache=True, error_model="numpy", nogil=True)
@no_type_check
def _project_back(
    values: np.ndarray, order: np.ndarray, eye: Eye,
    projected: Projected, v_shapes: np.ndarray, v_colours: np.ndarray, v_values: np.ndarray,
) -> None:  # fmt: skip
    """Fill the rows `order` of `v_values` with the gradient of `_project`; `v_x` is the gradient of x throughout."""
    origin, axes, widened = eye.origin, eye.axes, eye.widened
    shapes, colours = projected.shapes, projected.colours
    kind = values.dtype
    turn, flat, deep = np.empty((3, 3), kind), np.empty((3, 2), kind), np.empty(3, kind)
    v_turn, direction = np.empty((3, 3), kind), np.empty(3, kind)
    terms = (values.shape[1] - HARMONICS) // 3
    toward = np.empty(terms, kind)
    for place in range(order.shape[0]):
        row, v_row = values[order[place]], v_values[order[place]]
        a, b, z, length = _flatten(row, origin, axes, turn, flat, deep)
        wide = (widened / z) * (widened / z)
        # the conic K is the inverse of the covariance C: dC = −K dK K
        k_xx, k_xy, k_yy = shapes[place, 2], shapes[place, 3], shapes[place, 4]
        v_conic_xx, v_conic_xy, v_conic_yy = v_shapes[place, 2], HALF * v_shapes[place, 3], v_shapes[place, 4]
        v_xx = -(k_xx * k_xx * v_conic_xx + TWO * k_xx * k_xy * v_conic_xy + k_xy * k_xy * v_conic_yy)
        v_yy = -(k_xy * k_xy * v_conic_xx + TWO * k_xy * k_yy * v_conic_xy + k_yy * k_yy * v_conic_yy)
        v_xy = -TWO * (k_xx * k_xy * v_conic_xx + (k_xx * k_yy + k_xy * k_xy) * v_conic_xy + k_xy * k_yy * v_conic_yy)
        p, q = _limited(a), _limited(b)
        v_wide = v_xx * (ONE + p * p) + v_yy * (ONE + q * q) + v_xy * p * q
        v_p, v_q = wide * (TWO * v_xx * p + v_xy * q), wide * (TWO * v_yy * q + v_xy * p)
        v_z = -TWO * wide * v_wide / z
        for j in range(3):
            v_right = (TWO * v_xx * flat[j, 0] + v_xy * flat[j, 1]) / z
            v_down = (TWO * v_yy * flat[j, 1] + v_xy * flat[j, 0]) / z
            v_deep = -(p * v_right + q * v_down)
            v_p -= v_right * deep[j]
            v_q -= v_down * deep[j]
            v_z -= v_right * flat[j, 0] + v_down * flat[j, 1]
            scale = math.exp(row[3 + j])
            v_scale = np.float32(0.0)
            for i in range(3):
                along = v_right * axes[i, 0] + v_down * axes[i, 1] + v_deep * axes[i, 2]
                v_turn[i, j] = scale * along
                v_scale += scale * along * turn[i, j]
            v_row[3 + j] = v_scale
        # a slope at its limit stays there
        v_a = v_shapes[place, 0] + (v_p if p == a else NOTHING)
        v_b = v_shapes[place, 1] + (v_q if q == b else NOTHING)
        v_z -= (v_a * a + v_b * b) / z
        distance = colours[place, 3]
        for i in range(3):
            away = (row[i] - origin[i]) / distance
            seen = (v_a * axes[i, 0] + v_b * axes[i, 1]) / z + v_z * axes[i, 2]
            v_row[i] = seen + v_colours[place, 3] * away
            direction[i] = away
        _rotate_back(row, length, v_turn, v_row)
        opacity = shapes[place, 5]
        v_row[OPACITY] = v_shapes[place, 5] * opacity * (ONE - opacity)
        _fill_harmonics(direction[0], direction[1], direction[2], toward)
        for c in range(3):
            seen = v_colours[place, c] if colours[place, c] > 0.0 else np.float32(0.0)
            v_row[COLOUR + c] = Y0 * seen
            for t in range(terms):
                v_row[HARMONICS + c * terms + t] = toward[t] * seen


@njit(inline="always")
@no_type_check
def _covered(centre: float, half: float, lower: float, size: float, count: int) -> tuple[int, int]:
    """Return the first and last of `count` cells that centre ± half reaches; if it reaches none, first > last."""
    first, last = math.floor((centre - half - lower) / size), math.floor((centre + half - lower) / size)
    return max(np.int64(first), 0), min(np.int64(last), count - 1)


@njit(inline="always")
@no_type_check
def _find_rays(rays: RayCells, band: tuple[int, int], shape: np.ndarray, half: np.ndarray, found: np.ndarray) -> int:
    """Fill `found` with the rays in the cells of the rows `band` that a Gaussian's box reaches; return how many."""
    start, columns, lower, size = rays.start, rays.columns, rays.lower, rays.size
    row, end = _covered(shape[1], half[1], lower[1], size[1], band[1])
    left, right = _covered(shape[0], half[0], lower[0], size[0], columns)
    count = 0
    if left <= right:
        for r in range(max(row, band[0]), end + 1):
            for i in range(start[r * columns + left], start[r * columns + right + 1]):
                found[count] = i
                count += 1
    return count


FALL = tuple(
    np.float32(c)
    for c in Chebyshev.interpolate(lambda x: np.exp(-x), 6, domain=[0.0, 0.695]).convert(kind=Polynomial).coef
)
EIGHTH, NOTHING = np.float32(0.125), np.float32(0.0)


@no_type_check
def _falloff(power):  # numba compares its signature with those of the two below
    """Return e^−power. In float32 it is a polynomial to the eighth power, within 5e-7 up to log 255, beyond which
    nothing is drawn: the compiler does not vectorise a loop around the library's function.
    """
    raise NotImplementedError("only compiled code calls it")


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
    rays: RayCells, band: tuple[int, int], projected: Projected, out: np.ndarray, through: np.ndarray, last: np.ndarray
) -> int:
    """Draw Gaussians over the rows `band`. Add to `out` [rays, 4]; `through` [rays] is the transmittance, `last` [rays]
    the last Gaussian drawn. Return how often a Gaussian was drawn on a ray.
    """
    shapes, halves, colours = projected.shapes, projected.halves, projected.colours
    found = np.empty(through.shape[0], np.int32)
    x, y, let, weight = np.empty_like(through), np.empty_like(through), np.empty_like(through), np.empty_like(through)
    drawn = 0
    for g in range(shapes.shape[0]):
        count = _find_rays(rays, band, shapes[g], halves[g], found)
        for i in range(count):
            x[i], y[i], let[i] = rays.at[0, found[i]], rays.at[1, found[i]], through[found[i]]
        cx, cy, xx, xy, yy, opacity = shapes[g]
        faintest = math.log(np.float32(255.0) * opacity)
        for i in range(count):
            dx, dy = x[i] - cx, y[i] - cy
            power = HALF * (xx * dx * dx + yy * dy * dy) + xy * dx * dy
            alpha = min(opacity * _falloff(power), CLAMP)
            alpha = NOTHING if (power > faintest) | (let[i] < END) else alpha
            weight[i] = alpha * let[i]
            let[i] *= ONE - alpha
        for i in range(count):
            if weight[i] != NOTHING:
                ray = found[i]
                for c in range(4):
                    out[ray, c] += weight[i] * colours[g, c]
                through[ray], last[ray] = let[i], g
                drawn += 1
    return drawn


@njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract", "arcp", "reassoc"})
@no_type_check
def _backward(
    rays: RayCells, projected: Projected, v_out: np.ndarray,
    through: np.ndarray, behind: np.ndarray, last: np.ndarray, v_shapes: np.ndarray, v_colours: np.ndarray,
) -> None:  # fmt: skip
    """Undo `_forward` from back to front, and fill `v_shapes` and `v_colours` from `v_out` [rays, 4]. `behind` [rays]
    is the transmittance times its gradient; `through` and `behind` are overwritten.
    """
    shapes, halves, colours = projected.shapes, projected.halves, projected.colours
    found = np.empty(through.shape[0], np.int32)
    x, y, let, rest = np.empty_like(through), np.empty_like(through), np.empty_like(through), np.empty_like(through)
    g0, g1, g2, g3 = np.empty_like(through), np.empty_like(through), np.empty_like(through), np.empty_like(through)
    alpha, share, weight = np.empty_like(through), np.empty_like(through), np.empty_like(through)
    own, slope = np.empty_like(through), np.empty_like(through)
    for g in range(shapes.shape[0] - 1, -1, -1):
        count = _find_rays(rays, (0, rays.rows), shapes[g], halves[g], found)
        met = 0
        for i in range(count):
            ray = found[i]
            if g <= last[ray]:
                found[met] = ray
                x[met], y[met], let[met], rest[met] = rays.at[0, ray], rays.at[1, ray], through[ray], behind[ray]
                g0[met], g1[met], g2[met], g3[met] = v_out[ray, 0], v_out[ray, 1], v_out[ray, 2], v_out[ray, 3]
                met += 1
        cx, cy, xx, xy, yy, opacity = shapes[g]
        red, green, blue, depth = colours[g]
        faintest = math.log(np.float32(255.0) * opacity)
        v_cx = v_cy = v_xx = v_xy = v_yy = v_opacity = c0 = c1 = c2 = c3 = opacity * NOTHING
        for i in range(met):
            dx, dy = x[i] - cx, y[i] - cy
            power = HALF * (xx * dx * dx + yy * dy * dy) + xy * dx * dy
            fall = _falloff(power)
            fall = NOTHING if power > faintest else fall
            alpha[i] = min(opacity * fall, CLAMP)
            share[i] = fall if opacity * fall < CLAMP else NOTHING  # an opacity at its limit has no slope
        # separate short loops, as the compiler vectorises a loop that writes to few arrays
        for i in range(met):
            let[i] /= ONE - alpha[i]
            weight[i] = alpha[i] * let[i]
        for i in range(met):
            own[i] = red * g0[i] + green * g1[i] + blue * g2[i] + depth * g3[i]
            slope[i] = share[i] * (let[i] * own[i] - rest[i] / (ONE - alpha[i]))
        for i in range(met):
            rest[i] += weight[i] * own[i]
        for i in range(met):
            c0 += weight[i] * g0[i]
            c1 += weight[i] * g1[i]
            c2 += weight[i] * g2[i]
            c3 += weight[i] * g3[i]
        for i in range(met):
            dx, dy = x[i] - cx, y[i] - cy
            v_opacity += slope[i]
            v_power = -opacity * slope[i]
            v_xx += HALF * dx * dx * v_power
            v_xy += dx * dy * v_power
            v_yy += HALF * dy * dy * v_power
            v_cx -= (xx * dx + xy * dy) * v_power
            v_cy -= (yy * dy + xy * dx) * v_power
        for i in range(met):
            through[found[i]], behind[found[i]] = let[i], rest[i]
        v_shapes[g, 0], v_shapes[g, 1], v_shapes[g, 2] = v_cx, v_cy, v_xx
        v_shapes[g, 3], v_shapes[g, 4], v_shapes[g, 5] = v_xy, v_yy, v_opacity
        v_colours[g, 0], v_colours[g, 1], v_colours[g, 2], v_colours[g, 3] = c0, c1, c2, c3


@njit(cache=True, error_model="numpy", nogil=True)
@no_type_check
def add_densities(
    x: np.ndarray, middle: np.ndarray, whitened: np.ndarray, peak: np.ndarray, far: np.ndarray, total: np.ndarray
) -> None:
    """Add the densities of Gaussians with the maximum `peak` [n], up to `far` [n] from their `middle` [n, 3]."""
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
    """Colour and depth [rays, 4] without a background, transmittance [rays], and how often a Gaussian was drawn on a
    ray; differentiable once with respect to the Gaussians, with their viewing directions held constant.
    """

    @staticmethod
    def forward(ctx: Any, rays: RayCells, eye: Eye, values: Tensor) -> tuple[Tensor, Tensor, int]:
        given = values.detach().numpy()
        kind, count = given.dtype, rays.at.shape[1]
        depth = (given[:, :3] - eye.origin) @ eye.axes[:, 2]
        order = np.argsort(depth, kind="stable")
        order = order[np.searchsorted(depth[order], eye.nearest) :]
        projected = Projected(*(np.empty((len(order), size), kind) for size in (6, 2, 4)))
        _project(given, order, eye, projected)
        out, through = np.zeros((count, 4), kind), np.ones(count, kind)
        last = np.full(count, -1, np.int32)

        def draw(band: tuple[int, int]) -> int:
            return int(_forward(rays, band, projected, out, through, last))

        drawn = sum(_at_once(draw, rays.bands(torch.get_num_threads())))
        ctx.save_for_backward(values, *map(torch.from_numpy, (order, *projected, through, last)))
        ctx.rays, ctx.eye = rays, eye
        return torch.from_numpy(out[rays.back]), torch.from_numpy(through[rays.back]), drawn

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, v_out: Tensor, v_through: Tensor, _: Any) -> tuple[Tensor | None, ...]:
        values, order, *parts, through, last = (tensor.numpy() for tensor in ctx.saved_tensors)
        rays, projected = ctx.rays, Projected(*parts)
        v_shapes, v_colours = np.zeros_like(projected.shapes), np.zeros_like(projected.colours)
        behind = through * v_through.numpy()[rays.order]
        _backward(rays, projected, v_out.numpy()[rays.order], through.copy(), behind, last, v_shapes, v_colours)
        v_values = np.zeros_like(values)
        _project_back(values, order, ctx.eye, projected, v_shapes, v_colours, v_values)
        return None, None, torch.from_numpy(v_values)


def _at_once(draw: Callable[[tuple[int, int]], int], bands: list[tuple[int, int]]) -> Iterable[int]:
    if len(bands) == 1:
        return map(draw, bands)
    with ThreadPoolExecutor(len(bands)) as pool:
        return list(pool.map(draw, bands))
