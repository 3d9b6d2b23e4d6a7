"""`splats` in training: it is bit-identical across a relocation and a stop, and stops at a NaN."""

import math
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch.nn.functional import normalize

from baselines.catalog import CATALOG
from baselines.contract import Rays
from baselines.methods.explicit import GaussianSettings
from baselines.splats.ply import ply_bytes, read_ply
from baselines.splats.rasteriser import COLOUR
from harness.plan.schedule import Budget
from harness.records.snapshot import read_unfinished, write_unfinished
from harness.studies.conformance.learner_checks import CPU, SETTINGS, STREAM, drawn
from harness.training.batches import Batch
from harness.training.checkpoints import restore_training, tensors_of, training_state
from harness.training.kinds.splat_trainer import SplatTrainer
from harness.training.kinds.ssim_loss import ssim_loss
from harness.training.learner import Job, at_step, train
from harness.training.lockstep import box_of
from harness.training.make_learner import NotAvailable, learner_for
from harness.training.scoring.evaluate import cameras_of
from harness.training.trainer import Diverged
from scenes.rendering.render import use
from scenes.rendering.variant import Variant
from tests.harness.voxels import drjit_or_skip

OWN: GaussianSettings = CATALOG["splats"].settings
MOVED_EVERY = OWN.moved_every
STEPS = MOVED_EVERY + 6


def trainer(steps: int = 2 * STEPS, own: GaussianSettings = OWN) -> SplatTrainer:
    views, _ = drawn()
    settings = replace(SETTINGS, own={"splats": own})
    return SplatTrainer(Job("splats", box_of(views, CPU), settings, Budget(steps, None), STREAM, CPU, True))


def batch_at() -> Callable[[int], Batch]:
    return drawn()[1].for_learner(SplatTrainer.whole_views, STREAM, 0)


def test_a_step_sees_all_pixels_of_one_view_and_each_view_in_its_turn() -> None:
    views, _ = drawn()
    seen = [batch_at()(step) for step in range(40)]
    assert {len(batch.rays) for batch in seen} == {views.width * views.height}
    assert all(bool((batch.rays.origins == batch.rays.origins[:1]).all()) for batch in seen)
    assert len({tuple(batch.rays.origins[0].tolist()) for batch in seen}) == len(views.train.names)
    assert torch.equal(batch_at()(7).colours, seen[7].colours)


def test_stopped_before_and_after_a_relocation_it_ends_in_the_same_bits() -> None:
    whole = train(trainer(), batch_at(), at_step(STEPS))
    pieces = trainer()
    for stop in (MOVED_EVERY - 2, MOVED_EVERY + 2):
        with tempfile.TemporaryDirectory() as scratch:
            path = Path(scratch) / "cell.safetensors"
            write_unfinished(path, training_state(train(pieces, batch_at(), at_step(stop))))
            kept = read_unfinished(path)
        pieces = trainer()
        restore_training(pieces, kept)
    train(pieces, batch_at(), at_step(STEPS))
    assert len(whole.field.values) > OWN.first
    assert all(torch.equal(value, tensors_of(pieces)[name]) for name, value in tensors_of(whole).items())
    assert torch.equal(whole.square, pieces.square)


def test_moments_of_what_moved_begin_again_and_there_are_never_more_than_may_be() -> None:
    first = OWN.first
    learner = train(trainer(own=replace(OWN, most=first + 3)), batch_at(), at_step(MOVED_EVERY))
    assert len(learner.field.values) == first + 3
    assert learner.seen[first:].tolist() == [[0.0]] * 3
    assert float(learner.square[first:].abs().max()) == 0.0
    assert float(learner.seen.max()) == MOVED_EVERY


def test_ssim_in_the_loss_raises_it() -> None:
    """The picture of one view after a few steps is nearer to it in SSIM than without, and the rows are found."""
    ended = {}
    rays, colours, *_ = batch_at()(0)
    for weight in (0.0, 0.3):
        learner = train(trainer(own=replace(OWN, ssim_weight=weight)), lambda _: batch_at()(0), at_step(30))
        ended[weight] = learner.field.render(rays).colour
    width = drawn()[0].width
    before, after = (
        float(ssim_loss(picture.view(-1, width, 3), colours.view(-1, width, 3))) for picture in ended.values()
    )
    assert after < 0.9 * before


