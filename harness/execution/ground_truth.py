"""View sets for a plan, from the cache or rendered by Mitsuba in another process, as Dr.Jit may abort."""

import contextlib
import io
import json
import math
import multiprocessing
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Literal

from harness.execution.progress import Progress, Range, RenderProgress
from harness.machine.device import available_cores
from harness.plan.defaults import RENDER_LIMIT
from harness.plan.group_task import GroupTask
from harness.plan.run_plan import Machine, Plan
from harness.plan.settings import ViewSettings
from scenes.files.errors import InputError
from scenes.files.json_object import JsonObject
from scenes.modelling.needs import with_needs
from scenes.rendering.variant import llvm_libraries
from scenes.view_sets.formats.foreign import source_of
from scenes.view_sets.view_set import ViewSet, read_view_set


def scenes_output(*words: str, **options: object) -> str:
    """Return the output of `python -m scenes WORDS --OPTION VALUE …`, tried again with `scalar_rgb` if Dr.Jit aborts.
    Raises `InputError` with its error output, and `RuntimeError` if it fails otherwise.
    """
    command = [sys.executable, "-m", "scenes", *words]
    command += _words({f"--{name}": value for name, value in options.items()})
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    if ended.returncode < 0:
        ended = subprocess.run([*command, "--variant", "scalar_rgb"], capture_output=True, text=True, check=False)
    if ended.returncode == 2:
        raise InputError(ended.stderr.strip().removeprefix("scenes: "))
    if ended.returncode:
        raise RuntimeError(f"`scenes {words[0]}` ended with exit code {ended.returncode}: {ended.stderr[-2000:]}")
    return ended.stdout


def read_views(
    folder: Path,
    views: ViewSettings,
    scratch: Path,
    scored_on: Literal["val", "test"] = "test",
    decoded: Path | None = None,
) -> ViewSet:
    """Read the views for training and scoring a cell. Decoded images go to `scratch`, a folder on a disk; those of
    other programs also to `decoded`, to be read again. Raises `InputError` for any fault of the folder.
    """
    stored = read_view_set(
        folder,
        resolution=views.resolution,
        splits=("train", scored_on),
        counts={"train": views.train, "val": views.val, "test": views.test},
        scratch=scratch,
        region=views.region,
        decoded=decoded,
    )
    return with_needs(stored, views.need, views.no_need)


def view_set_folders(plan: Plan, cache: Path, show: Progress) -> dict[str, Path]:
    """Map scene → its view set: the user's, rendered, or from the cache."""
    if plan.view_set:
        given = dict(zip(plan.scenes, map(Path, plan.view_set), strict=True))
        for scene, path in given.items():
            for note in source_of(path).notes:
                show.line(f"view set {scene}: {note}")
        return given
    folders: dict[str, Path] = {}
    for event in render_view_sets(plan.scenes, plan.views, cache, plan.scene_file, plan.render_limit):
        show.rendered(event, len(plan.scenes))
        if event.path is not None:
            folders[event.scene] = event.path
    return folders


def render_view_sets(
    scenes: tuple[str, ...],
    views: ViewSettings,
    cache: Path,
    scene_file: str | None = None,
    limit: float | None = None,
    threads: int | None = None,
) -> Generator[RenderProgress]:
    """Yield progress, with a `path` for each finished scene. Raises `InputError` with the renderer's message. By
    default all cores render.

    With `scene_file`, only that scene is rendered, and `InputError` is also raised if its process crashes, or if
    loading or a view takes longer than `limit` seconds (default `usual_limit`; otherwise there is no limit). Finished
    views are kept. If Dr.Jit crashes its process, the missing scenes are rendered with `scalar_rgb`.
    """
    missing = list(scenes)
    if scene_file is not None and limit is None:
        limit = usual_limit(views)
    how = [*sizes_of(views), *_words({"--integrator": _forced_integrator(views), "--threads": threads})]
    for variant in ([], ["--variant", "scalar_rgb"]):
        named = missing if scene_file is None else ["--scene-file", scene_file]
        try:
            words = [*named, "--view-sets", str(cache), *variant, *how]
            for event in _render(words, tuple(missing), scene_file, limit):
                if event.path is not None:
                    missing.remove(event.scene)
                yield event
            return
        except _Aborted as error:
            if variant and scene_file is None:
                raise
            if variant:
                raise InputError(f"--scene-file {scene_file}: {error}; repair or simplify the scene") from error


