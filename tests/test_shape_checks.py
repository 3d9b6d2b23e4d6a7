"""The shape and type checker is active: a wrong shape or type raises an error.

Without these tests a mistyped `--jaxtyping-packages` would switch it off silently.
"""

import re
import tomllib
from collections.abc import Callable
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
INDEX = torch.zeros(5, dtype=torch.long)


def cameras() -> Cameras:
    return Cameras(torch.eye(4).expand(2, 4, 4), 8, 8, 10.0, 2.0, 6.0)


@pytest.mark.parametrize(
    "call",
    [
        lambda: fourier_features(torch.zeros(3, 3), torch.zeros(2, 2)),  # too many axes
        lambda: fourier_features(torch.zeros(3, 3, dtype=torch.long), torch.zeros(2)),  # integers
        lambda: midpoint(torch.zeros(4, 8), torch.zeros(4, 7), torch.zeros(4, 9)),  # axes that disagree
        lambda: Rays(torch.zeros(5, 3), torch.zeros(4, 3), 2.0, 6.0),
        lambda: Rays(torch.zeros(5, 3), torch.zeros(5, 3), "2", 6),  # type: ignore[arg-type]
        lambda: Box(torch.zeros(2), torch.ones(2)),
        lambda: Cameras(torch.zeros(2, 3, 4), 8, 8, 10.0, 2.0, 6.0),
        lambda: Batches(cameras(), torch.zeros(2, 8, 8, 4)),  # type: ignore[arg-type]
        lambda: cameras().rays(INDEX, INDEX, INDEX[:4]),
    ],
)
def test_wrong_shapes_and_types_are_refused(call: Callable[[], object]) -> None:
    with pytest.raises(TypeCheckError):
        call()


def test_right_shapes_and_an_int_for_a_float_are_accepted() -> None:
    """PEP 484 and mypy accept an int as a float; see `conftest.py`."""
    Batches(cameras(), ImageStack.of(np.zeros((2, 8, 8, 4), np.float32)))
    assert Rays(torch.zeros(5, 3), torch.zeros(5, 3), 2, 6).far == 6


def test_every_module_with_shapes_is_checked() -> None:
    """Only mypy checks the other modules: checking every call costs more than half of the suite's time."""
    options = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["pytest"]["ini_options"]
    checked = re.search(r"--jaxtyping-packages=(\S+)", options["addopts"])[1].split(",")[:-1]
    shaped = [
        ".".join(file.relative_to(ROOT).with_suffix("").parts)
        for package in ("baselines", "harness", "reports", "scenes")
        for file in (ROOT / package).rglob("*.py")
        if "from jaxtyping import" in file.read_text(encoding="utf-8")
    ]
    assert len(shaped) > 20
    assert [name for name in shaped if not any(f"{name}.".startswith(f"{package}.") for package in checked)] == []
