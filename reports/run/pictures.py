"""Rendered views next to their ground truth: stills for print and readers without a script, and data for the comparer.

The stills show the first kept view of each scene, of the first seed in which most methods have a picture of their last
checkpoint. They are base64 PNGs, reduced if a large run would make the page heavy.
"""

import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from harness.records.cells import CellRecord, SceneRecord
from harness.records.pictures import Render, Truth, last_of
from reports.data import packing
from reports.data.load import Records
from reports.data.packing import Packed
from reports.data.saved_pictures import NOT_KEPT, Kept, kept
from reports.data.wording import counted, number
from reports.drawing.images import Picture, data_uri, delta_e, side_for, smaller
from reports.drawing.palette import colours_of
from scenes.files.atomic import write_atomically
from scenes.files.json_object import JsonObject

SCRIPTS = (
    *("chunks.js", "kept.js", "pixels.js", "colour_space.js", "colour_maps.js", "delta_e.js", "flip.js"),
    *("error_maps.js", "zoom.js", "compare_data.js", "thumbnails.js", "compare_choice.js", "compare_layers.js"),
    *("compare_view.js", "compare_probe.js", "compare_controls.js", "compare.js"),
    "turn.js",
)
BUDGET_BYTES = 1_500_000


class Shown(NamedTuple):
    method: str
    caption: str
    render: str | None
    """A data URI."""
    failed: bool = False


class View(NamedTuple):
    scene: str
    title: str
    view: str
    seed: int
    truth: str | None
    methods: list[Shown]


def views(records: Records) -> list[View]:
    chosen = [(scene, seed) for scene in records.scenes if (seed := seed_shown(records, scene)) is not None]
    side = side_for(len(chosen) * (1 + len(records.pictured)), BUDGET_BYTES)
    shown = []
    for scene, seed in chosen:
        pictures, about = kept(records, scene, (seed,)), records.scene(scene)
        view = first_view(pictures)
        if view is not None:
            cells = {cell.method: cell for cell in records.pictured_cells if (cell.scene, cell.seed) == (scene, seed)}
            truth = pictures.truth.get(view)
            methods = [_shown(pictures, cells[name], view, truth, side) for name in records.pictured if name in cells]
            small = data_uri(smaller(as_picture(truth.display), side)) if truth else None
            shown.append(View(scene, about.title if about else scene, view, seed, small, methods))
    return shown


def seed_shown(records: Records, scene: str) -> int | None:
    """Return the first seed in which the most finished methods, then the most methods, have pictures, if any does."""
    pictured = [cell for cell in records.cells if cell.scene == scene and cell.pictures is not None]
    started = Counter(cell.seed for cell in pictured)
    finished = Counter(cell.seed for cell in pictured if cell.status == "done")
    return max(started, key=lambda seed: (finished[seed], started[seed], -seed), default=None)


def first_view(pictures: Kept) -> str | None:
    names = [*pictures.truth, *(render.view for renders in pictures.renders.values() for render in renders)]
    return next(iter(names), None)


def last_render(pictures: Kept, cell: CellRecord, view: str) -> Render | None:
    """Return the last render of a finished cell; the last render of a diverged cell is not the end of a training."""
    if cell.status != "done":
        return None
    renders = last_of(pictures.renders.get((cell.method, cell.seed), []))
    return next((render for render in renders if render.view == view), None)


def as_picture(values: np.ndarray) -> Picture:
    return np.clip(np.asarray(values, dtype=np.float64), 0.0, 1.0)


def _shown(pictures: Kept, cell: CellRecord, view: str, truth: Truth | None, side: int) -> Shown:
    if cell.status in ("diverged", "error"):
        return Shown(cell.method, cell.reason or cell.status, None, failed=True)
    render = last_render(pictures, cell, view)
    if render is None:
        return Shown(cell.method, pictures.missing.get((cell.method, cell.seed), NOT_KEPT), None)
    picture = as_picture(render.colour)
    uri = data_uri(smaller(picture, side))
    if truth is None or truth.display.shape != render.colour.shape:
        return Shown(cell.method, "no ground truth of this size", uri)
    score = next((scored.psnr for scored in cell.views if scored.view == view), None)
    psnr = f"{number(score)} dB, " if score is not None else ""
    mean = float(delta_e(as_picture(truth.display), picture).mean())
    return Shown(cell.method, f"{psnr}mean ΔE₀₀ {number(mean, 1)}", uri)


