"""The context of the serving studies: the run, its cells ready to render, poses, ground truth, timing."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np
import torch

from harness.execution.progress import Progress
from harness.playback.camera_paths import orbit
from harness.playback.run_loader import FinishedRun, TrainedCell
from harness.records.cells import SceneRecord
from harness.records.json_record import DamagedRecord
from harness.records.serving_record import Latency, Pair, Timed
from harness.training.batches import Camera
from harness.training.evaluate import View, render_view
from harness.training.learner import Learner
from harness.training.metrics import mse
from scenes.files.errors import InputError
from scenes.view_sets.pixels import over_white
from scenes.view_sets.view_set import ViewSet


@dataclass(frozen=True)
class Sizes:
    """The sizes of the measurements."""

    rounds: int
    """The renderings that are timed, each with hits of every level around it."""
    hits: int
    """The hits of every level in a round."""
    orbit: int
    """The views of a camera path."""
    walks: int
    """The seeds of a walk whose hits are counted."""
    confused: int
    """The views that are requested by a key of the pose alone."""
    extra_steps: int
    """The steps of further training, for slightly later weights."""
    scenes: int
    """The scenes on which attention is examined."""
    views: int
    """The views of each of these."""
    repeats: int
    """The repeats of every refinement, for a median of its seconds."""
    shared: int
    """The repeats of every picture with its samples distributed, of one view per scene."""
    reference_bins: int
    first_frames: int


FULL = Sizes(
    rounds=20, hits=5, orbit=12, walks=20, confused=3, extra_steps=10, scenes=3, views=3, repeats=3, shared=2,
    reference_bins=512, first_frames=5,
)  # fmt: skip
QUICK = Sizes(
    rounds=3, hits=2, orbit=4, walks=3, confused=2, extra_steps=2, scenes=1, views=1, repeats=1, shared=1,
    reference_bins=64, first_frames=1,
)  # fmt: skip
"""Sizes at which no figure means anything, to try the studies themselves."""


@dataclass
class ServingContext:
    """A finished run and what of it is requested."""

    run: FinishedRun
    scenes: list[SceneRecord]
    methods: list[str]
    seed: int
    width: int
    device: torch.device
    view_sets: Path
    scratch: Path
    """A folder on a disk that is removed after the run; pictures for the report lie under it as they will under the
    run.
    """
    quick: bool
    show: Progress
    deadline: float | None = None
    """The time by `clock` after which nothing is begun."""
    clock: Callable[[], float] = time.monotonic
    is_late: bool = False
    """Whether something was left out because of the deadline."""
    left_out: list[str] = field(default_factory=list)
    """What cannot be measured and why, one sentence each, no sentence twice."""
    _cells: dict[tuple[str, str, int], TrainedCell | None] = field(default_factory=dict)
    _views: dict[str, ViewSet | None] = field(default_factory=dict)

    @property
    def sizes(self) -> Sizes:
        return QUICK if self.quick else FULL

    def leave_out(self, sentence: str) -> None:
        """Add a sentence to `left_out`, once."""
        if sentence not in self.left_out:
            self.left_out.append(sentence)
            self.show.line(f"  left out: {sentence}")

    def is_over(self, rest: str) -> bool:
        """Whether the time is up: then `rest`, which comes next, is named as left out."""
        if self.deadline is None or self.clock() < self.deadline:
            return False
        self.leave_out(f"{rest}: not measured, as the time for it was over")
        self.is_late = True
        return True

    def trained(self, scene: SceneRecord, method: str, seed: int | None = None) -> TrainedCell | None:
        """Return the cell ready to render; None, with a sentence in `left_out`, if it cannot be rendered here. Nobody
        may train it.
        """
        key = (scene.name, method, self.seed if seed is None else seed)
        if key not in self._cells:
            try:
                self._cells[key] = self.run.trained(scene, method, key[2], self.device)
            except (InputError, DamagedRecord) as reason:
                self.leave_out(f"{scene.name}, {method}, seed {key[2]} cannot be rendered: {reason}")
                self._cells[key] = None
        return self._cells[key]

    def camera(self, cell: TrainedCell, pose: np.ndarray) -> Camera:
        """Return the scene's lens at a pose, in pictures of the width that is measured."""
        return cell.camera(pose).resized(self.width)

    def orbit(self, scene: SceneRecord, frames: int) -> np.ndarray:
        """Return poses [frames, 4, 4] around a scene, as far away as its views were taken from."""
        try:
            radius = self.run.view_radius(scene, self.view_sets)
        except InputError as reason:
            self.leave_out(f"orbits of {scene.name} are 4 scene units wide, as its cameras are not known: {reason}")
            return orbit(frames, radius=4.0)
        return orbit(frames, radius=radius)

    def views(self, scene: SceneRecord) -> ViewSet | None:
        """Return the run's own views at the measured width; None, with a sentence in `left_out`, if they are
        missing.
        """
        if scene.name not in self._views:
            self._views[scene.name] = self._read_views(scene)
        return self._views[scene.name]

    def _read_views(self, scene: SceneRecord) -> ViewSet | None:
        missing = f"without the ground truth of {scene.name}"
        if self.width > scene.width:
            self.leave_out(f"{missing}: its views are {scene.width} pixels wide, {self.width} are measured")
            return None
        try:
            found = self.run.views(scene, self.view_sets, self.width, train=TRAIN_VIEWS, scratch=self.scratch)
        except InputError as reason:
            self.leave_out(f"{missing}: {reason}")
            return None
        height = max(1, round(scene.height * self.width / scene.width))
        if (found.height, found.width) != (height, self.width):
            self.leave_out(f"{missing}: its views have {found.height} rows at this width, pictures have {height}")
            return None
        return found

    def test_poses(self, scene: SceneRecord, count: int) -> list[tuple[np.ndarray, np.ndarray | None]]:
        """Return `count` poses evenly spread over the test views, with their pictures over white [h, w, 3]; if the
        views are missing, poses of an orbit without pictures.
        """
        views = self.views(scene)
        if views is None or not len(views.test.names):
            return [(pose, None) for pose in self.orbit(scene, count)]
        test = views.test
        chosen = np.unique(np.linspace(0, len(test.names), count, endpoint=False).astype(int))
        return [(test.camera_to_world[index], over_white(test.rgba[int(index)])) for index in chosen]


