"""Question 8: peak memory of what a run starts, in fresh processes."""

import json
import shlex
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from harness.records.study import Check, Series, Table
from harness.studies.drawn_views import write_noise
from harness.studies.speed.memory_worker import Request
from harness.studies.speed.speed_context import SpeedContext, measured, not_measured, reduced_plan, views_of

MEBIBYTE = 1 << 20
LIMIT_GB = 2.0
IMAGES, RESOLUTIONS = (25, 100), (50, 100, 200)
METHODS = (("nerf",), ("nerf", "nerf_matched", "qnerf"))
WHOLE_RUN_SCENES = ("lego", "hotdog")


@dataclass(frozen=True)
class Peak:
    """A peak in bytes, and what it was measured for."""

    training: float
    training_anonymous: float
    """The peak of its own pages: without libraries, which are shared and can be dropped."""
    whole: float
    """The peak of reading, training, scoring and writing."""
    whole_anonymous: float


def measure(situation: SpeedContext) -> Iterator[Check | Series | Table]:
    plan = reduced_plan(situation)
    steps = plan.train.grid.first_step + (2 if situation.quick else 60)
    views = views_of(situation, "lego")
    for methods in METHODS[: 1 if situation.quick else None]:
        request = Request(
            str(views.path), plan.views.resolution, plan.views.train, plan.views.test, methods, steps, situation.quick,
            situation.device.type, 1,
        )  # fmt: skip
        peaks = [peak_of(request, situation) for _ in range(1 if situation.quick else 2)]
        own = statistics.median(peak.whole_anonymous for peak in peaks)
        name = "nerf" if len(methods) == 1 else "three"
        title = "a worker of the reduced profile, " + ("nerf alone" if len(methods) == 1 else "three methods")
        yield measured(
            f"memory.worker.{name}.peak",
            f"Peak memory of {title}",
            [peak.whole / 1e9 for peak in peaks],
            "GB",
            target=LIMIT_GB,
            sense="at_most",
            detail=f"{steps} steps, then scored; {own / 1e9:.2f} GB of it are its own pages, the rest libraries",
        )
    yield from _whole_run(situation, steps)
    yield from _independence(situation, steps)


def peak_of(request: Request, situation: SpeedContext) -> Peak:
    """Return the peak of a fresh interpreter that does what a worker of a run does. Raises `RuntimeError` with its
    error output.
    """
    out = situation.scratch / f"memory-{time.monotonic_ns()}"
    out.mkdir()
    done = subprocess.run(
        [sys.executable, "-m", "harness.studies.speed.memory_worker", json.dumps(asdict(request)), str(out)],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"a worker ended with {done.returncode}: {done.stderr.strip()[-500:]}")
    return Peak(**json.loads(done.stdout.splitlines()[-1]))


def _independence(situation: SpeedContext, steps: int) -> Iterator[Check | Series | Table]:
    """Yield the peak during training, against the number of images and their size."""
    images, resolutions = ((4,), (16, 24)) if situation.quick else (IMAGES, RESOLUTIONS)
    rows: list[list[str | float | None]] = []
    peaks: dict[tuple[int, int], float] = {}
    for count in images:
        for resolution in resolutions:
            folder = situation.scratch / f"noise-{count}-{resolution}"
            write_noise(folder, resolution, count, 1)
            request = Request(
                str(folder), resolution, count, 1, ("nerf",), steps, situation.quick, situation.device.type, 1
            )
            peak = peak_of(request, situation)
            peaks[count, resolution] = peak.training
            rows.append([float(count), float(resolution), peak.training / 1e9, peak.training_anonymous / 1e9])
        yield Series(
            panel="Peak memory during training",
            item=0,
            name=f"{count} training images",
            x_label="width of an image (px)",
            y_label="peak memory (GB)",
            x=[float(one) for one in resolutions],
            y=[peaks[count, one] / 1e9 for one in resolutions],
            log_y=False,
        )
    columns = ["training images", "width (px)", "peak (GB)", "its own pages (GB)"]
    yield Table("memory.training", 0, "Peak memory during training, nerf, reduced settings", columns, rows)
    largest, smallest = peaks[images[-1], resolutions[-1]], peaks[images[0], resolutions[0]]
    pixels = (images[-1] * resolutions[-1] ** 2) / (images[0] * resolutions[0] ** 2)
    yield measured(
        "memory.training.growth",
        "Peak memory during training, most and largest images against fewest and smallest",
        [largest / smallest],
        "×",
        target=1.1,
        sense="at_most",
        detail=f"{pixels:.0f} times the pixels, {(largest - smallest) / MEBIBYTE:.0f} MiB more; a single run each",
    )


def _whole_run(situation: SpeedContext, steps: int) -> Iterator[Check]:
    """Yield the peak of `python -m harness run` as a user starts it: all its processes together, shared pages counted
    once.
    """
    id, title = "memory.run.peak", "Peak memory of a whole run at the reduced profile, all processes together"
    if not Path("/proc/self/smaps_rollup").exists():
        yield not_measured(id, title, "GB", "this system does not tell which pages processes share")
        return
    plan = reduced_plan(situation)
    out = situation.scratch / "memory-run"
    if situation.quick:
        words = "run --profile smoke --methods nerf --resolution 16"
        words += f" --view-set {shlex.quote(str(views_of(situation, 'lego').path))}"
    else:
        words = f"run --profile {plan.profile} --scenes {' '.join(WHOLE_RUN_SCENES)}"
        words += f" --view-sets {shlex.quote(str(situation.view_sets))}"
    words += f" --seeds 1 --budget-steps {steps} --device {situation.device.type} --quiet --out {shlex.quote(str(out))}"
    process = subprocess.Popen(
        [sys.executable, "-m", "harness", *shlex.split(words)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    peak = 0
    try:
        while process.poll() is None:
            peak = max(peak, sum(proportional_bytes(one) for one in family_of(process.pid)))
            time.sleep(0.1)
    finally:
        if process.poll() is None:
            process.terminate()
            process.wait()
    if process.returncode not in (0, 3):
        raise RuntimeError(f"`python -m harness {words}` ended with {process.returncode}")
    workers = "one scene" if situation.quick else f"{len(WHOLE_RUN_SCENES)} scenes"
    yield measured(
        id,
        title,
        [peak / 1e9],
        "GB",
        target=LIMIT_GB,
        sense="at_most",
        detail=f"{workers}, three methods, {steps} steps, one worker a core; pages that processes share count once",
    )


def family_of(process: int, proc: Path = Path("/proc")) -> list[int]:
    """Return the process and all its descendants that are alive now."""
    children: dict[int, list[int]] = {}
    for stat in proc.glob("[0-9]*/stat"):
        try:
            text = stat.read_text(encoding="utf-8")
        except OSError:
            continue  # it has ended meanwhile
        # the name in parentheses may hold blanks; behind it come the state and the parent
        children.setdefault(int(text.rpartition(")")[2].split()[1]), []).append(int(stat.parent.name))
    found, waiting = [], [process]
    while waiting:
        one = waiting.pop()
        found.append(one)
        waiting += children.get(one, [])
    return found


def proportional_bytes(process: int, proc: Path = Path("/proc")) -> int:
    """Return the memory of a process, each shared page divided by the number of its sharers; 0 once it has ended."""
    try:
        text = (proc / str(process) / "smaps_rollup").read_text(encoding="utf-8")
    except OSError:
        return 0
    return next((1024 * int(line.split()[1]) for line in text.splitlines() if line.startswith("Pss:")), 0)
