"""The number of samples for a noise target, and the noise of renders: closed forms, limits, images with a known
variance, and a tiny scene that Mitsuba renders.
"""

from pathlib import Path

import numpy as np
import pytest

from scenes.files.errors import InputError
from scenes.rendering import noise_study, samples
from scenes.rendering.noise_study import rerender, rerender_noise
from scenes.rendering.order import NoiseTarget
from scenes.rendering.samples import PILOT_SPP, PILOT_VIEWS, chosen_samples, noise_curve, samples_for
from scenes.view_sets.manifest import read_manifest
from tests.scenes.loading import SCALAR, TINY, render_tiny

TARGET = NoiseTarget(40.0, most=256)
"""A mean square error of 1e-4."""
SLOPE = 1.055 / 2.4 * 0.2 ** (1 / 2.4 - 1)
"""The slope of the display curve at a grey of 0.2."""


def at_pilots(a: float, b: float) -> tuple[float, float]:
    few, more = (a / n + b / n**1.5 for n in PILOT_SPP)
    return few, more


@pytest.mark.parametrize(("a", "b"), [(2e-3, 0.0), (0.0, 3e-2), (4e-3, 1e-2), (0.0, 0.0)])
def test_the_curve_goes_through_both_points(a: float, b: float) -> None:
    assert noise_curve(*at_pilots(a, b)) == pytest.approx((a, b), abs=1e-12)


@pytest.mark.parametrize("few", [0.0, 1e-3, 4.1e-3, 1.0], ids=["rising", "flat", "almost 1/n", "falling fast"])
def test_noise_off_the_curve_keeps_the_value_at_more_samples(few: float) -> None:
    a, b = noise_curve(few, 1e-3)
    assert min(a, b) >= 0.0
    assert at_pilots(a, b)[1] == pytest.approx(1e-3)


@pytest.mark.parametrize(
    ("target", "a", "b", "spp"),
    [
        (TARGET, 0.0, 0.0, 4),  # black, or without noise
        (TARGET, 1e-4, 0.0, 4),
        (TARGET, 9.9e-3, 0.0, 112),  # 99 samples: 2 · 7 · 7 are too few, 2 · 7 · 8 are enough
        (TARGET, 9.8e-3, 0.0, 98),
        (TARGET, 0.0, 1e-4 * 50**1.5 * (1 - 1e-12), 50),
        (TARGET, 0.0, 1e-4 * 50**1.5 * (1 + 1e-6), 60),
        (TARGET, 1.0, 0.0, 256),  # out of reach
        (NoiseTarget(40.0, most=256, least=30), 0.0, 0.0, 32),
        (NoiseTarget(40.0, most=2), 1.0, 1.0, 2),
        (NoiseTarget(40.0, most=4), 0.0, 0.0, 4),
    ],
)
def test_the_smallest_sufficient_number(target: NoiseTarget, a: float, b: float, spp: int) -> None:
    assert samples_for(target, *at_pilots(a, b)) == spp


class Noisy:
    """A scene whose views are opaque grey with Gaussian noise of variance `of[x of the camera]` / samples."""

    def __init__(self, *of: float, level: float = 0.2) -> None:
        self.of, self.level, self.calls = of, level, list[tuple[int, int, int]]()

    def colour(self, camera: np.ndarray, spp: int, seed: int) -> np.ndarray:
        place = int(camera[0, 3])
        self.calls.append((place, spp, seed))
        noise = np.random.default_rng(seed).normal(0.0, (self.of[place] / spp) ** 0.5, (64, 64, 4))
        return np.array([self.level, self.level, self.level, 1.0]) + noise * [1.0, 1.0, 1.0, 0.0]


def cameras(*places: int) -> np.ndarray:
    poses = np.tile(np.eye(4), (len(places), 1, 1))
    poses[:, 0, 3] = places
    return poses


def choose(scene: Noisy, spp: dict[str, int | NoiseTarget], poses: dict[str, np.ndarray]) -> tuple[dict, dict]:
    return chosen_samples(scene, spp, poses)  # type: ignore[arg-type]


