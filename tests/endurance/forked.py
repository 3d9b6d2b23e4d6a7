"""Runs of the command in forked processes that have imported everything already, and ways to kill them.

A run is the product's own code from `main` on, in real processes that die of real signals; what differs from a start
in a shell is that its workers and its renderer are forked too, so that a hundred starts take minutes and not hours,
and that the renderer is Mitsuba's scalar variant, which needs no compiler at each start.
"""

import errno
import importlib
import mmap
import multiprocessing
import os
import signal
import struct
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

LATE = (
    "torch._dynamo",
    "colour",
    "flip_evaluator",
    "OpenImageIO",
    "scipy.stats",
    "scipy.signal",
    "trimesh",
    "PIL.Image",
)
"""What runs import only where they need it."""
POINTS = ("half a file written", "before fsync", "before a rename", "after a rename")

FULL = "disk full"
"""Not killed: refused, there and from then on."""


@dataclass(frozen=True)
class Ended:
    """How a run ended."""

    code: int
    """Of the exit, or minus the signal."""
    seconds: float
    printed: str
    phase: str = ""
    """Where it was killed."""

    @property
    def was_killed(self) -> bool:
        return self.code == -signal.SIGKILL


def prepare() -> None:
    """Imports everything and makes the smallest of runs of the smoke profile; once, before the first fork."""
    import torch

    import scenes.__main__
    import scenes.rendering.render  # noqa: F401
    from harness.plan import profiles
    from harness.plan.settings import GridSettings

    for name in LATE:
        importlib.import_module(name)
    mitsuba = importlib.import_module("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    torch.set_num_threads(1)
    smoke = profiles.PROFILES["smoke"]
    network = replace(smoke.train.network, depth=2, width=16, colour_width=8)
    train = replace(smoke.train, network=network, rays=64, bins=12, first_bins=6, precision="float32",
                    grid=GridSettings(cells=8, first_step=4, every=3))  # fmt: skip
    views = replace(smoke.views, resolution=16, train=6, val=0, test=2, spp_train=4, spp_test=4)
    profiles.PROFILES["smoke"] = replace(
        smoke, train=train, views=views, score=replace(smoke.score, checkpoints=2, train_views=1)
    )


def run(
    arguments: list[str], scratch: Path, after: float | None = None, point: tuple[str, int] | None = None,
    alone: bool = False, phase_of: Callable[[], str] = lambda: "",
) -> Ended:  # fmt: skip
    """Run `python -m harness …`; killed `after` so many seconds, with its whole group or `alone`, or at the n-th time
    that it comes to a `point`. Without either it runs to its end.
    """
    log = scratch / "printed.txt"
    began = time.monotonic()
    child = os.fork()
    if child == 0:
        _child(arguments, log, point)
    phase = ""
    if after is not None:
        while time.monotonic() < began + after and not _has_ended(child):
            time.sleep(0.002)
        phase = phase_of()
        with suppress(ProcessLookupError):
            (os.kill if alone else os.killpg)(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    seconds = time.monotonic() - began
    if not alone:
        with suppress(ProcessLookupError):  # whatever of it is left
            os.killpg(child, signal.SIGKILL)
    printed = log.read_text(encoding="utf-8", errors="replace") if log.exists() else ""
    code = os.waitstatus_to_exitcode(status)
    return Ended(code, seconds, printed, phase if point is None else f"at a write: {point[0]}")


def _has_ended(child: int) -> bool:
    return os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None


def _child(arguments: list[str], log: Path, point: tuple[str, int] | None) -> None:
    code = 70
    try:
        os.setsid()
        file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(file, 1)
        os.dup2(file, 2)
        sys.stdout, sys.stderr = (os.fdopen(number, "w", buffering=1, closefd=False) for number in (1, 2))
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        import harness.execution.ground_truth
        import harness.execution.local_executor
        import harness.machine.device
        from harness.command.main import main
        from scenes.files.stopping import stop_on_signals

        harness.machine.device.available_cores = lambda: 1
        fork = multiprocessing.get_context("fork")
        harness.execution.local_executor.multiprocessing = _With(multiprocessing, get_context=lambda _: fork)  # type: ignore[attr-defined,assignment]
        harness.execution.ground_truth.subprocess = _With(harness.execution.ground_truth.subprocess, Popen=_Renderer)  # type: ignore[attr-defined,assignment]
        if point is not None:
            _kill_at(*point)
        stop_on_signals()
        code = main(arguments)
        sys.stdout.flush()
        sys.stderr.flush()
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        os._exit(code)


class _With:
    """A module with some of its names replaced."""

    def __init__(self, module: Any, **names: Any) -> None:
        self.__dict__.update(names)
        self._module = module

    def __getattr__(self, name: str) -> Any:
        return getattr(self._module, name)


class _Renderer:
    """`subprocess.Popen` of `python -m scenes render …`, forked."""

    def __init__(self, command: list[str], stdout: int, stderr: Any, text: bool) -> None:
        ours, theirs = os.pipe()
        self.returncode: int | None = None
        self.pid = os.fork()
        if self.pid == 0:
            try:
                os.dup2(theirs, 1)
                os.dup2(stderr.fileno(), 2)
                os.closerange(3, 256)
                for number in (signal.SIGINT, signal.SIGTERM):
                    signal.signal(number, signal.SIG_DFL)
                sys.stdout, sys.stderr = (os.fdopen(number, "w", closefd=False) for number in (1, 2))
                sys.argv = ["scenes", *command[command.index("render") :], "--variant", "scalar_rgb"]
                from scenes.__main__ import main

                code = main()
                sys.stdout.flush()
                sys.stderr.flush()
                os._exit(code or 0)
            except BaseException:
                os._exit(9)
        os.close(theirs)
        self.stdout = os.fdopen(ours, "r")

    def poll(self) -> int | None:
        if self.returncode is None:
            done, status = os.waitpid(self.pid, os.WNOHANG)
            if done:
                self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode

    def wait(self) -> int:
        if self.returncode is None:
            self.returncode = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        return self.returncode

    def kill(self) -> None:
        os.kill(self.pid, signal.SIGKILL)


def _kill_at(point: str, number: int) -> None:
    """The group dies when any of its processes comes to this point for the n-th time."""
    shared = mmap.mmap(-1, 8)

    def count() -> bool:
        so_far = struct.unpack("q", shared[:8])[0] + 1
        shared[:8] = struct.pack("q", so_far)
        return so_far == number

    def die() -> None:
        os.killpg(0, signal.SIGKILL)
        time.sleep(10)

    fsync, rename, replaced = os.fsync, os.rename, os.replace

    def on_fsync(file: Any) -> None:
        if point == FULL and (count() or struct.unpack("q", shared[:8])[0] >= number):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if point in POINTS[:2] and count():
            if point == POINTS[0]:
                os.ftruncate(file, os.fstat(file).st_size // 2)
            die()
        fsync(file)

    def on_rename(really: Callable[..., None]) -> Callable[..., None]:
        def renamed(*names: Any, **options: Any) -> None:
            if point == POINTS[2] and count():
                die()
            really(*names, **options)
            if point == POINTS[3] and count():
                die()

        return renamed

    os.fsync, os.rename, os.replace = on_fsync, on_rename(rename), on_rename(replaced)  # type: ignore[assignment]
