"""A tiny finished run, copies of it that may be written to, and what its studies are given."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from harness.execution.progress import Quiet
from harness.playback.run_loader import FinishedRun, TrainedCell
from harness.studies.serving import serving_run
from harness.studies.serving.serving_context import ServingContext
from tests.harness.trained_runs import SIZE, train_run

CPU = torch.device("cpu")


@pytest.fixture(scope="session")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """nerf and qnerf on the ball; not to be changed."""
    return train_run(tmp_path_factory.mktemp("served"), ["nerf", "qnerf"])


@pytest.fixture
def out(trained: Path, tmp_path: Path) -> Path:
    """A copy; its view set is where it was."""
    return Path(shutil.copytree(trained, tmp_path / "run"))


@pytest.fixture
def situation(trained: Path, tmp_path: Path) -> ServingContext:
    run = FinishedRun.of(trained)
    return ServingContext(
        run=run,
        scenes=run.run.scenes,
        methods=["nerf", "qnerf"],
        seed=0,
        width=SIZE,
        device=CPU,
        view_sets=tmp_path,
        scratch=tmp_path,
        quick=True,
        show=Quiet(),
    )


@pytest.fixture
def cell(situation: ServingContext) -> TrainedCell:
    """nerf."""
    found = situation.trained(situation.scenes[0], "nerf")
    assert found is not None
    return found


class Ticks:
    """A clock that goes on by so many seconds whenever it is looked at."""

    def __init__(self, step: float = 1.0) -> None:
        self.step, self.now = step, 0.0

    def __call__(self) -> float:
        self.now += self.step
        return self.now


@pytest.fixture
def ticks() -> Ticks:
    return Ticks()


def fail_with(error: BaseException) -> Callable[..., Any]:
    def study(situation: Any) -> Any:
        raise error

    return study


def with_study(monkeypatch: pytest.MonkeyPatch, field: str, study: Callable[..., Any]) -> None:
    monkeypatch.setitem(serving_run.STUDIES, field, (serving_run.STUDIES[field][0], study))
