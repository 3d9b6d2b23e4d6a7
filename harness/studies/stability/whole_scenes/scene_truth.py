"""The common parts of all cases about scenes: scenes rendered and trained once, closed forms, and a check of each
method.
"""

import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Literal

import numpy as np

from harness.execution.ground_truth import render_view_sets
from harness.records.cells import CellRecord, RunRecord, cell_path, read_cells, read_run, records_folder
from harness.records.json_record import DamagedRecord
from harness.records.pictures import last_of, read_renders
from harness.records.study import Check, Status, Table, check, limits
from harness.run_folder.integrity import mend
from harness.studies.stability.stability_context import Finding, StabilityContext, whose
from scenes.catalog.entries import scene_named
from scenes.modelling.truth import Truth, pixel_means
from scenes.view_sets.images import read_channels
from scenes.view_sets.pixels import over_white
from scenes.view_sets.transforms import read_transforms
from scenes.view_sets.view_set import ViewSet

COLOURS = "RGBA"
LARGEST_Z = 4.0
STRATA = (13, 16)
"""The closed form is averaged over a pixel twice, by one random ray in each of so many strata along either axis: this
is free of bias, and what the two differ by is the noise of their mean. Even grids of the same sizes are off by their
alignment with straight edges: beneath fields half a pixel wide by four standard errors of six views.
"""


@dataclass(frozen=True)
class Views:
    """Some views of a view set as they were rendered, and their closed form; n views."""

    names: tuple[str, ...]
    rendered: np.ndarray
    """Colour, float64 [n, h, w, 4]: linear, premultiplied."""
    variance: np.ndarray
    """Variance [n, h, w, 4]: the renderer's estimate of its noise, and the difference of the two means of the closed
    form.
    """
    truth: np.ndarray
    """The closed form [n, h, w, 4]."""
    depth: np.ndarray
    """Depth [n, h, w]: rendered, 0 where nothing was hit."""
    true_depth: np.ndarray

    @property
    def covered(self) -> np.ndarray:
        """Return the pixels [n, h, w] that are covered from border to border, by the rendering and by the closed
        form.
        """
        whole: np.ndarray = (self.rendered[..., 3] > 1 - 1e-6) & (self.truth[..., 3] > 1 - 1e-9)
        return whole

    def of(self, name: str) -> "Views":
        """Return the one view of that name."""
        one = slice(index := self.names.index(name), index + 1)
        return Views(
            (name,), self.rendered[one], self.variance[one], self.truth[one], self.depth[one], self.true_depth[one]
        )


def read_views_and_truth(folder: Path, names: Iterable[str], poses: Iterable[np.ndarray], truth: Truth) -> Views:
    """Read `names` inside a view set's folder, without suffix, and their cameras [4, 4]."""
    names = tuple(names)
    rows = []
    for number, (name, pose) in enumerate(zip(names, poses, strict=True)):
        channels = read_channels(folder / f"{name}.exr")
        rendered = np.stack([channels[one] for one in COLOURS], axis=-1).astype(np.float64)
        noise = np.stack([channels[f"V.{one}"] for one in COLOURS], axis=-1).astype(np.float64)
        height, width = rendered.shape[:2]
        mean, apart, depth = closed_form(truth, pose, width, height, number)
        rows.append((rendered, noise + apart, mean, channels["Z"], depth))
    return Views(names, *(np.stack(column).astype(np.float64) for column in zip(*rows, strict=True)))


