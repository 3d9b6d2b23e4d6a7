"""The true occupancy: which points of a grid over a scene's box lie inside its solids.

It comes from the scene's description, which no trained method may see. A part of a mesh, joined by its vertices, is
solid if every edge has a triangle on either side. A part with a rim, such as a leaf or a cloth, is thin: it has no
inside. The same holds for disks, rectangles, open tubes, and lamps that no camera sees. Fog counts as solid.
"""

import base64
import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from scenes.files.atomic import write_atomically
from scenes.files.digest import json_digest
from scenes.files.errors import InputError
from scenes.modelling.needs import glows
from scenes.modelling.normalise import INFINITE
from scenes.modelling.scene import Description
from scenes.rendering.order import Order
from scenes.view_sets.formats.transforms import read_json
from scenes.view_sets.manifest import DamagedViewSet, read_manifest
from scenes.view_sets.view_set import ViewSet

CELLS = 32
"""The number of points along each side of the box, at the centres of equal cells."""
THIN = frozenset({"rectangle", "disk", "cylinder"})
OFF_THE_GRID = (1.3e-7, 2.9e-7)
"""The share of the box by which columns are moved in x and y, so that none runs along an edge."""
FINEST = 1e-6
"""The share of the mesh's size below which vertices are the same: a seam of a texture is not a rim."""


def axes_of(bounds: np.ndarray, cells: int = CELLS) -> list[np.ndarray]:
    """Return the coordinates [cells] of the points along x, y and z of the box [2, 3]."""
    shares = (np.arange(cells) + 0.5) / cells
    return [low + shares * (high - low) for low, high in np.asarray(bounds, dtype=np.float64).T]


def inside(description: Description, bounds: np.ndarray, emitters_seen: bool) -> np.ndarray | None:
    """Return the occupancy, bool [32, 32, 32] over x, y, z of the box; None if a shape's inside is unknown."""
    axes = axes_of(bounds)
    occupied = np.zeros((CELLS,) * 3, dtype=bool)
    for entry in description.values():
        if not isinstance(entry, dict) or (kind := entry.get("type")) in INFINITE:
            continue
        if glows(entry) and not emitters_seen:
            continue
        if kind == "mesh":
            occupied |= inside_mesh(np.asarray(entry["vertices"]), np.asarray(entry["faces"]), axes)
        elif kind in ("sphere", "cube"):
            occupied |= _inside_unit(entry, axes)
        elif kind not in THIN:
            return None
    return occupied


def _inside_unit(entry: dict[str, Any], axes: Sequence[np.ndarray]) -> np.ndarray:
    """Return whether points in the shape's own frame lie inside a ball or a cube ±1."""
    back = np.linalg.inv(np.asarray(entry.get("to_world", np.eye(4)), dtype=np.float64))
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1) @ back[:3, :3].T + back[:3, 3]
    if entry["type"] == "cube":
        return np.asarray((np.abs(points) < 1).all(axis=-1))
    points -= np.asarray(entry.get("center", (0.0, 0.0, 0.0)), dtype=np.float64)
    return np.asarray(np.linalg.norm(points, axis=-1) < entry.get("radius", 1.0))


def inside_mesh(vertices: np.ndarray, faces: np.ndarray, axes: Sequence[np.ndarray]) -> np.ndarray:
    """Return which points of the grid, bool [x, y, z], the mesh's solid parts enclose, in either orientation."""
    corners = solid_triangles(np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64))
    x, y, z = axes
    turns = np.zeros((len(x), len(y), len(z) + 1), dtype=np.int64)
    triangle, column, row = _columns_met(corners, x, y)
    a, b, c = np.moveaxis(corners[triangle], 1, 0)
    at = np.stack([x[column] + _off(x, 0), y[row] + _off(y, 1)], axis=-1)
    to_a, to_b, to_c = a[:, :2] - at, b[:, :2] - at, c[:, :2] - at
    u, v, w = _cross(to_b, to_c), _cross(to_c, to_a), _cross(to_a, to_b)
    met = (np.minimum(np.minimum(u, v), w) > 0) | (np.maximum(np.maximum(u, v), w) < 0)
    area = u + v + w
    height = (u * a[:, 2] + v * b[:, 2] + w * c[:, 2])[met] / area[met]
    # a triangle turns the points below it once around: counted where it is, summed from above
    below = np.searchsorted(z, height)
    np.add.at(turns, (column[met], row[met], below), np.sign(area[met]).astype(np.int64))
    return np.asarray(np.cumsum(turns[..., ::-1], axis=-1)[..., ::-1][..., 1:] != 0)


