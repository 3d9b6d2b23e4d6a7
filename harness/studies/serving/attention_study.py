"""Attention-prioritised rendering (§8.2, Eq. 7) on a finished run: anytime curves, distributed samples, what φ does."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from baselines.numerics.attention.priorities import PHI, PhiEffect, without_phi
from baselines.numerics.attention.regions import Regions
from harness.playback.progressive import changed_by_regions, coarse, why_plain
from harness.playback.run_loader import TrainedCell
from harness.records.cells import records_folder
from harness.records.json_record import finite_or_none
from harness.records.serving_record import AttentionRecord, ExampleFrame, NotByRegions, PhiCheck, Reaching
from harness.studies.serving.allocations import Sampled, allocations, least_bins, sampled
from harness.studies.serving.anytime import (
    KINDS,
    ORDERS,
    Looked,
    Seen,
    TimedCurve,
    attention_of,
    curve,
    measured,
    reachings,
    runs_of,
)
from harness.studies.serving.serving_context import ServingContext, plain
from harness.training.metrics import psnr
from scenes.view_sets.images import write_png

FOLDER = "images/serving"
"""The folder under `OUT/records`."""
EXAMPLES = ("point", "gradients")
SHARE_OF_TIME = 0.4
"""The share of raster order's time, for every order: coarse frame and map take up to a quarter, and then something must
be visible.
"""


def frames(out: Path, seen: Seen, truth: np.ndarray | None) -> list[ExampleFrame]:
    """Return the example frames, written under `out`."""
    cell, finished = seen.view.cell, seen.finished.colour
    scene, method = cell.scene.name, cell.learner.method
    raster = seen.runs["raster", None]
    limit = SHARE_OF_TIME * float(np.median(raster.seconds[:, -1]))
    percent = f"{SHARE_OF_TIME:.0%}".replace("%", " %")

    def written(name: str, title: str, attention: str, colour: np.ndarray, scored: bool = True) -> ExampleFrame:
        file = f"{FOLDER}/{scene}.{method}.{name}.png"
        path = records_folder(out) / file
        path.parent.mkdir(parents=True, exist_ok=True)
        opaque = np.ones((*colour.shape[:2], 1))
        write_png(path, np.concatenate([np.clip(colour, 0.0, 1.0), opaque], axis=-1).astype(np.float32))
        score = finite_or_none(psnr(colour, finished)) if scored else None
        return ExampleFrame(scene, method, attention, title, file, score)

    found = []
    if truth is not None:
        found.append(written("truth", "ground truth", "none", truth, scored=False))
    found.append(written("finished", "finished", "none", finished, scored=False))
    found.append(written("coarse", "coarse frame", "none", raster.refined.first.colour))
    found.append(written("raster", f"in raster order, after {percent} of the time", "none", raster.after(limit).colour))
    spread = seen.runs["spread", None]
    found.append(written("spread", f"spread, after {percent} of the time", "none", spread.after(limit).colour))
    plainly = seen.runs["plain", None].after(limit).colour
    found.append(written("plain", f"plain, without a coarse frame, after {percent} of the time", "none", plainly))
    for kind in EXAMPLES:
        if ("attention", kind) not in seen.runs:
            continue
        attention = seen.maps[kind]
        grey = np.repeat(seen.view.regions.spread(attention / attention.max())[..., None], 3, axis=-1)
        found.append(written(f"{kind}.map", f"attention: {kind}", kind, grey, scored=False))
        picture = seen.runs["attention", kind].after(limit).colour
        found.append(written(kind, f"by attention ({kind}), after {percent} of the time", kind, picture))
    return found


SCENES = ("lego", "hotdog", "drums")
METHODS = ("nerf", "nerf_matched")
"""The methods preferred if the run has them; the first that can be rendered by regions is taken."""
STRIDE = 4
"""The stride of the coarse frame: one ray of sixteen."""
REGIONS_A_SIDE = 10
LEAST_TILE = 4


@dataclass
class _Found:
    """The results so far, scene after scene."""

    seen: dict[str, list[Seen]] = field(default_factory=dict)
    sampled: dict[str, list[Sampled]] = field(default_factory=dict)
    phi: list[PhiEffect] = field(default_factory=list)
    """The effects of each map."""
    frames: list[ExampleFrame] = field(default_factory=list)


def measured_attention(situation: ServingContext) -> AttentionRecord | None:
    """Measure attention; None if no method of the run can be rendered by regions here."""
    cells = cells_of(situation)
    if not cells:
        situation.leave_out("attention: no method of the run can be rendered by regions here")
        return None
    found = _Found()
    for cell in cells:
        _look_at(situation, cell, found)
    if not found.seen:
        return None
    first = next(iter(found.seen.values()))[0].view
    curves, reached = _curves(found)
    return AttentionRecord(
        width=first.camera.width,
        height=first.camera.height,
        tile=first.regions.tile,
        reference_bins=situation.sizes.reference_bins,
        curves=[one.anytime for one in curves],
        reaching=reached,
        allocations=[row for some in found.sampled.values() for kind in KINDS for row in allocations(some, kind)],
        not_by_regions=_not_by_regions(situation, cells[0]),
        phi=_phi_check(found.phi),
        frames=found.frames,
    )


def run_bins(cell: TrainedCell) -> int:
    return int(cell.cell.settings["train"]["bins"])


def tile_of(width: int) -> int:
    return max(LEAST_TILE, width // REGIONS_A_SIDE)


def cells_of(situation: ServingContext) -> list[TrainedCell]:
    """Return one cell per scene, of one method: a pointwise one, as others are rendered plainly whatever is
    attended.
    """
    names = {scene.name: scene for scene in situation.scenes}
    scenes = [names.pop(name) for name in SCENES if name in names] + list(names.values())
    methods = [name for name in METHODS if name in situation.methods]
    methods += [name for name in situation.methods if name not in methods]
    for method in methods:
        cells: list[TrainedCell] = []
        for scene in scenes:
            if len(cells) < situation.sizes.scenes and (cell := situation.trained(scene, method)) is not None:
                if why_plain(cell.learner):
                    break
                cells.append(cell)
        if cells:
            return cells
    return []


def _look_at(situation: ServingContext, cell: TrainedCell, found: _Found) -> None:
    scene, sizes = cell.scene.name, situation.sizes
    poses = situation.test_poses(cell.scene, sizes.views)
    for number, (pose, truth) in enumerate(poses):
        if situation.is_over(f"attention on {scene}, views after {number} of {len(poses)}"):
            return
        situation.show.line(f"  {cell.learner.method} on {scene}, view {number + 1} of {len(poses)}")
        camera = situation.camera(cell, pose)
        regions = Regions(camera.height, camera.width, tile_of(camera.width))
        view = Looked(cell, camera, regions, STRIDE, run_bins(cell))
        finished = plain(cell.learner, camera, cell.chunk)
        first = coarse(cell.learner, camera, STRIDE, cell.chunk).view
        maps = {kind: attention_of(kind, view, first)[0] for kind in KINDS}
        runs = runs_of(maps)
        for kind in KINDS:
            if ("attention", kind) not in runs:
                situation.leave_out(
                    f"{scene}, view {number + 1}: {kind} attends to all alike, which is plain rendering"
                )
        one = Seen(view, finished, first, maps, measured(view, runs, sizes.repeats))
        found.seen.setdefault(scene, []).append(one)
        if not number:
            shared = sampled(view, maps, sizes.reference_bins, sizes.shared, truth)
            found.sampled.setdefault(scene, []).append(shared)
        for attention in maps.values():
            found.phi.append(without_phi(attention, regions.rays, view.bins, least_bins(view.bins)))
        if not found.frames:
            found.frames = frames(situation.scratch, one, truth)


def _curves(found: _Found) -> tuple[list[TimedCurve], list[Reaching]]:
    curves, reached = [], []
    for seen in found.seen.values():
        for kind in KINDS:
            some = [one for order in ORDERS if (one := curve(seen, kind, order)) is not None]
            curves += some
            reached += reachings(some) if some else []
    return curves, reached


def _not_by_regions(situation: ServingContext, first: TrainedCell) -> list[NotByRegions]:
    """Return the other methods on the first scene, whose picture regions would change."""
    rows = []
    for method in situation.methods:
        cell = situation.trained(first.scene, method)
        if cell is None or method == first.learner.method:
            continue
        reason = why_plain(cell.learner)
        if reason is None:
            situation.leave_out(f"attention was measured with {first.learner.method}, not with {method}")
            continue
        pose = situation.test_poses(first.scene, 1)[0][0]
        camera = situation.camera(cell, pose)
        regions = Regions(camera.height, camera.width, tile_of(camera.width))
        changed = changed_by_regions(cell.learner, camera, regions, cell.chunk)
        rows.append(NotByRegions(method, first.scene.name, reason, changed))
    return rows


def _phi_check(maps: list[PhiEffect]) -> PhiCheck:
    """Check φ; the sum that is farthest from φ stands for all."""
    sums = np.array([one.sum_of_priorities for one in maps])
    return PhiCheck(
        sum_of_priorities=float(sums[np.abs(sums - PHI).argmax()]),
        maps=len(maps),
        orders_changed=sum(one.order_changed for one in maps),
        allocations_changed=sum(one.allocation_changed for one in maps),
    )
