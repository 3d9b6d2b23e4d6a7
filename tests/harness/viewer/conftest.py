"""One small run that a page can show, and copies of it that may be written to."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from harness.playback.run_loader import FinishedRun, TrainedCell
from harness.records.cells import cell_path, read_cell, read_run, write_cell, write_run
from harness.training.checkpoints import checkpoint_path
from harness.viewer.shown_run import ShownRun
from tests.harness.tiny import CPU
from tests.harness.trained_runs import train_run
from tests.harness.viewer.site import Site, served
from tests.replacing import replace

SIZE = 40
"""Pixels: nine regions."""
HOSTILE = "<img src=x onerror=\"document.title='taken'\"> & more"
METHODS = {"nerf": HOSTILE, "qnerf": "Q-NeRF as listed", "nerf_matched": "never trained here"}


@pytest.fixture(scope="session")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with hostile titles, next to its view set `ball`; not to be changed."""
    out = train_run(tmp_path_factory.mktemp("viewer"), ["nerf", "qnerf"], steps=30, size=SIZE)
    run = read_run(out)
    write_run(out, replace(run, methods=METHODS, scenes=[replace(run.scenes[0], title=HOSTILE)]))
    return out


def shown_of(out: Path, methods: list[str] | None = None) -> ShownRun:
    return ShownRun.of(out, None, methods, 0, out / "none", None, CPU)


def add_second_scene(out: Path) -> None:
    """Add a second name for the scene's views and the weights of nerf."""
    run, name = read_run(out), "second"
    scene = run.scenes[0]
    shutil.copy(checkpoint_path(out, scene.name, "nerf", 0), checkpoint_path(out, name, "nerf", 0))
    write_cell(out, replace(read_cell(cell_path(out, scene.name, "nerf", 0)), scene=name))
    write_run(out, replace(run, scenes=[scene, replace(scene, name=name)]))


@pytest.fixture
def out(trained: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(trained, tmp_path / "run"))


@pytest.fixture(scope="session")
def cells(trained: Path) -> list[TrainedCell]:
    run = FinishedRun.of(trained)
    return [run.trained(run.run.scenes[0], method, 0, CPU) for method in ("nerf", "qnerf")]


@pytest.fixture
def shown(out: Path) -> ShownRun:
    return shown_of(out)


@pytest.fixture(scope="module")
def site(trained: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """With a cache of its own, for the tests of one file."""
    out = Path(shutil.copytree(trained, tmp_path_factory.mktemp("site") / "run"))
    with served(shown_of(out)) as found:
        yield found
