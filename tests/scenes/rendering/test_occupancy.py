"""Which points lie inside: closed forms, thin shapes, nested solids, and the file in a view set."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenes.modelling.parts import merged
from scenes.modelling.scene import Scene
from scenes.modelling.solids import Solid, ball, box, cylinder, mesh
from scenes.rendering.occupancy import CELLS, NAME, axes_of, inside, inside_mesh, read_occupancy, with_occupancy
from scenes.rendering.order import Order
from scenes.view_sets.manifest import DamagedViewSet, write_manifest
from scenes.view_sets.view_set import read_view_set
from tests.harness.ball import write_ball

BOX = np.array([[-1.1, -1.0, -0.9], [1.0, 1.2, 1.3]])
GREY = {"type": "diffuse"}


def points(bounds: np.ndarray = BOX) -> np.ndarray:
    return np.stack(np.meshgrid(*axes_of(bounds), indexing="ij"), axis=-1)


def within(solid: Solid) -> np.ndarray:
    return inside_mesh(solid.vertices, solid.faces, axes_of(BOX))


def test_points_are_the_middles_of_equal_cells() -> None:
    x, _, z = axes_of(BOX, 4)
    assert x.tolist() == pytest.approx([-1.1 + 2.1 / 8, -1.1 + 3 * 2.1 / 8, -1.1 + 5 * 2.1 / 8, -1.1 + 7 * 2.1 / 8])
    assert z[0] == pytest.approx(-0.9 + 2.2 / 8)


def test_a_box_holds_the_points_between_its_sides() -> None:
    result = within(box(1.0, 0.6, 0.8).moved(0.1, 0.2, 0.3))
    expected = (np.abs(points() - (0.1, 0.2, 0.3)) < (0.5, 0.3, 0.4)).all(axis=-1)
    assert np.array_equal(result, expected)
    assert 0 < expected.sum() < expected.size


def test_a_box_on_the_grid_itself_is_not_torn() -> None:
    """Its edges and diagonals run along columns of points."""
    cube = inside_mesh(box(1.0, 1.0, 1.0).vertices, box(1.0, 1.0, 1.0).faces, [np.linspace(-1, 1, 9) + 0.0625] * 3)
    assert cube.sum() == 4**3
    x = np.linspace(-1, 1, 9)
    on = inside_mesh(box(1.0, 1.0, 1.0).vertices, box(1.0, 1.0, 1.0).faces, [x, x, x + 0.01])
    assert set(on.sum(axis=2).ravel().tolist()) == {0, 4}


def test_a_turned_ball_of_triangles_is_nearly_a_sphere() -> None:
    result = within(ball(0.7, 48).turned(33.0, (1.0, 2.0, 0.5)).moved(0.0, 0.1, 0.1))
    radius = np.linalg.norm(points() - (0.0, 0.1, 0.1), axis=-1)
    assert result[radius < 0.69].all()
    assert not result[radius > 0.7].any()


def test_which_way_a_solid_faces_does_not_matter_and_a_cavity_is_hollow() -> None:
    outer, inner = ball(0.8), ball(0.5)
    turned = Solid(outer.vertices, outer.faces[:, ::-1])
    assert np.array_equal(within(turned), within(outer))
    shell = merged([outer, Solid(inner.vertices, inner.faces[:, ::-1])])
    assert np.array_equal(within(shell), within(outer) & ~within(inner))
    assert np.array_equal(within(merged([outer, inner])), within(outer))


def test_what_has_a_rim_has_no_inside_and_leaves_its_neighbour_alone() -> None:
    complete = cylinder(0.4, 1.0)
    open_ = Solid(complete.vertices, complete.faces[1:])
    assert within(complete).any()
    assert not within(open_).any()
    apart = ball(0.3).moved(0.6, 0.0, 0.6)
    assert np.array_equal(within(merged([open_, apart])), within(apart))


def test_a_seam_is_no_rim() -> None:
    """Every triangle has separate vertices, as in a flat-shaded or textured mesh."""
    solid = ball(0.6)
    torn = Solid(solid.vertices[solid.faces].reshape(-1, 3), np.arange(3 * len(solid.faces)).reshape(-1, 3))
    assert within(solid).any()
    assert np.array_equal(within(torn), within(solid))


def test_shapes_of_a_description() -> None:
    shift = np.array([[0.5, 0, 0, 0.2], [0, 0.5, 0, 0], [0, 0, 0.5, 0.1], [0, 0, 0, 1]])
    sphere = {"type": "sphere", "to_world": shift, "center": [0.2, 0.0, 0.0], "radius": 1.2, "bsdf": GREY}
    light = {"light": {"type": "constant"}, "floor": {"type": "rectangle", "bsdf": GREY}}
    result = inside({"type": "scene", "ball": sphere, **light}, BOX, False)
    expected = np.linalg.norm(points() - (0.3, 0.0, 0.1), axis=-1) < 0.6
    assert result is not None
    assert np.array_equal(result, expected)
    cube = inside({"cube": {"type": "cube", "to_world": shift}}, BOX, False)
    assert np.array_equal(cube, (np.abs(points() - (0.2, 0.0, 0.1)) < 0.5).all(axis=-1))
    lamp = {**mesh(ball(0.5), GREY), "emitter": {"type": "area"}}
    assert not np.any(inside({"lamp": lamp}, BOX, emitters_seen=False))
    assert np.any(inside({"lamp": lamp}, BOX, emitters_seen=True))
    assert inside({"unknown": {"type": "bsplinecurve"}}, BOX, False) is None


def order_of(description: dict[str, Any]) -> Order:
    scene = Scene("tiny", "tiny", lambda: description)
    return Order(scene, description, None, 8, {"train": 1, "val": 0, "test": 1}, {"train": 2, "val": 2, "test": 2})


def manifest_of(folder: Path) -> dict[str, Any]:
    facts = {"scene": "tiny", "title": "", "near": 2.0, "far": 6.0, "digest": "ab12", "bounds": BOX.tolist()}
    facts |= {"empty_splits": [], "needs": [], "left_out": [], "views": {}}
    write_manifest(folder, facts, [])
    return json.loads((folder / "view_set.json").read_text(encoding="utf-8"))


def test_the_file_comes_back_and_is_bound_to_its_view_set(tmp_path: Path) -> None:
    write_ball(tmp_path, size=8, train=1, test=1)
    views = read_view_set(tmp_path)
    assert read_occupancy(views) is None, "unknown for a view set of another program"
    order = order_of({"ball": mesh(ball(0.6), GREY)})
    views = replace(views, rendered=manifest_of(tmp_path), bounds=BOX)
    assert read_occupancy(views) is None, "rendered before there was such a file"
    with_occupancy(tmp_path, order)
    result = read_occupancy(views)
    assert result is not None
    assert result.shape == (CELLS,) * 3
    assert np.array_equal(result, inside(order.description, BOX, False))
    before = (tmp_path / NAME).read_bytes()
    with_occupancy(tmp_path, order)
    assert (tmp_path / NAME).read_bytes() == before
    assert read_occupancy(replace(views, bounds=2 * BOX)) is None, "for another box"
    with pytest.raises(DamagedViewSet, match="delete it"):
        read_occupancy(replace(views, rendered={**views.rendered, "digest": "cd34"}))


def test_a_damaged_file_is_refused_and_made_again(tmp_path: Path) -> None:
    write_ball(tmp_path, size=8, train=1, test=1)
    views = replace(read_view_set(tmp_path), rendered=manifest_of(tmp_path), bounds=BOX)
    order = order_of({"ball": mesh(ball(0.6), GREY)})
    with_occupancy(tmp_path, order)
    complete = (tmp_path / NAME).read_text()
    place = complete.index("inside") + 12
    other = "B" if complete[place] == "A" else "A"
    flipped = complete[:place] + other + complete[place + 1 :]
    for damaged in ("", "{", "[]", "null", '{"inside": 3, "checksum": 4}', flipped):
        (tmp_path / NAME).write_text(damaged)
        with pytest.raises(DamagedViewSet, match=NAME):
            read_occupancy(views)
        with_occupancy(tmp_path, order)
        assert (tmp_path / NAME).read_text() == complete


def test_an_unknown_shape_leaves_no_file(tmp_path: Path) -> None:
    manifest_of(tmp_path)
    with_occupancy(tmp_path, order_of({"curve": {"type": "bsplinecurve"}}))
    assert not (tmp_path / NAME).exists()