class Exhibit(NamedTuple):
    """Truth, baseline and contender of one view of one scene, and which of the two is closer to the truth where."""

    title: str
    why: str
    """How the view was chosen."""
    truth: str
    renders: list[Shown]
    difference: str | None
    """A picture in the colours of the two methods; None unless both have one."""


EXHIBIT_SIDE = 128
LARGEST_ERROR = 0.2
"""The difference of two errors of display colour that has a method's full colour."""


def exhibit(records: Records) -> Exhibit | None:
    """Return the first screen's pictures, of the scene with the median difference; None if no truth was kept."""
    methods = list(dict.fromkeys([records.baseline, *records.contenders[:1]]))
    scene, why = _typical_scene(records, methods)
    if scene is None:
        return None
    seed, about = seed_shown(records, scene), records.scene(scene)
    pictures = kept(records, scene, () if seed is None else (seed,))
    view = first_view(pictures)
    truth = pictures.truth.get(view) if view else None
    if view is None or truth is None:
        return None
    cells = {cell.method: cell for cell in records.cells if (cell.scene, cell.seed) == (scene, seed)}
    shown, errors, true, inks = [], [], as_picture(truth.display), colours_of(records.pictured)
    for method in methods:
        render = last_render(pictures, cells[method], view) if method in cells else None
        if render is None or render.colour.shape != truth.display.shape:
            shown.append(Shown(method, "no picture yet" if not records.run.finished else "no picture", None))
            continue
        score = next((scored.psnr for scored in cells[method].views if scored.view == view), None)
        picture = as_picture(render.colour)
        uri = data_uri(smaller(picture, EXHIBIT_SIDE))
        shown.append(Shown(method, f"{number(score)} dB" if score is not None else "", uri))
        errors.append(np.abs(picture - true).mean(axis=-1))
    two = len(errors) == len(methods) == 2
    return Exhibit(
        about.title if about else scene,
        f"View {view}, seed {seed}: {why}, its first kept view; chosen by this rule and not by appearance.",
        data_uri(smaller(true, EXHIBIT_SIDE)),
        shown,
        data_uri(smaller(_closer(errors, [inks[name].light for name in methods]), EXHIBIT_SIDE)) if two else None,
    )


def _typical_scene(records: Records, methods: list[str]) -> tuple[str | None, str]:
    """Return the scene with the lower median of the differences, else the first; among those with pictures."""
    drawn = [scene for scene in records.scenes if seed_shown(records, scene) is not None]
    rows = [records.comparison(scene, methods[-1], methods[0]) for scene in drawn]
    ranked = sorted((row.difference, row.scene) for row in rows if row is not None and row.difference is not None)
    if ranked:
        many = f" of {counted(len(ranked), 'scene')}" if len(ranked) > 1 else ""
        return ranked[(len(ranked) - 1) // 2][1], f"the scene of the median difference{many}"
    return (drawn[0], "the first scene") if drawn else (None, "")


def _closer(errors: list[np.ndarray], colours: list[str]) -> Picture:
    """Colour each pixel by the method that is closer to the truth, the more the larger the difference of errors."""
    inks = [np.array([int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5)]) for colour in colours]
    ahead = np.clip((errors[0] - errors[1]) / LARGEST_ERROR, -1.0, 1.0)[..., None]
    ink = np.where(ahead > 0, inks[1], inks[0])
    return np.asarray(1.0 - np.abs(ahead) * (1.0 - ink))


INLINE_BYTES = 6_000_000
FILE_BYTES = 32_000_000
"""The maximum bytes of base64 in the page, and in a file next to it."""
FOLDER = "report_pictures"
IMPORTANCE = (
    "the last checkpoint of the seed that is shown",
    "earlier checkpoints of it, first view",
    "earlier checkpoints of it, other views",
    "other seeds, first view",
    "other seeds, other views",
)
LEAST = 1
"""The importance up to which the pictures of every scene must fit into the page; if not, files hold them."""
BRIGHT = 1.0 + 1 / 256
"""The linear light above which a value is brighter than white, beyond the rounding of float16."""


