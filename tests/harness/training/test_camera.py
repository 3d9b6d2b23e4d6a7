"""One camera: the rays of the views, kept in shape when resized, and nothing that no picture can be taken with."""

import math
from dataclasses import FrozenInstanceError
from typing import Any

import numpy as np
import pytest
import torch

from harness.playback.camera_paths import orbit
from harness.training.batches import Camera, Cameras

CPU = torch.device("cpu")
POSE = orbit(3)[1]


def camera(**changes: Any) -> Camera:
    given = {"camera_to_world": POSE, "width": 8, "height": 6, "focal": 9.0, "near": 2.0, "far": 6.0}
    return Camera(**{**given, **changes})


def test_its_rays_are_those_of_the_views() -> None:
    ours = camera().rays(CPU)
    theirs = Cameras.of(orbit(3), 8, 6, 9.0, 2.0, 6.0).all_rays(1)
    assert torch.equal(ours.origins, theirs.origins)
    assert torch.equal(ours.directions, theirs.directions)
    assert (ours.near, ours.far) == (2.0, 6.0)


def test_resized_sees_the_same_between_the_same_corners() -> None:
    one = camera()
    half, same = one.resized(4), one.resized(8)
    assert (half.width, half.height, half.focal) == (4, 3, 4.5)
    assert (same.width, same.height, same.focal) == (8, 6, 9.0)
    assert half.width / half.focal == one.width / one.focal
    assert (one.resized(1).width, one.resized(1).height) == (1, 1)
    assert camera(width=100, height=1).resized(10).height == 1
    np.testing.assert_array_equal(half.camera_to_world, POSE)


def test_at_is_the_same_lens_elsewhere() -> None:
    other = camera().at(orbit(3)[2])
    np.testing.assert_array_equal(other.camera_to_world, orbit(3)[2])
    assert (other.width, other.height, other.focal, other.near, other.far) == (8, 6, 9.0, 2.0, 6.0)


def test_it_cannot_be_changed_from_outside() -> None:
    pose = POSE.copy()
    one = camera(camera_to_world=pose)
    pose[0, 0] = 7.0
    np.testing.assert_array_equal(one.camera_to_world, POSE)
    with pytest.raises(ValueError, match="read-only"):
        one.camera_to_world[0, 0] = 7.0
    with pytest.raises(FrozenInstanceError):
        one.width = 9  # type: ignore[misc]


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
