"""The run record's facts about a scene's view set, and those beside the paper's numbers that need no training."""

from pathlib import Path
from typing import Any

import torch

from baselines.catalog import CATALOG
from baselines.contract import Box, NetworkSize
from baselines.field import NetworkField
from harness.execution.ground_truth import read_views
from harness.plan.profiles import Plan
from harness.records.cells import LeftOut, SceneRecord
from harness.records.json_record import finite_or_none


def parameters_at_paper_size(method: str) -> dict[str, int]:
    """Count weights by component of a method at 8 × 256, L = 10/4. Raises `ValueError` for a method
    without a network.
    """
    parts = CATALOG[method].parts
    if parts is None:
        raise ValueError(f"{method} is no network: Table 1 says nothing of it")
    box = Box(-torch.ones(3), torch.ones(3))
    return NetworkField(parts, NetworkSize(), box, "float32", seed=0).parameter_counts()


def scene_record(plan: Plan, name: str, folder: Path, out: Path) -> SceneRecord:
    """Read the view set once, so that any fault of it is reported before any training."""
    import numpy as np

    from harness.training.cell_training import finished_on
    from harness.training.evaluate import floor_psnr
    from harness.training.metrics import psnr_from_mse
    from harness.training.saved_renders import drop_truth, keep_truth

    views = read_views(folder, plan.views, out)
    if not finished_on(out, [key for key in plan.cells() if key[0] == name], views):
        drop_truth(out, name)
    noise = views.test.noise_mse
    ceiling = None if noise is None else finite_or_none(float(np.mean([psnr_from_mse(float(one)) for one in noise])))
    keep_truth(out, name, views, plan.score.stored_views)
    manifest = views.rendered
    kept = ("variant", "integrator", "spp", "seconds", "versions", "digest")
    return SceneRecord(
        name=name,
        title=views.title,
        view_set=folder.name,
        width=views.width,
        height=views.height,
        views={"train": len(views.train.names), "val": 0, "test": len(views.test.names)},
        near=views.near,
        far=views.far,
        bounds=views.bounds.tolist(),
        psnr_ceiling=ceiling,
        psnr_floor=floor_psnr(views),
        rendered={key: manifest[key] for key in kept if key in manifest},
        left_out=[_left_out(row) for row in manifest.get("left_out", [])],
    )


def _left_out(row: dict[str, Any]) -> LeftOut:
    """Return the manifest's omissions, as far as it has them: an older one knows no bounds."""
    known = ("name", "concerns", "bound", "unit")
    return LeftOut(row["what"], row["reason"], None, None, None, **{key: row[key] for key in known if key in row})