def _off(axis: np.ndarray, which: int) -> float:
    return OFF_THE_GRID[which] * float(axis[-1] - axis[0] + 1e-30)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _columns_met(corners: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return triangles and the columns (indices of x and y) within their boxes, every pair once."""
    spans = []
    for which, axis in enumerate((x, y)):
        values = corners[..., which] - _off(axis, which)
        first = np.searchsorted(axis, values.min(axis=1))
        spans.append((first, np.searchsorted(axis, values.max(axis=1)) - first))
    (x_first, x_many), (y_first, y_many) = spans
    many = x_many * y_many
    triangle = np.repeat(np.arange(len(corners)), many)
    place = np.arange(many.sum()) - np.repeat(np.cumsum(many) - many, many)
    return triangle, x_first[triangle] + place // y_many[triangle], y_first[triangle] + place % y_many[triangle]


def solid_triangles(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the corners [triangles, 3, 3] of the parts without a rim."""
    joined = _joined(vertices)[faces]
    has_area = (joined[:, 0] != joined[:, 1]) & (joined[:, 1] != joined[:, 2]) & (joined[:, 2] != joined[:, 0])
    faces, joined = faces[has_area], joined[has_area]
    if not len(faces):
        return np.zeros((0, 3, 3))
    count = int(joined.max()) + 1
    start, end = joined.ravel(), np.roll(joined, -1, axis=1).ravel()
    graph = coo_matrix((np.ones(len(start), dtype=np.int8), (start, end)), shape=(count, count))
    _, part = connected_components(graph, directed=False)
    # an edge that is walked equally often in both directions is not a rim
    lower, upper = np.minimum(start, end), np.maximum(start, end)
    _, edge = np.unique(lower * count + upper, return_inverse=True)
    balance = np.bincount(edge, weights=np.where(start < end, 1.0, -1.0))
    rims = part[start[balance[edge] != 0]]
    solid = ~np.isin(part[joined[:, 0]], rims)
    return np.asarray(vertices[faces[solid]])


def _joined(vertices: np.ndarray) -> np.ndarray:
    """Return the number [vertices] of each vertex's place: equal places have equal numbers."""
    size = float(np.ptp(vertices, axis=0).max()) if len(vertices) else 0.0
    place = np.round((vertices - vertices.min(axis=0)) / max(size * FINEST, 1e-30)).astype(np.int64)
    key = (place[:, 0] << 42) + (place[:, 1] << 21) + place[:, 2]
    return np.asarray(np.unique(key, return_inverse=True)[1])


NAME = "occupancy.json"
SCHEMA = 1


def with_occupancy(folder: Path, order: Order) -> Path:
    """Return the folder of a complete view set, with the file in it if every shape's inside is known."""
    manifest = read_manifest(folder)
    with suppress(DamagedViewSet):
        if _read(folder, manifest) is not None:
            return folder
    scene = order.scene
    occupied = None if scene.load else inside(order.description, np.array(manifest["bounds"]), scene.emitters_seen)
    if occupied is not None:
        content, bits = _bound_to(manifest), np.packbits(occupied).tobytes()
        content |= {"inside": base64.b64encode(bits).decode("ascii"), "checksum": json_digest(content, bits)}
        with suppress(OSError):  # a read-only cache: the occupancy stays unknown, and the report says so
            write_atomically(folder / NAME, json.dumps(content), fsync=False)
    return folder


def read_occupancy(views: ViewSet) -> np.ndarray | None:
    """Read bool [32, 32, 32] over x, y, z of the view set's box; None if it is unknown, or `views` has another box.
    Raises `DamagedViewSet` for a file that is damaged or belongs to another view set.
    """
    if "bounds" not in views.rendered or not np.array_equal(views.bounds, views.rendered["bounds"]):
        return None
    return _read(views.path, views.rendered)


def _bound_to(manifest: dict[str, object]) -> dict[str, object]:
    return {"schema": SCHEMA, "digest": manifest.get("digest"), "bounds": manifest["bounds"], "cells": CELLS}


def _read(folder: Path, manifest: dict[str, object]) -> np.ndarray | None:
    file = folder / NAME
    if not file.is_file():
        return None
    try:
        content = read_json(file)
        claimed = content.pop("checksum")
        bits = base64.b64decode(content.pop("inside"), validate=True)
        if content != _bound_to(manifest) or claimed != json_digest(content, bits) or len(bits) != CELLS**3 // 8:
            raise ValueError("it is damaged, or belongs to another view set")
    except (InputError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise DamagedViewSet(f"{file}: {error}; delete it, the next run makes it again") from error
    cells = np.unpackbits(np.frombuffer(bits, dtype=np.uint8)).astype(bool)
    return cells.reshape(CELLS, CELLS, CELLS)
