"""The loader of a finished run: its methods, with the weights that training left, ready to render."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import msgspec
import numpy as np
import torch

from baselines.catalog import CATALOG
from baselines.composition import Parts
from baselines.contract import Box
from baselines.methods.explicit import GaussianSettings, PlaneSettings, TableSettings, VoxelSettings
from harness.plan.names import known_names
from harness.plan.plugins import require_methods
from harness.plan.schedule import Budget
from harness.plan.settings import ScoreSettings, TrainSettings
from harness.playback.camera_paths import mean_distance
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
from harness.records.json_record import shown
from harness.training.batches import Camera
from harness.training.checkpoints import checkpoint_path, load_checkpoint
from harness.training.learner import Job, Learner
from harness.training.lockstep import stream_of
from harness.training.make_learner import learner_for
from scenes.files.errors import DamagedRecord, InputError
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
        """The rays per chunk with which it was scored: part of the picture if a density depends on the chunk."""
        return int(self.cell.settings["score"]["chunk"])

    def camera(self, camera_to_world: np.ndarray) -> Camera:
        scene, focal = self.scene, float(self.cell.settings["view_set"]["focal"])
        return Camera(camera_to_world, scene.width, scene.height, focal, scene.near, scene.far)


class ForcedParts(msgspec.Struct):
    need: tuple[str, ...] = ()
    no_need: tuple[str, ...] = ()


@dataclass(frozen=True)
class FinishedRun:
    """The contents of an output folder."""

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
            # they become parts of paths, of files that are read and of films that are written
            if not name.isprintable() or set(name) & set("/\\") or name in ("", ".", ".."):
                raise DamagedRecord(f"{records_folder(out) / 'run.json'}: {name!r} is no name; run again")
        return FinishedRun(out, run)

    def scenes(self, asked: list[str] | None, option: str = "--scenes") -> list[SceneRecord]:
        """Return those of `asked`, or all; raises `InputError`, naming the option, for one that the run lacks."""
        known = {scene.name: scene for scene in self.run.scenes}
        return [known[name] for name in known_names(option, asked or list(known), list(known))]

    def methods(self, asked: list[str] | None) -> list[str]:
        """Return those of `asked`, or all that every scene has; raises `InputError` for one that the run lacks."""
        return list(known_names("--methods", asked or self.run.main_methods, list(self.run.methods)))

    def shown_methods(self, asked: list[str] | None) -> list[str]:
        """Return those of `asked`, or the baseline and the first method that is compared with it."""
        every, cast = self.methods(None), self.run.roles
        return self.methods(asked or [cast.among(every).baseline, *cast.among(every).contenders(every)[:1]])

    def is_trained(self, scene: str, method: str, seed: int) -> bool:
        return checkpoint_path(self.out, scene, method, seed).is_file()

    def trained(self, scene: SceneRecord, method: str, seed: int, device: torch.device) -> TrainedCell:
        """Load a trained cell; raises `InputError` if it was not trained to its end, or its checkpoint is damaged, and
        `NotAvailable` for a method that this machine cannot render.
        """
        name = f"{scene.name}, {method}, seed {seed}"
        path = cell_path(self.out, scene.name, method, seed)
        if not path.is_file():
            raise InputError(f"{self.out}: {name} was not trained; choose another one, or go on with --resume")
        cell = read_cell(path)
        if cell.status != "done":
            raise InputError(f"{self.out}: {name} is {cell.status} ({cell.reason}); there is nothing to look at")
        require_methods([method])
        if method not in CATALOG:
            raise InputError(
                f"{path}: method {method!r} is not in this version's catalogue, and no installed package offers it: "
                f"{' '.join(CATALOG)}"
            )
        settings = from_plain(TrainSettings, cell.settings.get("train"), path)
        if (usual := CATALOG[method].settings) is not None:
            own = from_plain(type(usual), settings.own.get(method), path)
            settings = replace(settings, own={method: own})
        budget = from_plain(Budget, cell.settings.get("budget"), path)
        from_plain(ScoreSettings, cell.settings.get("score"), path)
        if not isinstance(cell.settings.get("view_set"), dict) or "focal" not in cell.settings["view_set"]:
            raise InputError(f"{path}: recorded before the focal length of its views was; run again to look at it")
        checkpoint = checkpoint_path(self.out, scene.name, method, seed)
        _require_possible(settings, settings.own.get(method), path, checkpoint)
        if [len(corner) for corner in scene.bounds] != [3, 3] or not scene.bounds[0] < scene.bounds[1]:
            raise DamagedRecord(f"{self.out}: {scene.name}: bounds {shown(scene.bounds)} are no box; run again")
        box = Box(*(torch.tensor(corner, dtype=torch.float32, device=device) for corner in scene.bounds))
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
        """Return the folder of its posed images: in `cache`, or in the folder `view_sets` beside the run; one that was
        given with `--view-set` is where it was. Raises `InputError` if it is not there any more.
        """
        given = self.run.settings.get("view_set")
        if isinstance(given, list):  # one per scene, if there are several
            given = given[self.run.settings["scenes"].index(scene.name)]
        places = [Path(given)] if given else [cache / scene.view_set, self.out.parent / "view_sets" / scene.view_set]
        for place in places:
            if place.exists() if given else transforms_file(place, "train").is_file():
                return place
        tried = " or ".join(map(str, places))
        raise InputError(f"{tried}: the view set of {scene.name} is not there; name its cache with --view-sets")

    def views(
        self,
        scene: SceneRecord,
        cache: Path = VIEW_SETS,
        width: int | None = None,
        train: int = 0,
        geometry: bool = True,
        scratch: Path | None = None,
    ) -> ViewSet:
        """Read the test views that the run was scored on, at `width` pixels or the run's own, and `train` of the
        training views, evenly spread; with parts forced in or out as in the run's settings, and without depth and
        normals unless `geometry` is asked for. Decoded images go to `scratch`, a folder on a disk.

        Raises `InputError` for any fault of the view set, and for another rendering than the methods were trained on.
        """
        path, asked = records_folder(self.out) / "run.json", self.run.settings.get("views", {})
        if missing := sorted({"train", "test"} - set(scene.views)):
            raise DamagedRecord(f"{path}: {scene.name}: views says no number of {' '.join(missing)}; run again")
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
            train_count=min(train, scene.views["train"]),
            test_count=scene.views["test"],
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
        """Return the distance of its cameras from the origin, in scene units: known for our own scenes, for others the
        mean over the training cameras. Raises `InputError` if those are not there any more.
        """
        if scene.rendered:
            return RADIUS
        frames = source_of(self.view_set(scene, cache)).frames("train")
        return RADIUS if frames is None else mean_distance(frames.camera_to_world)


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
"""The most that each size in the settings may be, of all methods or of an explicit method's own."""
EXPLICIT = (VoxelSettings, PlaneSettings, TableSettings, GaussianSettings)


