"""A run that is interrupted says how to go on; `tests.endurance` kills runs anywhere, and compares what is resumed."""

import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from harness.records.cells import read_cells, read_comparisons, read_run
from tests.harness.shell import ROOT, TINY, command, on_one_core


def wait_for(what: Callable[[], object]) -> None:
    """Wait for at most two minutes."""
    for _ in range(2400):
        if what():
            return
        time.sleep(0.05)
    pytest.fail("waited in vain")


def in_the_foreground() -> None:
    """Use one core and accept Ctrl-C, which a suite in the background ignores."""
    on_one_core()
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc to find worker processes")
def test_an_interrupted_run_says_how_to_go_on(ball_folder: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    # many cells, as a signal on a busy machine may come late
    call = command(*TINY, "--seeds", "10", "--view-set", ball_folder, "--out", run)
    process = subprocess.Popen(
        call, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, preexec_fn=in_the_foreground
    )
    wait_for(lambda: process.poll() is not None or list((run / "records/cells").glob("*.json")))
    workers = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    process.send_signal(signal.SIGINT)
    said = process.communicate()[1]
    wait_for(lambda: not any(Path(f"/proc/{worker}/cmdline").exists() for worker in workers))
    assert process.returncode == 130
    kept = len(list(read_cells(run)))
    assert 1 <= kept < 20
    assert said == (
        f"interrupted: {kept} of 20 cells are kept; `python -m reports {run} --partial` reports them; "
        f"resume with --resume --out {run}\n"
    )
    if kept >= 2:
        assert read_comparisons(run)
    assert not read_run(run).finished
