"""Rendered views beside their ground truth, with maps of the error; which ones is a fixed rule, not a choice.

Shown are the stored views of the first seed in which most methods of a scene have one.
On the page they are base64 PNGs, made smaller where a large run would otherwise make the page heavy.
"""

import base64
import io
from dataclasses import dataclass
from pathlib import Path

import matplotlib.image
import numpy as np

from harness.records import CellRecord, StoredImage
from reports.error_maps import Picture, absolute_error, delta_e, delta_e_map, smaller
from reports.load import Records
from reports.wording import number

BUDGET_BYTES = 9_000_000
BYTES_A_PIXEL = 2.6
"""Of a PNG in base64, about."""
SIZES = (400, 320, 256, 200, 160, 128, 100, 64)


@dataclass(frozen=True)
class Shown:
    """One method's picture of a view; the maps are data URIs like the picture, None where there is no picture."""

    method: str
    caption: str
    render: str | None
    error: str | None = None
    delta_e: str | None = None
    opacity: str | None = None
    failed: bool = False


@dataclass(frozen=True)
class View:
    scene: str
    title: str
    view: str
    seed: int
    truth: str | None
    methods: list[Shown]
    first: bool
    """The scene's first view; the page folds the others away."""


def views(records: Records) -> list[View]:
    """Every scene's stored views of one seed, in the order of scenes."""
    chosen = [(scene, seed) for scene in records.scenes if (seed := seed_shown(records, scene)) is not None]
    many = sum(
        1 + 4 * len(cell.images)
        for scene, seed in chosen
        for cell in records.cells
        if cell.scene == scene and cell.seed == seed
    )
    side = side_for(many)
    found = []
    for scene, seed in chosen:
        cells = [cell for cell in records.cells if cell.scene == scene and cell.seed == seed]
        names = dict.fromkeys(image.view for cell in cells for image in cell.images)
        found += [_view(records, scene, seed, name, cells, side, not place) for place, name in enumerate(names)]
    return found


def side_for(pictures: int, budget: int = BUDGET_BYTES) -> int:
    """The longest side at which so many pictures stay within a budget, the page's own by default."""
    fitting = (side for side in SIZES if pictures * side * side * BYTES_A_PIXEL <= budget)
    return next(fitting, SIZES[-1])


def seed_shown(records: Records, scene: str) -> int | None:
    """The first seed in which the most methods have stored pictures; None where there are no pictures."""
    seeds = sorted({cell.seed for cell in records.cells if cell.scene == scene})
    having = {seed: sum(bool(c.images) for c in records.cells if (c.scene, c.seed) == (scene, seed)) for seed in seeds}
    best = max(seeds, key=lambda seed: (having[seed], -seed), default=None)
    return best if best is not None and having[best] else None


def _view(records: Records, scene: str, seed: int, name: str, cells: list[CellRecord], side: int, first: bool) -> View:
    stored = {cell.method: image for cell in cells for image in cell.images if image.view == name}
    truth = next(
        (picture for image in stored.values() if (picture := read(records.folder, image.truth)) is not None), None
    )
    about = records.scene(scene)
    shown = []
    for method in records.methods:
        cell = next((cell for cell in cells if cell.method == method), None)
        if cell is None:
            continue
        shown.append(_shown(records.folder, cell, stored.get(method), truth, side))
    title = about.title if about else scene
    small = data_uri(smaller(truth, side)) if truth is not None else None
    return View(scene, title, name, seed, small, shown, first)


def _shown(folder: Path, cell: CellRecord, image: StoredImage | None, truth: Picture | None, side: int) -> Shown:
    if cell.status == "not_available":
        return Shown(cell.method, f"not available: {cell.reason or 'no reason recorded'}", None)
    if cell.status in ("diverged", "error"):
        return Shown(cell.method, cell.reason or cell.status, None, failed=True)
    render = read(folder, image.render) if image else None
    if image is None or render is None:
        return Shown(cell.method, "no picture was kept", None)
    opacity = read(folder, image.opacity)
    small_opacity = data_uri(smaller(opacity, side)) if opacity is not None else None
    if truth is None or truth.shape != render.shape:
        return Shown(
            cell.method, "no ground truth of this size", data_uri(smaller(render, side)), opacity=small_opacity
        )
    differences = delta_e(truth, render)
    score = next((one.psnr for one in cell.views if one.view == image.view), None)
    psnr = f"{number(score)} dB, " if score is not None else ""
    return Shown(
        cell.method,
        f"{psnr}mean ΔE₀₀ {number(float(differences.mean()), 1)}",
        data_uri(smaller(render, side)),
        data_uri(smaller(absolute_error(truth, render), side)),
        data_uri(smaller(delta_e_map(differences), side)),
        small_opacity,
    )


def read(folder: Path, relative: str) -> Picture | None:
    """A stored picture as display colour, or None where it is missing, unreadable or outside of the records."""
    path = (folder / relative).resolve()
    if not path.is_relative_to(folder.resolve()) or not path.is_file():
        return None
    try:
        picture = np.asarray(matplotlib.image.imread(path, format="png"), dtype=np.float64)
    except (OSError, ValueError, SyntaxError):
        return None
    if picture.ndim == 2:
        picture = np.repeat(picture[..., None], 3, axis=-1)
    return picture[..., :3] if picture.shape[-1] >= 3 else np.repeat(picture[..., :1], 3, axis=-1)


def data_uri(picture: Picture) -> str:
    """PNG in base64, for an `<img>` that needs no other file."""
    buffer = io.BytesIO()
    eight_bit = np.round(255 * np.clip(picture, 0, 1)).astype(np.uint8)
    matplotlib.image.imsave(buffer, np.ascontiguousarray(eight_bit), format="png")
    return f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}"
