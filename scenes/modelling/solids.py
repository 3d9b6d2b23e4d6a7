"""Solids as triangle meshes: geometry without material, plain arrays, z up, outward-facing triangles."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.interpolate import CubicSpline

from scenes.modelling.scene import Description

Point = Sequence[float] | np.ndarray


@dataclass(frozen=True)
class Solid:
    """Triangles: `vertices` float64 [V, 3], `faces` int64 [F, 3], optional `uv` [V, 2] and `normals` [V, 3]."""

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray | None = None
    normals: np.ndarray | None = None

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> "Solid":
        return self.transformed(trimesh.transformations.translation_matrix([x, y, z]))

    def turned(self, degrees: float, axis: Sequence[float] = (0.0, 0.0, 1.0)) -> "Solid":
        return self.transformed(trimesh.transformations.rotation_matrix(np.radians(degrees), axis))

    def scaled(self, x: float, y: float | None = None, z: float | None = None) -> "Solid":
        return self.transformed(np.diag([x, x if y is None else y, x if z is None else z, 1.0]))

    def transformed(self, matrix: np.ndarray) -> "Solid":
        """Apply an affine matrix [4, 4]; a mirroring one flips the triangles so that they still face outwards."""
        vertices = self.vertices @ matrix[:3, :3].T + matrix[:3, 3]
        faces = self.faces if np.linalg.det(matrix[:3, :3]) > 0 else self.faces[:, ::-1]
        normals = self.normals
        if normals is not None:
            normals = normals @ np.linalg.inv(matrix[:3, :3])
            normals = normals / np.linalg.norm(normals, axis=1, keepdims=True).clip(1e-12)
        return Solid(vertices, faces, self.uv, normals)


def mesh(solid: Solid, bsdf: Description) -> Description:
    entry: Description = {
        "type": "mesh",
        "vertices": solid.vertices.astype(np.float32),
        "faces": solid.faces.astype(np.uint32),
        "bsdf": bsdf,
    }
    if solid.uv is not None:
        entry["uv"] = solid.uv.astype(np.float32)
    if solid.normals is not None:
        entry["normals"] = solid.normals.astype(np.float32)
    return entry


def box(x: float, y: float, z: float) -> Solid:
    """An axis-aligned box of these full extents, centred at the origin, flat-shaded."""
    shape = trimesh.creation.box(extents=(x, y, z))
    return Solid(np.asarray(shape.vertices), np.asarray(shape.faces))


def rounded_box(x: float, y: float, z: float, radius: float, segments: int = 4) -> Solid:
    """A box of these full extents whose edges and corners are rounded; smooth normals."""
    core = np.array([x, y, z]) / 2 - radius
    reach = radius * np.tan(np.linspace(0.0, np.pi / 4, segments + 1))
    offset, inward = np.concatenate([-reach[::-1], reach]), np.arange(2 * segments + 2) <= segments
    # a grid on each side of the box, dense only in the corners, pulled in to the radius about the core
    points: list[np.ndarray] = []
    faces: list[np.ndarray] = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for sign in (1.0, -1.0):
            side = np.empty((len(offset), len(offset), 3))
            side[..., axis] = sign * (core[axis] + radius)
            side[..., u] = (np.where(inward, -core[u], core[u]) + offset)[:, None]
            side[..., v] = np.where(inward, -core[v], core[v]) + offset
            faces.append(grid_faces(len(offset), len(offset))[:, :: int(sign)] + len(offset) ** 2 * len(points))
            points.append(side.reshape(-1, 3))
    surface = np.concatenate(points)
    nearest = np.clip(surface, -core, core)
    normals = (surface - nearest) / np.linalg.norm(surface - nearest, axis=1, keepdims=True)
    vertices = nearest + radius * normals
    # neighbouring sides share the points and the normals of their common edge
    _, chosen, place = np.unique(np.round(vertices, 9), axis=0, return_index=True, return_inverse=True)
    triangles = place.reshape(-1)[np.concatenate(faces)]
    # without a core along some axis, its corners meet and leave triangles that are lines
    full = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    return Solid(vertices[chosen], triangles[full], None, normals[chosen])


def cylinder(radius: float, height: float, segments: int = 32) -> Solid:
    shape = trimesh.creation.cylinder(radius=radius, height=height, sections=segments)
    return Solid(np.asarray(shape.vertices), np.asarray(shape.faces))


def ball(radius: float, segments: int = 32) -> Solid:
    shape = trimesh.creation.uv_sphere(radius=radius, count=[segments, segments])
    vertices = np.asarray(shape.vertices)
    return Solid(vertices, np.asarray(shape.faces), None, vertices / radius)


def lathe(profile: Sequence[tuple[float, float]], segments: int = 48) -> Solid:
    """Turn a profile of (radius, z) points, bottom to top outside, about z; `uv`: around, by arc length along it."""
    points = np.asarray(profile, dtype=np.float64)
    angle = np.linspace(0.0, 2.0 * np.pi, segments + 1)
    radius, z = points[:, 0], points[:, 1]
    vertices = np.stack(
        [np.outer(np.cos(angle), radius), np.outer(np.sin(angle), radius), np.tile(z, (segments + 1, 1))], axis=-1
    )
    length = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(radius), np.diff(z)))])
    uv = np.stack(np.broadcast_arrays((angle / (2 * np.pi))[:, None], length / length[-1]), axis=-1)
    return Solid(vertices.reshape(-1, 3), grid_faces(segments + 1, len(points)), uv.reshape(-1, 2))


def tube(path: np.ndarray, radius: float | np.ndarray, sides: int = 8, closed: bool = False) -> Solid:
    """A round tube along a polyline [N, 3]; `radius` may vary by point; open ends are capped.

    The frame is carried along by the smallest rotation, so a bend does not twist the tube.
    """
    path = np.asarray(path, dtype=np.float64)
    count = len(path)
    following = np.roll(path, -1, axis=0) if closed else np.vstack([path[1:], 2 * path[-1] - path[-2]])
    before = np.roll(path, 1, axis=0) if closed else np.vstack([2 * path[0] - path[1], path[:-1]])
    tangent = following - before
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    helper = np.eye(3)[np.argmin(np.abs(tangent[0]))]
    normal = np.cross(tangent[0], helper)
    normals = []
    for direction in tangent:
        normal = normal - direction * (normal @ direction)
        normal /= np.linalg.norm(normal)
        normals.append(normal)
    side = np.stack(normals)
    binormal = np.cross(tangent, side)
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    outward = np.cos(angle)[None, :, None] * side[:, None] + np.sin(angle)[None, :, None] * binormal[:, None]
    rings = path[:, None] + np.broadcast_to(radius, count)[:, None, None] * outward
    ring = np.arange(sides)
    rows = np.arange(count if closed else count - 1)
    a = rows[:, None] * sides + ring
    b = rows[:, None] * sides + (ring + 1) % sides
    c = (rows[:, None] + 1) % count * sides + (ring + 1) % sides
    d = (rows[:, None] + 1) % count * sides + ring
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    vertices = rings.reshape(-1, 3)
    if not closed:
        caps = np.stack([path[0], path[-1]])
        first, last = len(vertices), len(vertices) + 1
        top = (count - 1) * sides
        faces = np.concatenate(
            [
                faces,
                np.stack([np.full(sides, first), (ring + 1) % sides, ring], -1),
                np.stack([np.full(sides, last), top + ring, top + (ring + 1) % sides], -1),
            ]
        )
        vertices = np.vstack([vertices, caps])
    return Solid(vertices, faces)


def grid_faces(rows: int, columns: int) -> np.ndarray:
    """Return triangles [2 (rows−1) (columns−1), 3] of a row-major grid of vertices."""
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).reshape(-1)
    b, c, d = a + columns, a + columns + 1, a + 1
    return np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])


def loft(rings: np.ndarray) -> Solid:
    """A closed surface through rings [N, M, 3] of points that run counter-clockwise seen from the last ring.

    The ends are closed by fans about their centres; `uv`: u around the ring, v from the first ring to the last.
    """
    count, around = rings.shape[:2]
    first, last = (np.repeat(ring.mean(0)[None], around, 0) for ring in (rings[0], rings[-1]))
    rows = np.concatenate([first[None], rings, last[None]])
    points = np.concatenate([rows, rows[:, :1]], axis=1)
    v = np.clip(np.arange(-1, count + 1) / (count - 1), 0.0, 1.0)
    uv = np.stack(np.broadcast_arrays(np.linspace(0.0, 1.0, around + 1), v[:, None]), axis=-1)
    # a grid runs along its rows first; here the second index runs around, hence the flip
    faces = grid_faces(count + 2, around + 1)[:, ::-1]
    return Solid(points.reshape(-1, 3), faces, uv.reshape(-1, 2))


def smooth(solid: Solid) -> Solid:
    """Return the solid with area-weighted vertex normals; vertices at one place (a seam of `uv`) share a normal."""
    corner = solid.vertices[solid.faces]
    area_normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    _, place = np.unique(np.round(solid.vertices, 7), axis=0, return_inverse=True)
    place = place.reshape(-1)
    total = np.zeros((place.max() + 1, 3))
    for column in solid.faces.T:
        np.add.at(total, place[column], area_normal)
    normals = total / np.linalg.norm(total, axis=1, keepdims=True).clip(1e-12)
    return Solid(solid.vertices, solid.faces, solid.uv, normals[place])


def sheet(points: np.ndarray, uv: np.ndarray | None = None) -> Solid:
    """A smooth surface through a grid of points [rows, columns, 3], with `uv` [rows, columns, 2]."""
    faces = grid_faces(*points.shape[:2])
    return smooth(Solid(points.reshape(-1, 3), faces, None if uv is None else uv.reshape(-1, 2)))


def between(start: Point, end: Point, shares: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return points [N, 3] on the straight line, at these shares [N] of the way."""
    first = np.asarray(start)
    return np.asarray(first + np.asarray(shares)[:, None] * (np.asarray(end) - first))


