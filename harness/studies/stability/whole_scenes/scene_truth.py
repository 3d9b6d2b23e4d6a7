"""Shared by all cases about scenes: scenes rendered and trained once, closed forms, checks of methods."""

import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from math import isfinite
from pathlib import Path

import numpy as np

from harness.execution import run as execution
from harness.execution.ground_truth import read_views, render_view_sets
from harness.records.cells import CellRecord, RunRecord, cell_path, read_cells, read_run, records_folder
from harness.records.pictures import Render, last_of, read_renders
from harness.records.study import Check, CheckFacts, Status, Table, check
from harness.run_folder.integrity import repair
from harness.studies.framework import Rows
from harness.studies.stability.cases import CASES
from harness.studies.stability.stability_context import StabilityContext, owner_of_method
from harness.training.scoring.evaluate import mean_of
from harness.verdicts.failures import COLLAPSED, failure_of
from scenes.files.errors import DamagedRecord
from scenes.modelling.truth import Truth, pixel_means
from scenes.view_sets.formats.transforms import read_transforms
from scenes.view_sets.images import read_channels
from scenes.view_sets.pixels import over_white
from scenes.view_sets.view_set import ViewSet

COLOURS = "RGBA"
LARGEST_Z = 4.0
STRATA = (13, 16)
"""The closed form is averaged over a pixel twice, by one random ray in each of this many strata along either axis. This
is free of bias, and the difference of the two estimates the noise of their mean. Even grids of the same sizes are
biased by their alignment with straight edges: on stripes half a pixel wide by four standard errors of six views.
"""


@dataclass(frozen=True)
class Views:
    """n rendered views of a view set with their closed form: float64, linear and premultiplied."""

    names: tuple[str, ...]
    rendered: np.ndarray
    """[n, h, w, 4]"""
    variance: np.ndarray
    """[n, h, w, 4]: the sum of the variances of rendering and closed form."""
    truth: np.ndarray
    """[n, h, w, 4]: the closed form."""
    depth: np.ndarray
    """[n, h, w]: rendered, 0 where nothing was hit."""
    true_depth: np.ndarray

    @property
    def covered(self) -> np.ndarray:
        """Return the pixels [n, h, w] that both rendering and closed form cover completely."""
        complete: np.ndarray = (self.rendered[..., 3] > 1 - 1e-6) & (self.truth[..., 3] > 1 - 1e-9)
        return complete

    def of(self, name: str) -> "Views":
        part = slice(index := self.names.index(name), index + 1)
        return Views(*(getattr(self, column.name)[part] for column in fields(self)))


def views_with(folder: Path, truth: Truth, count: int | None = None) -> Views:
    """Return the test views of a view set, or the first `count`, with their closed form."""
    frames = read_transforms(folder, "test")
    names = [file.relative_to(folder.resolve()).with_suffix("").as_posix() for file in frames.files][:count]
    rows = []
    for number, (name, pose) in enumerate(zip(names, frames.camera_to_world[:count], strict=True)):
        channels = read_channels(folder / f"{name}.exr")
        rendered, noise = (
            np.stack([channels[f"{kind}{colour}"] for colour in COLOURS], axis=-1).astype(np.float64)
            for kind in ("", "V.")
        )
        mean, apart, depth = closed_form(truth, pose, rendered.shape[1], rendered.shape[0], number)
        rows.append((rendered, noise + apart, mean, channels["Z"], depth))
    return Views(tuple(names), *(np.stack(column).astype(np.float64) for column in zip(*rows, strict=True)))


