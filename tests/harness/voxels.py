"""Whether Dr.Jit can train here, found out without risk to the process that asks."""

import pytest
import torch

from harness.training.make_learner import NotAvailable, drjit_backend


def drjit_or_skip() -> None:
    """Skips, with the reason, where `voxels_drjit` is not available."""
    try:
        drjit_backend(torch.device("cpu"))
    except NotAvailable as missing:
        pytest.skip(str(missing))