def test_each_target_has_its_own_views_and_equal_ones_share() -> None:
    scene = Noisy(1e-4, 1e-3)
    numbers, facts = choose(
        scene,
        {"train": TARGET, "val": TARGET, "test": NoiseTarget(40.0, 512)},
        {"train": cameras(*[0] * 40), "val": cameras(), "test": cameras(1)},
    )
    assert numbers["train"] == numbers["val"] < numbers["test"]
    assert set(facts) == {"train", "test"}, "an empty split has no facts"
    assert sorted({call[:2] for call in scene.calls}) == [(place, n // 2) for place in (0, 1) for n in PILOT_SPP]
    assert len(scene.calls) == 2 * len(PILOT_SPP) * (PILOT_VIEWS + 1), "a split of one view has one"
    # noise of display colour: variance / samples times the squared slope of sRGB
    for split, variance in (("train", 1e-4), ("test", 1e-3)):
        for n, mse in zip(PILOT_SPP, facts[split]["pilot_mse"].values(), strict=True):
            assert mse == pytest.approx(SLOPE**2 * variance / n, rel=0.1)
    assert facts["test"]["ceiling_db"] == 40.0
    assert (facts["test"]["most"], facts["test"]["least"]) == (512, 4)


def test_no_view_is_rendered_where_there_is_no_choice() -> None:
    scene = Noisy(1.0)
    fixed, low = 17, NoiseTarget(40.0, most=3)
    numbers, facts = choose(
        scene, {"train": fixed, "val": TARGET, "test": low}, {"train": cameras(0), "val": cameras(), "test": cameras(0)}
    )
    assert numbers == {"train": 17, "val": 4, "test": 3}
    assert "pilot_mse" not in facts["test"]
    assert scene.calls == []


def test_a_render_that_is_not_finite_is_refused() -> None:
    with pytest.raises(samples.RenderError, match="not finite"):
        choose(Noisy(np.nan), {"train": TARGET}, {"train": cameras(0)})


def test_a_view_set_has_the_ceiling_and_says_how_it_was_chosen(tmp_path: Path) -> None:
    targets = {"train": NoiseTarget(35.0, 1024), "val": 4, "test": NoiseTarget(42.0, 1024)}
    manifest = read_manifest(render_tiny(tmp_path, spp=targets))
    noise = {
        split: np.mean([facts["noise_mse"] for name, facts in manifest["views"].items() if name.startswith(split)])
        for split in ("train", "test")
    }
    for split, mse in noise.items():
        assert 4 < manifest["spp"][split] < 1024
        assert -10 * np.log10(mse) == pytest.approx(targets[split].ceiling_db, abs=1.5)
    assert set(manifest["noise_target"]) == {"train", "test"}
    assert manifest["noise_target"]["test"]["ceiling_db"] == 42.0
    numbers = {"train": manifest["spp"]["train"], "val": 4, "test": manifest["spp"]["test"]}
    plain = read_manifest(render_tiny(tmp_path, spp=numbers))
    assert plain["digest"] == manifest["digest"], "the images are the same"
    assert plain["files"]["test/r_0.exr"] == manifest["files"]["test/r_0.exr"]
    folders = {path.name for path in tmp_path.iterdir()}
    assert len(folders) == 2, "the cache does not know the chosen numbers in advance"
    render_tiny(tmp_path, spp=targets | {"test": NoiseTarget(42.0, 1023)})
    assert len(list(tmp_path.iterdir())) == 3


VARIANCE = 0.02**2
POSE = np.eye(4)


def test_the_noise_of_one_image_is_what_was_put_in() -> None:
    renderer = Noisy(VARIANCE)
    stored = (renderer.colour(POSE, 8, 1) + renderer.colour(POSE, 8, 2)) / 2
    noise, halves = rerender_noise(renderer, stored, POSE, 16, 2, "test/r_0")
    # variance of a variance: 2 / n of its square, here with 2 × 12288 values
    assert (noise, halves) == pytest.approx([SLOPE**2 * VARIANCE / 16] * 2, rel=0.05)


def test_every_render_has_random_numbers_of_its_own() -> None:
    renderer = Noisy(VARIANCE)
    for view in ("test/r_0", "test/r_1"):
        rerender_noise(renderer, Noisy(VARIANCE).colour(POSE, 4, 1), POSE, 7, 3, view)
    assert [spp for _, spp, _ in renderer.calls] == [4] * 12
    assert len({seed for _, _, seed in renderer.calls}) == 12


def test_what_lies_above_white_has_no_noise() -> None:
    renderer = Noisy(VARIANCE, level=3.0)
    assert rerender_noise(renderer, renderer.colour(POSE, 4, 1), POSE, 16, 1, "test/r_0") == (0.0, 0.0)


def test_test_views_of_a_view_set_are_rendered_again(stored_once: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(noise_study, "scene_named", lambda name: TINY)
    rows = list(rerender(stored_once, 1, SCALAR))
    manifest = read_manifest(stored_once)
    assert [row.view for row in rows] == ["test/r_0", "test/r_1"]
    assert [row.stored for row in rows] == [manifest["views"][row.view]["noise_mse"] for row in rows]
    assert {(row.scene, row.spp, row.variant) for row in rows} == {("tiny", manifest["spp"]["test"], "scalar_rgb")}
    for row in rows:
        # the same view: far nearer than another one, and not the same numbers
        assert row.again == pytest.approx(row.stored, rel=0.6)
        assert row.halves == pytest.approx(row.stored, rel=0.6)
        assert len({row.again, row.stored, row.halves}) == 3


def test_wrong_input_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not a rendered view set"):
        next(rerender(tmp_path, 1, SCALAR))
    with pytest.raises(InputError, match="--repeats 0"):
        next(rerender(tmp_path, 0, SCALAR))
    without = render_tiny(tmp_path, counts={"train": 1, "val": 0, "test": 0})
    with pytest.raises(InputError, match="has no test views"):
        next(rerender(without, 1, SCALAR))