@dataclass
class SceneData:
    entry: JsonObject
    renders: list[tuple[int, dict[str, object], dict[str, str]]] = field(default_factory=list)
    """(importance, row, id → base64), in the order of methods, seeds, steps and views; no row if not packed."""
    texts: dict[str, str] = field(default_factory=dict)
    """The pictures of the truth: id → base64."""
    left_out: Counter[int] = field(default_factory=Counter)
    unshown: bool = False
    """Whether there are renders but no truth."""

    def sizes(self) -> np.ndarray:
        """Return the bytes by importance; the truth counts as most important."""
        sizes = np.zeros(len(IMPORTANCE), dtype=np.int64)
        for importance, _, texts in [(0, {}, self.texts), *self.renders]:
            sizes[importance] += sum(map(len, texts.values()))
        return sizes

    def choose(self, up_to: int) -> dict[str, str]:
        """Write the rows up to an importance into the entry; return their pictures and those of the truth."""
        texts = dict(self.texts)
        for importance, row, of_row in self.renders:
            if importance <= up_to:
                self.entry["renders"].append(row)
                texts |= of_row
        self.left_out.update(importance for importance, _, _ in self.renders if importance > up_to)
        return texts


class PictureData(NamedTuple):
    data: dict[str, object]
    inline: dict[str, str]
    """The id of an element → base64."""
    files: dict[str, str]
    """The path relative to the page → content; empty if the page holds its pictures."""


def picture_data(records: Records, budget: int = INLINE_BYTES, file_budget: int = FILE_BYTES) -> PictureData | None:
    if not any(cell.pictures for cell in records.pictured_cells):
        return None
    return _inline(records, budget) or _beside(records, file_budget)


def _inline(records: Records, budget: int) -> PictureData | None:
    """Put the pictures into the page; return None if those up to `LEAST` do not fit."""
    scenes: list[SceneData] = []
    spent, up_to = np.zeros(len(IMPORTANCE), dtype=np.int64), len(IMPORTANCE) - 1
    for scene in records.scenes:
        scenes.append(scene_data(records, scene, up_to))
        spent += scenes[-1].sizes()
        up_to = _fitting(spent, budget)
        if up_to < LEAST:
            return None
    inline = {name: text for shown in scenes for name, text in shown.choose(up_to).items()}
    return PictureData(_data(records, scenes, ""), inline, {})


def _beside(records: Records, budget: int) -> PictureData:
    """Make a file per scene; only the packed pictures of one scene are in memory at a time."""
    scenes: list[SceneData] = []
    files: dict[str, str] = {}
    for place, scene in enumerate(records.scenes):
        shown = scene_data(records, scene, len(IMPORTANCE) - 1)
        texts = shown.choose(max(_fitting(shown.sizes(), budget), 0))
        # the name of a scene may hold any character
        file = f"{FOLDER}/{place}_{re.sub('[^A-Za-z0-9_-]', '_', scene)[:80]}.js"
        for holder in (*(view["truth"] for view in shown.entry["views"]), *shown.entry["renders"]):
            for ref in holder.values():
                if isinstance(ref, dict):
                    ref["file"] = file
        lines = ",\n".join(f'"{name}":"{text}"' for name, text in texts.items())
        files[file] = f"reportPictures({{{lines}}});\n"
        shown.renders.clear()
        shown.texts.clear()
        scenes.append(shown)
    beside = (
        f"The pictures of this report lie in {FOLDER}/ next to it, "
        f"{counted(len(files), 'file')} of {sum(map(len, files.values())) / 1e6:.0f} MB: "
        "pass that folder on together with the report."
    )
    return PictureData(_data(records, scenes, beside), {}, files)


def _fitting(spent: np.ndarray, budget: int) -> int:
    """Return the largest importance up to which everything fits; −1 if nothing does."""
    return int((np.cumsum(spent) <= budget).sum()) - 1


