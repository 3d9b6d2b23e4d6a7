"""The test views that a run saves as pictures: their choice, their truth, and the renders of each cell."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.records.cells import records_folder
from harness.records.pictures import (
    EVERY_CHECKPOINT_SEED,
    HEADER_BYTES,
    LARGEST_BYTES,
    RENDER,
    TRUTH,
    Render,
    Truth,
    Turn,
    cell_pictures,
    half,
    read_truth,
    read_turn,
    truth_pictures,
    write_renders,
    write_truth,
)
from harness.training.scoring.evaluate import View
from scenes.files.errors import DamagedRecord, InputError
from scenes.view_sets.pixels import area_average, over_white
from scenes.view_sets.view_set import Split, ViewSet, linear_over_white
from scenes.view_sets.viewpoints import by_azimuth, evenly_spread

TURN_VIEWS, TURN_SIDE = 24, 100
"""The maximum number of views of a turn, and the maximum number of pixels of their sides."""
ROOM = LARGEST_BYTES - HEADER_BYTES - 3 * TURN_VIEWS * TURN_SIDE**2
TRUTH_BYTES = 2 * sum(channels or 1 for channels in TRUTH.values())
RENDER_BYTES = 2 * sum(channels or 1 for channels in RENDER.values())
"""The bytes per pixel."""
SAME_COLOUR = 0.01
"""The difference of display colours below which two truths may be of one view, rendered twice or read differently."""


def saved_views(test: Split, count: int) -> list[int]:
    """Return at most `count` evenly spread test views, equal for all cells; fewer if their truth would be too large."""
    count = min(count, ROOM // (_pixels(test) * TRUTH_BYTES))
    spread = np.linspace(0, len(test.names) - 1, count + 2).round().astype(int)[1:-1].tolist()
    return list(dict.fromkeys(spread))


def turned(test: Split) -> list[int]:
    """Return indices of evenly spread test views in the order of their azimuth, for a turn around the scene."""
    poses = test.camera_to_world
    chosen = evenly_spread(min(TURN_VIEWS, len(poses)), poses)
    return [int(index) for index in chosen[by_azimuth(poses[chosen])]]


def frame_of(colour: np.ndarray) -> NDArray[np.uint8]:
    """Return a small picture of display colour [h, w, 3]."""
    width = max(1, round(colour.shape[1] * min(1.0, TURN_SIDE / max(colour.shape[:2]))))
    small = area_average(colour, width) if width < colour.shape[1] else colour
    return np.round(255.0 * np.clip(np.asarray(small, dtype=np.float64), 0.0, 1.0)).astype(np.uint8)


def _pixels(test: Split) -> int:
    return math.prod(test.rgba.image_shape[:2])


def keep_truth(out: Path, scene: str, views: ViewSet, count: int) -> None:
    """Write the truth of the saved views, in the same bytes for every process; an existing file is kept. Raises
    `OSError`, and `InputError` if that file is of other views or the view set was damaged.
    """
    test = views.test
    now = []
    for index in saved_views(test, count):
        name, rgba = test.names[index], test.rgba[index]
        light = linear_over_white(views, name)
        linear = None if light is None else half(light)
        depth = None if test.depth is None else half(test.depth[index])
        now.append(Truth(name, half(over_white(rgba)), half(rgba[..., 3]), linear, depth))
    path = records_folder(out) / truth_pictures(scene)
    try:
        kept, turn = read_truth(path), read_turn(path, "truth")
    except DamagedRecord:
        kept, turn = [], None
    if kept and not _same_truth(kept, now):
        raise InputError(f"{views.path}: not the views of {path}; restore those views, or name a fresh --out")
    if now and turn is None:
        frames = [frame_of(over_white(test.rgba[index])) for index in turned(test)]
        write_truth(path, kept or now, Turn([test.names[index] for index in turned(test)], np.stack(frames)))


def drop_truth(out: Path, scene: str) -> None:
    (records_folder(out) / truth_pictures(scene)).unlink(missing_ok=True)


def _same_truth(kept: list[Truth], now: list[Truth]) -> bool:
    """Return whether truths are equal, except for last bits that depend on the processor or the version."""
    if [(truth.view, truth.display.shape) for truth in kept] != [(truth.view, truth.display.shape) for truth in now]:
        return False
    pairs = zip(kept, now, strict=True)
    return all(np.abs(a.display.astype(np.float32) - b.display).max() < SAME_COLOUR for a, b in pairs)


@dataclass
class KeptRenders:
    """The renders that a cell saves, taken from the views that are rendered for its scores."""

    chosen: list[int]
    names: tuple[str, ...]
    every: bool
    """Whether the renders of every checkpoint are saved, or only those of the last."""
    turn: list[int]
    """The views of the turn; empty if this cell saves none."""
    renders: list[Render] = field(default_factory=list)
    frames: dict[int, NDArray[np.uint8]] = field(default_factory=dict)

    @staticmethod
    def of(test: Split, count: int, seed: int, checkpoints: int) -> "KeptRenders":
        chosen = saved_views(test, count)
        fits = checkpoints * len(chosen) * _pixels(test) * RENDER_BYTES <= ROOM
        is_first = seed == EVERY_CHECKPOINT_SEED
        return KeptRenders(chosen, test.names, fits and is_first, turned(test) if chosen and is_first else [])

    def passing(self, images: Iterable[tuple[int, View]], step: int, last: bool) -> Iterator[tuple[int, View]]:
        """Yield the same indices and views one at a time, and remember those that are saved."""
        for index, image in images:
            if (last or self.every) and index in self.chosen:
                parts = (half(image.colour), half(image.opacity), half(image.depth))
                self.renders.append(Render(self.names[index], step, *parts))
            if last and index in self.turn:
                self.frames[index] = frame_of(image.colour)
            yield index, image

    def write(self, out: Path, scene: str, method: str, seed: int) -> str | None:
        """Write the renders. Return the path relative to the records, None if nothing was saved. Raises `OSError`."""
        if not self.renders:
            return None
        path = cell_pictures(scene, method, seed)
        turn = None
        if self.frames.keys() == set(self.turn) and self.turn:
            views = [self.names[index] for index in self.turn]
            turn = Turn(views, np.stack([self.frames[index] for index in self.turn]))
        write_renders(records_folder(out) / path, self.renders, turn)
        return path