@dataclass(frozen=True)
class Arrival:
    """Progress of the renderer, and the groups that can train from now on, each with its place in the plan."""

    rendered: RenderProgress | None
    """None after the last."""
    tasks: list[tuple[int, GroupTask]]


class Arriving:
    """The scenes of the catalogue, rendered in another process while the groups of those that are ready train.

    The renderer takes the place of some workers, so that no core waits for it and the first scores come early. Cells
    train beside other work throughout the run: first beside the renderer, later beside other cells.
    """

    def __init__(
        self, plan: Plan, cache: Path, machine: Machine, ready: Callable[[str, Path], list[GroupTask]]
    ) -> None:
        """Begin to render or check the view sets; `ready` returns the groups of each complete one, in `receive`."""
        self._places = max(1, machine.workers // 2)
        """The number of workers in whose place the renderer runs."""
        self._ready = ready
        self._order = {group: place for place, group in enumerate(plan.groups())}
        threads = self._places * machine.threads if machine.workers > 1 else available_cores()
        self.connection, sending = multiprocessing.Pipe(duplex=False)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._send, args=(sending, plan, cache, threads), daemon=True)
        self._thread.start()

    @property
    def places(self) -> int:
        """Return the number of workers that must wait; 0 after the last arrival."""
        return 0 if self.connection.closed else self._places

    def receive(self) -> Arrival:
        """Wait for the next arrival. Raises what the renderer raised."""
        message = self.connection.recv()
        if not isinstance(message, RenderProgress):
            self.connection.close()
            if message is not None:
                raise message
            return Arrival(None, [])
        tasks = [] if message.path is None else self._ready(message.scene, message.path)
        return Arrival(message, [(self._order[task.scene, task.seed], task) for task in tasks])

    def stop(self) -> None:
        """End the renderer after its current view, which is kept for the next run."""
        self._stopped.set()
        self.connection.close()

    def _send(self, sending: Connection, plan: Plan, cache: Path, threads: int) -> None:
        events = render_view_sets(plan.scenes, plan.views, cache, threads=threads)
        try:
            for event in events:
                if self._stopped.is_set():
                    return
                sending.send(event)
            sending.send(None)
        except Exception as error:
            if not self._stopped.is_set():
                sending.send(error)
        finally:
            events.close()


def is_cached(scene: str, views: ViewSettings, cache: Path) -> bool:
    """Return whether a scene of the catalogue is stored, provided that the folder of its name is complete."""
    from scenes.rendering.order import NoiseTarget
    from scenes.rendering.store import is_stored

    counts = {"train": views.train, "val": views.val, "test": views.test}
    most, ceilings = (views.spp_train, views.spp_test), (views.ceiling_train_db, views.ceiling_test_db)
    train, test = (n if db is None else NoiseTarget(db, n) for n, db in zip(most, ceilings, strict=True))
    spp = {"train": train, "val": train, "test": test}
    return is_stored(scene, views.resolution, counts, spp, cache, _forced_integrator(views))


def _forced_integrator(views: ViewSettings) -> str | None:
    if "participating_media" in views.no_need:
        return "path"
    return "volpath" if "participating_media" in views.need else None


MEGASAMPLE, SCALAR_MEGASAMPLE, MEGASAMPLE_CORES = (0.2, 0.9), (0.6, 1.6), 2
"""The range over scenes of seconds of Mitsuba's path tracer, compiled by LLVM and scalar, and the number of cores."""


def rendering_seconds(views: ViewSettings, scenes: int) -> Range:
    """Return the seconds of rendering a number of scenes on all cores; at best the speed grows with the cores."""
    scale, megasample = MEGASAMPLE_CORES / available_cores(), MEGASAMPLE if llvm_libraries() else SCALAR_MEGASAMPLE
    megasamples = scenes * sum(views.samples()) / 2 * views.resolution**2 / 1e6
    return scale * megasample[0] * megasamples, max(scale, 1.0) * megasample[1] * megasamples


def usual_limit(views: ViewSettings) -> float:
    """Return the maximum seconds of a view; for large views four times the slower variant's seconds."""
    megasamples = views.resolution**2 * max(views.spp_train, views.spp_test) / 1e6
    return max(RENDER_LIMIT, 4 * SCALAR_MEGASAMPLE[1] * megasamples)


