"""Image gates: calibrated on simulated renders, and shown deliberately broken ones."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from harness.gate import images
from harness.gate.gates import IMAGE_BATCHES, IMAGE_SCENES, gates
from harness.gate.images import Reference, Renders, biases, largest, mean_square, read_reference, standardised
from harness.gate.limits import LEVEL, Limit, judge, limit_from
from harness.records.study import Check
from scenes.files.errors import InputError
from scenes.view_sets.images import read_image

SIZE, SPP, REFERENCE_RENDERS = 24, 256, 96
SCENES = ("lego", "drums")
WHITE = np.array([1.0, 1.0, 1.0, 0.0])
GATES = tuple(
    gate for gate in gates() if gate.kind == "images" and (gate.name.split(".")[1] in SCENES or "all" in gate.name)
)


def truth(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and standard deviation of a render [size, size, 4]: a disc with a soft rim and no background."""
    generator = np.random.default_rng(seed)
    y, x = np.indices((SIZE, SIZE)) + 0.5
    radius = np.hypot(x - SIZE / 2, y - SIZE / 2)
    alpha = np.clip(9.0 - radius, 0.0, 1.0)
    colour = generator.uniform(0.1, 0.8, (SIZE, SIZE, 3)) * alpha[..., None]
    mean = np.concatenate([colour, alpha[..., None]], axis=-1)
    deviation = 0.05 * mean * generator.uniform(0.5, 1.5, mean.shape)
    deviation[..., 3] = np.sqrt(alpha * (1 - alpha) / SPP)
    return mean, deviation


def renders(seed: int, count: int, stream: int) -> np.ndarray:
    mean, deviation = truth(seed)
    return mean + deviation * np.random.default_rng((seed, stream)).standard_normal((count, *mean.shape))


@pytest.fixture(scope="module")
def references() -> dict[str, Reference]:
    return {scene: Reference.of(renders(number, REFERENCE_RENDERS, 1), SPP) for number, scene in enumerate(SCENES)}


@pytest.fixture(scope="module")
def limits(references: dict[str, Reference]) -> dict[str, Limit]:
    further = {scene: renders(number, 10 * IMAGE_BATCHES, 2) for number, scene in enumerate(SCENES)}
    values = images.figures_of(further, references)
    return {gate.name: limit_from(gate, values[gate.name]) for gate in GATES}


def judged(references: dict[str, Reference], limits: dict[str, Limit], shown: Renders) -> dict[str, Check]:
    figures = images.figures_of(shown, references, limits)
    return {gate.name: judge(gate, figures[gate.name], limits[gate.name]) for gate in GATES}


def failing(checks: dict[str, Check]) -> set[str]:
    """Return the tests that fail on any scene."""
    return {name.rpartition(".")[2] for name, check in checks.items() if check.is_broken}


def fresh(stream: int) -> Renders:
    return {scene: renders(number, IMAGE_BATCHES, 100 + stream) for number, scene in enumerate(SCENES)}


def with_fireflies(image: np.ndarray) -> np.ndarray:
    """Add white to 0.01 % of the pixels of all renders."""
    generator = np.random.default_rng(7)
    struck = generator.uniform(size=image.shape[:3]) < 1e-4
    struck.ravel()[generator.integers(struck.size)] = True
    return image + struck[..., None] * WHITE


def with_bright_samples(image: np.ndarray) -> np.ndarray:
    """Make 0.01 % of all samples 100 times white: each adds 100 / spp to its pixel."""
    samples = np.random.default_rng(8).binomial(SPP, 1e-4, image.shape[:3])
    return image + samples[..., None] * WHITE * 100 / SPP


def each(change: Callable[[np.ndarray], np.ndarray], scenes: tuple[str, ...] = SCENES) -> Callable[[Renders], Renders]:
    """Return a function that changes the renders of each of these scenes."""
    return lambda shown: {scene: change(image) if scene in scenes else image for scene, image in shown.items()}


def with_a_nan(image: np.ndarray) -> np.ndarray:
    broken = image.copy()
    broken[3, 12, 12, 1] = np.nan
    return broken


shifted = each(lambda image: np.roll(image, 1, axis=2))
# the same random numbers in every render: four times the intended standard error
all_alike = each(lambda image: np.repeat(image[:1], len(image), axis=0))


def test_what_is_unchanged_passes(references: dict[str, Reference], limits: dict[str, Limit]) -> None:
    checks = [check for stream in range(40) for check in judged(references, limits, fresh(stream)).values()]
    assert sum(check.is_broken for check in checks) <= 1
    assert 40 * len(GATES) * LEVEL < 0.05


@pytest.mark.parametrize(
    ("broken", "caught_by"),
    [
        (each(lambda image: image * np.array([1.002, 1.002, 1.002, 1.0])), "bias"),
        (each(lambda image: image * np.array([0.998, 0.998, 0.998, 1.0])), "bias"),
        (shifted, "pixels"),
        (each(lambda image: np.roll(image, 1, axis=1), SCENES[:1]), "pixels"),
        (each(with_fireflies), "largest"),
        (each(with_bright_samples), "largest"),
        *((each(with_a_nan, SCENES[:1]), test) for test in ("bias", "pixels", "largest")),
        (all_alike, "pixels"),
    ],
)
def test_what_is_broken_is_caught(
    broken: Callable[[Renders], Renders], caught_by: str, references: dict[str, Reference], limits: dict[str, Limit]
) -> None:
    caught = [caught_by in failing(judged(references, limits, broken(fresh(stream)))) for stream in range(20)]
    assert np.mean(caught) >= 0.8


