"""The views on which attention is examined, their maps of attention, and the study of φ that needs only these."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from baselines.numerics.attention.maps import MAPS, MapInputs
from baselines.numerics.attention.priorities import PHI, without_phi
from baselines.numerics.attention.regions import Regions
from harness.playback.progressive import coarse, estimated_error, why_plain
from harness.playback.run_loader import TrainedCell
from harness.records.study import Check
from harness.studies.framework import Found
from harness.studies.serving.serving_context import ServingContext, study
from harness.training.batches import Camera
from harness.training.scoring.evaluate import View

KINDS = {
    "point": "a point of interest in the picture's centre, half the attention a quarter of the width away",
    "mask": "a user's mask: the middle half of the rows and of the columns, a quarter of the picture",
    "gradients": "where the coarse frame changes",
    "error": "where half of the samples make another coarse frame",
    "foveal": "the acuity of an eye that looks at a third of the height and two thirds of the width",
}
"""Map of `baselines.numerics.attention.maps.MAPS` → what it attends to."""
CENTRE = (1 / 2, 1 / 2)
LOOKED_AT = {"foveal": (1 / 3, 2 / 3)}
"""The row and column of the gaze, as shares of height and width; the centre for all other maps."""
SCENES = ("lego", "hotdog", "drums")
METHODS = ("nerf", "nerf_matched")
"""The methods that are preferred if the run has them; the first that can be rendered by regions is used."""
STRIDE = 4
"""The stride of the coarse frame: one ray of sixteen."""
REGIONS_PER_SIDE = 10
MIN_TILE = 4
MIN_SHARE = 0.25
"""The minimum number of samples of a ray, as a share of the mean."""
NOTHING = "No method of the run can be rendered by regions here."


@dataclass(frozen=True)
class RegionView:
    cell: TrainedCell
    camera: Camera
    regions: Regions
    stride: int
    bins: int
    """The samples per ray, of the coarse frame as well."""


@dataclass(frozen=True)
class AttendedView:
    view: RegionView
    number: int
    coarse: View
    maps: dict[str, np.ndarray]

    @property
    def scene(self) -> str:
        return self.view.cell.scene.name


def attended_views(context: ServingContext) -> list[AttendedView]:
    """Return the views of every scene, rendered coarsely once for all studies."""
    if "attended views" not in context.memory:
        views = []
        for cell in cells_of(context):
            for number, pose in enumerate(context.orbit(cell.scene, context.sizes.views)):
                view = region_view(context, cell, pose)
                first = coarse(cell.learner, view.camera, STRIDE, cell.chunk).view
                maps = {kind: attention_of(kind, view, first) for kind in KINDS}
                views.append(AttendedView(view, number, first, maps))
        context.memory["attended views"] = views
    remembered: list[AttendedView] = context.memory["attended views"]
    return remembered


def region_view(context: ServingContext, cell: TrainedCell, pose: np.ndarray) -> RegionView:
    camera = context.camera(cell, pose)
    tile = max(MIN_TILE, camera.width // REGIONS_PER_SIDE)
    return RegionView(
        cell, camera, Regions(camera.height, camera.width, tile), STRIDE, int(cell.cell.settings["train"]["bins"])
    )


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


def attention_of(kind: str, view: RegionView, first: View) -> np.ndarray:
    """Return the attention, float64 [regions]; `first` is the coarse frame of the view."""
    learner, camera, chunk = view.cell.learner, view.camera, view.cell.chunk
    row, column = LOOKED_AT.get(kind, CENTRE)
    inputs = MapInputs(
        view.regions,
        row * camera.height,
        column * camera.width,
        0.25 * camera.width,
        camera.focal,
        mask=lambda: middle(camera.height, camera.width),
        image=lambda: first.colour,
        error=lambda: estimated_error(learner, camera, first, view.stride, chunk, view.bins).error,
    )
    return MAPS[kind](inputs)


def middle(height: int, width: int) -> np.ndarray:
    """Return bool [height, width]: the pixels with a centre in the middle half of the rows and of the columns."""
    rows, columns = (np.arange(height) + 0.5) / height, (np.arange(width) + 0.5) / width
    return (np.abs(rows - 0.5) < 0.25)[:, None] & (np.abs(columns - 0.5) < 0.25)[None, :]


def least_bins(bins: int) -> int:
    return max(1, int(MIN_SHARE * bins))


@study
def priorities(context: ServingContext) -> Iterator[Found]:
    effects = [
        without_phi(attention, attended.view.regions.rays, attended.view.bins, least_bins(attended.view.bins))
        for attended in attended_views(context)
        for attention in attended.maps.values()
    ]
    if not effects:
        yield NOTHING
        return
    sums, *changes = zip(*effects, strict=True)
    orders, allocations = map(sum, changes)
    total = max(sums, key=lambda value: abs(value - PHI))
    yield (
        f"The priorities sum to {total:.4g}, not to 1: they are not probabilities. Without φ, which scales all alike, "
        f"{orders} of {len(effects)} maps have another order of regions, and {allocations} another number of samples."
    )
    yield Check("sum of the priorities", total, owner="paper", repeats=len(effects), id="phi.sum")
    yield Check(
        "maps whose order or samples φ changes",
        float(max(orders, allocations)),
        why=f"of {len(effects)} maps; the priorities sum to {total:.4g}, not to 1: they are not probabilities",
        owner="paper",
        repeats=len(effects),
        id="phi.changed",
    )