@pytest.mark.parametrize("where", ["gradient", "loss", "step"])
def test_what_is_not_finite_ends_it_with_the_gaussians_of_before(where: str, monkeypatch: pytest.MonkeyPatch) -> None:
    learner = train(trainer(), batch_at(), at_step(3))
    before = learner.field.values.clone()
    rays, colours, *_ = batch_at()(3)
    if where == "gradient":
        slope: Any = learner._slope
        monkeypatch.setattr(learner, "_slope", lambda *given: (0.0, slope(*given)[1] * float("nan"), 1))
    elif where == "loss":
        colours = colours.clone()
        colours[5] = float("nan")
    else:
        learner.own = replace(OWN, epsilon=float("nan"))
    with pytest.raises(Diverged, match="step 3"):
        learner.train_on(rays, colours)
    assert torch.equal(learner.field.values, before)
    assert learner.step == 3


def test_on_a_gpu_it_is_not_available_with_the_remedy() -> None:
    views, _ = drawn()
    gpu = torch.device("cuda")
    with pytest.raises(NotAvailable, match="--device cpu"):
        learner_for(Job("splats", box_of(views, CPU), SETTINGS, Budget(1, None), STREAM, gpu))


def test_a_pixel_is_that_of_the_views_whatever_the_rays_bins() -> None:
    views, _ = drawn()
    side = float((views.bounds[1] - views.bounds[0]).max())
    distance = float(np.linalg.norm(views.train.camera_to_world[:, :3, 3] - views.bounds.mean(axis=0), axis=-1).mean())
    for bins in (24, 48):
        settings = replace(SETTINGS, bins=bins)
        learner = SplatTrainer(Job("splats", box_of(views, CPU), settings, Budget(1, None), STREAM, CPU, True))
        assert learner.field.pixel * 0.5 * side == pytest.approx(distance / views.focal)


def test_colours_of_a_picture_lie_in_0_to_1() -> None:
    learner = trainer()
    learner.field.values = learner.field.values.clone()
    learner.field.values[:, COLOUR] = 9.0
    views, _ = drawn()
    colour = learner.field.render(cameras_of(views, views.test, CPU).all_rays(0)).colour
    assert colour.max() == 1.0
    assert colour.min() >= 0.0


def test_traced_colours_are_written_as_other_programs_read_them(tmp_path: Path) -> None:
    drjit_or_skip()
    views, _ = drawn()
    box = box_of(views, CPU)
    learner = learner_for(Job("ellipsoids", box, SETTINGS, Budget(1, None), STREAM, CPU, True))
    draw = torch.Generator().manual_seed(0)
    ball = 0.1 * torch.randn(1, learner.field.columns, generator=draw)
    ball[:, :3], ball[:, 3:6], ball[:, 10] = 0.0, -2.0, 3.0
    learner.field.values = ball
    (tmp_path / "a.ply").write_bytes(ply_bytes(learner.field))
    read = read_ply(tmp_path / "a.ply", math.inf)
    for direction in normalize(torch.randn(4, 1, 3, generator=draw), dim=-1):
        ray = Rays(0.5 * (box.lower + box.upper) - 4.0 * direction, direction, 0.1, 9.0)
        torch.testing.assert_close(read.render(ray).colour, learner.render(ray, 1).colour, rtol=0.0, atol=1e-4)


def test_traced_steps_have_the_same_bits_if_a_renderer_sets_another_variant_between_them() -> None:
    drjit_or_skip()
    views, batches = drawn()
    learners = []
    for disturbed in (False, True):
        learner = learner_for(Job("ellipsoids", box_of(views, CPU), SETTINGS, Budget(4, None), STREAM, CPU, True))
        for step in range(1, 4):
            train(learner, batches.for_learner(learner.whole_views, STREAM, 256), at_step(step))
            if disturbed:
                use(Variant("scalar_rgb", None, "test"))
        learners.append(learner)
    alone, between = learners
    assert torch.equal(alone.field.values, between.field.values)
