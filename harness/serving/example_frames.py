"""Pictures for the report: one view, attended and not, after the same part of the time."""

from pathlib import Path

import numpy as np

from harness.json_record import finite_or_none
from harness.metrics import psnr
from harness.records import records_folder
from harness.serving.anytime import Seen
from harness.serving_record import ExampleFrame
from scenes.images import write_png

FOLDER = "images/serving"
"""Under `OUT/records`."""
EXAMPLES = ("point", "gradients")
SHARE_OF_TIME = 0.4
"""Of raster order's, for every order: coarse frame and map take up to a quarter, and then something is to be seen."""


def frames(out: Path, seen: Seen, truth: np.ndarray | None) -> list[ExampleFrame]:
    """Written under `out`."""
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
