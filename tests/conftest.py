"""For every test: a browser to look at pages, torch with one thread, and an int is a float to the type checker, as
PEP 484 and mypy have it.

`--jaxtyping-packages` in `pyproject.toml` names the checker, and can say neither its settings nor a module of ours;
it looks `beartype.beartype` up while our packages are imported, which is after this file. Plain beartype would
refuse `box(1, 1, 0.2)`.
"""

import shutil
from collections.abc import Callable, Iterator
from inspect import isfunction
from typing import Any

import beartype
import jaxtyping
import pytest
import torch

beartype.beartype = beartype.beartype(conf=beartype.BeartypeConf(is_pep484_tower=True))


jaxtyped = jaxtyping.jaxtyped


def where_shapes_are(**options: Any) -> Callable[[Any], Any]:
    """Leave out what states no shape, which mypy has seen, and functions in functions, each call of which would make
    their checks anew: together they take a fifth of the suite's time.
    """

    def decorate(one: Any) -> Any:
        shapes = not isfunction(one) or any("jaxtyping" in str(each) for each in one.__annotations__.values())
        return jaxtyped(one, **options) if shapes and "<locals>" not in one.__qualname__ else one

    return decorate


jaxtyping.jaxtyped = where_shapes_are
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
