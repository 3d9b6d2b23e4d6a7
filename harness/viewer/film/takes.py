"""The takes of a scene: the cameras of a path, or the test views with their ground truth."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.playback.camera_paths import ELEVATION, PATHS
from harness.playback.run_loader import FinishedRun, TrainedCell
from harness.records.cells import SceneRecord
from harness.training.batches import Camera
from harness.viewer.film.frames import as_levels
from harness.viewer.film.panels import LARGEST, size_of
from scenes.files.errors import InputError
from scenes.view_sets.pixels import over_white
from scenes.view_sets.view_set import ViewSet
from scenes.view_sets.viewpoints import evenly_spread

FRAMES = 60
TRUTH = "ground truth"


@dataclass(frozen=True)
class FilmSpec:
    """The settings of a film, the same for all scenes; None: the default of the run or of the path."""

    path: str
    """The path, one of `harness.playback.camera_paths.PATHS`, or test."""
    frames: int | None
    resolution: int | None
    elevation: float | None
    seed: int

    @property
    def name(self) -> str:
        """Return the name of a folder, made of the settings that are not the defaults."""
        parts = {
            "frames": self.frames,
            "px": self.resolution,
            "degrees": None if self.elevation is None else f"{self.elevation:g}",
            "seed": self.seed or None,
        }
        return "-".join([self.path, *(f"{value}-{what}" for what, value in parts.items() if value is not None)])


@dataclass(frozen=True)
class Take:
    scene: SceneRecord
    cameras: tuple[Camera, ...]
    truth: ViewSet | None = None
    shown: tuple[int, ...] = ()

    def truth_levels(self, number: int) -> dict[str, np.ndarray]:
        """Return the ground truth of one frame by its label, uint8 [h, w, 3]; nothing if there is none."""
        if self.truth is None:
            return {}
        return {TRUTH: as_levels(over_white(self.truth.test.rgba[self.shown[number]]))}


def take_of(run: FinishedRun, cell: TrainedCell, spec: FilmSpec, view_sets: Path, methods: int) -> Take:
    """Make a take; raises `InputError` if the picture is too large, for too many test views, or without a view set."""
    take = _test_views(run, cell.scene, spec, view_sets) if spec.path == "test" else _path(run, cell, spec, view_sets)
    across, down = size_of(methods + (take.truth is not None), take.cameras[0].width, take.cameras[0].height)
    if max(across, down) > LARGEST:
        raise InputError(
            f"{methods} methods side by side make {across} × {down} pixels; a side has at most {LARGEST}: "
            "choose fewer --methods or a smaller --resolution"
        )
    return take


def _path(run: FinishedRun, cell: TrainedCell, spec: FilmSpec, view_sets: Path) -> Take:
    raised = {}
    if spec.path == "orbit":
        raised["elevation"] = ELEVATION if spec.elevation is None else float(np.radians(spec.elevation))
    radius = run.view_radius(cell.scene, view_sets)
    poses = PATHS[spec.path](FRAMES if spec.frames is None else spec.frames, radius=radius, **raised)
    lens = cell.camera(poses[0])
    if spec.resolution is not None:
        lens = lens.resized(spec.resolution)
    return Take(cell.scene, tuple(lens.at(pose) for pose in poses))


def _test_views(run: FinishedRun, scene: SceneRecord, spec: FilmSpec, view_sets: Path) -> Take:
    views = run.views(scene, view_sets, spec.resolution, geometry=False)
    poses = views.test.camera_to_world
    shown = evenly_spread(len(poses) if spec.frames is None else spec.frames, poses, "test views")
    lens = Camera(poses[0], views.width, views.height, views.focal, views.near, views.far)
    return Take(scene, tuple(lens.at(poses[index]) for index in shown), views, tuple(map(int, shown)))
