"""Error against time while a view is refined by attention, in raster order, and plainly; and what φ changes."""

import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from baselines.numerics.attention.maps import MAPS, MapInputs
from baselines.numerics.attention.priorities import PHI, is_equal, region_order, without_phi
from baselines.numerics.attention.regions import Regions
from harness.playback.progressive import Canvas, Done, Order, coarse, estimated_error, refine, why_plain
from harness.playback.run_loader import TrainedCell
from harness.records.study import Check, Status, Table
from harness.studies.framework import Found, Rows
from harness.studies.serving.serving_context import CLOCK, Clock, ServingContext, brief, factor, plain, study
from harness.training.batches import Camera
from harness.training.scoring.evaluate import View

ORDERS = {"attention": "attention", "raster": "raster order", "plain": "plain rendering"}
"""The orders in which a picture is refined after its coarse frame; `plain` has no such frame and the largest chunks."""
MEASURES = {"whole": "the whole picture", "attended": "the most attended quarter"}
SCENES, METHODS = ("lego", "hotdog", "drums"), ("nerf", "nerf_matched")
"""What is preferred if the run has it; the first method that can be rendered by regions is used."""
STRIDE = 4
"""The stride of the coarse frame: one ray of sixteen."""
REGIONS_PER_SIDE, MIN_TILE = 10, 4
MIN_SHARE = 0.25
"""The minimum number of samples of a ray, as a share of the mean."""
SHARE_OF_ERROR = 0.1
"""The share of the error of raster order's coarse frame at which a picture is called useful."""
QUARTER = 0.25
"""The share of the regions that count as the most attended."""
MIN_SCENES = 3
NOTHING = "No method of the run can be rendered by regions here."


@dataclass(frozen=True)
class RegionView:
    cell: TrainedCell
    camera: Camera
    regions: Regions

    @property
    def bins(self) -> int:
        return int(self.cell.cell.settings["train"]["bins"])

    def coarse(self) -> View:
        return coarse(self.cell.learner, self.camera, STRIDE, self.cell.chunk).view


@dataclass(frozen=True)
class Refined:
    """One view refined in one order. All repeats give the same picture, at other times."""

    first: View
    parts: list[Done]
    seconds: np.ndarray
    """Seconds [repeats, points] from the request to the first frame, and to each part."""


Times = dict[str, np.ndarray]
"""Order → seconds [repeats], means over views, until its error is small for good; infinite if it never is."""


@dataclass(frozen=True)
class Case:
    scene: str
    kind: str
    times: dict[str, Times]
    """Measure → its times."""


@study
def attention(context: ServingContext) -> Iterator[Found]:
    cases, effects = [], []
    for cell in cells_of(context):
        views = [region_view(context, cell, pose) for pose in context.orbit(cell.scene, context.sizes.views)]
        context.show.line(f"  {cell.learner.method} on {cell.scene.name}")
        by_kind: dict[str, list[dict[str, Times]]] = {}
        for number, view in enumerate(views):
            first = view.coarse()
            maps = {kind: attention_of(kind, view, first) for kind in MAPS}
            least = max(1, int(MIN_SHARE * view.bins))
            effects += [without_phi(weights, view.regions.rays, view.bins, least) for weights in maps.values()]
            for kind in [kind for kind, weights in maps.items() if is_equal(weights)]:
                name = f"{cell.scene.name}, view {number + 1} of {len(views)}, {kind}"
                context.leave_out(name, "it attends equally to all regions, which is plain rendering")
                del maps[kind]
            runs = refined(view, list(maps), context.sizes.repeats)
            finished = plain(cell.learner, view.camera, cell.chunk)
            for kind, weights in maps.items():
                orders = {order: runs[kind if order == "attention" else order] for order in ORDERS}
                by_kind.setdefault(kind, []).append(times_of(orders, finished, attended_pixels(view.regions, weights)))
        cases += [Case(cell.scene.name, kind, _means(of_views)) for kind, of_views in by_kind.items()]
    yield from findings_of(cases) if cases else (NOTHING,)
    if effects:
        yield from _of_phi(effects)


def cells_of(context: ServingContext) -> list[TrainedCell]:
    """Return one cell per scene of the first pointwise method, as others cannot be rendered by regions."""
    scenes, methods = context.in_order(SCENES, METHODS)
    for method in methods:
        cells: list[TrainedCell] = []
        for scene in scenes:
            if len(cells) < context.sizes.scenes and (cell := context.trained(scene, method)) is not None:
                if reason := why_plain(cell.learner):
                    context.leave_out(f"attention with {method}", reason)
                    break
                cells.append(cell)
        if cells:
            return cells
    return []


