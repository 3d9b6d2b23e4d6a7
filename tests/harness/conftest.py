"""A view set that needs no renderer, and torch's switches put back after each test."""

from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

from scenes.view_set import ViewSet, read_view_set
from tests.harness.ball import write_ball


@pytest.fixture(scope="session")
def ball_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Not to be changed."""
    return write_ball(tmp_path_factory.mktemp("views") / "ball")


@pytest.fixture(scope="session")
def ball(ball_folder: Path) -> ViewSet:
    return read_view_set(ball_folder)


@pytest.fixture(autouse=True)
def torch_switches() -> Iterator[None]:
    """A run sets threads and determinism for its whole process; here the process is the test session."""
    threads, deterministic = torch.get_num_threads(), torch.get_deterministic_debug_mode()
    torch.set_num_threads(1)  # nothing here is large, and threads that wait for each other burn a busy core
    yield
    torch.set_num_threads(threads)
    torch.set_deterministic_debug_mode(deterministic)
