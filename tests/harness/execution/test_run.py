"""What a run does besides its cells: it decodes images of the user once, trains a guest, and scores given Gaussians."""

import math
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from baselines.catalog import GIVEN
from baselines.contract import Box
from baselines.splats.gaussians import Gaussians
from baselines.splats.ply import ply_bytes
from harness.command.plan_options import planned
from harness.execution.progress import Progress
from harness.execution.run import run
from harness.plan.run_plan import Machine
from harness.plan.schedule import Budget
from harness.records.cells import cell_path, read_cell, read_comparisons, read_run
from harness.training.scoring.others import score_pictures
from reports.claims.first_screen import guests
from reports.data.load import read_records
from reports.run.metrics_table import costs_grid
from reports.run.pictures import views
from scenes.files.digest import file_digest
from scenes.view_sets import view_set
from scenes.view_sets.images import write_png
from scenes.view_sets.source import Source
from scenes.view_sets.view_set import read_view_set
from tests.harness.ball import write_ball
from tests.harness.patching import changed
from tests.harness.tiny import SCORE, TRAIN, VIEWS
from tests.harness.trained_runs import in_this_process, train_run


@pytest.fixture
def decoded(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """The number of times that each image is decoded."""
    times: Counter[str] = Counter()

    def counted(source: Source, _: Path) -> Source:
        def pixels(file: Path, width: int | None) -> np.ndarray:
            times[str(file)] += 1
            return source.pixels(file, width)

        return replace(source, pixels=pixels)

    changed(monkeypatch, view_set, "source_of", counted)
    return times


def test_a_run_decodes_each_image_once(tmp_path: Path, decoded: Counter[str]) -> None:
    out = train_run(tmp_path, ["nerf"], steps=2)
    assert (len(decoded), set(decoded.values())) == (8, {1})
    assert [file.name for file in out.iterdir() if file.name.startswith(".scratch")] == []


def test_an_image_that_changed_is_decoded_again(tmp_path: Path, decoded: Counter[str]) -> None:
    ball, kept = write_ball(tmp_path / "ball", size=16, train=3, test=1), tmp_path / "kept"
    kept.mkdir()
    first = read_view_set(ball, 8, decoded=kept)
    again = read_view_set(ball, 8, decoded=kept)
    assert first.content == again.content
    before = decoded.total()
    write_png(ball / "train" / "r_0.png", np.zeros((16, 16, 4), dtype=np.float32))
    changed = read_view_set(ball, 8, decoded=kept)
    assert decoded.total() == before + 1
    assert changed.content != first.content
    assert not changed.train.rgba[0].any()
    assert read_view_set(ball, 8, decoded=tmp_path / "none").content == changed.content, "a node without the folder"


def test_given_gaussians_are_scored_as_a_folder_of_their_pictures_is_and_not_trained(
    ball_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("harness.execution.run.run_locally", in_this_process)
    file, out = tmp_path / "ball.ply", tmp_path / "out"
    out.mkdir()
    file.write_bytes(ply_bytes(Gaussians(Box(-torch.ones(3), torch.ones(3)), 0, grey_ball(), 0.0, 0.0)))
    plan = planned("smoke", view_set=[ball_folder], methods=["nerf"], seeds=2)
    plan = replace(plan, budget=Budget(4, None), train=TRAIN, score=SCORE, views=VIEWS)
    plan = replace(plan, given=((str(file), file_digest(file)),))
    assert run(plan, out, tmp_path / "sets", Machine("cpu", 1, 1), "command", Progress()) == 0
    cell = read_cell(cell_path(out, "ball", GIVEN, 0))
    assert (cell.status, cell.steps, cell.train_seconds, cell.curve) == ("done", 0, 0.0, [])
    alone = score_pictures(file, ball_folder, "theirs", resolution=VIEWS.resolution)
    for name in ("psnr", "ssim", "flip"):
        assert cell.scores[name] == pytest.approx(getattr(alone, name), abs=1e-4)
    assert (read_run(out).guests, read_comparisons(out)) == ([GIVEN], [])
    assert plan.settings()["given"] == [file_digest(file)]
    records = read_records(out)
    assert guests(records).startswith(f"given_splats reaches {cell.scores['psnr']:.2f} dB as given, nerf ")
    assert [row[1].text for row in costs_grid(records).rows if row[0].text == GIVEN] == ["–"]
    (view,) = views(records)
    assert [shown.method for shown in view.methods] == ["nerf", GIVEN]
    file.write_bytes(file.read_bytes()[:-4] + b"\0\0\0\0")
    cell_path(out, "ball", GIVEN, 0).unlink()
    assert run(plan, out, tmp_path / "sets", Machine("cpu", 1, 1), "command", Progress()) == 3
    changed = read_cell(cell_path(out, "ball", GIVEN, 0))
    assert (changed.status, "changed since the run began" in (changed.reason or "")) == ("error", True)


def grey_ball() -> torch.Tensor:
    """Return one round Gaussian of standard deviation 0.4 in the middle."""
    return torch.tensor([[0.0, 0.0, 0.0, *[math.log(0.4)] * 3, 1.0, 0.0, 0.0, 0.0, 4.0, 0.1, 0.1, 0.1]])
