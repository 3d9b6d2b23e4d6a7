"""Noise of renders: images with a known variance, and a tiny scene that Mitsuba renders."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from scenes.files.errors import InputError
from scenes.modelling.scene import Scene
from scenes.rendering import noise_study
from scenes.rendering.noise_study import rerender, rerender_noise
from scenes.rendering.variant import Variant
from scenes.view_sets.manifest import read_manifest

GREY = 0.2
SLOPE = 1.055 / 2.4 * GREY ** (1 / 2.4 - 1)
"""The slope of the display curve at `GREY`."""
SIGMA = 0.02
POSE = np.eye(4)


class Grey:
    """Opaque grey with independent Gaussian noise of variance σ² / spp in every channel."""

    def __init__(self, level: float = GREY, sigma: float = SIGMA) -> None:
        self.level, self.sigma = level, sigma
        self.calls: list[tuple[int, int]] = []

    def colour(self, camera_to_world: np.ndarray, spp: int, seed: int) -> np.ndarray:
        self.calls.append((spp, seed))
        noise = np.random.default_rng(seed).normal(0.0, self.sigma / spp**0.5, (64, 64, 4))
        noise[..., 3] = 0.0
        return np.array([self.level, self.level, self.level, 1.0]) + noise


def test_the_noise_of_one_image_is_what_was_put_in() -> None:
    renderer = Grey()
    stored = (renderer.colour(POSE, 8, 1) + renderer.colour(POSE, 8, 2)) / 2
    noise, halves = rerender_noise(renderer, stored, POSE, 16, 2, "test/r_0")
    # variance of a variance: 2 / n of its square, here with 2 × 12288 values
    assert noise == pytest.approx((SLOPE * SIGMA) ** 2 / 16, rel=0.05)
    assert halves == pytest.approx((SLOPE * SIGMA) ** 2 / 16, rel=0.05)


def test_every_render_has_random_numbers_of_its_own() -> None:
    renderer = Grey()
    rerender_noise(renderer, Grey().colour(POSE, 4, 1), POSE, 7, 3, "test/r_0")
    rerender_noise(renderer, Grey().colour(POSE, 4, 1), POSE, 7, 3, "test/r_1")
    assert [spp for spp, _ in renderer.calls] == [4] * 12
    assert len({seed for _, seed in renderer.calls}) == 12


def test_what_lies_above_white_has_no_noise() -> None:
    stored = Grey(level=3.0).colour(POSE, 4, 1)
    assert rerender_noise(Grey(level=3.0), stored, POSE, 16, 1, "test/r_0") == (0.0, 0.0)


def test_test_views_of_a_view_set_are_rendered_again(
    stored_once: Path, tiny_scene: Scene, scalar: Variant, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(noise_study, "scene_named", lambda name: tiny_scene)
    rows = list(rerender(stored_once, 1, scalar))
    manifest = read_manifest(stored_once)
    assert [row.view for row in rows] == ["test/r_0", "test/r_1"]
    assert [row.stored for row in rows] == [manifest["views"][row.view]["noise_mse"] for row in rows]
    assert {(row.scene, row.spp, row.variant) for row in rows} == {("tiny", manifest["spp"]["test"], "scalar_rgb")}
    for row in rows:
        # the same view: far nearer than another one, and not the same numbers
        assert row.again == pytest.approx(row.stored, rel=0.6)
        assert row.halves == pytest.approx(row.stored, rel=0.6)
        assert len({row.again, row.stored, row.halves}) == 3


def test_wrong_input_is_named(tmp_path: Path, scalar: Variant, render_tiny: Callable[..., Path]) -> None:
    with pytest.raises(InputError, match="not a rendered view set"):
        next(rerender(tmp_path, 1, scalar))
    with pytest.raises(InputError, match="--repeats 0"):
        next(rerender(tmp_path, 0, scalar))
    without = render_tiny(tmp_path, counts={"train": 1, "val": 0, "test": 0})
    with pytest.raises(InputError, match="has no test views"):
        next(rerender(without, 1, scalar))
