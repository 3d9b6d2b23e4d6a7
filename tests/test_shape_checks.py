"""The shape and type checker is really on where there are shapes: a wrong shape or type raises.

Without these tests a mistyped `--jaxtyping-packages` would switch it off in silence.
"""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
import torch
from jaxtyping import TypeCheckError

from baselines.contract import Box, Rays
from baselines.numerics.encoding import fourier_features
from baselines.numerics.quadrature import midpoint
from harness.training.batches import Batches, Cameras
from scenes.view_sets.image_stack import ImageStack

ROOT = Path(__file__).parents[1]


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


def test_every_module_with_shapes_is_checked() -> None:
    """The others are left to mypy: a check of every call costs more than half of the suite's time."""
    options = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["pytest"]["ini_options"]
    checked = re.search(r"--jaxtyping-packages=(\S+)", options["addopts"])[1].split(",")[:-1]
    shaped = [
        ".".join(file.relative_to(ROOT).with_suffix("").parts)
        for package in ("baselines", "harness", "reports", "scenes")
        for file in (ROOT / package).rglob("*.py")
        if "from jaxtyping import" in file.read_text(encoding="utf-8")
    ]
    assert len(shaped) > 20
    assert [name for name in shaped if not any(f"{name}.".startswith(f"{one}.") for one in checked)] == []


def test_an_int_is_a_float_but_a_string_is_not() -> None:
    """As PEP 484 and mypy have it; see `conftest.py`."""
    assert Rays(torch.zeros(5, 3), torch.zeros(5, 3), 2, 6).far == 6
    with pytest.raises(TypeCheckError):
        Rays(torch.zeros(5, 3), torch.zeros(5, 3), "2", 6)  # type: ignore[arg-type]
