"""A turn around each scene: small pictures of its test views, the methods beside the truth, in the order of azimuth.

They are JPEGs, to be looked at; what was saved of the views that the comparer shows is exact.
"""

from typing import NamedTuple

import numpy as np

from harness.records.pictures import EVERY_CHECKPOINT_SEED, Turn, read_turn, truth_pictures
from reports.data.kept_pictures import inside
from reports.data.load import Records
from reports.drawing.images import data_uri, smaller
from scenes.files.errors import DamagedRecord

BUDGET_BYTES = 2_000_000
BYTES_A_PIXEL = 0.28
"""The approximate bytes per pixel of a JPEG in base64."""
SIDES = (100, 50, 34, 25)
QUALITY = 75


class Strip(NamedTuple):
    """The views of the truth or of a method side by side, as a data URI."""

    method: str | None
    """None: the truth."""
    image: str


class Round(NamedTuple):
    scene: str
    title: str
    views: int
    strips: list[Strip]
    missing: list[str]


def rounds(records: Records) -> list[Round]:
    """Return the scenes of which the truth and a method have a turn."""
    found = {scene: _turns(records, scene) for scene in records.scenes}
    pixels = sum(turn.frames[..., 0].size for turns in found.values() for turn in turns.values())
    side = next((side for side in SIDES if pixels * (side / SIDES[0]) ** 2 * BYTES_A_PIXEL <= BUDGET_BYTES), SIDES[-1])
    shown = []
    for scene, turns in found.items():
        about, strips = records.scene(scene), [Strip(name, _strip(turn, side)) for name, turn in turns.items()]
        if len(strips) > 1:
            missing = [name for name in records.methods if name not in turns]
            title, views = about.title if about else scene, len(turns[None].views)
            shown.append(Round(scene, title, views, strips, missing))
    return shown


def _turns(records: Records, scene: str) -> dict[str | None, Turn]:
    """Map None, the truth, and each method → its turn, as far as they are of the same views."""
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
    """Return the turn of a file; None where there is none, or the file is damaged, which the page says elsewhere."""
    path = None if relative is None else inside(records.folder, relative)
    if path is None:
        return None
    try:
        return read_turn(path, "truth" if method is None else "renders")
    except DamagedRecord:
        return None


def _strip(turn: Turn, side: int) -> str:
    frames = [smaller(frame / 255.0, side) for frame in turn.frames]
    return data_uri(np.concatenate(frames, axis=1), "jpeg", quality=QUALITY, subsampling=0)
