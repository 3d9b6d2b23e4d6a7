"""Pixels → rays, against `CONVENTIONS.md` and a loop over pixels; one camera, and what no picture can be taken with."""

import math
from dataclasses import FrozenInstanceError
from typing import Any

import numpy as np
import pytest
import torch

from harness.training.batches import Camera, Cameras
from tests.harness.ball import pose
from tests.harness.tiny import CPU

POSES = np.array([pose(0.3, 0.2), pose(2.0, 0.9), pose(-1.0, -0.4)])


def cameras(width: int, height: int, focal: float = 6.5) -> Cameras:
    return Cameras.of(POSES, width, height, focal, 2.0, 6.0)


def slow_direction(matrix: np.ndarray, column: int, row: int, width: int, height: int, focal: float) -> list[float]:
    """One pixel in double precision: right, down, forward."""
    right = (column + 0.5 - width / 2) / focal
    down = (row + 0.5 - height / 2) / focal
    d = [right * matrix[i, 0] - down * matrix[i, 1] - matrix[i, 2] for i in range(3)]
    length = math.sqrt(sum(x * x for x in d))
    return [x / length for x in d]


@pytest.mark.parametrize("size", [(5, 5), (6, 4), (1, 3)])
def test_rays_equal_a_loop_over_pixels(size: tuple[int, int]) -> None:
    width, height = size
    some = cameras(width, height)
    assert len(some) == 3
    for view, matrix in enumerate(POSES):
        rays = some.all_rays(view)
        assert len(rays) == width * height
        expected = [
            slow_direction(matrix, column, row, width, height, some.focal)
            for row in range(height)
            for column in range(width)
        ]
        np.testing.assert_allclose(rays.directions.numpy(), expected, atol=1e-6)
        np.testing.assert_allclose(rays.origins.numpy(), np.tile(matrix[:3, 3], (len(rays), 1)), rtol=1e-6)
        assert (rays.near, rays.far) == (2.0, 6.0)


def test_directions_are_unit_and_pixels_may_be_of_several_views() -> None:
    some = cameras(4, 4)
    view, column, row = torch.tensor([0, 2, 1]), torch.tensor([3, 0, 1]), torch.tensor([0, 3, 2])
    rays = some.rays(view, column, row)
    np.testing.assert_allclose(rays.directions.norm(dim=-1).numpy(), 1.0, atol=1e-6)
    for i in range(3):
        alone = some.all_rays(int(view[i])).directions[int(row[i]) * 4 + int(column[i])]
        assert torch.equal(rays.directions[i], alone)


POSE = POSES[1]


def camera(**changes: Any) -> Camera:
    given = {"camera_to_world": POSE, "width": 8, "height": 6, "focal": 9.0, "near": 2.0, "far": 6.0}
    return Camera(**{**given, **changes})


def test_its_rays_are_those_of_the_views() -> None:
    ours = camera().rays(CPU)
    theirs = Cameras.of(POSES, 8, 6, 9.0, 2.0, 6.0).all_rays(1)
    assert torch.equal(ours.origins, theirs.origins)
    assert torch.equal(ours.directions, theirs.directions)
    assert (ours.near, ours.far) == (2.0, 6.0)


def test_resized_sees_the_same_between_the_same_corners() -> None:
    lens = camera()
    half, same = lens.resized(4), lens.resized(8)
    assert (half.width, half.height, half.focal) == (4, 3, 4.5)
    assert (same.width, same.height, same.focal) == (8, 6, 9.0)
    assert half.width / half.focal == lens.width / lens.focal
    assert (lens.resized(1).width, lens.resized(1).height) == (1, 1)
    assert camera(width=100, height=1).resized(10).height == 1
    np.testing.assert_array_equal(half.camera_to_world, POSE)


def test_at_is_the_same_lens_elsewhere() -> None:
    other = camera().at(POSES[2])
    np.testing.assert_array_equal(other.camera_to_world, POSES[2])
    assert (other.width, other.height, other.focal, other.near, other.far) == (8, 6, 9.0, 2.0, 6.0)


def test_it_cannot_be_changed_from_outside() -> None:
    pose = POSE.copy()
    lens = camera(camera_to_world=pose)
    pose[0, 0] = 7.0
    np.testing.assert_array_equal(lens.camera_to_world, POSE)
    with pytest.raises(ValueError, match="read-only"):
        lens.camera_to_world[0, 0] = 7.0
    with pytest.raises(FrozenInstanceError):
        lens.width = 9  # type: ignore[misc]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"camera_to_world": np.eye(3)}, "4 × 4"),
        ({"camera_to_world": np.full((4, 4), np.nan)}, "finite"),
        ({"width": 0}, "0 × 6"),
        ({"height": -1}, "8 × -1"),
        ({"focal": 0.0}, "focal length 0.0"),
        ({"focal": math.nan}, "focal length nan"),
        ({"focal": math.inf}, "focal length inf"),
        ({"near": -1.0}, "near -1.0"),
        ({"near": 6.0}, "near 6.0"),
        ({"near": math.nan}, "near nan"),
        ({"far": math.inf}, "far inf"),
    ],
)
def test_what_no_picture_can_be_taken_with_is_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        camera(**changes)
