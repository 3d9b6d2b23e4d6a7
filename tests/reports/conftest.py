"""A hand-written run on disk, read and unread, and a browser to look at its pages."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

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


@pytest.fixture
def whole(tmp_path: Path) -> Records:
    """The same, but with every cell finished."""
    return read_records(write_fake_run(tmp_path / "whole", pictures=False, with_diverged=False))


@pytest.fixture(scope="session")
def pictured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with pictures; not to be changed."""
    return write_fake_run(tmp_path_factory.mktemp("pictured") / "run")


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if chromium is None:
        pytest.skip("no chromium found (Debian: apt-get install chromium)")
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        yield opened
        opened.close()
