"""A hand-written run on disk, read and unread."""

import shutil
from pathlib import Path

import pytest

from reports.data.load import Records, read_records
from tests.reports.fake_run import write_fake_run


@pytest.fixture(scope="session")
def plain_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two scenes × three methods × three seeds without pictures; drums, qnerf, seed 2 diverged; not to be changed."""
    return write_fake_run(tmp_path_factory.mktemp("plain") / "run", pictures=False)


@pytest.fixture
def out(plain_run: Path, tmp_path: Path) -> Path:
    """A copy of it, to be changed."""
    return shutil.copytree(plain_run, tmp_path / "run")


@pytest.fixture(scope="session")
def records(plain_run: Path) -> Records:
    """What was read of it; not to be changed."""
    return read_records(plain_run)


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Records:
    """The same, but with every cell finished."""
    return read_records(write_fake_run(tmp_path_factory.mktemp("whole") / "run", pictures=False, with_diverged=False))


@pytest.fixture(scope="session")
def pictured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with pictures; not to be changed."""
    return write_fake_run(tmp_path_factory.mktemp("pictured") / "run")
