"""A hand-written run on disk, read and unread."""

from pathlib import Path

import pytest

from reports.load import Records, read_records
from tests.reports.fake_run import write_fake_run


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """Two scenes × three methods × three seeds without pictures; drums, qnerf, seed 2 diverged."""
    return write_fake_run(tmp_path / "run", pictures=False)


@pytest.fixture
def records(out: Path) -> Records:
    return read_records(out)


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Records:
    """The same, but with every cell finished; its files are not to be changed."""
    out = tmp_path_factory.mktemp("whole") / "whole"
    return read_records(write_fake_run(out, pictures=False, with_diverged=False))


@pytest.fixture(scope="session")
def pictured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with pictures; not to be changed."""
    return write_fake_run(tmp_path_factory.mktemp("pictured") / "run")
