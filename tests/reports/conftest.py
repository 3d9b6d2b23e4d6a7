"""Fake runs on disk, their records and their pages. Tests may change only `out`."""

import shutil
from pathlib import Path

import pytest

from reports.data.load import Records, read_records
from reports.run.run_page import page
from tests.reports.fake_run import fake_records, write_fake_run


@pytest.fixture(scope="session")
def plain_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two scenes × three methods × three seeds without pictures; drums, qnerf, seed 2 diverged."""
    return write_fake_run(tmp_path_factory.mktemp("plain") / "run", pictures=False)


@pytest.fixture
def out(plain_run: Path, tmp_path: Path) -> Path:
    """Return a copy of it, which the test may change."""
    return shutil.copytree(plain_run, tmp_path / "run")


@pytest.fixture(scope="session")
def records(plain_run: Path) -> Records:
    return read_records(plain_run)


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Records:
    """Return the same run with every cell finished."""
    return fake_records(tmp_path_factory.mktemp("whole") / "run")


@pytest.fixture(scope="session")
def whole_page(whole: Records) -> str:
    return page(whole)


@pytest.fixture(scope="session")
def pictured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The plain run with pictures."""
    return write_fake_run(tmp_path_factory.mktemp("pictured") / "run")


@pytest.fixture(scope="session")
def pictured_page(pictured: Path) -> str:
    return page(read_records(pictured))
