"""Runs of the command that are killed: started as typed, or forked from a process that has imported everything.

A forked run executes the product's code from `main` on, in real processes that real signals kill. Its workers and its
renderer are forked too, so that a hundred starts take minutes instead of hours. The renderer is Mitsuba's scalar
variant, which compiles nothing at the start and is bit-identical in every run.
"""

import errno
import importlib
import mmap
import multiprocessing
import os
import resource
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing.context import ForkProcess
from pathlib import Path
from types import SimpleNamespace
from typing import IO, Any, NamedTuple

from scenes.rendering.variant import FORCE

ROOT = Path(__file__).parents[2]
OPTIONS = ["run", "--profile", "smoke", "--methods", "nerf", "qnerf", "--seeds", "1", "--budget-steps", "6",
           "--workers", "1", "--device", "cpu", "--keep-every", "0"]  # fmt: skip
POINTS = ("half a file written", "before fsync", "before a rename", "after a rename")
FULL = "disk full"
"""No kill: all writes from the n-th on are refused, or those while rendering if n is 0."""
ROOM_BYTES = 4500
"""The size of a file at which the disk is full while rendering."""
PHASES = ("starting", "rendering", "reading view sets", "training", "after training")
Point = tuple[str, int]
LATE = ("torch._dynamo", "colour", "flip_evaluator", "OpenImageIO", "scipy.stats", "scipy.signal", "trimesh",
        "PIL.Image")  # fmt: skip
"""Packages that runs import late."""


class Way(NamedTuple):
    """How runs are started."""

    name: str
    start: Callable[[list[str], IO[str], Point | None], Any]
    """Start a run that prints to the file, and return its `Popen`, the leader of a new process group."""
    scenes: tuple[str, ...]
    rendered: float
    """The share of folders that find their view sets rendered, so that more is trained."""
    at_points: float
    """The share of kills at a write."""
    more: tuple[str, ...] = ()


@dataclass(frozen=True)
class Ended:
    """How a run ended; the code is minus the signal if it was killed, and the phase is where."""

    code: int
    printed: str
    phase: str


def run(
    way: Way, here: Path, resume: bool = False, point: Point | None = None,
    moment: Callable[[], str] = lambda: "", alone: bool = False, quiet: bool = True,
) -> Ended:  # fmt: skip
    """Run into `here/out` to its end, or kill it at a `point`, or when `moment` returns a phase; `alone` spares the
    rest of its process group.
    """
    arguments = [*OPTIONS, *way.more, "--scenes", *way.scenes, "--out", str(here / "out")]
    arguments += ["--view-sets", str(here / "view_sets"), *(["--resume"] if resume else [])]
    arguments += ["--quiet"] if quiet else []
    log, phase = here / "printed.txt", ""
    with log.open("w") as printed:
        process = way.start(arguments, printed, point)
    try:
        while process.poll() is None and not (phase := moment()):
            time.sleep(0.002)
    finally:
        with suppress(ProcessLookupError):
            (os.kill if alone else os.killpg)(process.pid, signal.SIGKILL)
    code = process.wait()
    printed_text = log.read_text(encoding="utf-8", errors="replace")
    return Ended(code, printed_text, phase if point is None else f"at a write: {point[0]}")


def phase_of(here: Path, way: Way) -> str:
    """Return the phase of a run of two methods, judged by its files."""
    out, sets = here / "out", here / "view_sets"
    if list(out.rglob(".*.part")):
        return "writing"
    if not (out / "records/plan.json").exists():
        return "starting"
    if not (out / "records/run.json").exists():
        complete = [folder for folder in sets.glob("*") if not folder.name.startswith(".")]
        return "rendering" if len(complete) < len(way.scenes) else "reading view sets"
    if len(list((out / "records/cells").glob("*.json"))) < 2 * len(way.scenes):
        return "training"
    return "after training"


# --- as it is typed


def _typed(arguments: list[str], printed: IO[str], point: Point | None) -> "subprocess.Popen[bytes]":
    environment = {**os.environ, FORCE: "scalar_rgb"}
    command = [sys.executable, "-m", "harness", *arguments]
    return subprocess.Popen(command, cwd=ROOT, env=environment, stdout=printed, stderr=printed, start_new_session=True)


# --- forked


