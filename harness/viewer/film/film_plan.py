"""The frames of a film, those that exist already, and the estimated cost of the others."""

import time
from dataclasses import dataclass
from pathlib import Path

import torch

from harness.playback.cached import CachedMethod
from harness.playback.run_loader import FinishedRun, TrainedCell
from harness.playback.store import ViewStore
from harness.training.batches import Camera
from harness.training.scoring.evaluate import View, render_view
from harness.training.trainer import Diverged
from harness.viewer.film.frames import FrameFolder
from harness.viewer.film.takes import FilmSpec, Take, take_of
from scenes.files.errors import InputError

BYTES_PER_PIXEL = 23
"""The maximum of bytes per pixel of a frame: 3 in its PNG and 20 in its EXR."""
WARM_UP_PIXELS = 4
"""The width of a picture that is rendered before the first timed one."""


@dataclass
class Part:
    take: Take
    method: str
    frames: FrameFolder
    keys: list[str]
    missing: list[int]
    cached: int


@dataclass
class FilmPlan:
    run: FinishedRun
    spec: FilmSpec
    folder: Path
    device: torch.device
    store: ViewStore
    use_cache: bool
    parts: list[Part]
    seconds: dict[str, float]
    """Map method → the seconds of rendering a frame, for methods with frames to render."""

    def lines(self) -> list[str]:
        parts, lens = self.parts, self.parts[0].take.cameras[0]
        frames = sorted({len(part.keys) for part in parts})
        count, cached = sum(len(part.keys) for part in parts), sum(part.cached for part in parts)
        missing = sum(len(part.missing) for part in parts)
        pixels = sum(part.take.cameras[0].width * part.take.cameras[0].height * len(part.missing) for part in parts)
        cost = sum(self.seconds.get(part.method, 0.0) * (len(part.missing) - part.cached) for part in parts)
        measured = ", ".join(f"{method} {1e3 * spent:.0f} ms" for method, spent in self.seconds.items())
        return [
            f"film: {self.spec.path}, {' or '.join(map(str, frames))} frames of {lens.width} × {lens.height} pixels",
            f"  scenes   {' '.join(dict.fromkeys(part.take.scene.name for part in parts))}",
            f"  methods  {' '.join(dict.fromkeys(part.method for part in parts))}, seed {self.spec.seed}",
            f"  folder   {self.folder}",
            f"  frames   {count}: {count - missing} there, {cached} in the view cache, {missing - cached} to render",
            f"  estimated cost: {cost:.1f} s of rendering{f' ({measured} per frame)' if measured else ''}, "
            f"{pixels * BYTES_PER_PIXEL / 1e6:.1f} MB of frames at most",
        ]


def plan_film(
    run: FinishedRun,
    scenes: list[str] | None,
    methods: list[str] | None,
    spec: FilmSpec,
    folder: Path,
    view_sets: Path,
    disk: Path | None,
    device: torch.device,
) -> FilmPlan:
    """Load every cell of the film, so that faults are reported first; without `disk` there is no view cache."""
    shown = run.shown_methods(methods)
    store = ViewStore(0, disk)
    parts = []
    seconds: dict[str, float] = {}
    for scene in run.scenes(scenes):
        take = None
        for method in shown:
            cell = run.trained(scene, method, spec.seed, device)
            take = take or take_of(run, cell, spec, view_sets, len(shown))
            cached = CachedMethod(cell.learner, store, cell.chunk)
            keys = [cached.key(camera) for camera in take.cameras]
            frames = FrameFolder(folder / scene.name / method)
            missing = [number for number, key in enumerate(keys) if not frames.is_whole(number, key)]
            unseen = [number for number in missing if cached.lookup(take.cameras[number]) is None]
            parts.append(Part(take, method, frames, keys, missing, len(missing) - len(unseen)))
            if unseen and method not in seconds:
                render_frame(cell, take.cameras[unseen[0]].resized(WARM_UP_PIXELS))
                began = time.perf_counter()
                render_frame(cell, take.cameras[unseen[0]])
                seconds[method] = time.perf_counter() - began
    return FilmPlan(run, spec, folder, device, store, disk is not None, parts, seconds)


def render_frame(cell: TrainedCell, camera: Camera) -> View:
    """Render one view plainly; raises `InputError` if a pixel is not finite."""
    try:
        return render_view(cell.learner, camera.cameras(cell.learner.device), 0, cell.chunk)
    except Diverged as error:
        raise InputError(
            f"{cell.scene.name}, {cell.cell.method}: {error}; leave the method out with --methods"
        ) from error
