"""What a worker of a run does, in a process of its own, and its peak memory.

The peak over all pages is the system's own (`VmHWM`); that of its own pages is the largest of many samples.
"""

import resource
import sys
import threading
from multiprocessing.connection import Connection
from pathlib import Path

from harness.execution.group import run_group
from harness.machine.stopping import end_with_parent
from harness.plan.group_task import GroupTask
from harness.records.cells import CellRecord

STATUS = Path("/proc/self/status")
LOOK_SECONDS = 0.005


def memory_of(status: str) -> dict[str, int]:
    """Return bytes by name from `/proc/self/status`: VmHWM (the peak), RssAnon, …"""
    rows = (line.partition(":") for line in status.splitlines())
    return {name: 1024 * int(value.split()[0]) for name, _, value in rows if value.strip().endswith("kB")}


def _memory() -> dict[str, int]:
    """Return what this system tells; nothing if it has no such file."""
    return memory_of(STATUS.read_text(encoding="utf-8")) if STATUS.exists() else {}


def peak_bytes() -> int:
    """Return the peak of all pages so far; macOS counts bytes, Linux, if the file is missing, kibibytes."""
    unit = 1 if sys.platform == "darwin" else 1024
    return _memory().get("VmHWM") or resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def send_peaks(task: GroupTask, connection: Connection) -> None:
    """Do the task; send the peak bytes in `training`, and until it is `complete` with reading, scoring and writing.
    `_own` pages are those without libraries, which are shared and can be dropped. If a cell failed, send the reason.
    """
    end_with_parent()
    peaks = {"training": 0, "training_own": 0, "complete": 0, "complete_own": 0}
    failed: list[str] = []
    ended = threading.Event()

    def look() -> None:
        while not ended.wait(LOOK_SECONDS):
            peaks["complete_own"] = max(peaks["complete_own"], _memory().get("RssAnon", 0))

    def on_progress(share: float) -> None:
        if share < 1.0:
            peaks.update(training=peak_bytes(), training_own=peaks["complete_own"])

    def on_cell(cell: CellRecord) -> None:
        if cell.status != "done":
            failed.append(f"{cell.method}: {cell.status}, {cell.reason}")

    looking = threading.Thread(target=look, daemon=True)
    looking.start()
    run_group(task, on_progress, on_cell)
    ended.set()
    looking.join()
    peaks["complete"] = peak_bytes()
    connection.send("; ".join(failed) or peaks)