class Forked(ForkProcess):
    """The used part of `subprocess.Popen`, for a call in a forked process."""

    stdout: IO[str]

    def __init__(self, call: Callable[[], int], stdout: int, stderr: int) -> None:
        super().__init__(target=self._called, args=(call, stdout, stderr))
        self.start()

    @staticmethod
    def _called(call: Callable[[], int], stdout: int, stderr: int) -> None:
        for number, file in ((1, stdout), (2, stderr)):
            os.dup2(file, number)
        sys.stdout, sys.stderr = (os.fdopen(number, "w", buffering=1, closefd=False) for number in (1, 2))
        for interrupt in (signal.SIGINT, signal.SIGTERM):
            signal.signal(interrupt, signal.SIG_DFL)
        sys.exit(call())

    def poll(self) -> int | None:
        return self.exitcode

    def wait(self) -> int | None:
        self.join()
        return self.exitcode


def prepare() -> None:
    """Import everything and shrink the smoke profile; once, before the first fork."""
    import torch

    import scenes.__main__
    import scenes.rendering.render  # noqa: F401
    from harness.plan import profiles
    from harness.plan.settings import GridSettings

    for name in LATE:
        importlib.import_module(name)
    importlib.import_module("mitsuba").set_variant("scalar_rgb")
    torch.set_num_threads(1)
    smoke = profiles.PROFILES["smoke"]
    network = replace(smoke.train.network, depth=2, width=16, colour_width=8)
    train = replace(smoke.train, network=network, rays=64, bins=12, first_bins=6, precision="float32",
                    grid=GridSettings(cells=8, first_step=4, every=3))  # fmt: skip
    views = replace(smoke.views, resolution=16, train=6, val=0, test=2, spp_train=4, spp_test=4)
    score = replace(smoke.score, checkpoints=2, train_views=1)
    profiles.PROFILES["smoke"] = replace(smoke, train=train, views=views, score=score)


def _forked(arguments: list[str], printed: IO[str], point: Point | None) -> Forked:
    return Forked(partial(_main, arguments, point), printed.fileno(), printed.fileno())


def _main(arguments: list[str], point: Point | None) -> int:
    os.setsid()
    from harness.command.main import main
    from harness.execution import ground_truth, local_executor
    from harness.machine import device
    from scenes.files.stopping import stop_on_signals

    fork = multiprocessing.get_context("fork")
    device.available_cores = lambda: 1
    local_executor.multiprocessing = SimpleNamespace(get_context=lambda _: fork)  # type: ignore[assignment]
    ground_truth.subprocess = SimpleNamespace(**{**vars(subprocess), "Popen": _renderer})  # type: ignore[assignment]
    if point == (FULL, 0):
        resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM_BYTES, ROOM_BYTES))
    elif point is not None:
        _kill_at(*point)
    stop_on_signals()
    return main(arguments)


def _renderer(command: list[str], stdout: int, stderr: IO[str], text: bool) -> Forked:
    """Stand in for `subprocess.Popen` of `python -m scenes render …`."""
    from scenes.__main__ import main

    def render() -> int:
        os.closerange(3, 256)  # like Popen, so that no lock is inherited
        return main([*command[command.index("render") :], "--variant", "scalar_rgb"])

    reads, writes = os.pipe()
    process = Forked(render, writes, stderr.fileno())
    os.close(writes)
    process.stdout = os.fdopen(reads)
    return process


def _kill_at(point: str, number: int) -> None:
    """Kill the group when its processes together reach this point for the n-th time."""
    shared = mmap.mmap(-1, 8)
    fsync = os.fsync

    def count() -> int:
        times = struct.unpack("q", shared[:8])[0] + 1
        shared[:8] = struct.pack("q", times)
        return times

    def die() -> None:
        os.killpg(0, signal.SIGKILL)
        time.sleep(10)

    def on_fsync(file: Any) -> None:
        if point == FULL and count() >= number:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if point in POINTS[:2] and count() == number:
            if point == POINTS[0]:
                os.ftruncate(file, os.fstat(file).st_size // 2)
            die()
        fsync(file)

    def on_rename(rename: Callable[..., None], *names: Any, **options: Any) -> None:
        if point == POINTS[2] and count() == number:
            die()
        rename(*names, **options)
        if point == POINTS[3] and count() == number:
            die()

    os.fsync, os.rename, os.replace = on_fsync, partial(on_rename, os.rename), partial(on_rename, os.replace)  # type: ignore[assignment]


FORKED = Way("forked", _forked, ("hotdog", "lego"), rendered=0.0, at_points=0.3)
TYPED = Way("typed", _typed, ("hotdog",), rendered=0.5, at_points=0.0, more=("--resolution", "16"))
