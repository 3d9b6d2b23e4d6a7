"""`python -m harness.studies.speed.memory_worker REQUEST OUT`: what a worker of a run does, and its peak memory.

The peak over all pages is the system's own (`VmHWM`); that of its own pages is the largest of many samples.
"""

import json
import resource
import sys
import threading
import time
from dataclasses import dataclass, replace
from pathlib import Path

STATUS = Path("/proc/self/status")
LOOK_SECONDS = 0.005


@dataclass(frozen=True)
class Request:
    """A request that can be written as JSON."""

    view_set: str
    resolution: int
    train: int
    test: int
    methods: tuple[str, ...]
    steps: int
    quick: bool
    device: str


class OwnPages:
    """Samples this process's own pages until it is told to stop."""

    def __init__(self) -> None:
        self.peak = 0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    def _look(self) -> None:
        while not self._ended.is_set():
            self.peak = max(self.peak, memory_of(_status()).get("RssAnon", 0))
            time.sleep(LOOK_SECONDS)

    def stop(self) -> None:
        self._ended.set()
        self._thread.join()


def _status() -> str:
    """Return the status file; empty if the system has none."""
    return STATUS.read_text(encoding="utf-8") if STATUS.exists() else ""


def memory_of(status: str) -> dict[str, int]:
    """Return bytes by name from `/proc/self/status`: VmHWM (the peak), RssAnon, …"""
    rows = (line.partition(":") for line in status.splitlines())
    return {name: 1024 * int(value.split()[0]) for name, _, value in rows if value.strip().endswith("kB")}


def peak_bytes() -> int:
    """Return the peak of all pages so far; macOS counts bytes, Linux, if the file is missing, kibibytes."""
    unit = 1 if sys.platform == "darwin" else 1024
    return memory_of(_status()).get("VmHWM") or resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def main(arguments: list[str]) -> None:
    given = json.loads(arguments[0])
    request = Request(**{**given, "methods": tuple(given["methods"])})
    own_pages = OwnPages()

    import torch

    from harness.execution.group import run_group
    from harness.machine.device import multiplies_bfloat16
    from harness.plan.group_task import GroupTask
    from harness.plan.profiles import PROFILES
    from harness.plan.schedule import Budget
    from harness.records.cells import CellRecord

    plan = PROFILES["smoke" if request.quick else "reduced"]
    precision = plan.train.precision if multiplies_bfloat16(torch.device(request.device)) else "float32"
    task = GroupTask(
        scene="memory",
        seed=0,
        methods=request.methods,
        view_set=Path(request.view_set),
        views=replace(plan.views, resolution=request.resolution, train=request.train, val=0, test=request.test),
        train=replace(plan.train, precision=precision),
        # scored at the end alone, so that what comes before is training
        score=replace(plan.score, checkpoints=1),
        budget=Budget(request.steps, None),
        device=request.device,
        threads=1,
        out=Path(arguments[1]),
    )
    peaks = {"training": 0, "training_own": 0}

    def on_progress(share: float) -> None:
        if share < 1.0:
            peaks.update(training=peak_bytes(), training_own=own_pages.peak)

    def on_cell(cell: CellRecord) -> None:
        if cell.status != "done":
            raise SystemExit(f"{cell.method}: {cell.status}, {cell.reason}")

    run_group(task, on_progress, on_cell)
    own_pages.stop()
    peaks.update(complete=peak_bytes(), complete_own=own_pages.peak)
    print(json.dumps(peaks))  # noqa: T201


if __name__ == "__main__":
    main(sys.argv[1:])
