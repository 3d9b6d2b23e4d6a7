"""The shape and type checker is really on in each package: a wrong shape or type raises.

Without these tests a mistyped `--jaxtyping-packages` would switch it off in silence.
"""

import numpy as np
import pytest
import torch
from jaxtyping import TypeCheckError

from baselines.contract import Box, Rays
from baselines.numerics.encoding import fourier_features
from baselines.numerics.quadrature import midpoint
from harness.batches import Batches
from harness.rays import Cameras
from reports.wording import number
from scenes.image_stack import ImageStack
from scenes.pixels import decode_srgb


def cameras() -> Cameras:
    return Cameras(torch.eye(4).expand(2, 4, 4), 8, 8, 10.0, 2.0, 6.0)


def test_baselines_function_refuses_a_wrong_number_of_axes() -> None:
    with pytest.raises(TypeCheckError):
        fourier_features(torch.zeros(3, 3), torch.zeros(2, 2))


def test_baselines_function_refuses_axes_that_disagree() -> None:
    with pytest.raises(TypeCheckError):
        midpoint(torch.zeros(4, 8), torch.zeros(4, 7), torch.zeros(4, 9))


def test_baselines_function_refuses_integers_for_floats() -> None:
    with pytest.raises(TypeCheckError):
        fourier_features(torch.zeros(3, 3, dtype=torch.long), torch.zeros(2))


def test_baselines_dataclass_refuses_a_wrong_shape() -> None:
    with pytest.raises(TypeCheckError):
        Rays(torch.zeros(5, 3), torch.zeros(4, 3), 2.0, 6.0)
    with pytest.raises(TypeCheckError):
        Box(torch.zeros(2), torch.ones(2))


def test_harness_dataclass_refuses_a_wrong_shape() -> None:
    with pytest.raises(TypeCheckError):
        Cameras(torch.zeros(2, 3, 4), 8, 8, 10.0, 2.0, 6.0)


def test_harness_function_refuses_a_wrong_shape() -> None:
    Batches(cameras(), ImageStack.of(np.zeros((2, 8, 8, 4), np.float32)))
    with pytest.raises(TypeCheckError):
        Batches(cameras(), torch.zeros(2, 8, 8, 4))  # type: ignore[arg-type]
    index = torch.zeros(5, dtype=torch.long)
    with pytest.raises(TypeCheckError):
        cameras().rays(index, index, index[:4])


def test_scenes_function_refuses_a_wrong_type() -> None:
    """Its arrays carry no shapes; their type is checked."""
    assert decode_srgb(np.zeros(3)).shape == (3,)
    with pytest.raises(TypeCheckError):
        decode_srgb([0.0, 0.5])  # type: ignore[arg-type]


def test_reports_function_refuses_a_wrong_type() -> None:
    assert number(1.5) == "1.50"
    with pytest.raises(TypeCheckError):
        number("1.5")  # type: ignore[arg-type]


def test_an_int_is_a_float_but_a_string_is_not() -> None:
    """As PEP 484 and mypy have it; see `conftest.py`."""
    assert Rays(torch.zeros(5, 3), torch.zeros(5, 3), 2, 6).far == 6
    with pytest.raises(TypeCheckError):
        Rays(torch.zeros(5, 3), torch.zeros(5, 3), "2", 6)  # type: ignore[arg-type]
