"""Workers end with their parent, and their errors reach it."""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from harness.command.plan_options import planned
from harness.machine.stopping import in_child
from harness.studies.choices import arms


def slept(task: arms.CellTask) -> None:
    (task.scratch / "begun").touch()
    time.sleep(1000)


@pytest.fixture
def _open_to_ctrl_c() -> Iterator[None]:
    """Restore Ctrl-C, which a suite that was started in the background ignores."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("_open_to_ctrl_c")
def test_a_pool_in_the_middle_of_a_cell_ends_with_its_parent(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(arms, "kept_cell", slept)
    task = arms.CellTask("lego", "nerf", 0, Path(), tmp_path, planned("smoke"), {})

    def stop() -> None:
        while not (tmp_path / "begun").exists():
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=stop, daemon=True).start()
    with pytest.raises(KeyboardInterrupt):
        list(arms.trained_cells([task, task], 1))
    assert multiprocessing.active_children() == []


def test_a_child_returns_its_result_or_error(capfd: pytest.CaptureFixture[str]) -> None:
    assert in_child(divmod, 7, 2) == (3, 1)
    with pytest.raises(ZeroDivisionError):
        in_child(divmod, 1, 0)
    assert capfd.readouterr() == ("", "")