def _require_possible(settings: TrainSettings, own: object, path: Path, checkpoint: Path) -> None:
    """Raise `InputError` for sizes that no run has before memory is allocated."""
    network = own.size(settings.network) if isinstance(own, Parts) else settings.network
    shared = {**asdict(network), **asdict(settings), "grid.cells": settings.grid.cells}
    for sizes in (shared, asdict(own) if isinstance(own, EXPLICIT) else {}):
        for name in sizes.keys() & LARGEST.keys():
            for value in np.ravel(sizes[name]).tolist():
                if not 0 <= value <= LARGEST[name]:
                    most = LARGEST[name]
                    raise InputError(
                        f"{path}: {name} {value} of its settings: must lie between 0 and {most}; run again"
                    )
    least = 4 * max(0, network.depth - 2) * network.width**2
    if isinstance(own, Parts) and checkpoint.is_file() and least > checkpoint.stat().st_size:
        raise InputError(
            f"{checkpoint}: has fewer bytes than the weights of {network.depth} layers of {network.width}, which its "
            "record names; run again"
        )


def from_plain(kind: type[Settings], data: object, path: Path) -> Settings:
    """Make a frozen dataclass from the JSON of its `asdict`; raises `InputError` naming the file if a key is missing or
    unknown: settings that silently differ would render another picture.
    """
    try:
        settings = msgspec.convert(data, kind)
        ours = settings.settings() if isinstance(settings, Budget) else asdict(settings)
        if unlike := _unlike(ours, data):
            raise ValueError(f"{kind.__name__}: {unlike}")
    except (msgspec.ValidationError, ValueError) as error:
        raise InputError(f"{path}: its settings are not those of this version ({error}); run again") from error
    return settings


def _unlike(ours: object, theirs: object) -> str:
    """Return the keys that only one of two JSON documents has."""
    if not (isinstance(ours, dict) and isinstance(theirs, dict)):
        return ""
    inner = (_unlike(ours[key], theirs[key]) for key in ours.keys() & theirs.keys())
    return " ".join(filter(None, [*sorted(ours.keys() ^ theirs.keys()), *inner]))
