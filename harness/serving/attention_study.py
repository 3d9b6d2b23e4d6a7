"""Attention-prioritised rendering (§8.2, Eq. 7) on a finished run: anytime curves, shared samples, what φ does."""

from dataclasses import dataclass, field

import numpy as np

from harness.attention.priorities import PHI, PhiEffect, without_phi
from harness.attention.progressive import changed_by_regions, coarse, why_plain
from harness.attention.regions import Regions
from harness.finished import TrainedCell
from harness.serving.allocations import Sampled, allocations, least_bins, sampled
from harness.serving.anytime import ORDERS, Curve, Seen, curve, measured, reachings, runs_of
from harness.serving.attention_maps import KINDS, Looked, attention_of
from harness.serving.example_frames import frames
from harness.serving.situation import Situation, plain
from harness.serving_record import AttentionRecord, ExampleFrame, NotByRegions, PhiCheck, Reaching

SCENES = ("lego", "hotdog", "drums")
METHODS = ("nerf", "nerf_matched")
"""Looked at first where the run has them; the first that can be rendered by regions is taken."""
STRIDE = 4
"""Of the coarse frame: one ray of sixteen."""
REGIONS_A_SIDE = 10
LEAST_TILE = 4


@dataclass
class _Found:
    """What is added to, scene after scene."""

    seen: dict[str, list[Seen]] = field(default_factory=dict)
    sampled: dict[str, list[Sampled]] = field(default_factory=dict)
    phi: list[PhiEffect] = field(default_factory=list)
    """Of each map."""
    frames: list[ExampleFrame] = field(default_factory=list)


def measured_attention(situation: Situation) -> AttentionRecord | None:
    """None where no method of the run can be rendered by regions here."""
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


def cells_of(situation: Situation) -> list[TrainedCell]:
    """One a scene, of one method: a pointwise one, as others are rendered plainly whatever is attended."""
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


def _look_at(situation: Situation, cell: TrainedCell, found: _Found) -> None:
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


def _curves(found: _Found) -> tuple[list[Curve], list[Reaching]]:
    curves, reached = [], []
    for seen in found.seen.values():
        for kind in KINDS:
            some = [one for order in ORDERS if (one := curve(seen, kind, order)) is not None]
            curves += some
            reached += reachings(some) if some else []
    return curves, reached


def _not_by_regions(situation: Situation, first: TrainedCell) -> list[NotByRegions]:
    """The other methods on the first scene, where regions would change their picture."""
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
    """The sum that is farthest from φ stands for all."""
    sums = np.array([one.sum_of_priorities for one in maps])
    return PhiCheck(
        sum_of_priorities=float(sums[np.abs(sums - PHI).argmax()]),
        maps=len(maps),
        orders_changed=sum(one.order_changed for one in maps),
        allocations_changed=sum(one.allocation_changed for one in maps),
    )
