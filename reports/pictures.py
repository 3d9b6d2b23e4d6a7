"""Rendered views beside their ground truth, for print and for readers without a script; which ones is a fixed rule.

Shown is the first kept view of each scene, of the first seed in which most methods have a picture of their last
checkpoint. They are base64 PNGs, made smaller where a large run would otherwise make the page heavy. Everything else
that was kept is in the page's picture data (`reports.picture_data`).
"""

from dataclasses import dataclass

import numpy as np

from harness.pictures_record import Render, Truth, last_of
from harness.records import CellRecord
from reports.error_maps import Picture, delta_e, smaller
from reports.inline_png import data_uri, side_for
from reports.kept_pictures import NOT_KEPT, Kept, kept
from reports.load import Records
from reports.wording import number

BUDGET_BYTES = 1_500_000


@dataclass(frozen=True)
class Shown:
    """One method's picture of a view as a data URI, None where there is none."""

    method: str
    caption: str
    render: str | None
    failed: bool = False


@dataclass(frozen=True)
class View:
    scene: str
    title: str
    view: str
    seed: int
    truth: str | None
    methods: list[Shown]


def views(records: Records) -> list[View]:
    """One view of every scene that has pictures, in the order of scenes."""
    chosen = [(scene, seed) for scene in records.scenes if (seed := seed_shown(records, scene)) is not None]
    side = side_for(len(chosen) * (1 + len(records.methods)), BUDGET_BYTES)
    found = (_view(records, scene, seed, side) for scene, seed in chosen)
    return [one for one in found if one is not None]


def seed_shown(records: Records, scene: str) -> int | None:
    """The first seed in which the most finished methods have pictures; of those that are equal in this, the first in
    which the most methods have any; None where there are none."""
    having: dict[int, tuple[int, int]] = {}
    for cell in records.cells:
        if cell.scene == scene and cell.pictures is not None:
            finished, any_ = having.get(cell.seed, (0, 0))
            having[cell.seed] = (finished + (cell.status == "done"), any_ + 1)
    return max(having, key=lambda seed: (*having[seed], -seed), default=None)


def first_view(found: Kept) -> str | None:
    """The first view of the truth, else the first that any cell has."""
    names = [*found.truth, *(one.view for renders in found.renders.values() for one in renders)]
    return next(iter(names), None)


def last_render(found: Kept, cell: CellRecord, view: str) -> Render | None:
    """Of a cell that finished; what one that diverged had last is not the end of a training."""
    if cell.status != "done":
        return None
    renders = last_of(found.renders.get((cell.method, cell.seed), []))
    return next((one for one in renders if one.view == view), None)


def as_picture(values: np.ndarray) -> Picture:
    """float16 display colour → what is shown of it."""
    return np.clip(np.asarray(values, dtype=np.float64), 0.0, 1.0)


def _view(records: Records, scene: str, seed: int, side: int) -> View | None:
    found = kept(records, scene, (seed,))
    view = first_view(found)
    if view is None:
        return None
    cells = {cell.method: cell for cell in records.cells if (cell.scene, cell.seed) == (scene, seed)}
    truth = found.truth.get(view)
    about = records.scene(scene)
    shown = [_shown(found, cells[method], view, truth, side) for method in records.methods if method in cells]
    small = data_uri(smaller(as_picture(truth.display), side)) if truth else None
    return View(scene, about.title if about else scene, view, seed, small, shown)


def _shown(found: Kept, cell: CellRecord, view: str, truth: Truth | None, side: int) -> Shown:
    if cell.status in ("diverged", "error"):
        return Shown(cell.method, cell.reason or cell.status, None, failed=True)
    render = last_render(found, cell, view)
    if render is None:
        return Shown(cell.method, found.missing.get((cell.method, cell.seed), NOT_KEPT), None)
    picture = as_picture(render.colour)
    uri = data_uri(smaller(picture, side))
    if truth is None or truth.display.shape != render.colour.shape:
        return Shown(cell.method, "no ground truth of this size", uri)
    score = next((one.psnr for one in cell.views if one.view == view), None)
    psnr = f"{number(score)} dB, " if score is not None else ""
    mean = float(delta_e(as_picture(truth.display), picture).mean())
    return Shown(cell.method, f"{psnr}mean ΔE₀₀ {number(mean, 1)}", uri)
