"""A run that a page can show: two methods, trained for a moment on the ball, in this process."""

import shutil
from dataclasses import asdict
from pathlib import Path

from harness.execution.ground_truth import read_views
from harness.plan.group_task import GroupTask
from harness.plan.needed import for_scene
from harness.plan.schedule import Budget
from harness.plan.settings import ViewSettings
from harness.records.cells import RunRecord, SceneRecord, cell_path, read_cell, read_run, write_cell, write_run
from harness.training.checkpoints import checkpoint_path
from harness.training.lockstep import train_group
from tests.harness.ball import write_ball
from tests.harness.tiny import SCORE, TRAIN
from tests.replacing import replace

SIZE = 40
"""Pixels: nine regions."""
VIEWS = ViewSettings(resolution=SIZE, train=4, val=0, test=3)
HOSTILE = "<img src=x onerror=\"document.title='taken'\"> & more"
METHODS = {"nerf": HOSTILE, "qnerf": "Q-NeRF as listed", "nerf_matched": "never trained here"}


def train(folder: Path, scene: str = "ball") -> Path:
    """The output folder `run`; its view set `ball` is beside it. Titles are hostile."""
    views_folder, out = write_ball(folder / "ball", size=SIZE, train=4, test=3), folder / "run"
    out.mkdir()
    views = read_views(views_folder, VIEWS, folder)
    train, score = for_scene(TRAIN, views), replace(SCORE, checkpoints=1)
    task = GroupTask(scene, 0, ("nerf", "qnerf"), train, score, Budget(30, None), out)
    for cell in train_group(task, views, {}, lambda share: None):
        assert cell.status == "done", cell.reason
        write_cell(out, cell)
    known = SceneRecord(
        name=scene, title=HOSTILE, view_set="ball", width=SIZE, height=SIZE,
        views={"train": 4, "val": 0, "test": 3}, near=views.near, far=views.far, bounds=views.bounds.tolist(),
        psnr_ceiling=None, psnr_floor=12.5, rendered={}, left_out=[],
    )  # fmt: skip
    write_run(out, RunRecord(
        profile="smoke", command="", scenes=[known], methods=METHODS, deviations=[], paper={}, seeds=[0],
        settings={"views": asdict(VIEWS), "view_set": str(views_folder)}, provenance={}, phases={}, finished=True,
        not_tested=[],
    ))  # fmt: skip
    return out


def add_second_scene(out: Path) -> None:
    """Another name for the same weights and views, of which qnerf's are left out."""
    run, name = read_run(out), "second"
    scene = run.scenes[0]
    shutil.copy(checkpoint_path(out, scene.name, "nerf", 0), checkpoint_path(out, name, "nerf", 0))
    write_cell(out, replace(read_cell(cell_path(out, scene.name, "nerf", 0)), scene=name))
    write_run(out, replace(run, scenes=[scene, replace(scene, name=name)]))
