"""The method `voxels_drjit` in training, where Dr.Jit is available."""

from dataclasses import replace
from typing import Any

import pytest
import torch

from baselines.methods.explicit import VoxelSettings
from harness.training.learner import Job
from harness.training.make_learner import NotAvailable, drjit_backend, learner_for
from tests.harness.tiny import BUDGET, CPU, TRAIN, box

SETTINGS = replace(TRAIN, own={"voxels_drjit": VoxelSettings(finest=16, bins=24, smoothed=256)})


def drjit_or_skip() -> None:
    """Skip the test, with the reason, if `voxels_drjit` is not available."""
    try:
        drjit_backend(torch.device("cpu"))
    except NotAvailable as missing:
        pytest.skip(str(missing))


def voxels() -> Any:
    """Return the method in training; skips the test if it is not available."""
    drjit_or_skip()
    return learner_for(Job("voxels_drjit", box(), SETTINGS, BUDGET, 0, CPU))
