"""Errors of weighted means of cells: false alarms and power by simulation, with unequal scatter and shared seeds."""

from collections.abc import Callable

import numpy as np
import pytest

from harness.gate.quality import scatter

SCENES, METHODS, SEEDS, DRAWS, OTHERS = 3, 4, 4, 4, 4
ALARMS = 0.01
REPEATS = 2000
ALL = np.full((SCENES, METHODS), 1 / (SCENES * METHODS))
ONE = np.eye(1, SCENES * METHODS, 5).reshape(SCENES, METHODS)
PAIR = np.tile([1.0, 0.0, -1.0, 0.0], (SCENES, 1)) / SCENES
WEIGHTS = pytest.mark.parametrize("weights", [ALL, ONE, PAIR], ids=["all", "one", "pair"])
SCATTER = 0.01 * np.arange(1, SCENES * METHODS + 1).reshape(SCENES, METHODS, 1, 1)
"""Unequal scatter: the largest is twelve times the smallest."""
SPREAD = 0.1 + 2.0 * SCATTER[::-1, ::-1, :, 0]


def seeds(generator: np.random.Generator, many: int) -> np.ndarray:
    """Return trainings with other seeds; half of a seed's variance is shared by all methods."""
    shared = generator.standard_normal((SCENES, 1, many))
    return np.asarray(SPREAD * (shared + generator.standard_normal((SCENES, METHODS, many))) / np.sqrt(2.0))


def rounded(generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return stored draws of the rounding, and by how much one more draw is better than their mean."""
    draws = seeds(generator, SEEDS)[..., None] + SCATTER * generator.standard_normal(
        (SCENES, METHODS, SEEDS, DRAWS + 1)
    )
    return draws[..., 1:], draws[..., 0] - draws[..., 1:].mean(axis=-1)


Sample = tuple[scatter.Error, float]


def by_rounding(generator: np.random.Generator, weights: np.ndarray) -> Sample:
    draws, better_by = rounded(generator)
    return scatter.rounding_error(weights, draws), scatter.figure(weights, better_by)


def by_seeds(generator: np.random.Generator, weights: np.ndarray) -> Sample:
    stored, new = seeds(generator, SEEDS + OTHERS), seeds(generator, SEEDS)
    return scatter.seeds_error(weights, stored, SEEDS), scatter.figure(weights, new - stored[..., :SEEDS])


def by_a_change(generator: np.random.Generator, weights: np.ndarray) -> Sample:
    draws, better_by = rounded(generator)
    return scatter.change_error(weights, draws, 3.0 * better_by), scatter.figure(weights, 3.0 * better_by)


def shares(error: float) -> float:
    return 4.0 * np.sqrt(error * (1.0 - error) / REPEATS)


@pytest.mark.slow
@WEIGHTS
@pytest.mark.parametrize("sample", [by_rounding, by_seeds, by_a_change])
def test_limits_alarm_as_often_as_they_say_and_find_what_they_say(
    sample: Callable[[np.random.Generator, np.ndarray], Sample], weights: np.ndarray
) -> None:
    generator = np.random.default_rng(1)
    samples = [sample(generator, weights) for _ in range(REPEATS)]
    true = float(np.std([figure for _, figure in samples]))
    size = float(np.sqrt(np.mean([error.size**2 for error, _ in samples])))
    assert size == pytest.approx(true, rel=0.06)
    alarms = np.mean([figure < -error.limit(ALARMS) for error, figure in samples])
    assert alarms <= ALARMS + shares(ALARMS), "Satterthwaite's degrees of freedom are somewhat too few"
    freedom = float(np.median([error.freedom for error, _ in samples]))
    expected = scatter.Error(true, freedom)
    for loss, share in ((expected.detects(ALARMS), 0.8), (5.0 * true, expected.power(5.0 * true, ALARMS))):
        found = np.mean([figure - loss < -error.limit(ALARMS) for error, figure in samples])
        assert found == pytest.approx(share, abs=0.06)


def test_the_error_of_equal_cells_is_the_closed_form() -> None:
    """It is σ √((1 + 1/4) / n) for the mean of n cells with four stored draws each."""
    generator = np.random.default_rng(2)
    draws = generator.standard_normal((SCENES, METHODS, 2000, DRAWS))
    error = scatter.rounding_error(ALL, draws)
    assert error.size == pytest.approx(np.sqrt(1.25 / (SCENES * METHODS * 2000)), rel=0.03)
    assert error.freedom == pytest.approx(SCENES * 2000 * (DRAWS - 1), rel=0.01)
    assert scatter.rounding_error(ALL, np.ones_like(draws)).size == 0.0


def test_other_random_numbers_are_told_from_the_same_ones() -> None:
    generator = np.random.default_rng(3)
    redrawn, same = [], []
    for _ in range(1000):
        stored = seeds(generator, SEEDS + OTHERS)
        redrawn.append(scatter.alike(seeds(generator, SEEDS) - stored[..., :SEEDS], stored))
        same.append(scatter.alike(rounded(generator)[1], stored))
    assert np.mean(np.array(redrawn) < scatter.ALIKE) <= 0.002
    assert max(same) < scatter.ALIKE
    assert np.median(redrawn) == pytest.approx(1.0, abs=0.1)


def test_what_has_no_score_is_left_out_of_the_scatter() -> None:
    draws, better_by = rounded(np.random.default_rng(4))
    stored = seeds(np.random.default_rng(4), SEEDS + OTHERS)
    spoilt = better_by.copy()
    spoilt[1, 2, 0] = np.nan
    for value in (scatter.change_error(ALL, draws, spoilt).size, scatter.alike(spoilt, stored)):
        assert np.isfinite(value)
    assert scatter.alike(np.full_like(better_by, np.nan), stored) == 1.0