def test_a_shift_shows_in_the_pictures(references: dict[str, Reference], tmp_path: Path) -> None:
    images.leave_pictures(tmp_path / "failed", shifted(fresh(0))["lego"], references["lego"], "pixels")
    shown, expected, difference = (
        read_image(tmp_path / "failed" / f"{name}.png")[..., :3] for name in ("image", "reference", "difference")
    )
    assert shown.shape == expected.shape == (images.ENLARGED * SIZE, images.ENLARGED * SIZE, 3)
    assert np.allclose(shown, np.roll(expected, images.ENLARGED, axis=1), atol=0.05)
    assert np.abs(difference - 0.5).max() == pytest.approx(0.5)
    # the corners are empty, and do not differ
    assert difference[0, 0] == pytest.approx(0.5, abs=0.003)


def test_statistics_against_slow_sums(references: dict[str, Reference]) -> None:
    reference, shown = references["lego"], fresh(3)["lego"]
    variance = reference.variances()
    above = below = 0.0
    for row in range(SIZE):
        for column in range(SIZE):
            for channel in range(3):
                r = reference.mean[row, column, channel]
                weight = 1 / variance[row, column, channel]
                above += weight * r * shown[5, row, column, channel]
                below += weight * r * r
    assert biases(shown, reference)[5] == pytest.approx(100 * (above / below - 1), abs=1e-9)
    z = standardised(shown.mean(axis=0), reference, len(shown))
    error = (variance[12, 12, 0] / 16 + variance[12, 12, 0] / 96) ** 0.5
    assert z[12, 12, 0] == pytest.approx((shown[:, 12, 12, 0].mean() - reference.mean[12, 12, 0]) / error)


def test_the_mean_square_of_sound_renders_is_that_of_the_pixels_that_vary(references: dict[str, Reference]) -> None:
    for number, scene in enumerate(SCENES):
        varying = float((truth(number)[1] > 0).mean())
        square = np.mean([mean_square(fresh(stream)[scene], references[scene]) for stream in range(10)])
        assert varying < 0.4
        assert square == pytest.approx(varying, abs=0.03)


def test_a_uniform_bias_is_measured_as_what_it_is(references: dict[str, Reference]) -> None:
    exact = np.repeat(references["lego"].mean[None], 2, axis=0)
    assert biases(1.002 * exact, references["lego"]) == pytest.approx([0.2, 0.2])
    assert mean_square(exact, references["lego"]) == 0


def test_a_pixel_never_hit_before_may_be_hit_once(references: dict[str, Reference]) -> None:
    shown = fresh(4)["lego"]
    shown[2, 0, 0, :3] += references["lego"].mean.max() / SPP  # one sample of this render
    assert largest(shown, references["lego"])[2] < 15
    assert largest(shown, references["lego"])[2] >= 9


@pytest.mark.parametrize(
    ("mean", "variance"),
    [
        (np.zeros((4, 4, 4)), np.ones((4, 4, 4))),
        (np.ones((4, 4, 4)), -np.ones((4, 4, 4))),
        (np.full((4, 4, 4), np.nan), np.ones((4, 4, 4))),
        (np.ones((4, 4, 4)), np.ones((4, 5, 4))),
    ],
)
def test_a_reference_that_nothing_can_be_held_to(mean: np.ndarray, variance: np.ndarray) -> None:
    with pytest.raises(ValueError, match=r"finite|do not match"):
        Reference(mean, variance, 96, 256)


def test_scenes_whose_weights_are_missing_have_no_common_figure(references: dict[str, Reference]) -> None:
    known = {"images.lego.bias": Limit(-1.0, 1.0, spread=0.1)}
    assert "images.all.bias" not in images.figures_of(fresh(0), references, known)


def test_references_are_stored_and_read(
    tmp_path: Path, references: dict[str, Reference], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(images, "IMAGE_RESOLUTION", SIZE)
    stored = images.store(tmp_path / "images", "lego", renders(0, REFERENCE_RENDERS, 1))
    assert np.allclose(stored.mean, references["lego"].mean, rtol=1e-6)
    assert np.allclose(stored.variance, references["lego"].variance, rtol=1e-6)
    file = tmp_path / "images" / "lego.exr"
    file.write_bytes(file.read_bytes()[:300])
    with pytest.raises(InputError, match=r"lego\.exr"):
        read_reference(tmp_path / "images", "lego")
    monkeypatch.undo()
    images.store(tmp_path / "other", "lego", np.ones((3, 48, 48, 4)))
    with pytest.raises(InputError, match="missing"):
        read_reference(tmp_path / "other", "drums")


def test_all_scenes_are_rendered_where_all_are_judged() -> None:
    assert images.scenes_of(["images.all.bias"]) == IMAGE_SCENES
    assert images.scenes_of(["images.drums.bias", "images.drums.largest"]) == ("drums",)
