"""Facts of a run's record that need no training: those of a scene's view set, and measurements for claims."""

from typing import NamedTuple

import numpy as np
import torch
from msgspec import structs

from baselines.catalog import CATALOG
from baselines.contract import Box, NetworkSize
from baselines.field import NetworkField
from harness.execution.ground_truth import read_views
from harness.machine.provenance import core_module_lines
from harness.plan.group_task import GroupTask
from harness.plan.needed import needs_here
from harness.records.cells import LeftOut, SceneRecord
from harness.records.claims import ClaimFile, Measured
from harness.records.json_record import finite_or_none
from harness.training.cell_training import content_of, finished_on
from harness.training.saved_renders import drop_truth, keep_truth
from harness.training.scoring.evaluate import floor_psnr
from harness.training.scoring.metrics import psnr_from_mse
from scenes.modelling.needs import left_out
from scenes.view_sets.cautions import cautions
from scenes.view_sets.visibility import visibility_of


def measured_at_printed_size(file: ClaimFile) -> ClaimFile:
    """Return claims with the measurements that they need: weights at 8 × 256, L = 10/4, and lines of this program."""
    measured = Measured()
    for claim in file.claims:
        if claim.quantity == "lines":
            lines = core_module_lines()
            measured["sloc"], measured["sloc_files"] = sum(lines.values()), {**lines}
        elif claim.quantity == "weights" and (parts := CATALOG[claim.of["method"]].parts) is not None:
            box = Box(-torch.ones(3), torch.ones(3))
            measured["weights"] = {**NetworkField(parts, NetworkSize(), box, "float32", seed=0).parameter_counts()}
    return structs.replace(file, measured=measured)


class SceneRead(NamedTuple):
    record: SceneRecord
    content: str | None
    """The digest of the view set."""
    notes: tuple[str, ...]
    """What the reader of its images noted."""
    focal: float
    """The focal length in pixels."""
    hull: bytes
    """The hull of the silhouettes, packed."""


def scene_record(task: GroupTask, keys: list[tuple[str, str, int]]) -> SceneRead:
    """Read a task's view set before any training. Raises `InputError` for a fault, or if cameras miss the box."""
    scene, out = task.scene, task.out
    views = read_views(task.view_set, task.views, out, decoded=task.decoded)
    seen = visibility_of(views)
    cautioned = cautions(views, seen)  # refuses cameras that see nothing, before anything is written
    if not finished_on(out, [key for key in keys if key[0] == scene], views):
        drop_truth(out, scene)
    noise = views.test.noise_mse
    ceiling = None if noise is None else finite_or_none(float(np.mean([psnr_from_mse(float(each)) for each in noise])))
    keep_truth(out, scene, views, task.score.stored_views)
    manifest = views.rendered
    rows = {row.get("name", row["what"]): row for row in manifest.get("left_out", [])}
    rows = {row["name"]: row for row in left_out(needs_here(task.train, views))} | rows
    bounds = ("name", "concerns", "bound", "unit")  # which an older manifest lacks
    kept = ("variant", "integrator", "spp", "noise_target", "seconds", "versions", "digest")
    record = SceneRecord(
        name=scene,
        title=views.title,
        view_set=task.view_set.name,
        width=views.width,
        height=views.height,
        views={"train": len(views.train.names), "val": 0, "test": len(views.test.names)},
        near=views.near,
        far=views.far,
        bounds=views.bounds.tolist(),
        hull_share=float(views.hull.mean()),
        seen=seen.line,
        cautions=cautioned,
        psnr_ceiling=ceiling,
        psnr_floor=floor_psnr(views),
        rendered={key: manifest[key] for key in kept if key in manifest},
        left_out=[
            LeftOut(row["what"], row["reason"], None, None, None, **{key: row[key] for key in bounds if key in row})
            for row in rows.values()
        ],
    )
    return SceneRead(record, content_of(views), views.notes, views.focal, views.packed_hull)
