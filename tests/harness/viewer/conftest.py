"""One small run that a page can show, and copies of it that may be written to."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

from harness.playback.run_loader import FinishedRun, TrainedCell
from harness.viewer.shown_run import ShownRun
from tests.harness.viewer.site import Site, served
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


@pytest.fixture(scope="module")
def site(trained: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """With a cache of its own, for the tests of one file."""
    out = Path(shutil.copytree(trained, tmp_path_factory.mktemp("site") / "run"))
    with served(ShownRun.of(out, None, None, 0, out / "none", None, CPU)) as found:
        yield found
