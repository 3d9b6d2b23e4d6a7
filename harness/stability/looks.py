"""How much of a surface's looks a method explains, within the silhouette, which any method finds."""

import numpy as np

from harness.records import CellRecord
from harness.stability.scene_truth import colour_variance, explained_share
from harness.stability.trained_scenes import Trained, shown
from scenes.pixels import over_white
from scenes.view_set import ViewSet


def share_of_looks(found: Trained, cell: CellRecord, views: ViewSet) -> float | None:
    """Over the pixels that are wholly covered; display colours of 8 bits."""
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
