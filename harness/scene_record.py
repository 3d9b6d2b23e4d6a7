"""What a run's record says of a scene's view set."""

from pathlib import Path
from typing import Any

from harness.ground_truth import read_views
from harness.json_record import finite_or_none
from harness.plan import Plan
from harness.records import LeftOut, SceneRecord


def scene_record(plan: Plan, name: str, folder: Path, out: Path) -> SceneRecord:
    """Reads the view set once, so that whatever is wrong with it is said before any training."""
    import numpy as np

    from harness.evaluate import floor_psnr
    from harness.kept_views import drop_truth, keep_truth
    from harness.metrics import psnr_from_mse
    from harness.view_set_facts import finished_on

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
    """What a manifest says, as far as it says it: an older one knows no bounds."""
    known = ("name", "concerns", "bound", "unit")
    return LeftOut(row["what"], row["reason"], **{key: row[key] for key in known if key in row})
