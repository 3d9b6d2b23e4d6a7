"""Scale: boxes by hand, similarities that undo themselves, and the bias that is the reason for all of it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenes.catalog.stress import fog
from scenes.catalog.stress.scales import TINY, described, unit
from scenes.files.errors import InputError
from scenes.modelling.normalise import Similarity, box_of, check_scale, check_unit, normalised, to_unit
from scenes.modelling.scene import Description, Scene
from tests.scenes.loading import load

TURN = np.array([[0.0, -2.0, 0.0, 5.0], [2.0, 0.0, 0.0, 0.0], [0.0, 0.0, 2.0, -1.0], [0.0, 0.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    ("entry", "low", "high"),
    [
        ({"type": "sphere", "center": [1, 2, 3], "radius": 0.5}, [0.5, 1.5, 2.5], [1.5, 2.5, 3.5]),
        ({"type": "sphere", "radius": 0.5, "center": [1, 0, 0], "to_world": TURN}, [4, 1, -2], [6, 3, 0]),
        ({"type": "sphere", "to_world": np.diag([1.0, 2.0, 3.0, 1.0])}, [-1, -2, -3], [1, 2, 3]),
        ({"type": "cube", "to_world": TURN}, [3, -2, -3], [7, 2, 1]),
        ({"type": "rectangle"}, [-1, -1, 0], [1, 1, 0]),
        ({"type": "cylinder", "p0": [0, 0, 0], "p1": [0, 0, 2], "radius": 0.5}, [-0.5, -0.5, 0], [0.5, 0.5, 2]),
        (
            {"type": "cylinder", "p0": [0, 0, 0], "p1": [1, 1, 0], "radius": math.sqrt(2)},
            [-1, -1, -math.sqrt(2)],
            [2, 2, math.sqrt(2)],
        ),
        ({"type": "mesh", "vertices": np.array([[0, 1, 2], [-3, 4, 5]], np.float32)}, [-3, 1, 2], [0, 4, 5]),
    ],
)
def test_boxes_are_those_worked_out_by_hand(entry: Description, low: list[float], high: list[float]) -> None:
    box = box_of({"sky": {"type": "constant"}, "shape": entry})
    assert box == pytest.approx(np.array([low, high], dtype=float), abs=1e-12)


def test_boxes_are_mitsubas() -> None:
    description = described(Similarity(0.7, (0.1, -0.2, 0.3)))
    assert box_of(description) == pytest.approx(load(description, 4).box(), abs=1e-5)


@given(st.floats(1e-4, 1e4), st.tuples(*[st.floats(-1e5, 1e5)] * 3))
@settings(max_examples=50)
def test_a_similarity_undoes_itself(scale: float, shift: tuple[float, float, float]) -> None:
    change = Similarity(scale, shift)
    assert change.inverse.matrix @ change.matrix == pytest.approx(np.eye(4), abs=1e-6)
    ball: Description = {"ball": {"type": "sphere", "radius": 0.5, "center": [0.1, 0.2, 0.3]}}
    moved = box_of(change.applied(ball))
    assert moved is not None
    back = to_unit(moved)
    assert back.matrix @ change.matrix == pytest.approx(to_unit(box_of(ball)).matrix, abs=1e-4)  # type: ignore[arg-type]


def test_optical_depth_does_not_depend_on_the_unit() -> None:
    scene = fog.SCENES[0]
    grown = Similarity(100.0, (0.0, 0.0, 0.0)).applied(scene.build())["fog"]
    radius = 100.0 * fog.RADIUS
    assert grown["interior"]["scale"] * grown["interior"]["sigma_t"] * 2 * radius == pytest.approx(fog.DENSE)
    assert "scale" not in scene.build()["fog"]["interior"]


def test_only_what_is_far_from_unit_scale_is_changed() -> None:
    usual = Scene("unit", "t" * 20, unit)
    assert normalised(usual)[1] is None
    for change in (TINY, Similarity(1e4, (1e5, 0.0, 0.0)), Similarity(1.0, (50.0, 0.0, 0.0))):
        result = normalised(Scene("other", "t" * 20, lambda change=change: described(change)))[1]  # type: ignore[misc]
        assert result is not None
        assert result.scale * change.scale == pytest.approx(1.0, rel=1e-3)
    void = {"sky": {"type": "constant"}}
    assert normalised(Scene("void", "t" * 20, lambda: void)) == (void, None)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"type": "obj", "filename": "x"}, "'obj' is not known"),
        ({"type": "point", "position": [0, 0, 1]}, "'point' is not known"),
        ({"type": "sphere", "radius": math.nan}, "finite"),
    ],
)
def test_what_cannot_be_measured_is_refused(entry: Description, message: str) -> None:
    with pytest.raises(InputError, match=message):
        box_of({"thing": entry})
    with pytest.raises(InputError, match="one point"):
        to_unit(np.zeros((2, 3)))


def test_rendering_as_it_is_is_refused() -> None:
    for change in (TINY, Similarity(1.0, (1e3, 0.0, 0.0)), Similarity(1e4, (0.0, 0.0, 0.0))):
        with pytest.raises(InputError, match=r"units long.*normalise"):
            load(described(change), 4)
    check_scale(np.array([[-1.0] * 3, [1.0] * 3]))


@pytest.mark.parametrize("unit", [0.02, 1.0, 280.0, 9e3])
def test_a_file_may_have_any_unit_in_which_the_ray_epsilon_is_small(unit: float) -> None:
    box = unit * np.array([[-1.0] * 3, [1.0] * 3])
    check_unit(box)
    check_unit(box + 2.0 * unit)
    with pytest.raises(InputError, match=r"units long.*<translate> and <scale>"):
        check_unit(box + 100.0 * (1.0 + unit))
    with pytest.raises(InputError, match="units long"):
        check_unit(box * 1e-3 if unit <= 1.0 else box * 1e5)
