"""Rendered views beside their ground truth, for print and for readers without a script; they are chosen by a fixed
rule.

Shown is the first kept view of each scene, of the first seed in which most methods have a picture of their last
checkpoint. They are base64 PNGs, made smaller if a large run would otherwise make the page heavy. Everything else
that was saved is in the page's picture data (`reports.run.pictures`).
"""

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.records.cells import CellRecord, SceneRecord
from harness.records.pictures import Render, Truth, last_of
from reports.data import packing
from reports.data.kept_pictures import NOT_KEPT, Kept, kept
from reports.data.load import Records
from reports.data.packing import Packed
from reports.data.wording import counted, number
from reports.drawing.images import Picture, data_uri, delta_e, side_for, smaller
from reports.drawing.palette import colours_of
from scenes.files.atomic import write_atomically

SCRIPTS = tuple(
    f"{name}.js"
    for name in (
        *("chunks", "kept", "pixels", "colour_space", "colour_maps", "delta_e", "flip", "error_maps", "zoom"),
        *("compare_data", "thumbnails", "compare_choice", "compare_layers", "compare_view"),
        *("compare_probe", "compare_controls", "compare"),
    )
)
BUDGET_BYTES = 1_500_000


@dataclass(frozen=True)
class Shown:
    """One method's picture of a view as a data URI, None if there is none."""

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
    """Return one view of every scene that has pictures, in the order of scenes."""
    chosen = [(scene, seed) for scene in records.scenes if (seed := seed_shown(records, scene)) is not None]
    side = side_for(len(chosen) * (1 + len(records.methods)), BUDGET_BYTES)
    shown = []
    for scene, seed in chosen:
        found, about = kept(records, scene, (seed,)), records.scene(scene)
        view = first_view(found)
        if view is not None:
            cells = {cell.method: cell for cell in records.cells if (cell.scene, cell.seed) == (scene, seed)}
            truth = found.truth.get(view)
            methods = [_shown(found, cells[name], view, truth, side) for name in records.methods if name in cells]
            small = data_uri(smaller(as_picture(truth.display), side)) if truth else None
            shown.append(View(scene, about.title if about else scene, view, seed, small, methods))
    return shown


def seed_shown(records: Records, scene: str) -> int | None:
    """Return the first seed in which the most finished methods have pictures; among equals, the first in which the most
    methods have any; None if there are none.
    """
    having: dict[int, tuple[int, int]] = {}
    for cell in records.cells:
        if cell.scene == scene and cell.pictures is not None:
            finished, any_ = having.get(cell.seed, (0, 0))
            having[cell.seed] = (finished + (cell.status == "done"), any_ + 1)
    return max(having, key=lambda seed: (*having[seed], -seed), default=None)


def first_view(found: Kept) -> str | None:
    """Return the first view of the truth, else the first that any cell has."""
    names = [*found.truth, *(one.view for renders in found.renders.values() for one in renders)]
    return next(iter(names), None)


def last_render(found: Kept, cell: CellRecord, view: str) -> Render | None:
    """Return the last render of a cell that finished; that of a diverged one is not the end of a training."""
    if cell.status != "done":
        return None
    renders = last_of(found.renders.get((cell.method, cell.seed), []))
    return next((one for one in renders if one.view == view), None)


def as_picture(values: np.ndarray) -> Picture:
    """Convert float16 display colour to the displayed picture."""
    return np.clip(np.asarray(values, dtype=np.float64), 0.0, 1.0)


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


INLINE_BYTES = 6_000_000
FILE_BYTES = 32_000_000
"""The bytes of base64, in the page and in a file beside it."""
FOLDER = "report_pictures"
IMPORTANCE = (
    "the last checkpoint of the seed that is shown",
    "earlier checkpoints of it, first view",
    "earlier checkpoints of it, other views",
    "other seeds, first view",
    "other seeds, other views",
)
LEAST = 1
"""The pictures of every scene that must fit into a page; otherwise its pictures lie beside it."""
BRIGHT = 1.0 + 1 / 256
"""The light above which a value is more than display colour and the rounding of float16 hold."""


