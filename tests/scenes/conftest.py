"""View sets: a tiny scene, rendered once per session with `scalar_rgb`, and a ball of another program."""

import shutil
from pathlib import Path

import pytest

from scenes.view_sets.formats.export import export
from tests.harness.ball import write_ball
from tests.scenes.loading import render_tiny


@pytest.fixture(scope="session")
def stored_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return render_tiny(tmp_path_factory.mktemp("view_sets"))


@pytest.fixture
def view_set(stored_once: Path, tmp_path: Path) -> Path:
    """A copy of the tiny view set, which a test may damage."""
    copy = tmp_path / stored_once.name
    shutil.copytree(stored_once, copy)
    return copy


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    """A view set of another program."""
    return write_ball(tmp_path / "ball", size=12, train=4, test=2)


@pytest.fixture
def studio(tmp_path: Path, ball: Path) -> Path:
    """The same view set with a `transforms.json`."""
    export(ball, "nerfstudio", tmp_path / "studio")
    return tmp_path / "studio"