def closed_form(
    truth: Truth, pose: np.ndarray, width: int, height: int, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the means over pixels [h, w, 4], their variances, and depth [h, w]."""
    (first, first_depth), (second, second_depth) = (
        pixel_means(truth, pose, width, height, strata, np.random.default_rng((seed, strata))) for strata in STRATA
    )
    return (first + second) / 2, (first - second) ** 2 / 4, (first_depth + second_depth) / 2


def z_score(estimate: float, truth: float, variance: float) -> float:
    """Return (estimate − truth) / standard error; without variance 0 if they agree, else infinite."""
    difference = estimate - truth
    if variance <= 0.0:
        return 0.0 if abs(difference) <= 1e-6 * max(abs(truth), 1.0) else float("inf")
    return difference / float(np.sqrt(variance))


def worst_z(views: Views, chosen: np.ndarray | None = None) -> float:
    """Return the largest |z| of the means of red, green, blue and opacity over the pixels `chosen` [n, h, w]."""
    picked = np.ones(views.depth.shape, bool) if chosen is None else chosen
    count = np.count_nonzero(picked)
    rendered, truth, variance = (values[picked] for values in (views.rendered, views.truth, views.variance))
    return max(
        abs(z_score(float(rendered[:, i].mean()), float(truth[:, i].mean()), float(variance[:, i].sum()) / count**2))
        for i in range(len(COLOURS))
    )


def unexplained(views: Views) -> float:
    """Return the mean square difference of pixels relative to their noise: about 1 if every pixel is right."""
    square, noise = float(np.mean((views.rendered - views.truth) ** 2)), float(np.mean(views.variance))
    # float32 colours carry a rounding error that no noise explains
    return square / (noise + 1e-13) if square > 1e-13 else 0.0


def colour_variance(pixels: np.ndarray) -> float:
    """Return the mean square distance of pixels [n, 3] from their mean, a prediction that explains nothing."""
    values = pixels.astype(np.float64)
    return float(np.mean((values - values.mean(axis=0)) ** 2))


@dataclass(frozen=True)
class SceneRun:
    out: Path
    view_sets: Path
    run: RunRecord
    cells: dict[tuple[str, str], list[CellRecord]]

    def of(self, scene: str) -> Iterator[CellRecord]:
        return (cell for method in self.run.methods for cell in self.cells.get((scene, method), []))

    def folder(self, scene: str) -> Path:
        return self.view_sets / next(record.view_set for record in self.run.scenes if record.name == scene)

    def view_set(self, context: StabilityContext, scene: str) -> ViewSet:
        return read_views(self.folder(scene), context.plan(self.run.profile).views, context.scratch)


def trained(context: StabilityContext, profile: str, scenes: Iterable[str], folder: Path) -> SceneRun:
    """Return `folder` with every cell of these scenes, after training those that it lacks; scenes that an earlier case
    trained there stay in the record, with their finished cells.
    """
    before = None
    with suppress(DamagedRecord):
        before = read_run(folder)
    needed = {*scenes, *(scene.name for scene in (before.scenes if before else []))}
    plan = context.plan(profile, [name for name in context.plan(profile).scenes if name in needed])
    if folder.exists():
        repair(folder, plan, lambda line: context.show.line(f"  {folder.name}: {line}"))
    complete = all(cell_path(folder, *cell).exists() for cell in plan.cells())
    if not (complete and before and before.finished and before.settings == json.loads(json.dumps(plan.settings()))):
        folder.mkdir(parents=True, exist_ok=True)
        machine = replace(context.machine, threads=1)
        execution.run(plan, folder, context.view_sets, machine, "nox -s stability", context.show)
    cells: dict[tuple[str, str], list[CellRecord]] = {}
    for cell in read_cells(folder):
        cells.setdefault((cell.scene, cell.method), []).append(cell)
    return SceneRun(folder, context.view_sets, read_run(folder), cells)


def shown(run: SceneRun, cell: CellRecord) -> list[Render]:
    """Return the stored renders of test views, clipped to [0, 1]."""
    if cell.pictures is None:
        return []

    def clipped(values: np.ndarray) -> np.ndarray:
        return np.clip(values.astype(np.float64), 0.0, 1.0)

    renders = last_of(read_renders(records_folder(run.out) / cell.pictures))
    return [replace(view, colour=clipped(view.colour), opacity=clipped(view.opacity)) for view in renders]


LARGEST_TRACE = 0.05
"""The largest mean distance from white of a picture that shows nothing."""


def learnt_nothing(run: SceneRun, cell: CellRecord) -> bool:
    """Return whether a complete cell shows nothing of its scene: empty collapse.

    Whether a training collapses within a few hundred steps depends on its random numbers and not on how well a formula
    is computed: it is not judged. A dark picture without opacity is judged, as it adds up its colours wrongly.
    """
    return failure_of(cell) == COLLAPSED and all(
        (1.0 - view.colour).mean() <= LARGEST_TRACE for view in shown(run, cell)
    )


PROFILE = "stress"
SCENES: dict[str, tuple[str, ...]] = {
    "S1": ("empty", "black", "white"),
    "S2": ("wall", "inside"),
    "S3": ("fog_dense", "fog_thin"),
    "S4": ("wires",),
    "S5": ("mirror", "glass", "glass_air"),
    "S6": ("hdr_emitter", "checker", "grazing", "furnace"),
    "S7": ("tiny", "huge"),
}


def stress(context: StabilityContext, case: str) -> SceneRun:
    chosen = [name for name in SCENES if name in context.cases] or list(SCENES)
    return trained(context, PROFILE, [scene for name in {case, *chosen} for scene in SCENES[name]], context.out)


def view_set_of(context: StabilityContext, scene: str) -> Path:
    """Return the view set of a scene in the size of the profile, rendered if it is not in the cache."""
    views = context.plan(PROFILE).views
    return next(event.path for event in render_view_sets((scene,), views, context.view_sets) if event.path)


def each_method(
    run: SceneRun,
    scene: str,
    what: str,
    figure: Callable[[CellRecord], float | None],
    low: float | None = None,
    high: float | None = None,
    unit: str = "",
) -> Iterator[Check]:
    """Check `figure` of every cell of the scene against its limit.

    A cell without scores fails, unless its method is not available; a figure of None is reported as not applicable. A
    cell that learnt nothing keeps its figure and is not judged: a blank picture is close to many scenes.
    """
    for cell in run.of(scene):
        name, facts = f"{scene}: {what}", CheckFacts(subject=cell.method, owner=owner_of_method(cell.method))
        if cell.status != "done":
            status: Status = "not_available" if cell.status == "not_available" else "fail"
            yield Check(name, None, why=f"{scene}: {cell.status}, {cell.reason}", status=status, **facts)
        elif (value := figure(cell)) is None:
            yield Check(name, None, why="its record holds no such score", status="not_applicable", **facts)
        elif learnt_nothing(run, cell):
            why = f"learnt nothing in {cell.steps} steps: empty collapse, not judged"
            finite = value if isfinite(value) else None
            yield Check(name, finite, low, high, unit, why, status="not_applicable", **facts)
        else:
            yield check(name, value, low, high, unit, "; ".join(cell.warnings), **facts)


SCORES = ("psnr", "psnr_train", "psnr_floor", "psnr_ceiling")


def scores_table(case: str, run: SceneRun) -> Table:
    rows: Rows = []
    for cell in (cell for scene in SCENES[case] for cell in run.of(scene)):
        status = cell.status if cell.reason is None else f"{cell.status}: {cell.reason}"
        notes = "; ".join(["learnt nothing"] * learnt_nothing(run, cell) + cell.warnings)
        rows.append([cell.scene, cell.method, *(cell.scores.get(name) for name in SCORES), status, notes])
    columns = ["scene", "method", "test dB", "training dB", "floor dB", "ceiling dB", "status", "notes"]
    return Table(f"{case.lower()}-scores", 10, CASES[case].info.title, columns, rows)


def mse_over_tests(cell: CellRecord) -> float | None:
    """Return the mean square error over the test views, of display colour over white."""
    return mean_of(10.0 ** (-view.psnr / 10.0) for view in cell.views if view.psnr is not None)


def share_of_looks(run: SceneRun, cell: CellRecord, views: ViewSet) -> float | None:
    """Return the explained share of the variance of the completely covered pixels, in display colour."""
    truth, render = [], []
    for view in shown(run, cell):
        rgba = views.test.rgba[views.test.names.index(view.view)]
        covered = rgba[..., 3] > 0.999
        truth.append(over_white(rgba)[covered])
        render.append(view.colour[covered])
    if not truth or not (true := np.concatenate(truth).astype(np.float64)).size:
        return None
    mse, variance = float(np.mean((np.concatenate(render) - true) ** 2)), colour_variance(true)
    return 1.0 - mse / variance if variance > 0.0 else None