TRAIN_VIEWS = 8
"""The views that a few more steps are trained on."""


def plain(learner: Learner, camera: Camera, chunk: int) -> View:
    """Return the picture as the run scored it: the reference of all measurements here."""
    return render_view(learner, camera.cameras(learner.device), 0, chunk)


def rmse(found: np.ndarray, wanted: np.ndarray) -> float:
    """Return the root of the mean square over everything; raises `ValueError` if a value is not finite."""
    return math.sqrt(mse(found, wanted))


One = TypeVar("One")
Clock = Callable[[], float]
"""Seconds that never decrease."""

CLOCK: Clock = time.perf_counter


def timed(call: Callable[[], One], clock: Clock = CLOCK) -> tuple[One, float]:
    """Return the result of a function, and its seconds. Whatever is rendered here ends as an array in memory, so that a
    device has finished by then.
    """
    began = clock()
    found = call()
    return found, clock() - began


def latency(
    scene: str, method: str, source: Timed, seconds: Sequence[float], rendering: Sequence[float] | None = None
) -> Latency:
    """Return the median and spread of timed requests and, against those of `rendering`, how many times as long
    rendering takes.

    Raises `ValueError` if there are none, and for seconds that are not positive: the clock is too coarse for them.
    """
    ratio, ratio_spread = None, None
    if rendering is not None:
        ratio = _quantile(rendering, 0.5) / _quantile(seconds, 0.5)
        ratio_spread = (
            _quantile(rendering, 0.25) / _quantile(seconds, 0.75),
            _quantile(rendering, 0.75) / _quantile(seconds, 0.25),
        )
    spread: Pair = (_quantile(seconds, 0.05), _quantile(seconds, 0.95))
    return Latency(scene, method, source, _quantile(seconds, 0.5), spread, len(seconds), ratio, ratio_spread)


def _quantile(seconds: Sequence[float], share: float) -> float:
    values = np.asarray(seconds, dtype=np.float64)
    if not len(values):
        raise ValueError("no call was timed")
    if not bool((values > 0.0).all()):
        raise ValueError(f"{float(values.min())} s for a call: the clock is too coarse, or ran backwards")
    return float(np.quantile(values, share))
