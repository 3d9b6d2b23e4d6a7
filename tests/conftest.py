"""For all tests: a browser, torch with one thread, worker processes that need not import it again, and a type checker
that accepts an int as a float, like PEP 484.

`--jaxtyping-packages` in `pyproject.toml` names the checker, but cannot set its options. It looks up
`beartype.beartype` when our packages are imported, which is after this file. Plain beartype would refuse
`box(1, 1, 0.2)`.
"""

import multiprocessing
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
    """Skip nested functions: each call of the outer function would compile their checks again."""
    return lambda function: function if "<locals>" in function.__qualname__ else jaxtyped(function, **options)


jaxtyping.jaxtyped = made_once
torch.set_num_threads(1)  # the tests are small, and threads that wait for each other occupy a busy core


WORKER = ["colour", "torch._dynamo", "harness.execution.local_executor", "harness.training.lockstep"]


def fork_in_place_of_spawn() -> None:
    """Fork workers from a process that has imported `WORKER`, as importing it anew takes seconds in each test."""
    original, forks = multiprocessing.get_context, multiprocessing.get_context("forkserver")
    forks.set_forkserver_preload(WORKER)
    multiprocessing.get_context = lambda name=None: forks if name == "spawn" else original(name)  # type: ignore[assignment]


fork_in_place_of_spawn()


def reset_torch() -> None:
    torch.set_deterministic_debug_mode("default")
    torch.set_num_threads(1)


@pytest.fixture(autouse=True)
def torch_switches() -> Iterator[None]:
    """Restore the threads and the determinism that a run sets for its process, which here is the test session."""
    reset_torch()  # a fixture of the module may have set them
    yield
    reset_torch()


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
