"""Question 8: peak memory of a run and of its workers, in fresh processes."""

import re
import shlex
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from harness.execution.group import run_group
from harness.machine.peak_memory import peak_bytes
from harness.machine.stopping import in_child
from harness.plan.group_task import GroupTask
from harness.plan.schedule import Budget
from harness.records.cells import CellRecord
from harness.records.study import Check, Series, Table
from harness.studies.drawn_views import write_noise
from harness.studies.framework import Rows, StudyContext
from harness.studies.speed.speed_context import SpeedContext, figure, no_figure, reduced_plan, views_of

LIMIT_GB = 2.0
IMAGES, RESOLUTIONS = (25, 100), (50, 100, 200)
QUICK_IMAGES, QUICK_RESOLUTIONS = (4,), (16, 24)
METHODS = {"nerf": ("only nerf", ("nerf",)), "three": ("three methods", ("nerf", "nerf_matched", "qnerf"))}
RUN_SCENES = ("lego", "hotdog")


def measure(context: SpeedContext) -> Iterator[Check | Series | Table]:
    plan, views = reduced_plan(context), views_of(context)
    steps = plan.train.grid.first_step + (2 if context.quick else 60)
    # scored only at the end, so that everything before is training
    score = replace(plan.score, checkpoints=1)
    task = GroupTask("memory", 0, ("nerf",), plan.train, score, Budget(steps, None), Path(), views.path, plan.views)
    task = replace(task, device=context.device.type)
    for name in ("nerf",) if context.quick else METHODS:
        words, methods = METHODS[name]
        peaks = [peaks_of(context, replace(task, methods=methods)) for _ in range(1 if context.quick else 2)]
        yield figure(
            f"memory.worker.{name}.peak",
            f"Peak memory of a worker of the reduced profile, {words}",
            [complete / 1e9 for _, complete in peaks],
            "GB",
            f"{steps} steps, then scored; libraries included",
            high=LIMIT_GB,
        )
    yield from _complete_run(context, steps)
    yield from _independence(context, task)


def peaks_of(context: StudyContext, task: GroupTask) -> tuple[int, int]:
    """Return the peak bytes of a fresh process that works like a worker of a run: in training, and to the end of
    scoring and writing. Raises `RuntimeError` if a cell fails.
    """
    return in_child(_peaks, replace(task, out=context.scratch / f"memory-{time.monotonic_ns()}"))


def _peaks(task: GroupTask) -> tuple[int, int]:
    training = 0
    cells: list[CellRecord] = []

    def on_progress(share: float) -> None:
        nonlocal training
        if share < 1.0:
            training = peak_bytes()

    run_group(task, on_progress, cells.append)
    if failed := [f"{cell.method}: {cell.status}, {cell.reason}" for cell in cells if cell.status != "done"]:
        raise RuntimeError(f"a worker failed: {'; '.join(failed)}")
    return training, peak_bytes()


def _independence(context: SpeedContext, task: GroupTask) -> Iterator[Check | Series | Table]:
    counts, resolutions = (QUICK_IMAGES, QUICK_RESOLUTIONS) if context.quick else (IMAGES, RESOLUTIONS)
    rows: Rows = []
    peaks: list[float] = []
    for count in counts:
        for resolution in resolutions:
            folder = context.scratch / f"noise-{count}-{resolution}"
            write_noise(folder, resolution, count, 1)
            views = replace(task.views, resolution=resolution, train=count, val=0, test=1)
            peaks.append(peaks_of(context, replace(task, view_set=folder, views=views))[0] / 1e9)
            rows.append([float(count), float(resolution), peaks[-1]])
        yield Series(
            "Peak memory during training", 0, f"{count} training images", "width of an image (px)", "peak memory (GB)",
            [float(resolution) for resolution in resolutions], peaks[-len(resolutions) :], log_y=False,
        )  # fmt: skip
    columns = ["training images", "width (px)", "peak (GB)"]
    yield Table("memory.training", 0, "Peak memory during training, nerf, reduced settings", columns, rows)
    pixels = (counts[-1] * resolutions[-1] ** 2) / (counts[0] * resolutions[0] ** 2)
    mebibytes = (peaks[-1] - peaks[0]) * 1e9 / (1 << 20)
    yield figure(
        "memory.training.growth",
        "Peak memory during training, many large images against few small images",
        [peaks[-1] / peaks[0]],
        "×",
        f"{pixels:.0f} times the pixels, {mebibytes:.0f} MiB more; a single run each",
        high=1.1,
    )


def _complete_run(context: SpeedContext, steps: int) -> Iterator[Check]:
    id, title = "memory.run.peak", "Peak memory of a complete run at the reduced profile, all processes together"
    if not Path("/proc/self/smaps_rollup").exists():
        yield no_figure(id, title, "GB", "this system does not report which pages processes share")
        return
    if context.quick:
        views = shlex.quote(str(views_of(context).path))
        words = f"run --profile smoke --methods nerf --resolution 16 --view-set {views}"
    else:
        views = shlex.quote(str(context.view_sets))
        words = f"run --profile reduced --scenes {' '.join(RUN_SCENES)} --view-sets {views}"
    out = shlex.quote(str(context.scratch / "memory-run"))
    words += f" --seeds 1 --budget-steps {steps} --device {context.device.type} --quiet --out {out}"
    command = [sys.executable, "-m", "harness", *shlex.split(words)]
    silent = subprocess.DEVNULL
    process = subprocess.Popen(command, stdout=silent, stderr=silent, start_new_session=True)
    peak = 0
    try:
        while process.poll() is None:
            peak = max(peak, session_bytes(process.pid))
            time.sleep(0.1)
    finally:
        process.terminate()
        process.wait()
    if process.returncode not in (0, 3):
        raise RuntimeError(f"`python -m harness {words}` ended with {process.returncode}")
    trained = "nerf on one scene" if context.quick else f"all its methods on {' and '.join(RUN_SCENES)}"
    detail = f"{trained}, {steps} steps, one worker per core; pages that processes share count once"
    yield figure(id, title, [peak / 1e9], "GB", detail, high=LIMIT_GB)


def session_bytes(session: int, proc: Path = Path("/proc")) -> int:
    """Return the memory of the processes of a session, each shared page divided by the number of its sharers."""
    total = 0
    for stat in proc.glob("[0-9]*/stat"):
        with suppress(OSError):  # a process may have ended meanwhile
            # the name in parentheses may hold blanks; after it come the state, the parent, the group and the session
            if int(stat.read_text(encoding="utf-8").rpartition(")")[2].split()[3]) == session:
                pages = re.search(r"^Pss:\s+(\d+) kB", stat.with_name("smaps_rollup").read_text(encoding="utf-8"), re.M)
                total += 1024 * int(pages[1]) if pages else 0
    return total
