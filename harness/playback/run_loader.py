"""The loader of a finished run: its methods, with the weights that training left, ready to render."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import msgspec
import numpy as np
import torch

from baselines.catalog import CATALOG, UNTRAINED
from baselines.composition import Parts
from baselines.contract import Box
from baselines.methods.explicit import GaussianSettings, PlaneSettings, TableSettings, VoxelSettings
from harness.plan.names import known_names
from harness.plan.plugins import method_named, require_methods
from harness.plan.schedule import Budget
from harness.plan.settings import ScoreSettings, TrainSettings
from harness.records.cells import (
    CellRecord,
    RunRecord,
    SceneRecord,
    cell_path,
    checkpoint_name,
    read_cell,
    read_run,
    records_folder,
)
from harness.training.batches import Camera
from harness.training.checkpoints import checkpoint_path, load_checkpoint
from harness.training.learner import Job, Learner
from harness.training.lockstep import stream_of
from harness.training.make_learner import learner_for
from scenes.files.errors import DamagedRecord, InputError, shown
from scenes.modelling.needs import part_name, with_needs
from scenes.view_sets.formats.foreign import source_of
from scenes.view_sets.formats.transforms import transforms_file
from scenes.view_sets.source import Region
from scenes.view_sets.view_set import ViewSet, read_view_set
from scenes.view_sets.viewpoints import RADIUS

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

VIEW_SETS = Path("out/view_sets")
"""The default cache of view sets."""

Settings = TypeVar("Settings", bound="DataclassInstance")


@dataclass(frozen=True)
class TrainedCell:
    """One method on one scene with one seed, after its training."""

    scene: SceneRecord
    cell: CellRecord
    learner: Learner

    @property
    def chunk(self) -> int:
        """Return the rays per chunk of its scoring; the picture depends on them if its density does."""
        return int(self.cell.settings["score"]["chunk"])

    def camera(self, camera_to_world: np.ndarray) -> Camera:
        scene, focal = self.scene, float(self.cell.settings["view_set"]["focal"])
        return Camera(camera_to_world, scene.width, scene.height, focal, scene.near, scene.far)


class ForcedParts(msgspec.Struct):
    need: tuple[str, ...] = ()
    no_need: tuple[str, ...] = ()


@dataclass(frozen=True)
class FinishedRun:
    """A run that has a record, in its output folder."""

    out: Path
    run: RunRecord

    @staticmethod
    def of(out: Path) -> "FinishedRun":
        """Load a run; raises `InputError` if there is none, and `DamagedRecord` if it cannot be read."""
        if not (records_folder(out) / "run.json").is_file():
            raise InputError(f"{out}: holds no run; give the output folder of one, for instance out/latest")
        run = read_run(out)
        if not run.scenes or not run.main_methods:
            raise DamagedRecord(f"{records_folder(out) / 'run.json'}: names no scene or no method; run again")
        for name in (*run.methods, *(part for scene in run.scenes for part in (scene.name, scene.view_set))):
            # names become parts of paths
            if not name.isprintable() or set(name) & set("/\\") or name in ("", ".", ".."):
                raise DamagedRecord(f"{records_folder(out) / 'run.json'}: {name!r} is not a valid name; run again")
        return FinishedRun(out, run)

    def scenes(self, asked: list[str] | None, option: str = "--scenes") -> list[SceneRecord]:
        """Return the scenes of these names, or all; raises `InputError` with the option for an unknown name."""
        known = {scene.name: scene for scene in self.run.scenes}
        return [known[name] for name in known_names(option, asked or list(known), list(known))]

    def methods(self, asked: list[str] | None) -> list[str]:
        """Return the methods `asked` for, or those of all scenes; raises `InputError` for an unknown name."""
        return list(known_names("--methods", asked or self.run.main_methods, list(self.run.methods)))

    def shown_methods(self, asked: list[str] | None) -> list[str]:
        """Return the methods `asked` for, or the baseline and the first contender."""
        every = self.methods(None)
        roles = self.run.roles.among(every)
        return self.methods(asked or [roles.baseline, *roles.contenders(every)[:1]])

    def is_trained(self, scene: str, method: str, seed: int) -> bool:
        return checkpoint_path(self.out, scene, method, seed).is_file()

    def trained(self, scene: SceneRecord, method: str, seed: int, device: torch.device) -> TrainedCell:
        """Load a trained cell; raises `InputError` if its training did not end or its checkpoint is damaged, and
        `NotAvailable` if this machine cannot render the method.
        """
        name = f"{scene.name}, {method}, seed {seed}"
        path = cell_path(self.out, scene.name, method, seed)
        if not path.is_file():
            raise InputError(f"{self.out}: {name} was not trained; choose another one, or train it with --resume")
        cell = read_cell(path)
        if cell.status != "done":
            raise InputError(f"{self.out}: {name} is {cell.status} ({cell.reason}); there is nothing to look at")
        require_methods([method])
        if method not in CATALOG and method not in UNTRAINED:
            raise InputError(
                f"{path}: method {method!r} is not in this version's catalogue, and no installed package offers it: "
                f"{' '.join(CATALOG)}"
            )
        settings = from_plain(TrainSettings, cell.settings.get("train"), path)
        if (usual := method_named(method).settings) is not None:
            own = from_plain(type(usual), settings.own.get(method), path)
            settings = replace(settings, own={method: own})
        budget = from_plain(Budget, cell.settings.get("budget"), path)
        from_plain(ScoreSettings, cell.settings.get("score"), path)
        if not isinstance(cell.settings.get("view_set"), dict) or "focal" not in cell.settings["view_set"]:
            raise InputError(f"{path}: recorded before the focal length of its views was; run again to look at it")
        checkpoint = checkpoint_path(self.out, scene.name, method, seed)
        _require_possible(settings, settings.own.get(method), path, checkpoint)
        if [len(corner) for corner in scene.bounds] != [3, 3] or not scene.bounds[0] < scene.bounds[1]:
            raise DamagedRecord(f"{self.out}: {scene.name}: bounds {shown(scene.bounds)} are not a box; run again")
        lower, upper = (torch.tensor(corner, dtype=torch.float32, device=device) for corner in scene.bounds)
        box = Box(lower, upper)
        directed = "view_direction" not in [part_name(row.what, row.name) for row in scene.left_out]
        learner = learner_for(Job(method, box, settings, budget, stream_of(scene.name, seed), device, directed))
        written = cell.files.get(checkpoint_name(scene.name, method, seed))  # none in old records
        load_checkpoint(learner, checkpoint, cell.steps, written)
        trained = TrainedCell(scene, cell, learner)
        try:
            trained.camera(np.eye(4))
        except (TypeError, ValueError, OverflowError) as error:
            raise DamagedRecord(f"{path}: no camera of {scene.name}: {error}; run again") from error
        return trained

    def view_set(self, scene: SceneRecord, cache: Path = VIEW_SETS) -> Path:
        """Return the folder of its posed images: that of `--view-set`, else one in `cache` or in the folder `view_sets`
        next to the run. Raises `InputError` if there is none any more.
        """
        given = self.run.settings.get("view_set")
        if isinstance(given, list):  # one per scene, if there are several
            given = given[self.run.settings["scenes"].index(scene.name)]
        places = [Path(given)] if given else [cache / scene.view_set, self.out.parent / "view_sets" / scene.view_set]
        for place in places:
            if place.exists() if given else transforms_file(place, "train").is_file():
                return place
        tried = " or ".join(map(str, places))
        raise InputError(f"{tried}: the view set of {scene.name} is missing; name its cache with --view-sets")

    def views(
        self,
        scene: SceneRecord,
        cache: Path = VIEW_SETS,
        width: int | None = None,
        train: int = 0,
        geometry: bool = True,
        scratch: Path | None = None,
    ) -> ViewSet:
        """Read the test views that the run was scored on, at `width` pixels or the run's width, and `train` evenly
        spread training views; with the parts that the run forced in or out, and with `geometry` depth and normals.
        Decoded images go to the folder `scratch`. Raises `InputError` for any fault of the view set, and if the run was
        trained on another.
        """
        path, asked = records_folder(self.out) / "run.json", self.run.settings.get("views", {})
        if missing := sorted({"train", "test"} - set(scene.views)):
            raise DamagedRecord(f"{path}: {scene.name}: views lacks the number of {' '.join(missing)}; run again")
        folder = self.view_set(scene, cache)
        try:
            forced = msgspec.convert(asked, ForcedParts)
            region = Region(tuple(np.ravel(scene.bounds).tolist()), scene.near, scene.far)
        except msgspec.ValidationError as error:
            raise DamagedRecord(f"{path}: settings.views {shown(asked)}: {error}; run again") from error
        except InputError as error:
            raise DamagedRecord(f"{path}: {scene.name}: {error}; run again") from error
        views = read_view_set(
            folder,
            resolution=width or scene.width,
            splits=("train", "test") if train else ("test",),
            counts={"train": min(train, scene.views["train"]), "test": scene.views["test"]},
            geometry=("test",) if geometry else (),
            scratch=scratch,
            region=region,
        )
        if views.rendered.get("digest") != scene.rendered.get("digest"):
            raise InputError(
                f"{folder}: another rendering than the one that {scene.name} was trained on; name its cache with "
                "--view-sets"
            )
        return with_needs(views, forced.need, forced.no_need)

    def view_radius(self, scene: SceneRecord, cache: Path = VIEW_SETS) -> float:
        """Return the mean distance of its training cameras from the origin in scene units; raises `InputError`."""
        if scene.rendered:
            return RADIUS
        frames = source_of(self.view_set(scene, cache)).frames("train")
        if frames is None:
            return RADIUS
        return float(np.linalg.norm(frames.camera_to_world[:, :3, 3], axis=-1).mean())


LARGEST = {
    "depth": 64,
    "width": 8192,
    "colour_layers": 64,
    "colour_width": 8192,
    "position_bands": 64,
    "direction_bands": 64,
    "grid.cells": 512,
    **dict.fromkeys(("bins", "first_bins", "fine_bins"), 1 << 16),
    **dict.fromkeys(("rays", "smoothed", "entries"), 1 << 24),
    **dict.fromkeys(("first", "most"), 1 << 22),
    **dict.fromkeys(("nodes", "cells"), 4096),
    "finest": 512,
}
"""The maximum of each size in the shared settings, or in the own settings of an explicit method."""
EXPLICIT = (VoxelSettings, PlaneSettings, TableSettings, GaussianSettings)


def _require_possible(settings: TrainSettings, own: object, path: Path, checkpoint: Path) -> None:
    """Raise `InputError` for impossible sizes, before memory is allocated."""
    network = own.size(settings.network) if isinstance(own, Parts) else settings.network
    shared = {**asdict(network), **asdict(settings), "grid.cells": settings.grid.cells}
    for sizes in (shared, asdict(own) if isinstance(own, EXPLICIT) else {}):
        for name in sizes.keys() & LARGEST.keys():
            largest = LARGEST[name]
            for value in np.ravel(sizes[name]).tolist():
                if not 0 <= value <= largest:
                    raise InputError(f"{path}: {name} {value}: must lie between 0 and {largest}; run again")
    least = 4 * max(0, network.depth - 2) * network.width**2
    if isinstance(own, Parts) and checkpoint.is_file() and least > checkpoint.stat().st_size:
        raise InputError(
            f"{checkpoint}: has fewer bytes than the weights of {network.depth} layers of {network.width}, which its "
            "record names; run again"
        )


def from_plain(kind: type[Settings], data: object, path: Path) -> Settings:
    """Make a frozen dataclass from the JSON of its `asdict`; raises `InputError` for a missing or unknown key."""
    try:
        settings = msgspec.convert(data, kind)
        known = settings.settings() if isinstance(settings, Budget) else asdict(settings)
        if unlike := _unlike(known, data):
            raise ValueError(f"{kind.__name__}: {unlike}")
    except (msgspec.ValidationError, ValueError) as error:
        raise InputError(f"{path}: its settings are not those of this version ({error}); run again") from error
    return settings


def _unlike(first: object, second: object) -> str:
    """Return the keys that only one of two JSON documents has."""
    if not (isinstance(first, dict) and isinstance(second, dict)):
        return ""
    inner = (_unlike(first[key], second[key]) for key in first.keys() & second.keys())
    return " ".join(filter(None, [*sorted(first.keys() ^ second.keys()), *inner]))
