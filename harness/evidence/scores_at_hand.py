"""Scores of what was trained already, in the folder of the studies or of the run that they lie beside."""

import statistics
from contextlib import suppress
from pathlib import Path

from harness.evidence.trainings import TRAININGS
from harness.json_record import DamagedRecord
from harness.records import read_cells


def scores_at_hand(out: Path, width: int) -> dict[str, float]:
    """Scene → PSNR of its best method, the median over seeds, of images `width` pixels wide.

    From the run in `out`, else from the first training of the studies that has the scene. Nothing is trained for it.
    """
    found: dict[str, float] = {}
    for folder in (out, *(out / "studies" / name for name in TRAININGS)):
        with suppress(DamagedRecord):
            found = _scores(folder, width) | found
    return found


def _scores(folder: Path, width: int) -> dict[str, float]:
    values: dict[tuple[str, str], list[float]] = {}
    for cell in read_cells(folder):
        psnr = cell.scores.get("psnr")
        if psnr is not None and cell.settings.get("view_set", {}).get("width") == width:
            values.setdefault((cell.scene, cell.method), []).append(psnr)
    best: dict[str, float] = {}
    for (scene, _), scores in values.items():
        best[scene] = max(best.get(scene, float("-inf")), statistics.median(scores))
    return best
