"""For every test: a browser to look at pages, and an int is a float to the type checker, as PEP 484 and mypy have it.

`--jaxtyping-packages` in `pyproject.toml` names the checker, and can say neither its settings nor a module of ours;
it looks `beartype.beartype` up while our packages are imported, which is after this file. Plain beartype would
refuse `box(1, 1, 0.2)`.
"""

import shutil
from collections.abc import Iterator
from typing import Any

import beartype
import pytest

beartype.beartype = beartype.beartype(conf=beartype.BeartypeConf(is_pep484_tower=True))


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