def creased(solid: Solid, degrees: float = 50.0) -> Solid:
    """Return the solid with vertex normals shared only by triangles that meet at less than this angle.

    So a lathed or tubular body looks round and keeps its rims sharp. Triangles without area are dropped.
    """
    corner = solid.vertices[solid.faces]
    area_normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = np.linalg.norm(area_normal, axis=1)
    kept = area > 1e-12
    faces, area_normal, unit = solid.faces[kept], area_normal[kept], area_normal[kept] / area[kept, None]
    _, place = np.unique(np.round(solid.vertices, 7), axis=0, return_inverse=True)
    at = place.reshape(-1)[faces].reshape(-1)
    order = np.argsort(at, kind="stable")
    _, start, size = np.unique(at[order], return_index=True, return_counts=True)
    # every corner meets every corner at the same place
    pairs = np.repeat(size, size)
    near = np.repeat(np.arange(len(order)), pairs)
    within = np.arange(len(near)) - np.repeat(np.cumsum(pairs) - pairs, pairs)
    other = within + np.repeat(np.repeat(start, size), pairs)
    near, other = order[near], order[other]
    close = (unit[near // 3] * unit[other // 3]).sum(-1) > np.cos(np.radians(degrees))
    near, other = near[close], other[close] // 3
    total = np.stack([np.bincount(near, area_normal[other, axis], len(order)) for axis in range(3)], axis=-1)
    normals = total / np.linalg.norm(total, axis=1, keepdims=True)
    grid = np.round((normals + 1.0) * 500.0).astype(np.int64)
    key = ((faces.reshape(-1) * 1001 + grid[:, 0]) * 1001 + grid[:, 1]) * 1001 + grid[:, 2]
    _, chosen, renamed = np.unique(key, return_index=True, return_inverse=True)
    source = faces.reshape(-1)[chosen]
    uv = None if solid.uv is None else solid.uv[source]
    return Solid(solid.vertices[source], renamed.reshape(-1, 3), uv, normals[chosen])


def spline(points: Sequence[Point] | np.ndarray, count: int, closed: bool = False) -> np.ndarray:
    """A smooth curve [count, D] through the points, evenly spread over its chord length."""
    through = np.asarray(points, dtype=np.float64)
    if closed:
        through = np.vstack([through, through[:1]])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(through, axis=0), axis=1))])
    curve = CubicSpline(length, through, bc_type="periodic" if closed else "natural")
    return np.asarray(curve(np.linspace(0.0, length[-1], count, endpoint=not closed)))


def rod(start: Point, end: Point, radius: float, sides: int = 16) -> Solid:
    return tube(np.array([start, end], dtype=np.float64), radius, sides)