def region_view(context: ServingContext, cell: TrainedCell, pose: np.ndarray) -> RegionView:
    camera = context.camera(cell, pose)
    tile = max(MIN_TILE, camera.width // REGIONS_PER_SIDE)
    return RegionView(cell, camera, Regions(camera.height, camera.width, tile))


def attention_of(kind: str, view: RegionView, first: View) -> np.ndarray:
    """Return the attention by a map of `MAPS`, float64 [regions]. The point of interest is the picture's centre, the
    mask its middle quarter; an eye looks at a third of the height and two thirds of the width.
    """
    learner, camera, chunk = view.cell.learner, view.camera, view.cell.chunk
    row, column = (1 / 3, 2 / 3) if kind == "foveal" else (1 / 2, 1 / 2)
    inputs = MapInputs(
        view.regions,
        row * camera.height,
        column * camera.width,
        0.25 * camera.width,
        camera.focal,
        mask=lambda: middle(camera.height, camera.width),
        image=lambda: first.colour,
        error=lambda: estimated_error(learner, camera, first, STRIDE, chunk, view.bins).error,
    )
    return MAPS[kind](inputs)


def middle(height: int, width: int) -> np.ndarray:
    """Return bool [height, width]: the pixels with a centre in the middle half of the rows and of the columns."""
    rows, columns = (np.arange(height) + 0.5) / height, (np.arange(width) + 0.5) / width
    return (np.abs(rows - 0.5) < 0.25)[:, None] & (np.abs(columns - 0.5) < 0.25)[None, :]


def refined(view: RegionView, kinds: Sequence[str], repeats: int, clock: Clock = CLOCK) -> dict[str, Refined]:
    """Refine a view by each map of `kinds` and in the other orders in turn, in alternating order, so that a busy
    machine affects all alike; return them by name.
    """
    runs: dict[str, list[Refined]] = {name: [] for name in (*kinds, *ORDERS) if name != "attention"}
    for repeat in range(repeats):
        for name in list(runs)[:: 1 if repeat % 2 == 0 else -1]:
            runs[name].append(refine_in(view, name, clock))
    return {
        name: Refined(some[0].first, some[0].parts, np.concatenate([run.seconds for run in some]))
        for name, some in runs.items()
    }


def refine_in(view: RegionView, name: str, clock: Clock = CLOCK) -> Refined:
    """Refine in an order, or by a map, which is computed on the same clock; `plain` begins with a white frame."""
    cell, regions, camera = view.cell, view.regions, view.camera
    order: Order = "raster" if name == "raster" else "attention"
    began, weights = clock(), np.ones(regions.count)
    if name == "plain":  # it is the order by attention with equal attention
        first, seconds = Canvas(camera.height, camera.width).view, [0.0]
    else:
        first = view.coarse()
        if order == "attention":
            weights = attention_of(name, view, first)
        seconds = [clock() - began]
    parts = []
    for done in refine(cell.learner, camera, regions, weights, cell.chunk, order):
        seconds.append(clock() - began)
        parts.append(done)
    return Refined(first, parts, np.array([seconds]))


def attended_pixels(regions: Regions, weights: np.ndarray) -> np.ndarray:
    """Return bool [pixels]: those of the most attended quarter of the regions."""
    count = max(1, round(QUARTER * regions.count))
    return np.isin(regions.of_pixel.reshape(-1), region_order(weights)[:count])


def errors_along(run: Refined, finished: View, where: np.ndarray) -> Iterator[dict[str, float]]:
    """Yield measure → root mean square error, everywhere and in `where`, of the first frame and after each part."""
    target = finished.colour.reshape(-1, 3).astype(np.float64)
    squares = ((run.first.colour.reshape(-1, 3) - target) ** 2).mean(axis=-1)
    for part in (None, *run.parts):
        if part is not None:
            squares[part.pixels] = ((part.colour - target[part.pixels]) ** 2).mean(axis=-1)
        yield {"whole": float(np.sqrt(squares.mean())), "attended": float(np.sqrt(squares[where].mean()))}


def times_of(runs: dict[str, Refined], finished: View, where: np.ndarray) -> dict[str, Times]:
    """Return measure → the seconds [repeats] of each order until its error stays below `SHARE_OF_ERROR`."""
    errors = {order: list(errors_along(run, finished, where)) for order, run in runs.items()}
    times: dict[str, Times] = {measure: {} for measure in MEASURES}
    for order, run in runs.items():
        or_never = np.pad(run.seconds, ((0, 0), (0, 1)), constant_values=np.inf)
        for measure in MEASURES:
            limit = SHARE_OF_ERROR * errors["raster"][0][measure]
            above = [place for place, error in enumerate(errors[order]) if error[measure] > limit]
            times[measure][order] = or_never[:, above[-1] + 1 if above else 0]
    return times


def _means(of_views: list[dict[str, Times]]) -> dict[str, Times]:
    return {
        measure: {order: np.mean([times[measure][order] for times in of_views], axis=0) for order in ORDERS}
        for measure in MEASURES
    }


def earlier(times: Times, order: str, other: str) -> bool:
    """Return whether `order` is small before `other`: its slowest repeat before the fastest of `other`."""
    return bool(times[order].max() < times[other].min())


def findings_of(cases: Sequence[Case]) -> Iterator[Found]:
    checks, medians = [], []
    for order, words in ORDERS.items():
        ms = [1e3 * float(np.median(case.times["whole"][order])) for case in cases]
        if np.isfinite(ms).all():
            what, id, spread = f"until a tenth of the error remains, {words}", f"whole.{order}", (min(ms), max(ms))
            middle = statistics.median(ms)
            checks.append(Check(what, middle, unit="ms", owner="machine", spread=spread, repeats=len(ms), id=id))
            medians.append(f"{words} {brief(1e-3 * middle)}")
    yield f"Until a tenth of the coarse frame's error remains in the whole picture: {', '.join(medians)} (medians)."
    yield from checks
    yield from (_earlier_check(cases, measure) for measure in MEASURES)
    pairs = [[float(np.median(case.times["attended"][order])) for order in ("raster", "attention")] for case in cases]
    if ratios := [raster / mine for raster, mine in pairs if max(raster, mine) < np.inf]:
        yield factor("sooner.attended", "time of raster order against attention, in the most attended quarter", ratios)
    yield _table(cases)


def _earlier_check(cases: Sequence[Case], measure: str) -> Check:
    """Return in how many cases attention is earlier than raster order. For the attended quarter this is the paper's
    claim: with enough scenes it holds if attention is earlier in every case, and fails if it is later in every case.
    """
    scenes = {case.scene for case in cases}
    not_ahead = [case.scene for case in cases if not earlier(case.times[measure], "attention", "raster")]
    behind = sum(earlier(case.times[measure], "raster", "attention") for case in cases)
    ahead, undecided = len(cases) - len(not_ahead), len(not_ahead) - behind
    status: Status = "measured"
    words = f"of {len(cases)} cases, later in {behind}" + (f", undecided in {undecided}" if undecided else "")
    if measure == "attended":
        status = "inconclusive"
        if len(scenes) >= MIN_SCENES and len(cases) in (ahead, behind):
            status = "pass" if ahead else "fail"
        words += f", earlier in all of them on {len(scenes - {*not_ahead})} of {len(scenes)} scenes"
        words += "; the map that orders regions defines which are attended: earlier by construction, but for its cost"
    return Check(
        f"cases in which attention is earlier than raster order, in {MEASURES[measure]}",
        float(ahead),
        why=words,
        subject="Eq. 7",
        owner="paper",
        status=status,
        repeats=len(cases),
        id=f"earlier.{measure}",
    )


def _table(cases: Sequence[Case]) -> Table:
    rows: Rows = []
    for case in cases:
        for measure, words in MEASURES.items():
            medians = [float(np.median(case.times[measure][order])) for order in ORDERS]
            shown = [brief(seconds) if np.isfinite(seconds) else "never" for seconds in medians]
            rows.append([case.scene, case.kind, words, *shown])
    title = "Until a tenth of the coarse frame's error remains"
    return Table("times", 0, title, ["scene", "attention", "in", *ORDERS.values()], rows)


def _of_phi(effects: Sequence[tuple[float, bool, bool]]) -> Iterator[Found]:
    sums, *changes = zip(*effects, strict=True)
    orders, allocations = map(sum, changes)
    total, count = max(sums, key=lambda value: abs(value - PHI)), len(effects)
    why = f"of {count} maps; the priorities sum to {total:.4g}, not to 1: they are not probabilities"
    yield f"Without φ {orders} maps have another order of regions, and {allocations} another number of samples, {why}."
    what, changed = "maps whose order or samples φ changes", float(max(orders, allocations))
    yield Check(what, changed, why=why, owner="paper", repeats=count, id="phi.changed")
