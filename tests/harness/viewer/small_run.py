"""A run that a page can show: two methods, trained for a moment on the ball, in this process."""

import shutil
from pathlib import Path

from harness.records.cells import cell_path, read_cell, read_run, write_cell, write_run
from harness.training.checkpoints import checkpoint_path
from tests.harness.trained_runs import train_run
from tests.replacing import replace

SIZE = 40
"""Pixels: nine regions."""
HOSTILE = "<img src=x onerror=\"document.title='taken'\"> & more"
METHODS = {"nerf": HOSTILE, "qnerf": "Q-NeRF as listed", "nerf_matched": "never trained here"}


def train(folder: Path) -> Path:
    """Train a run with hostile titles; returns its output folder `run`, next to its view set `ball`."""
    out = train_run(folder, ["nerf", "qnerf"], steps=30, size=SIZE)
    run = read_run(out)
    write_run(out, replace(run, methods=METHODS, scenes=[replace(run.scenes[0], title=HOSTILE)]))
    return out


def add_second_scene(out: Path) -> None:
    """Add a second name for the scene's views and the weights of nerf."""
    run, name = read_run(out), "second"
    scene = run.scenes[0]
    shutil.copy(checkpoint_path(out, scene.name, "nerf", 0), checkpoint_path(out, name, "nerf", 0))
    write_cell(out, replace(read_cell(cell_path(out, scene.name, "nerf", 0)), scene=name))
    write_run(out, replace(run, scenes=[scene, replace(scene, name=name)]))
