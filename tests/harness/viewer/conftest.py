"""One small run that a page can show, and copies of it that may be written to."""

import shutil
from pathlib import Path

import pytest
import torch

from harness.finished import FinishedRun, TrainedCell
from harness.viewer.shown_run import ShownRun
from tests.harness.viewer.small_run import train

CPU = torch.device("cpu")


@pytest.fixture(scope="session")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Not to be changed."""
    return train(tmp_path_factory.mktemp("viewer"))


@pytest.fixture
def out(trained: Path, tmp_path: Path) -> Path:
    """A copy."""
    return Path(shutil.copytree(trained, tmp_path / "run"))


@pytest.fixture(scope="session")
def cells(trained: Path) -> list[TrainedCell]:
    """nerf and qnerf."""
    run = FinishedRun.of(trained)
    return [run.trained(run.run.scenes[0], method, 0, CPU) for method in ("nerf", "qnerf")]


@pytest.fixture
def shown(out: Path) -> ShownRun:
    return ShownRun.of(out, None, None, 0, out / "none", None, CPU)
