"""What a worker holds in memory does not grow with the number and the size of the images."""

import subprocess
import sys
import weakref
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from harness.plan.group_task import GroupTask
from harness.plan.schedule import Budget
from harness.records.cells import records_folder
from harness.records.pictures import read_renders
from harness.training import evaluate
from harness.training.lockstep import train_group
from scenes.view_sets.transforms import write_transforms
from scenes.view_sets.view_set import read_view_set
from tests.harness.ball import FOV_X_RADIANS, GOLDEN_ANGLE, pose, write_ball
from tests.harness.tiny import SCORE, TRAIN

ROOT = Path(__file__).parents[4]

READ_AND_TRAIN = """
import re, sys
from pathlib import Path
import torch
from harness.training import evaluate
from harness.training.batches import Batches
from harness.training.trainer import Trainer
from baselines.contract import Box
from scenes.view_sets.view_set import read_view_set
from tests.harness.tiny import BUDGET, CPU, TRAIN

torch.set_num_threads(1)
for folder in sys.argv[2:]:
    views = read_view_set(Path(folder), scratch=Path(sys.argv[1]))
    evaluate.floor_psnr(views)
    batches = Batches(evaluate.cameras_of(views, views.train, CPU), views.train.rgba)
    box = Box(-torch.ones(3), torch.ones(3))
    trainer = Trainer("nerf", box, TRAIN, BUDGET, 0, CPU)
    for step in range(20):
        trainer.train_on(*batches.batch(0, step, TRAIN.rays))
    print(re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())[1])
"""


def write_noise(folder: Path, train: int, test: int, size: int) -> Path:
    """A view set of random pixels, quickly written."""
    for split, count in (("train", train), ("test", test)):
        (folder / split).mkdir(parents=True)
        for i in range(count):
            pixels = np.random.default_rng(i).integers(0, 256, (size, size, 4), dtype=np.uint8)
            Image.fromarray(pixels).save(folder / split / f"r_{i}.png", compress_level=0)
        poses = np.array([pose(GOLDEN_ANGLE * i, 0.2 + i / count) for i in range(count)])
        names = [f"./{split}/r_{i}" for i in range(count)]
        write_transforms(folder / f"transforms_{split}.json", FOV_X_RADIANS, names, poses)
    return folder


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="no /proc to read the most memory held from")
def test_reading_and_training_take_the_same_memory_for_a_hundred_megabytes_of_images(tmp_path: Path) -> None:
    small = write_noise(tmp_path / "small", 4, 2, 32)
    large = write_noise(tmp_path / "large", 32, 8, 400)
    in_memory = 40 * 400 * 400 * 16 / 1024
    done = subprocess.run(
        [sys.executable, "-c", READ_AND_TRAIN, tmp_path, small, large],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    after_small, after_large = map(int, done.stdout.split())
    # one image of 2.5 MB, as it is decoded and as it is compared, is what the larger size may cost
    assert after_large - after_small < 0.4 * in_memory


def test_views_are_rendered_scored_and_let_go_one_at_a_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    alive: list[weakref.ref[evaluate.View]] = []
    most = [0]
    original = evaluate.render_view

    def watched(*arguments: Any) -> evaluate.View:
        view = original(*arguments)
        alive.append(weakref.ref(view))
        most[0] = max(most[0], sum(one() is not None for one in alive))
        return view

    monkeypatch.setattr(evaluate, "render_view", watched)
    ball = read_view_set(write_ball(tmp_path / "ball", size=12, train=4, test=12))
    task = GroupTask("ball", 0, ("nerf",), TRAIN, SCORE, Budget(3, None), tmp_path)
    (cell,) = train_group(task, ball, {}, lambda share: None)
    assert (cell.status, len(cell.views)) == ("done", 12)
    renders = read_renders(records_folder(tmp_path) / str(cell.pictures))
    assert len(renders) == SCORE.stored_views * len(cell.curve)
    assert len(alive) >= 12 * 2
    # the one that is rendered and the one before it
    assert most[0] <= 2
