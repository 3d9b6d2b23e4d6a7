"""A finished run as something to look at: its methods, with the weights that training left, ready to render."""

import types
import typing
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch

from baselines.catalog import CATALOG
from baselines.contract import Box
from harness.camera import Camera
from harness.camera_paths import mean_distance
from harness.checkpoints import checkpoint_path, load_checkpoint
from harness.learner import Learner, learner_for
from harness.lockstep import needs_view_direction_of, stream_of
from harness.needed import with_needs
from harness.plan import known_names
from harness.records import CellRecord, RunRecord, SceneRecord, cell_path, read_cell, read_run, records_folder
from harness.schedule import Budget
from harness.settings import ScoreSettings, TrainSettings
from scenes.errors import InputError
from scenes.transforms import read_transforms, transforms_file
from scenes.view_set import ViewSet, read_view_set
from scenes.viewpoints import RADIUS

VIEW_SETS = Path("out/view_sets")
"""Where view sets are cached if nothing else is said."""

One = TypeVar("One")


@dataclass(frozen=True)
class TrainedCell:
    """One method on one scene with one seed, after its training."""

    scene: SceneRecord
    cell: CellRecord
    learner: Learner

    @property
    def chunk(self) -> int:
        """Rays a call with which it was scored: part of the picture where a density depends on the call."""
        return int(self.cell.settings["score"]["chunk"])

    def camera(self, camera_to_world: np.ndarray) -> Camera:
        """The lens of the scene's views at a pose."""
        one, focal = self.scene, float(self.cell.settings["view_set"]["focal"])
        return Camera(camera_to_world, one.width, one.height, focal, one.near, one.far)


@dataclass(frozen=True)
class FinishedRun:
    """What an output folder holds."""

    out: Path
    run: RunRecord

    @staticmethod
    def of(out: Path) -> "FinishedRun":
        """Raises `InputError` where there is no run, and `DamagedRecord` where it cannot be read."""
        if not (records_folder(out) / "run.json").is_file():
            raise InputError(f"{out}: holds no run; give the output folder of one, for instance out/latest")
        return FinishedRun(out, read_run(out))

    def scenes(self, asked: list[str] | None, option: str = "--scenes") -> list[SceneRecord]:
        """Those of `asked`, or all; raises `InputError`, naming the option, for a name that the run does not have."""
        known = {scene.name: scene for scene in self.run.scenes}
        return [known[name] for name in known_names(option, asked or list(known), list(known))]

    def methods(self, asked: list[str] | None) -> list[str]:
        """Those of `asked`, or all; raises `InputError` for a name that the run does not have."""
        known = list(self.run.methods)
        return list(known_names("--methods", asked or known, known))

    def is_trained(self, scene: str, method: str, seed: int) -> bool:
        """Whether its weights are there."""
        return checkpoint_path(self.out, scene, method, seed).is_file()

    def trained(self, scene: SceneRecord, method: str, seed: int, device: torch.device) -> TrainedCell:
        """Raises `InputError` for a cell that was not trained to its end, or whose checkpoint is not whole, and
        `NotAvailable` for a method that this machine cannot render.
        """
        name = f"{scene.name}, {method}, seed {seed}"
        path = cell_path(self.out, scene.name, method, seed)
        if not path.is_file():
            raise InputError(f"{self.out}: {name} was not trained; choose another one, or go on with --resume")
        cell = read_cell(path)
        if cell.status != "done":
            raise InputError(f"{self.out}: {name} is {cell.status} ({cell.reason}); there is nothing to look at")
        if method not in CATALOG:
            raise InputError(f"{path}: method {method!r} is not in this version's catalogue: {' '.join(CATALOG)}")
        settings = from_plain(TrainSettings, cell.settings.get("train"), path)
        budget = from_plain(Budget, cell.settings.get("budget"), path)
        from_plain(ScoreSettings, cell.settings.get("score"), path)
        if not isinstance(cell.settings.get("view_set"), dict) or "focal" not in cell.settings["view_set"]:
            raise InputError(f"{path}: recorded before the focal length of its views was; run again to look at it")
        box = Box(*(torch.tensor(corner, dtype=torch.float32, device=device) for corner in scene.bounds))
        directed = needs_view_direction_of([row.what for row in scene.left_out])
        learner = learner_for(method, box, settings, budget, stream_of(scene.name, seed), device, directed)
        load_checkpoint(learner, checkpoint_path(self.out, scene.name, method, seed), cell.steps)
        return TrainedCell(scene, cell, learner)

    def view_set(self, scene: SceneRecord, cache: Path = VIEW_SETS) -> Path:
        """The folder of its posed images: in `cache`, or in the folder `view_sets` beside the run; one that was given
        with `--view-set` is where it was. Raises `InputError` where it is not there any more.
        """
        given = self.run.settings.get("view_set")
        places = [Path(given)] if given else [cache / scene.view_set, self.out.parent / "view_sets" / scene.view_set]
        found = next((place for place in places if transforms_file(place, "train").is_file()), None)
        if found is None:
            tried = " or ".join(str(place) for place in places)
            raise InputError(f"{tried}: the view set of {scene.name} is not there; name its cache with --view-sets")
        return found

    def views(
        self,
        scene: SceneRecord,
        cache: Path = VIEW_SETS,
        width: int | None = None,
        train: int = 0,
        geometry: bool = True,
        scratch: Path | None = None,
    ) -> ViewSet:
        """The test views that the run was scored on, at `width` pixels or the run's own, and `train` of the training
        views, evenly spread; with what the run's settings force in or out, and without depth and normals where no
        `geometry` is asked for. Decoded images go to `scratch`, a folder on a disk.

        Raises `InputError` for whatever is wrong with the view set, and for another rendering than the methods were
        trained on.
        """
        folder, asked = self.view_set(scene, cache), self.run.settings.get("views", {})
        found = read_view_set(
            folder,
            resolution=width or scene.width,
            splits=("train", "test") if train else ("test",),
            train_count=min(train, scene.views["train"]),
            test_count=scene.views["test"],
            geometry=("test",) if geometry else (),
            scratch=scratch,
        )
        if found.rendered.get("digest") != scene.rendered.get("digest"):
            raise InputError(
                f"{folder}: another rendering than the one that {scene.name} was trained on; name its cache with "
                "--view-sets"
            )
        return with_needs(found, tuple(asked.get("need", ())), tuple(asked.get("no_need", ())))

    def view_radius(self, scene: SceneRecord, cache: Path = VIEW_SETS) -> float:
        """How far from the origin its cameras stand, in scene units: known of our own scenes, of others the mean over
        the training cameras. Raises `InputError` where those are not there any more.
        """
        if scene.rendered:
            return RADIUS
        return mean_distance(read_transforms(self.view_set(scene, cache), "train").camera_to_world)