def closed_form(
    truth: Truth, pose: np.ndarray, width: int, height: int, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return means over pixels [h, w, 4], the variance of each, and depth [h, w]."""
    (first, first_depth), (second, second_depth) = (
        pixel_means(truth, pose, width, height, strata, np.random.default_rng((seed, strata))) for strata in STRATA
    )
    return (first + second) / 2, (first - second) ** 2 / 4, (first_depth + second_depth) / 2


def z_score(estimate: float, truth: float, variance: float) -> float:
    """Return (estimate − truth) / standard error. Without variance: 0 if they agree to float32's digits, else
    infinite.
    """
    difference = estimate - truth
    if variance <= 0.0:
        return 0.0 if abs(difference) <= 1e-6 * max(abs(truth), 1.0) else float("inf")
    return difference / float(np.sqrt(variance))


def worst_z(views: Views, chosen: np.ndarray | None = None) -> float:
    """Return the largest |z| of the means of red, green, blue and opacity over the pixels `chosen` [n, h, w]."""
    picked = np.ones(views.depth.shape, bool) if chosen is None else chosen
    count = np.count_nonzero(picked)
    return max(
        abs(
            z_score(
                float(views.rendered[picked][:, i].mean()),
                float(views.truth[picked][:, i].mean()),
                float(views.variance[picked][:, i].sum()) / count**2,
            )
        )
        for i in range(len(COLOURS))
    )


def unexplained(views: Views) -> float:
    """Return the mean square difference of pixels over what noise explains: about 1 if every pixel is right, not means
    alone.

    It is 0 if there is neither difference nor noise.
    """
    square, noise = float(np.mean((views.rendered - views.truth) ** 2)), float(np.mean(views.variance))
    # float32 colours carry a rounding error that no noise explains
    return square / (noise + 1e-13) if square > 1e-13 else 0.0


def depth_error(views: Views) -> float:
    """Return the largest |rendered − true| distance over pixels that are completely covered, scene units; NaN if none
    is.
    """
    if not views.covered.any():
        return float("nan")
    return float(np.abs(views.depth - views.true_depth)[views.covered].max())


def explained_share(mse: float, variance: float) -> float:
    """Return R² = 1 − mse / variance: 1 if everything is explained, 0 for what one flat colour would reach."""
    return 1.0 - mse / variance


def colour_variance(pixels: np.ndarray) -> float:
    """Return the mean square distance of pixels [n, 3] from the one colour that is nearest to them all."""
    values = pixels.astype(np.float64)
    return float(np.mean((values - values.mean(axis=0)) ** 2))


@dataclass(frozen=True)
class SceneRun:
    """The results of a run of the ordinary benchmark."""

    out: Path
    view_sets: Path
    run: RunRecord
    cells: dict[tuple[str, str], list[CellRecord]]
    """(scene, method) → its cells, one per seed."""

    @property
    def methods(self) -> list[str]:
        return list(self.run.methods)

    def of(self, scene: str) -> Iterator[CellRecord]:
        """Yield the cells of a scene, method by method in the order of the run."""
        return (cell for method in self.methods for cell in self.cells.get((scene, method), []))

    def folder(self, scene: str) -> Path:
        """Return its view set."""
        return self.view_sets / next(one.view_set for one in self.run.scenes if one.name == scene)


def trained(situation: StabilityContext, profile: str, scenes: Iterable[str], folder: Path) -> SceneRun:
    """Return `folder` with every cell of these scenes: those that it lacks are trained.

    The cells that an earlier case trained there stay in its record: the scenes of both are planned, and finished cells
    are kept. If nothing is missing, nothing is run, so that cases can request it one after another.
    """
    before = _run_of(folder)
    there = [scene.name for scene in before.scenes] if before else []
    wanted = {*scenes, *there}
    everything = situation.plan(profile)
    plan = situation.plan(profile, [name for name in everything.scenes if name in wanted])
    if folder.exists():
        mend(folder, plan, lambda line: situation.show.line(f"  {folder.name}: {line}"))
    whole = all(cell_path(folder, *one).exists() for one in plan.cells())
    if not (whole and before and before.finished and before.settings == json.loads(json.dumps(plan.settings()))):
        folder.mkdir(parents=True, exist_ok=True)
        situation.trained(plan, folder)
    return read_trained(folder, situation.view_sets)


def read_trained(folder: Path, view_sets: Path) -> SceneRun:
    cells: dict[tuple[str, str], list[CellRecord]] = {}
    for cell in read_cells(folder):
        cells.setdefault((cell.scene, cell.method), []).append(cell)
    return SceneRun(folder, view_sets, read_run(folder), cells)


def _run_of(folder: Path) -> RunRecord | None:
    with suppress(DamagedRecord):
        return read_run(folder)
    return None


def unscored(case: str, cell: CellRecord, what: str) -> Check | None:
    """Return the check of a cell without scores: not available if the method is not, else failed; None for a complete
    cell.

    A cell that diverged or failed is a failure of whoever its method belongs to.
    """
    if cell.status == "done":
        return None
    status: Status = "not_available" if cell.status == "not_available" else "fail"
    return Check(
        what,
        None,
        why=f"{cell.scene}: {cell.status}, {cell.reason}",
        subject=cell.method,
        owner=whose(cell.method),
        status=status,
    )


@dataclass(frozen=True)
class Shown:
    """A test view as the record keeps it, in float16: what every method leaves behind, whatever it is made of."""

    view: str
    render: np.ndarray
    """The picture [h, w, 3], display colour over white."""
    opacity: np.ndarray
    """The opacity [h, w]."""


def shown(found: SceneRun, cell: CellRecord) -> list[Shown]:
    if cell.pictures is None:
        return []
    return [
        Shown(one.view, np.clip(one.colour.astype(np.float64), 0.0, 1.0), one.opacity.astype(np.float64).clip(0.0, 1.0))
        for one in last_of(read_renders(records_folder(found.out) / cell.pictures))
    ]


NOTHING_THERE = ("empty",)
"""The scenes of which to show nothing is right."""
LARGEST_TRACE = 0.05
"""The mean distance from white, at most, of a picture that shows nothing."""


def learnt_nothing(found: SceneRun, cell: CellRecord) -> bool:
    """Whether a complete cell shows nothing at all of a scene in which there is something: empty collapse.

    Whether a training collapses within a few hundred steps depends on its random numbers, and says nothing of how well
    a formula is computed: it is recorded, and never taken for a result. A picture that has no opacity and is dark all
    the same adds up its colours wrongly, and is judged.
    """
    collapsed = any(warning.startswith("empty collapse") for warning in cell.warnings)
    if cell.status != "done" or not collapsed or cell.scene in NOTHING_THERE:
        return False
    return all((1.0 - one.render).mean() <= LARGEST_TRACE for one in shown(found, cell))


SCORES = ("psnr", "psnr_train", "psnr_floor", "psnr_ceiling")


def scores_table(case: str, title: str, trained: SceneRun, scenes: Iterable[str], item: int) -> Table:
    """Return scene × method: training and test views always side by side."""
    rows: list[list[str | float | None]] = [
        [
            scene,
            cell.method,
            *(cell.scores.get(name) for name in SCORES),
            cell.status if cell.reason is None else f"{cell.status}: {cell.reason}",
            "; ".join(["learnt nothing"] * learnt_nothing(trained, cell) + cell.warnings),
        ]
        for scene in scenes
        for cell in trained.of(scene)
    ]
    columns = ["scene", "method", "test dB", "training dB", "floor dB", "ceiling dB", "status", "what to know"]
    return Table(f"{case.lower()}-scores", item, title, columns, rows)


PROFILE = "stress"
ITEM = 10
SCENES: dict[str, tuple[str, ...]] = {
    "S1": ("empty", "black", "white"),
    "S2": ("wall", "inside"),
    "S3": ("fog_dense", "fog_thin"),
    "S4": ("wires",),
    "S5": ("mirror", "glass", "glass_air"),
    "S6": ("hdr_emitter", "checker", "grazing", "furnace"),
    "S7": ("tiny", "huge"),
}
"""Case → the scenes that it examines."""
LARGEST_EXCESS = 1.5
"""The largest quotient of the mean square difference of pixels from closed form and what noise explains; measured: 0.92
to 1.35.
"""


def stress(situation: StabilityContext, case: str) -> SceneRun:
    """Return the scenes of all cases of this run, trained once."""
    chosen = [name for name in SCENES if name in situation.cases] or list(SCENES)
    wanted = [scene for name in {case, *chosen} for scene in SCENES[name]]
    return trained(situation, PROFILE, wanted, situation.out)


def views_of(found: SceneRun, scene: str, count: int | None = None) -> Views:
    """Return the scene's test views beside their closed form."""
    truth = scene_named(scene).truth
    if truth is None:
        raise ValueError(f"scene {scene} has no closed form")
    return views_beside(found.folder(scene), truth, count)


def views_beside(folder: Path, truth: Truth, count: int | None = None) -> Views:
    """Return the test views of a view set, or the first `count`, beside a closed form."""
    frames = read_transforms(folder, "test")
    names = [file.relative_to(folder.resolve()).with_suffix("").as_posix() for file in frames.files]
    return read_views_and_truth(folder, names[:count], frames.camera_to_world[:count], truth)


def view_set_of(situation: StabilityContext, scene: str) -> Path:
    """Return a scene's view set as the stress scenes have theirs, rendered if the cache has none, and nothing
    trained.
    """
    views = situation.plan(PROFILE).views
    return next(event.path for event in render_view_sets((scene,), views, situation.view_sets) if event.path)


def held_to_closed_form(case: str, scene: str, views: Views, why: str = "") -> Iterator[Check]:
    """Check the rendered ground truth against closed form: the means of complete views, and pixel by pixel."""
    yield check(
        f"{scene}: largest |z| of red, green, blue and opacity against closed form",
        worst_z(views),
        high=LARGEST_Z,
        why=why,
        subject="ground truth",
    )
    yield check(
        f"{scene}: mean square difference of pixels over what noise explains",
        unexplained(views),
        high=LARGEST_EXCESS,
        subject="ground truth",
    )


def each_method(
    case: str,
    found: SceneRun,
    scene: str,
    figure: Callable[[CellRecord], float | None],
    bar: float,
    what: str,
    unit: str = "",
    sense: Literal["at_most", "at_least"] = "at_most",
) -> Iterator[Check]:
    """Check `figure` of every cell of the scene against `bar`; a cell whose figure is None is reported as such.

    A cell that learnt nothing keeps its figure and is not judged by it: showing nothing at all comes close to many a
    scene, and is no success on any.
    """
    for cell in found.of(scene):
        missing = unscored(case, cell, f"{scene}: {what}")
        value = None if missing else figure(cell)
        if missing:
            yield missing
        elif value is None:
            yield Check(
                f"{scene}: {what}",
                None,
                why="its record holds no such score",
                subject=cell.method,
                owner=whose(cell.method),
                status="not_applicable",
            )
        elif learnt_nothing(found, cell):
            yield Check(
                f"{scene}: {what}",
                value if isfinite(value) else None,
                *limits(bar, sense),
                unit=unit,
                why=f"learnt nothing in {cell.steps} steps: empty collapse; nothing is there to judge",
                subject=cell.method,
                owner=whose(cell.method),
                status="not_applicable",
            )
        else:
            why = "; ".join(cell.warnings)
            yield check(
                f"{scene}: {what}",
                value,
                *limits(bar, sense),
                unit=unit,
                why=why,
                subject=cell.method,
                owner=whose(cell.method),
            )


def scores(case: str, title: str, found: SceneRun) -> Finding:
    """Return training and test views of the case's scenes side by side."""
    return scores_table(case, title, found, SCENES[case], ITEM)


def mse_over_tests(cell: CellRecord) -> float | None:
    """Return the mean over the test views of the mean square error, display colour over white."""
    errors = [10.0 ** (-view.psnr / 10.0) for view in cell.views if view.psnr is not None]
    return float(np.mean(errors)) if errors else None


def share_of_looks(found: SceneRun, cell: CellRecord, views: ViewSet) -> float | None:
    """Return the explained share over the pixels that are completely covered; display colours of 8 bits."""
    truth, render = [], []
    for one in shown(found, cell):
        rgba = views.test.rgba[views.test.names.index(one.view)]
        covered = rgba[..., 3] > 0.999
        truth.append(over_white(rgba)[covered])
        render.append(one.render[covered])
    if not truth or not np.concatenate(truth).size:
        return None
    true, seen = np.concatenate(truth).astype(np.float64), np.concatenate(render)
    variance = colour_variance(true)
    return explained_share(float(np.mean((seen - true) ** 2)), variance) if variance > 0.0 else None


def textbook_scores(image: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """Return PSNR of an error that may be 0, and SSIM of complete images [h, w, 3] without its two constants."""
    x, y = image.astype(np.float64), truth.astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        psnr = -10.0 * np.log10(np.mean((x - y) ** 2))
        mean_x, mean_y = x.mean(), y.mean()
        covariance = ((x - mean_x) * (y - mean_y)).mean()
        structure = 2 * mean_x * mean_y * 2 * covariance
        ssim = structure / ((mean_x**2 + mean_y**2) * (x.var() + y.var()))
    return {"psnr": float(psnr), "ssim": float(ssim)}
