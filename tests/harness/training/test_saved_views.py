"""The pictures that a run saves, their truth, and histograms of density by true occupancy."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from baselines.contract import Box
from harness.records.pictures import read_renders, read_truth, read_turn, write_truth
from harness.training.learner import Job
from harness.training.saved_renders import KeptRenders, frame_of, keep_truth, turned
from harness.training.scoring import evaluate
from harness.training.trainer import Trainer
from scenes.files.digest import file_digest
from scenes.view_sets.images import read_channels, write_channels
from scenes.view_sets.manifest import DamagedViewSet
from scenes.view_sets.pixels import decode_srgb, display_from_linear, encode_srgb, over_white
from scenes.view_sets.view_set import ViewSet, linear_over_white
from tests.harness.tiny import BUDGET, CPU, TRAIN


def kept(ball: ViewSet, out: Path, seed: int, *steps: int) -> str | None:
    """Show three views at each step, of which 24 is the last, and write what is kept of them."""
    keeping = KeptRenders.of(ball.test, 1, seed, 3)
    for step in steps:
        images = [
            evaluate.View(np.full((2, 3, 3), k / 4), np.full((2, 3), k / 4), np.full((2, 3), float(k)))
            for k in range(3)
        ]
        passed = keeping.passing(enumerate(images), step, last=step == 24)
        assert [view.depth[0, 0] for _, view in passed] == [0, 1, 2]
    return keeping.write(out, "ball", "nerf", seed)


@pytest.mark.parametrize(("seed", "steps"), [(0, [5, 9, 24]), (1, [24])])
def test_the_first_seed_keeps_every_checkpoint_and_others_the_last_alone(
    ball: ViewSet, tmp_path: Path, seed: int, steps: list[int]
) -> None:
    path = kept(ball, tmp_path, seed, 5, 9, 24)
    assert path == f"pictures/ball.nerf.{seed}.safetensors"
    found = read_renders(tmp_path / "records" / path)
    assert [(one.view, one.step) for one in found] == [("test/r_1", step) for step in steps]
    assert (found[0].colour == 0.25).all()


def test_a_cell_that_kept_nothing_writes_nothing(ball: ViewSet, tmp_path: Path) -> None:
    assert kept(ball, tmp_path, 1, 5) is None
    assert list(tmp_path.iterdir()) == []


def test_the_first_seed_saves_a_turn_of_all_test_views_in_the_order_of_azimuth(ball: ViewSet, tmp_path: Path) -> None:
    keep_truth(tmp_path, "ball", ball, 1)
    truth = read_turn(tmp_path / "records" / "pictures" / "ball.safetensors", "truth")
    poses = dict(zip(ball.test.names, ball.test.camera_to_world, strict=True))
    azimuths = [np.arctan2(poses[name][1, 3], poses[name][0, 3]) % (2 * np.pi) for name in truth.views]
    assert azimuths == sorted(azimuths)
    assert sorted(truth.views) == sorted(ball.test.names)
    place = ball.test.names.index(truth.views[0])
    assert np.abs(truth.frames[0] / 255.0 - over_white(ball.test.rgba[place])).max() <= 0.5 / 255 + 1e-6
    turn, none = (
        read_turn(tmp_path / "records" / str(kept(ball, tmp_path, seed, 5, 24)), "renders") for seed in (0, 1)
    )
    shown = [round(255 * ball.test.names.index(name) / 4) for name in turn.views]
    assert (turn.views, turn.frames[:, 0, 0, 0].tolist()) == (truth.views, shown)
    assert none is None


def test_a_turn_has_two_dozen_views_spread_over_all_azimuths(ball: ViewSet) -> None:
    angles = np.random.default_rng(0).permutation(50) * 2 * np.pi / 50 + 0.01
    poses = np.tile(np.eye(4), (50, 1, 1))
    poses[:, :2, 3] = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    chosen = turned(replace(ball.test, names=tuple(map(str, range(50))), camera_to_world=poses))
    assert len(chosen) == 24
    apart = np.diff([*angles[chosen], angles[chosen[0]] + 2 * np.pi]) / (2 * np.pi / 50)
    assert set(apart.round().tolist()) == {2.0, 3.0}


def test_a_truth_of_an_older_version_gets_its_turn(ball: ViewSet, tmp_path: Path) -> None:
    path = tmp_path / "records" / "pictures" / "ball.safetensors"
    keep_truth(tmp_path, "ball", ball, 1)
    whole = path.read_bytes()
    write_truth(path, read_truth(path))
    assert read_turn(path, "truth") is None
    keep_truth(tmp_path, "ball", ball, 1)
    assert path.read_bytes() == whole


def test_frames_are_small_and_averages() -> None:
    colour = np.zeros((400, 300, 3))
    colour[::2] = 1.0
    frame = frame_of(colour)
    assert (frame.shape, frame.dtype) == ((100, 75, 3), np.uint8)
    assert set(frame.flatten().tolist()) == {128}


def test_the_truth_of_posed_pngs_is_display_colour_alone(ball: ViewSet, tmp_path: Path) -> None:
    keep_truth(tmp_path, "ball", ball, 1)
    (truth,) = read_truth(tmp_path / "records/pictures/ball.safetensors")
    assert (truth.view, truth.linear, truth.depth) == ("test/r_1", None, None)
    assert truth.display == pytest.approx(over_white(ball.test.rgba[1]), abs=1e-3)
    assert truth.opacity == pytest.approx(ball.test.rgba[1][..., 3], abs=1e-3)


def rendered(ball: ViewSet, folder: Path, rgba: np.ndarray) -> ViewSet:
    """Return a rendered view set in which one test view has this linear light."""
    file = folder / "test" / "r_0.exr"
    file.parent.mkdir()
    write_channels(file, {name: rgba[..., i] for i, name in enumerate("RGBA")})
    return replace(ball, path=folder, width=len(rgba), rendered={"files": {"test/r_0.exr": file_digest(file)}})


def test_light_over_white_is_not_clipped_and_averages_areas(ball: ViewSet, tmp_path: Path) -> None:
    rgba = np.zeros((4, 4, 4), dtype=np.float32)
    rgba[:2] = (12.0, 3.0, 0.5, 1.0)
    rgba[2:, :2] = (0.1, 0.2, 0.25, 0.5)
    views = rendered(ball, tmp_path, rgba)
    light = linear_over_white(views, "test/r_0")
    assert light[0, 0] == pytest.approx([12.0, 3.0, 0.5])
    assert light[3, 0] == pytest.approx(decode_srgb(0.5 * encode_srgb(np.array([0.2, 0.4, 0.5])) + 0.5))
    assert light[3, 3].tolist() == [1.0, 1.0, 1.0]
    small = linear_over_white(replace(views, width=1), "test/r_0")
    mean = rgba.mean(axis=(0, 1))  # alpha 0.625; red and green are brighter than white
    (blue,) = decode_srgb(0.625 * encode_srgb(mean[2:3] / 0.625) + 0.375)
    assert small == pytest.approx(np.array([mean[0] + 0.375, mean[1] + 0.375, blue]).reshape(1, 1, 3))
    assert linear_over_white(ball, "test/r_0") is None
    file = tmp_path / "test" / "r_0.exr"
    write_channels(file, {**read_channels(file), "A": rgba[..., 0]})
    with pytest.raises(DamagedViewSet, match="checksum is wrong"):
        linear_over_white(views, "test/r_0")


def test_a_perfect_picture_has_no_error_in_linear_light_but_above_white(ball: ViewSet, tmp_path: Path) -> None:
    """Black that covers half a pixel is 0.5 in display colour over white, which is 0.214 of light."""
    alpha = np.random.default_rng(0).uniform(0, 1, (8, 8, 1)).astype(np.float32)
    colour = np.random.default_rng(1).uniform(0, 1, (8, 8, 3)).astype(np.float32)
    alpha[0, 0], colour[0, 0], colour[1, 1, 0], alpha[1, 1] = 0.5, 0.0, 9.0, 0.25
    rgba = np.concatenate([colour * alpha, alpha], axis=-1)
    light = linear_over_white(rendered(ball, tmp_path, rgba), "test/r_0")
    error = light - decode_srgb(over_white(display_from_linear(rgba)))
    assert light[0, 0] == pytest.approx([0.2140411] * 3)
    assert error[1, 1, 0] == pytest.approx(0.25 * 8)
    error[1, 1, 0] = 0
    assert np.abs(error).max() < 1e-6


def learner_of(box: Box, density: Callable[[torch.Tensor], torch.Tensor], gain: float) -> Trainer:
    """Return a bounded method with a known share of the largest density at positions [n, 3], amplified by `gain`."""
    learner = Trainer(Job("qnerf", box, TRAIN, BUDGET, 0, CPU))
    limit = learner.field.density_limit
    learner.field.density_before_and_after = lambda p: (limit * density(p), gain * limit * density(p))  # type: ignore
    return learner


def test_a_histogram_by_true_occupancy_is_the_closed_form() -> None:
    box = Box(-torch.ones(3), torch.ones(3))
    trained = learner_of(box, lambda p: torch.where(p.norm(dim=-1) < 0.7, 0.55, 0.05)[:, None], 1.5)
    axis = (np.arange(32) + 0.5) / 16 - 1
    radius = np.linalg.norm(np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1), axis=-1)
    occupied = radius < 0.7
    share = occupied.mean()
    found = evaluate.density_histogram(trained, occupied)
    assert found["points"] == [occupied.sum(), 32**3 - occupied.sum()]
    assert share == pytest.approx(4 / 3 * np.pi * 0.7**3 / 8, rel=0.02)

    def only(place: int) -> list[float]:
        return [float(k == place) for k in range(40)]

    # bins of 0.025: 0.55 is in the 22nd, 0.825 in the 33rd, 0.05 in the 2nd, 0.075 in the 3rd
    assert (found["before_inside"], found["after_inside"]) == (only(22), only(33))
    assert (found["before_outside"], found["after_outside"]) == (only(2), only(3))
    assert found["before"][22] == pytest.approx(share)
    half = evaluate.density_histogram(trained, occupied & (np.indices(occupied.shape)[0] < 16))
    assert half["before_outside"][22] == pytest.approx(0.5 * share / (1 - 0.5 * share))
    assert evaluate.density_histogram(trained).keys() == {"edges", "before", "after"}
    nowhere = evaluate.density_histogram(trained, np.zeros((32, 32, 32), dtype=bool))
    assert (nowhere["points"][0], sum(nowhere["before_inside"])) == (0.0, 0.0)


def test_a_box_that_is_longer_one_way_keeps_its_axes_apart() -> None:
    """There is geometry only where x is large: a grid with exchanged axes would find it elsewhere."""
    box = Box(torch.tensor([-1.0, -2.0, -3.0]), torch.tensor([1.0, 2.0, 3.0]))
    trained = learner_of(box, lambda p: torch.where(p[:, :1] > 0.5, 0.55, 0.05), 1.0)
    occupied = np.zeros((32, 32, 32), dtype=bool)
    occupied[24:] = True
    found = evaluate.density_histogram(trained, occupied)
    assert (found["before_inside"][22], found["before_outside"][2]) == (1.0, 1.0)
