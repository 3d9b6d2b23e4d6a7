"""A turn around each scene: small, approximate JPEGs of its test views by azimuth, the methods below the truth."""

from typing import NamedTuple

import numpy as np

from harness.records.pictures import EVERY_CHECKPOINT_SEED, Turn, read_turn, truth_pictures
from reports.data.load import Records, if_valid
from reports.data.saved_pictures import inside
from reports.drawing.images import data_uri, smaller

BUDGET_BYTES = 2_000_000
BYTES_PER_PIXEL = 0.28
SIDES = (100, 50, 34, 25)
QUALITY = 75


class Strip(NamedTuple):
    method: str | None
    """None for the truth."""
    image: str
    """A data URI."""


class Round(NamedTuple):
    scene: str
    title: str
    views: int
    strips: list[Strip]
    missing: list[str]


def rounds(records: Records) -> list[Round]:
    by_scene = {scene: _turns(records, scene) for scene in records.scenes}
    pixels = sum(turn.frames[..., 0].size for turns in by_scene.values() for turn in turns.values())
    fitting = (side for side in SIDES if pixels * (side / SIDES[0]) ** 2 * BYTES_PER_PIXEL <= BUDGET_BYTES)
    side, shown = next(fitting, SIDES[-1]), []
    for scene, turns in by_scene.items():
        if len(turns) > 1:
            about, strips = records.scene(scene), [Strip(name, _strip(turn, side)) for name, turn in turns.items()]
            missing = [name for name in records.methods if name not in turns]
            shown.append(Round(scene, about.title if about else scene, len(turns[None].views), strips, missing))
    return shown


def _turns(records: Records, scene: str) -> dict[str | None, Turn]:
    """Map None (the truth) and each method → its turn; methods with other views than the truth are left out."""
    truth = _read(records, truth_pictures(scene), None)
    if truth is None:
        return {}
    turns: dict[str | None, Turn] = {None: truth}
    for method in records.methods:
        for cell in records.cells_of(scene, method):
            if (cell.seed, cell.status) == (EVERY_CHECKPOINT_SEED, "done"):
                turn = _read(records, cell.pictures, method)
                if turn is not None and (turn.views, turn.frames.shape) == (truth.views, truth.frames.shape):
                    turns[method] = turn
    return turns


def _read(records: Records, relative: str | None, method: str | None) -> Turn | None:
    """Return the turn of a file; None if there is none, or if it is damaged, which another part of the page says."""
    path = None if relative is None else inside(records.folder, relative)
    if path is None:
        return None
    return if_valid(lambda: read_turn(path, "truth" if method is None else "renders"), None, [])


def _strip(turn: Turn, side: int) -> str:
    frames = [smaller(frame / 255.0, side) for frame in turn.frames]
    return data_uri(np.concatenate(frames, axis=1), "jpeg", quality=QUALITY, subsampling=0)
