"""A finished run as a page shows it: listings, and methods and views, which are loaded on the first request."""

import math
import time
from collections import Counter
from collections.abc import Generator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from msgspec.structs import asdict

from harness.playback.camera_paths import ELEVATION
from harness.playback.run_loader import FinishedRun
from harness.playback.store import ViewStore
from harness.records.cells import SceneRecord, cell_path, read_cell
from harness.training.batches import Camera
from harness.viewer import engine
from harness.viewer.attended import ATTENTIONS
from harness.viewer.requests import LARGEST_WIDTH, BadRequest, Orbit, ViewRequest, covering, orbit_of
from harness.viewer.wire import frame_message, message, picture_message
from scenes.files.errors import DamagedRecord, InputError
from scenes.view_sets.pixels import over_white
from scenes.view_sets.view_set import Split

TRUTHS = 2


@dataclass(frozen=True)
class GroundTruth:
    """The test views of a scene, or the reason why they are missing."""

    split: Split | None
    missing: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        return () if self.split is None else self.split.names


@dataclass
class ShownRun:
    """A shown run. Only `listing` is called outside the thread that renders, so that nothing is locked."""

    run: FinishedRun
    view_sets: Path
    seed: int
    first_scene: str
    first_methods: tuple[str, ...]
    device: torch.device
    store: ViewStore
    memory_alone: str = ""
    """The reason why the view cache is kept only in memory; empty if it is on disk, too."""
    width: int | None = None
    """The width in pixels; None: that of each scene's views."""
    loaded: dict[tuple[str, str], engine.MethodView] = field(default_factory=dict)
    lenses: dict[str, Camera] = field(default_factory=dict)
    """Map scene → a camera with the lens of its views."""
    truths: dict[str, GroundTruth] = field(default_factory=dict)
    sources: Counter[str] = field(default_factory=Counter)
    """The number of complete pictures by origin: a place of the view cache, or `rendered`."""

    @staticmethod
    def of(
        out: Path,
        scene: str | None,
        methods: list[str] | None,
        seed: int,
        view_sets: Path,
        width: int | None,
        device: torch.device,
    ) -> "ShownRun":
        """Load a run; raises `InputError` for unknown names, and if it has nothing to show."""
        run = FinishedRun.of(out)
        scenes = [record.name for record in run.scenes([scene] if scene else None, "--scene")]
        asked = run.shown_methods(methods)
        if seed not in run.run.seeds:
            raise InputError(f"--seed {seed}: the run has {' '.join(map(str, run.run.seeds))}")
        trained = [name for name in scenes if any(run.is_trained(name, method, seed) for method in asked)]
        if not trained:
            raise InputError(
                f"{out}: no checkpoint of {' '.join(asked)} with seed {seed} on {' '.join(scenes)}, so there is "
                "nothing to show; choose other --methods, --scene or --seed, or train them again"
            )
        memory_alone = ""
        try:
            store = ViewStore(disk=out / "view_cache")
        except InputError as reason:
            store, memory_alone = ViewStore(), str(reason)
        return ShownRun(run, view_sets, seed, trained[0], tuple(asked), device, store, memory_alone, width)

    def listing(self) -> dict[str, object]:
        return {
            "run": self.run.out.resolve().name,
            "profile": self.run.run.profile,
            "seed": self.seed,
            "scenes": [{"name": scene.name, "title": scene.title} for scene in self.run.run.scenes],
            "methods": [{"name": name, "about": about} for name, about in self.run.run.methods.items()],
            "attentions": [{"name": name, "about": about} for name, about in ATTENTIONS.items()],
            "first": {"scene": self.first_scene, "methods": self.first_methods},
            "largest_width": LARGEST_WIDTH,
        }

    def scene_listing(self, name: str) -> dict[str, object]:
        """List one scene: the size of its pictures, the first camera and those of the test views, and its cells."""
        scene = self.scene(name)
        truth = self.truth(scene)
        poses = () if truth.split is None else truth.split.camera_to_world
        centre = np.mean(scene.bounds, axis=0)
        width = self.width or scene.width
        return {
            "centre": centre.tolist(),
            "name": scene.name,
            "title": scene.title,
            "width": width,
            "height": max(1, round(scene.height * width / scene.width)),
            "start": asdict(_start(scene)),
            "views": [
                {"name": view, **asdict(orbit_of(pose, centre))} for view, pose in zip(truth.names, poses, strict=True)
            ],
            "missing": truth.missing,
            "psnr_ceiling": scene.psnr_ceiling,
            "psnr_floor": scene.psnr_floor,
            "cells": {method: self._cell(name, method) for method in self.run.run.methods},
        }

    def _cell(self, scene: str, method: str) -> dict[str, object]:
        try:
            cell = read_cell(cell_path(self.run.out, scene, method, self.seed))
        except DamagedRecord:
            return {"shown": False, "why": "was not trained"}
        shown = cell.status == "done" and self.run.is_trained(scene, method, self.seed)
        why = (cell.reason or cell.status) if cell.status != "done" else "its checkpoint is missing"
        return {
            "shown": shown,
            "why": "" if shown else why,
            "psnr": cell.scores.get("psnr"),
            "weights": cell.parameters.get("total"),
            "train_seconds": cell.train_seconds,
        }

    def scene(self, name: str) -> SceneRecord:
        for scene in self.run.run.scenes:
            if scene.name == name:
                return scene
        raise BadRequest("scene: the run has no such scene")

    def truth(self, scene: SceneRecord) -> GroundTruth:
        """Return the test views at the smaller of their and the shown width, or the fault of the view set."""
        if scene.name not in self.truths:
            if len(self.truths) >= TRUTHS:
                del self.truths[next(iter(self.truths))]
            width, scratch = min(self.width or scene.width, scene.width), None if self.memory_alone else self.run.out
            try:
                views = self.run.views(scene, self.view_sets, width, scratch=scratch)
                self.truths[scene.name] = GroundTruth(views.test)
            except (InputError, OSError) as error:
                self.truths[scene.name] = GroundTruth(None, f"No ground truth: {error}")
        return self.truths[scene.name]

    def method_view(self, scene: SceneRecord, method: str) -> engine.MethodView:
        """Load a cell; raises `InputError` if it cannot be shown."""
        if (scene.name, method) not in self.loaded:
            cell = self.run.trained(scene, method, self.seed, self.device)
            view = engine.MethodView.of(cell, self.store)
            lens = self.lenses.setdefault(scene.name, cell.camera(_start(scene).pose()))
            view.warm_up(self._camera(scene, lens, None))
            self.loaded[scene.name, method] = view
        return self.loaded[scene.name, method]

    def checked(self, asked: ViewRequest) -> None:
        """Check a request; raises `BadRequest` for unknown names and views."""
        scene = self.scene(asked.scene)
        if not set(asked.methods) <= self.run.run.methods.keys():
            raise BadRequest("methods: the run has no such method")
        if isinstance(asked.place, int):
            self._test_views(scene, asked.place)

    def _test_views(self, scene: SceneRecord, view: int) -> Split:
        """Return the test views; raises `BadRequest` if `view` is none of their numbers."""
        truth = self.truth(scene)
        if truth.split is None or view >= len(truth.names):
            raise BadRequest(f"view: there are {len(truth.names)} test views")
        return truth.split

    def truth_message(self, name: str, view: int) -> bytes:
        split = self._test_views(self.scene(name), view)
        rgba, depth = split.rgba[view], None if split.depth is None else split.depth[view]
        height, width = rgba.shape[:2]
        facts = {"name": split.names[view], "width": width, "height": height, "has_depth": depth is not None}
        return picture_message("truth", over_white(rgba), rgba[..., 3], depth, **facts)

    def messages(self, asked: ViewRequest) -> Generator[bytes, None, None]:
        """Yield all messages for a `checked` request, each after one piece of work."""
        scene = self.scene(asked.scene)
        exact, picture = None, None
        if isinstance(asked.place, Orbit):
            pose = asked.place.pose()
        else:
            exact, split = asked.place, self._test_views(scene, asked.place)
            pose, picture = split.camera_to_world[exact], over_white(split.rgba[exact])
        views = []
        for method in asked.methods:
            if (scene.name, method) not in self.loaded:
                yield message("loading", method=method)
            try:
                views.append(self.method_view(scene, method))
            except InputError as mistake:
                yield message("failed", method=method, note=str(mistake))
        if views:
            began = time.perf_counter()
            camera = self._camera(scene, self.lenses[scene.name].at(pose), asked.width, exact is None)
            yield message("start", width=camera.width, height=camera.height, exact=exact)
            for frame in engine.frames(views, camera, asked.attention, picture, asked_at=began):
                if frame.state == "whole":
                    self.sources[frame.cached or "rendered"] += 1
                yield frame_message(frame)
        yield message("end", cache={"sources": dict(self.sources), "memory_alone": self.memory_alone})

    def _camera(self, scene: SceneRecord, camera: Camera, width: int | None, free: bool = True) -> Camera:
        """Return the camera at the shown size; near and far of a free camera enclose the box."""
        camera = covering(camera, np.asarray(scene.bounds)) if free else camera
        width = width or self.width or scene.width
        return camera if width == camera.width else camera.resized(width)


def _start(scene: SceneRecord) -> Orbit:
    """Return the first position of the camera if there is no test view."""
    x, y, z = np.mean(scene.bounds, axis=0).tolist()
    return Orbit((x, y, z), 0.5 * math.pi, ELEVATION, 0.5 * (scene.near + scene.far))
