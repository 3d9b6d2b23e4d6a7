"""A tiny finished run, copies of it that may be written to, and the context of its studies."""

import shutil
from dataclasses import replace
from itertools import count
from pathlib import Path

import pytest

from harness.execution.progress import Progress
from harness.plan.run_plan import Machine
from harness.playback.run_loader import FinishedRun, TrainedCell
from harness.studies.serving.serving_context import Clock, ServingContext
from tests.harness.trained_runs import SIZE, train_run


@pytest.fixture(scope="session")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """nerf and qnerf on the ball; not to be changed."""
    return train_run(tmp_path_factory.mktemp("served"), ["nerf", "qnerf"])


@pytest.fixture
def out(trained: Path, tmp_path: Path) -> Path:
    """A copy; its view set is where it was."""
    return Path(shutil.copytree(trained, tmp_path / "run"))


@pytest.fixture
def context(trained: Path, tmp_path: Path) -> ServingContext:
    return replace(context_of(trained, tmp_path), scratch=tmp_path)


def context_of(out: Path, view_sets: Path) -> ServingContext:
    finished, machine = FinishedRun.of(out), Machine("cpu", 1, 1)
    scenes = finished.scenes(["ball"])
    return ServingContext(out, view_sets, out, True, Progress(), machine, finished, scenes, ["nerf", "qnerf"], 0, SIZE)


@pytest.fixture
def cell(context: ServingContext) -> TrainedCell:
    """nerf."""
    nerf = context.trained(context.scenes[0], "nerf")
    assert nerf is not None
    return nerf


@pytest.fixture
def ticks() -> Clock:
    """A clock that advances by a second whenever it is read."""
    return map(float, count()).__next__