def from_plain(kind: type[One], data: Any, path: Path) -> One:
    """A frozen dataclass from what `asdict` and JSON made of it; raises `InputError` naming the file where a key is
    missing or unknown: settings that are silently other ones would render another picture.
    """
    try:
        found = _from_plain(kind, data)
    except (TypeError, KeyError, ValueError) as error:
        raise InputError(f"{path}: its settings are not those of this version ({error}); run again") from error
    return typing.cast(One, found)


def _from_plain(kind: Any, data: Any) -> Any:
    origin, parts = typing.get_origin(kind), typing.get_args(kind)
    if is_dataclass(kind):
        hints = typing.get_type_hints(kind)
        if not isinstance(data, dict) or set(data) != set(hints):
            unlike = sorted(set(data) ^ set(hints)) if isinstance(data, dict) else type(data).__name__
            raise ValueError(f"{getattr(kind, '__name__', kind)}: {unlike}")
        return typing.cast(type, kind)(**{name: _from_plain(hints[name], value) for name, value in data.items()})
    if origin is tuple and parts[-1] is ... and isinstance(data, (list, tuple)):
        return tuple(_from_plain(parts[0], value) for value in data)
    if origin is tuple and isinstance(data, (list, tuple)) and len(data) == len(parts):
        return tuple(_from_plain(part, value) for part, value in zip(parts, data, strict=True))
    if origin in (types.UnionType, typing.Union):
        return None if data is None and type(None) in parts else _from_plain(parts[0], data)
    if origin is typing.Literal and data in parts:
        return data
    if kind is float and type(data) in (int, float):
        return float(data)
    if kind in (bool, int, str) and type(data) is kind:
        return data
    raise ValueError(f"{data!r} is no {kind}")
