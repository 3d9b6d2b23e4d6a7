"""A context, the results of a run and a stored picture, written by hand: nothing is rendered or trained."""

from pathlib import Path

import numpy as np

from harness.execution.progress import Progress
from harness.plan.run_plan import Machine
from harness.records.cells import CellRecord, RunRecord, records_folder
from harness.records.pictures import Render, cell_pictures, half, write_renders
from harness.records.study import Check
from harness.studies.framework import Found
from harness.studies.stability.cases import SHELF
from harness.studies.stability.stability_context import StabilityContext
from harness.studies.stability.whole_scenes.scene_truth import SceneRun


def context_in(folder: Path, *methods: str, quick: bool = True) -> StabilityContext:
    return StabilityContext(folder, folder / "view_sets", folder, quick, Progress(), Machine("cpu", 1, 1), methods)


def findings(case: str, context: StabilityContext) -> list[Found]:
    return list(SHELF.measure_of(case)(context))


def checks(case: str, context: StabilityContext) -> list[Check]:
    return [finding for finding in findings(case, context) if isinstance(finding, Check)]


def run_of(out: Path, *cells: CellRecord) -> SceneRun:
    methods = {cell.method: "" for cell in cells}
    run = RunRecord("stress", "", [], methods, [], [0], {}, {}, {}, True, [])
    return SceneRun(out, out, run, {(cell.scene, cell.method): [cell] for cell in cells})


def pictured(out: Path, image: np.ndarray) -> str:
    """Store a view of that colour [h, w, 3], with its red as opacity and depth; return its path."""
    picture, path = half(image), cell_pictures("any", "any", 0)
    write_renders(records_folder(out) / path, [Render("test/r_0", 1, picture, picture[..., 0], picture[..., 0])])
    return path
