"""The context of the serving studies: a run, its cells ready to render, poses, timing, omissions."""

import functools
import hashlib
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from msgspec import structs

from harness.machine.provenance import PROGRAM, versions
from harness.playback.camera_paths import orbit
from harness.playback.run_loader import FinishedRun, TrainedCell
from harness.records.cells import SceneRecord
from harness.records.study import Check, Studies
from harness.studies.framework import Found, Shelf, Study, StudyContext
from harness.training.batches import Camera
from harness.training.checkpoints import checkpoint_path
from harness.training.learner import Learner
from harness.training.scoring.evaluate import View, render_view
from harness.training.trainer import Diverged
from scenes.files.errors import DamagedRecord, InputError


@dataclass(frozen=True)
class Sizes:
    """Timed renderings, and hits of each kind per rendering; views that are requested after a change; scenes on which
    attention is examined, views per scene, repeats of each refinement.
    """

    rounds: int = 20
    hits: int = 5
    confused: int = 3
    scenes: int = 3
    views: int = 3
    repeats: int = 3


@dataclass(frozen=True)
class ServingContext(StudyContext):
    """The part of a finished run to measure, and what its studies share.

    Several torch threads wait for each other if the machine is busy, and rendering then takes many times as long; on
    two idle cores, two threads render 1.4 to 1.6 times as fast as one. A hit always uses one thread.
    """

    run: FinishedRun
    scenes: list[SceneRecord]
    methods: list[str]
    seed: int
    width: int
    gaps: list[Check] = field(default_factory=list)
    """What the current study had to leave out, and why."""
    _cells: dict[tuple[str, str, int], TrainedCell | None] = field(default_factory=dict)

    def settings(self) -> dict[str, object]:
        scenes = [scene.name for scene in self.scenes]
        return {
            "scenes": scenes,
            "methods": self.methods,
            "seed": self.seed,
            "width": self.width,
            "threads": self.threads,
            "quick": self.quick,
            "device": self.device.type,
            "code": versions()[PROGRAM],
            "weights": {
                f"{scene}.{method}": hashlib.blake2b(path.read_bytes(), digest_size=16).hexdigest()
                for scene in scenes
                for method in self.methods
                if (path := checkpoint_path(self.out, scene, method, self.seed)).is_file()
            },
        }

    def valid(self, record: Studies, shelf: Shelf, asked: list[str]) -> Studies:
        return structs.replace(record, studies=[study for study in record.studies if not study.failed])

    def seconds(self, study: Study, asked: list[Study]) -> float:
        return study.seconds * (0.1 if self.quick else 1.0)

    @property
    def sizes(self) -> Sizes:
        """Return the usual sizes, or for a quick trial of the studies some at which no figure means anything."""
        quick = Sizes(rounds=3, hits=2, confused=2, scenes=1, views=1, repeats=1)
        return quick if self.quick else Sizes()

    def leave_out(self, what: str, why: str) -> None:
        gap = Check(what, None, why=why, owner="machine", status="not_available", id="left_out")
        if gap not in self.gaps:
            self.gaps.append(gap)

    def trained(self, scene: SceneRecord, method: str, seed: int | None = None) -> TrainedCell | None:
        """Return the cell ready to render; None if it cannot be rendered here. It must not be trained."""
        key = (scene.name, method, self.seed if seed is None else seed)
        if key not in self._cells:
            try:
                self._cells[key] = self.run.trained(scene, method, key[2], self.device)
            except (InputError, DamagedRecord) as reason:
                self.leave_out(f"{scene.name}, {method}, seed {key[2]}", f"cannot be rendered: {reason}")
                self._cells[key] = None
        return self._cells[key]

    def in_order(self, scenes: Sequence[str], methods: Sequence[str]) -> tuple[list[SceneRecord], list[str]]:
        """Return the scenes and methods of the run, the named ones first."""
        by_name = {scene.name: scene for scene in self.scenes}
        first = [by_name.pop(name) for name in scenes if name in by_name]
        preferred = [name for name in methods if name in self.methods]
        return [*first, *by_name.values()], list(dict.fromkeys([*preferred, *self.methods]))

    def camera(self, cell: TrainedCell, pose: np.ndarray) -> Camera:
        """Return the scene's lens at a pose, for pictures of the measured width."""
        return cell.camera(pose).resized(self.width)

    def orbit(self, scene: SceneRecord, frames: int) -> np.ndarray:
        """Return poses [frames, 4, 4] around a scene, at the distance of its views."""
        try:
            radius = self.run.view_radius(scene, self.view_sets)
        except InputError as reason:
            self.leave_out(f"the distance of the cameras of {scene.name}", f"4 scene units are taken: {reason}")
            radius = 4.0
        return orbit(frames, radius=radius)


Measure = Callable[[ServingContext], Iterator[Found]]


def study(measure: Measure) -> Measure:
    """Let a study end with what it left out; a run that it cannot render is a failing check."""

    @functools.wraps(measure)
    def measured(context: ServingContext) -> Iterator[Found]:
        context.gaps.clear()
        try:
            yield from measure(context)
        except (InputError, DamagedRecord, Diverged) as error:
            yield Check("this study", None, why=" ".join(str(error).split()), status="fail", id="failed")
        yield from context.gaps

    return measured


def plain(learner: Learner, camera: Camera, chunk: int) -> View:
    """Render as the run does for its scores: the reference of all measurements here."""
    return render_view(learner, camera.cameras(learner.device), 0, chunk)


Clock = Callable[[], float]
"""Seconds that never decrease."""
CLOCK: Clock = time.perf_counter


def brief(seconds: float) -> str:
    """Format a time such as 18.3 µs, 45.2 ms, 1.20 s."""
    size, unit = next(((size, unit) for size, unit in ((1.0, "s"), (1e-3, "ms")) if seconds >= size), (1e-6, "µs"))
    return f"{significant(seconds / size)} {unit}"


def significant(value: float) -> str:
    """Format three significant digits, or all digits of a larger integer: 0.0123, 45.2, 1925."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:#.3g}".rstrip(".")


def factor(id: str, what: str, ratios: Sequence[float]) -> Check:
    """Return the geometric mean and the range of ratios over several cases."""
    mean = math.exp(float(np.mean(np.log(ratios))))
    spread = float(min(ratios)), float(max(ratios))
    return Check(what, mean, unit="×", owner="machine", spread=spread, repeats=len(ratios), id=id)