BEAT_SECONDS = 15.0
"""The seconds between two signs of life while no view is finished."""


class _Aborted(RuntimeError):
    """A signal ended the renderer."""


def sizes_of(views: ViewSettings) -> list[str]:
    """Return the options of `python -m scenes render` for the number and size of views."""
    names = ("resolution", "train", "val", "test", "spp_train", "spp_test")
    sizes = {f"--{name.replace('_', '-')}": getattr(views, name) for name in names}
    return _words({**sizes, "--ceiling-train": views.ceiling_train_db, "--ceiling-test": views.ceiling_test_db})


def _words(options: dict[str, object]) -> list[str]:
    return [word for name, value in options.items() if value is not None for word in (name, str(value))]


def _render(
    words: list[str], scenes: tuple[str, ...], scene_file: str | None, limit: float | None
) -> Iterator[RenderProgress]:
    command = [sys.executable, "-m", "scenes", "render", *words]
    with tempfile.TemporaryFile("w+") as complaints:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=complaints, text=True)
        try:
            remaining = iter(scenes)
            now, began = RenderProgress(next(remaining), 0, 0, doing="loading"), time.monotonic()
            for message in _messages(process, min(BEAT_SECONDS, (limit or math.inf) / 10)):
                seconds = time.monotonic() - began
                if message is not None:
                    event = _event(message)
                    yield event
                    now = replace(event, note="")
                    if event.path is not None:
                        now = RenderProgress(next(remaining, event.scene), 0, 0, doing="loading")
                    began = time.monotonic()  # the consumer's time for the event does not count
                elif limit is not None and seconds >= limit:
                    process.kill()
                    where = f"--scene-file {scene_file}" if scene_file else now.scene
                    raise InputError(
                        f"{where}: {now.doing} took more than {limit:g} s; simplify the scene, lower --resolution or "
                        "raise --render-limit; finished views are kept"
                    )
                else:
                    yield replace(now, doing=f"{now.doing} for {seconds:.0f} s")
            code = process.wait()
        finally:
            if process.poll() is None:
                process.kill()  # SIGTERM could take long
                process.wait()
        complaints.seek(0)
        complaint = complaints.read().strip()
    if code == 2:
        raise InputError(complaint.removeprefix("scenes: "))
    if code < 0:
        why = "as the system does where memory runs out" if -code == signal.SIGKILL else complaint[-2000:]
        raise _Aborted(f"{now.doing} was ended by signal {-code} ({signal.Signals(-code).name}), {why}")
    if code:
        raise RuntimeError(f"rendering ended with exit code {code}: {complaint[-2000:]}")


def _messages(process: "subprocess.Popen[str]", beat: float) -> Iterator[JsonObject | None]:
    """Yield the renderer's messages, and None after each `beat` seconds without one; after its end, when a child
    process may keep its pipe open, until two beats without one.
    """
    messages: queue.Queue[JsonObject | None] = queue.Queue()
    output = process.stdout
    assert isinstance(output, io.TextIOWrapper)

    def read() -> None:
        try:
            with output, contextlib.suppress(ValueError, OSError):
                output.reconfigure(errors="replace")  # a user's scene may print anything
                for line in output:
                    if (message := _message(line)) is not None:
                        messages.put(message)
        finally:
            messages.put(None)

    threading.Thread(target=read, daemon=True).start()
    ended = False
    while True:
        try:
            message = messages.get(timeout=beat)
        except queue.Empty:
            if ended:
                return
            ended = process.poll() is not None
            yield None
            continue
        if message is None:
            return
        yield message


def _event(message: JsonObject) -> RenderProgress:
    path = Path(message["path"]) if message.get("path") else None
    done, total = message.get("done", 0), message.get("total", 0)
    view = message.get("view")
    doing = f"view {view}" if view else "the end" if total else "loading"
    kept, share = message.get("kept", 0), message.get("share", 0.0)
    return RenderProgress(message["scene"], done, total, path, message.get("note", ""), doing, kept, share)


def _message(line: str) -> JsonObject | None:
    """Return the message, or None for a line that a user's scene printed."""
    try:
        message = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return message if isinstance(message, dict) and isinstance(message.get("scene"), str) else None