@dataclass
class SceneData:
    """One scene's entry and its pictures."""

    entry: dict[str, Any]
    renders: list[tuple[int, dict[str, Any], dict[str, str]]] = field(default_factory=list)
    """The triples (importance, row, id → base64), in the order of methods, seeds, steps and views; empty if it is left
    out.
    """
    texts: dict[str, str] = field(default_factory=dict)
    """The pictures of the truth."""
    unshown: bool = False
    """Whether there are renders without the truth that they belong to."""

    def sizes(self) -> np.ndarray:
        """Return the bytes by importance; the truth counts as most important."""
        sizes = np.zeros(len(IMPORTANCE), dtype=np.int64)
        sizes[0] = _size(self.texts)
        for importance, _, texts in self.renders:
            sizes[importance] += _size(texts)
        return sizes

    def chosen(self, up_to: int) -> dict[str, str]:
        """Write the rows up to an importance into the entry; returns their pictures and those of the truth."""
        texts = dict(self.texts)
        for importance, row, of_row in self.renders:
            if importance <= up_to:
                self.entry["renders"].append(row)
                texts |= of_row
        return texts


@dataclass(frozen=True)
class PictureData:
    """The picture data of the page."""

    data: dict[str, Any]
    inline: dict[str, str]
    """Map element's id → base64."""
    files: dict[str, str]
    """Map path beside the page → content; empty if the page holds its pictures."""


def picture_data(records: Records, budget: int = INLINE_BYTES, file_budget: int = FILE_BYTES) -> PictureData | None:
    """Return the picture data; None if no cell has pictures."""
    if not any(cell.pictures for cell in records.cells):
        return None
    return _inline(records, budget) or _beside(records, file_budget)


def _inline(records: Records, budget: int) -> PictureData | None:
    """Put everything into the page; returns None if `LEAST` does not fit."""
    scenes: list[SceneData] = []
    spent, up_to = np.zeros(len(IMPORTANCE), dtype=np.int64), len(IMPORTANCE) - 1
    for scene in records.scenes:
        scenes.append(scene_data(records, scene, up_to))
        spent += scenes[-1].sizes()
        up_to = _fitting(spent, budget)
        if up_to < LEAST:
            return None
    inline: dict[str, str] = {}
    for one in scenes:
        inline |= one.chosen(up_to)
    return PictureData(_data(records, scenes, [up_to] * len(scenes), ""), inline, {})


def _beside(records: Records, budget: int) -> PictureData:
    """Make one file per scene."""
    scenes: list[SceneData] = []
    reach: list[int] = []
    files: dict[str, str] = {}
    for scene in records.scenes:
        one = scene_data(records, scene, len(IMPORTANCE) - 1)
        up_to = max(_fitting(one.sizes(), budget), 0)
        file, texts = _file_name(scene, files), one.chosen(up_to)
        for holder in (*(view["truth"] for view in one.entry["views"]), *one.entry["renders"]):
            for ref in holder.values():
                if isinstance(ref, dict):
                    ref["file"] = file
        lines = ",\n".join(f'"{name}":"{text}"' for name, text in texts.items())
        files[file] = f"reportPictures({{{lines}}});\n"
        # the packed pictures of one scene are in memory at a time
        scenes.append(replace(one, renders=[(place, row, {}) for place, row, _ in one.renders], texts={}))
        reach.append(up_to)
    beside = (
        f"The pictures of this report lie in {FOLDER}/ beside it, "
        f"{counted(len(files), 'file')} of {sum(map(len, files.values())) / 1e6:.0f} MB: "
        "whoever passes the report on must pass that folder on with it."
    )
    return PictureData(_data(records, scenes, reach, beside), {}, files)


def _fitting(spent: np.ndarray, budget: int) -> int:
    """Return the largest importance up to which everything fits; −1 if nothing does."""
    return int((np.cumsum(spent) <= budget).sum()) - 1


def _size(texts: dict[str, str]) -> int:
    return sum(map(len, texts.values()))


def _data(records: Records, scenes: list[SceneData], reach: list[int], beside: str) -> dict[str, Any]:
    left_out = Counter(
        importance
        for one, up_to in zip(scenes, reach, strict=True)
        for importance, _, _ in one.renders
        if importance > up_to
    )
    sentences = [
        f"{counted(many, 'render')} left out to keep this report small: {IMPORTANCE[importance]}."
        for importance, many in sorted(left_out.items())
    ]
    sentences += [
        f"{one.entry['name']}: its pictures are not shown, the ground truth of them is missing or damaged."
        for one in scenes
        if one.unshown and not one.entry["views"]
    ]
    return {
        "methods": records.methods,
        "variables": {method: colour.variable for method, colour in colours_of(records.methods).items()},
        "scenes": [one.entry for one in scenes if one.entry["views"]],
        "left_out": sentences,
        "beside": beside,
    }


