"""Changes are found at their place, and series without a change seldom show one."""

from collections.abc import Callable

import numpy as np
import pytest

from harness.verdicts.history.change_points import CHANCE, FEWEST, MOST, change_points


def noise(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(1.0, 0.05, count)


def test_a_step_is_found_at_its_place_with_the_levels_of_both_sides() -> None:
    series = np.concatenate([np.full(10, 2.0), np.full(7, 5.0)])
    (change,) = change_points(series)
    assert (change.index, change.before, change.after) == (10, 2.0, 5.0)
    assert change.chance <= CHANCE


def test_up_and_down_again_are_two_changes_with_the_medians_between_them() -> None:
    series = np.concatenate([noise(20), noise(15, 1) + 1.0, noise(20, 2)])
    up, down = change_points(series)
    assert (up.index, down.index) == (20, 35)
    assert up.after == down.before == pytest.approx(2.0, abs=0.05)


DRAWS: dict[str, Callable[[np.random.Generator], np.ndarray]] = {
    "normal": lambda random: random.normal(size=25),
    "Cauchy": lambda random: random.standard_t(1, size=25),
    "ties": lambda random: random.permutation(np.repeat([0.0, 1.0, 2.0], [9, 8, 8])),
}


@pytest.mark.parametrize("draw", DRAWS)
def test_changes_by_chance_are_as_rare_as_is_said(draw: str) -> None:
    random = np.random.default_rng(3)
    false = sum(bool(change_points(DRAWS[draw](random))) for _ in range(600))
    assert false <= 15  # 600 at 1 %: 6 are expected, more than 15 in 0.05 % of seeds


def test_a_shift_of_four_spreads_is_found_six_runs_later() -> None:
    found = [change_points(np.concatenate([noise(15, seed), noise(6, seed + 1000) + 0.2])) for seed in range(50)]
    assert sum(any(abs(change.index - 15) <= 1 for change in changes) for changes in found) >= 45


def test_outliers_are_no_change() -> None:
    series = noise(30)
    series[[7, 8, 29]] = 40.0
    assert change_points(series) == []


@pytest.mark.parametrize("series", [np.zeros(40), np.arange(FEWEST - 1.0), np.zeros(0), np.array([1.0])])
def test_what_cannot_show_a_change_has_none(series: np.ndarray) -> None:
    assert change_points(series) == []


def test_the_clearest_change_in_the_fewest_runs_can_be_found() -> None:
    assert len(change_points(np.repeat([0.0, 1.0], FEWEST // 2) + 1e-3 * np.arange(FEWEST))) == 1


def test_only_the_last_runs_are_looked_at_and_places_count_from_the_first() -> None:
    early = np.concatenate([np.zeros(50), np.ones(MOST)])
    assert change_points(early) == []
    (change,) = change_points(np.concatenate([early, np.full(20, 3.0)]))
    assert change.index == 50 + MOST


def test_neither_unit_nor_offset_matters() -> None:
    series = np.concatenate([noise(12), noise(8, 5) + 0.3])
    places = [change.index for change in change_points(series)]
    assert places == [change.index for change in change_points(1e6 * series - 3.0)] != []
