"""For every test: a browser to look at pages, torch with one thread, and an int is a float to the type checker, as
PEP 484 and mypy have it.

`--jaxtyping-packages` in `pyproject.toml` names the checker, and can say neither its settings nor a module of ours;
it looks `beartype.beartype` up while our packages are imported, which is after this file. Plain beartype would
refuse `box(1, 1, 0.2)`.
"""

import shutil
from collections.abc import Callable, Iterator
from typing import Any

import beartype
import jaxtyping
import pytest
import torch

beartype.beartype = beartype.beartype(conf=beartype.BeartypeConf(is_pep484_tower=True))


jaxtyped = jaxtyping.jaxtyped


def made_once(**options: Any) -> Callable[[Any], Any]:
    """Leave out functions in functions: each call of the outer one would compile their checks anew."""
    return lambda one: one if "<locals>" in one.__qualname__ else jaxtyped(one, **options)


jaxtyping.jaxtyped = made_once
torch.set_num_threads(1)  # nothing here is large, and threads that wait for each other burn a busy core


@pytest.fixture(autouse=True)
def torch_switches() -> Iterator[None]:
    """A run sets threads and determinism for its whole process; here the process is the test session. What a test, or
    a fixture of its module, has set is undone: each test begins alike, whichever were before it.
    """
    torch.set_deterministic_debug_mode("default")
    torch.set_num_threads(1)
    yield
    torch.set_deterministic_debug_mode("default")
    torch.set_num_threads(1)


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