def scene_data(records: Records, scene: str, up_to: int) -> SceneData:
    """Return the scene, its renders packed up to an importance; `entry["renders"]` is still empty."""
    found, about = kept(records, scene), records.scene(scene)
    shown = seed_shown(records, scene)
    order = {method: place for place, method in enumerate(records.methods)}
    cells = {(cell.method, cell.seed): cell for cell in records.cells if cell.scene == scene}
    names = list(found.truth)
    far = _far(found, about)
    one = SceneData({"name": scene, "title": about.title if about else scene, "views": [], "renders": []})
    one.entry["views"] = [_view(found.truth[name], about, far, one.texts) for name in names]
    one.entry["missing"] = []
    for key in sorted(cells, key=lambda key: (order[key[0]], key[1])):
        cell, why = cells[key], found.missing.get(key)
        if cell.status != "done" or why is not None:
            reason = why or cell.reason or cell.status
            row = {"method": cell.method, "seed": cell.seed, "status": cell.status, "reason": reason}
            one.entry["missing"].append(row)
        for render in found.renders.get(key, []):
            truth = found.truth.get(render.view)
            if truth is None or render.opacity.shape != truth.opacity.shape:
                continue
            last, place = render.step == found.renders[key][-1].step, names.index(render.view)
            # the seed that is shown before the others, its end before what led there, first views before further ones
            importance = 0 if key[1] == shown and last else (1 if key[1] == shown else 3) + (place > 0)
            texts: dict[str, str] = {}
            packed = _row(cell, render, last, place, far, texts) if importance <= up_to else {}
            one.renders.append((importance, packed, texts))
    one.unshown = bool(found.renders) and not names
    return one


def _far(found: Kept, about: SceneRecord | None) -> float:
    depths = [one.depth for one in found.truth.values() if one.depth is not None]
    depths += [one.depth for renders in found.renders.values() for one in renders]
    largest = max((float(one.max()) for one in depths), default=0.0)
    return max(largest, about.far if about else 0.0) or 1.0


def _put(packed: Packed, texts: dict[str, str]) -> dict[str, Any]:
    texts[packed.id] = packed.text
    return dict(packed.ref)


def _view(truth: Truth, about: SceneRecord | None, far: float, texts: dict[str, str]) -> dict[str, Any]:
    height, width = truth.opacity.shape
    bright = truth.linear is not None and float(truth.linear.max()) > BRIGHT
    return {
        "name": truth.view,
        "width": width,
        "height": height,
        "near": about.near if about else 0.0,
        "far": about.far if about else far,
        "hdr": bright,
        "truth": {
            "display": _put(packing.display(truth.display), texts),
            "linear": _put(packing.light(truth.linear), texts) if bright and truth.linear is not None else None,
            "opacity": _put(packing.display(truth.opacity), texts),
            "depth": None if truth.depth is None else _put(packing.depth(truth.depth, far), texts),
        },
    }


def _row(cell: CellRecord, render: Render, last: bool, place: int, far: float, texts: dict[str, str]) -> dict[str, Any]:
    scored = next((one for one in cell.views if one.view == render.view), None) if last else None
    return {
        "method": cell.method,
        "seed": cell.seed,
        "step": render.step,
        "seconds": next((point.seconds for point in cell.curve if point.step == render.step), None),
        "last": last,
        "view": place,
        "psnr": scored.psnr if scored else None,
        "flip": scored.flip if scored else None,
        "delta_e": scored.delta_e if scored else None,
        "colour": _put(packing.display(render.colour), texts),
        "opacity": _put(packing.display(render.opacity), texts),
        "depth": _put(packing.depth(render.depth, far), texts),
    }


def _file_name(scene: str, taken: Iterable[str]) -> str:
    """Make the name of a file: a scene's name may hold any character, a file's may not."""
    stem = re.sub(r"[^A-Za-z0-9_-]", "_", scene)[:80] or "scene"
    names = [f"{FOLDER}/{stem}.js", *(f"{FOLDER}/{stem}_{number}.js" for number in range(2, 10_000))]
    return next(name for name in names if name.lower() not in {one.lower() for one in taken})


def write_files(files: dict[str, str], folder: Path) -> None:
    """Write the files beside a page in `folder`, each atomically. Raises `OSError`."""
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, text, fsync=False)


def remove_others(files: dict[str, str], folder: Path) -> None:
    """Remove files of an earlier page in `folder` that the present one does not name. Raises `OSError`."""
    beside = folder / FOLDER
    for path in beside.glob("*.js"):
        if f"{FOLDER}/{path.name}" not in files:
            path.unlink()
    if beside.is_dir() and not any(beside.iterdir()):
        beside.rmdir()