def _data(records: Records, scenes: list[SceneData], beside: str) -> dict[str, object]:
    left_out = sum((shown.left_out for shown in scenes), Counter[int]())
    sentences = [
        f"{counted(many, 'render')} left out to keep this report small: {IMPORTANCE[importance]}."
        for importance, many in sorted(left_out.items())
    ]
    sentences += [
        f"{shown.entry['name']}: its pictures are not shown, as their ground truth is missing or damaged."
        for shown in scenes
        if shown.unshown
    ]
    return {
        "methods": records.pictured,
        "variables": {method: colour.variable for method, colour in colours_of(records.pictured).items()},
        "scenes": [shown.entry for shown in scenes if shown.entry["views"]],
        "left_out": sentences,
        "beside": beside,
    }


def scene_data(records: Records, scene: str, up_to: int) -> SceneData:
    """Return the scene with its renders packed up to an importance; `choose` fills `entry["renders"]`."""
    pictures, about, first = kept(records, scene), records.scene(scene), seed_shown(records, scene)
    names = list(pictures.truth)
    far = _far(pictures, about)
    shown = SceneData({"name": scene, "title": about.title if about else scene, "missing": [], "renders": []})
    shown.entry["views"] = [_view(pictures.truth[name], about, far, shown.texts) for name in names]
    shown.unshown = bool(pictures.renders) and not names
    cells = [cell for cell in records.pictured_cells if cell.scene == scene]
    for cell in sorted(cells, key=lambda cell: (records.pictured.index(cell.method), cell.seed)):
        key = (cell.method, cell.seed)
        why = pictures.missing.get(key)
        if cell.status != "done" or why is not None:
            reason = why or cell.reason or cell.status
            row = {"method": cell.method, "seed": cell.seed, "status": cell.status, "reason": reason}
            shown.entry["missing"].append(row)
        renders = pictures.renders.get(key, [])
        for render in renders:
            truth = pictures.truth.get(render.view)
            if truth is None or render.opacity.shape != truth.opacity.shape:
                continue
            last, place = render.step == renders[-1].step, names.index(render.view)
            # in the order of IMPORTANCE
            importance = 0 if cell.seed == first and last else (1 if cell.seed == first else 3) + (place > 0)
            texts: dict[str, str] = {}
            packed = _row(cell, render, last, place, far, texts) if importance <= up_to else {}
            shown.renders.append((importance, packed, texts))
    return shown


def _far(pictures: Kept, about: SceneRecord | None) -> float:
    depths = [truth.depth for truth in pictures.truth.values() if truth.depth is not None]
    depths += [render.depth for renders in pictures.renders.values() for render in renders]
    return max([about.far if about else 0.0, *(float(depth.max()) for depth in depths)]) or 1.0


def _put(packed: Packed, texts: dict[str, str]) -> dict[str, object]:
    texts[packed.id] = packed.text
    return dict(packed.ref)


def _view(truth: Truth, about: SceneRecord | None, far: float, texts: dict[str, str]) -> dict[str, object]:
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


def _row(
    cell: CellRecord, render: Render, last: bool, place: int, far: float, texts: dict[str, str]
) -> dict[str, object]:
    scores = next((score for score in cell.views if score.view == render.view), None)
    scored, ceiling = scores if last else None, scores.psnr_ceiling if scores else None
    return {
        "method": cell.method,
        "seed": cell.seed,
        "step": render.step,
        "seconds": next((point.seconds for point in cell.curve if point.step == render.step), None),
        "last": last,
        "view": place,
        **{name: getattr(scored, name, None) for name in ("psnr", "flip", "delta_e", "rel_mse", "smape", "hdr_flip")},
        # the RMS difference between renders of the truth
        "noise": None if ceiling is None else 10.0 ** (-ceiling / 20.0),
        "colour": _put(packing.display(render.colour), texts),
        "opacity": _put(packing.display(render.opacity), texts),
        "depth": _put(packing.depth(render.depth, far), texts),
    }


def write_files(files: dict[str, str], folder: Path) -> None:
    """Write the picture files of a page in `folder`, each atomically. Raises `OSError`."""
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, text, fsync=False)


def remove_others(files: dict[str, str], folder: Path) -> None:
    """Remove picture files of an earlier page in `folder` that `files` does not name. Raises `OSError`."""
    pictures = folder / FOLDER
    for path in pictures.glob("*.js"):
        if f"{FOLDER}/{path.name}" not in files:
            path.unlink()
    if pictures.is_dir() and not any(pictures.iterdir()):
        pictures.rmdir()
