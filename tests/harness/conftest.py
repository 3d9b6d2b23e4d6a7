"""A view set that needs no renderer."""

from pathlib import Path

import pytest

from scenes.view_sets.view_set import ViewSet, read_view_set
from tests.harness.ball import write_ball


@pytest.fixture(scope="session")
def ball_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Not to be changed."""
    return write_ball(tmp_path_factory.mktemp("views") / "ball")


@pytest.fixture(scope="session")
def ball(ball_folder: Path) -> ViewSet:
    return read_view_set(ball_folder)
