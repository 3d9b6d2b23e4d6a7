"""The comparer's calibration on runs whose truth is known, and on comparers that were broken on purpose."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from harness.chart_record import Series, Table
from harness.comparisons import Judgement
from harness.evidence import calibration as study
from harness.evidence import real_a_a, simulated_a_a
from harness.evidence.calibration import calibration
from harness.evidence.real_a_a import TWIN, splits
from harness.evidence.simulated_a_a import drawn, measured_spreads, rates_by_scene, rates_over_scenes
from harness.evidence_record import Check
from harness.records import CellRecord
from tests.harness.cells import cell, checkpoint, diverged
from tests.harness.evidence.planted import situation

SCENES = tuple("abcdefgh")


def runs(seeds: int = 6, spread: float = 0.15, by_seed: Callable[[int], float] = lambda seed: 0.0) -> list[CellRecord]:
    """NeRF on eight scenes; more spread on the later ones."""
    draw = np.random.default_rng(4).normal
    found = []
    for k, scene in enumerate(SCENES):
        for seed in range(seeds):
            last = 20.0 + k + by_seed(seed) + draw(0, spread * (1 + k / 8))
            curve = [checkpoint(30, 1.0, last - 6), checkpoint(300, 10.0, last)]
            found.append(cell(scene, "nerf", seed, curve))
    return found


def findings(cells: list[CellRecord], monkeypatch: pytest.MonkeyPatch, count: int = 100) -> list[Any]:
    monkeypatch.setattr(real_a_a, "splits", lambda cells: splits(cells)[::20])  # all of them take half a minute here
    monkeypatch.setattr(study, "SIMULATED", count)
    monkeypatch.setattr(study, "FAMILIES", count // 5)
    monkeypatch.setattr(study, "ALONG_THE_CURVE", 10)
    return list(calibration(situation(Path(), {"a_a": cells})))


def failed(found: list[Any]) -> set[str]:
    return {one.what for one in found if isinstance(one, Check) and not one.holds}


def test_six_seeds_split_into_ten_pairs_of_halves_each_paired_in_six_orders() -> None:
    found = splits(runs())
    assert len(found) == 60
    assert len({tuple(sorted((c.method, c.seed, c.scores["psnr"]) for c in twins)) for twins in found}) == 60
    for twins in found:
        assert len(twins) == 48
        assert {(c.method, c.seed) for c in twins} == {(name, k) for name in ("nerf", TWIN) for k in range(3)}
    assert len(splits(runs(2))) == 1
    assert len(splits(runs(5))) == len(splits(runs(4)))  # the odd one stays out


def test_spreads_are_those_of_the_runs() -> None:
    cells = [cell("a", "nerf", k, [checkpoint(1, 1.0, v)]) for k, v in enumerate((20.0, 21.0, 22.0))]
    cells += [cell("b", "nerf", k, [checkpoint(1, 1.0, v)]) for k, v in enumerate((10.0, 14.0))]
    cells += [diverged("b", "nerf", 2), cell("c", "nerf", 0, [checkpoint(1, 1.0, 30.0)])]
    found = measured_spreads(cells)
    assert found.scale == {"a": pytest.approx(1.0), "b": pytest.approx(8**0.5)}
    assert found.shape.std() == pytest.approx(1.0)
    assert found.shape.mean() == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(ValueError, match="no scene"):
        measured_spreads([diverged("a", "nerf", 0)])


def test_what_is_drawn_has_twice_the_variance_of_the_runs() -> None:
    spreads = measured_spreads(runs(6))
    generator = np.random.default_rng(0)
    tables = [drawn(spreads, generator) for _ in range(2000)]
    for scene, scale in spreads.scale.items():
        values = np.array([one[scene] for one in tables])
        assert values.shape == (2000, 3)
        assert values.std() == pytest.approx(2**0.5 * scale, rel=0.05)
        assert values.mean() == pytest.approx(0.0, abs=0.06 * scale)
    varied = np.array([one["a"].mean() for one in (drawn(spreads, generator, 2.0) for _ in range(1000))])
    assert varied.std() == pytest.approx(2.0, rel=0.1)


def test_a_sound_comparer_passes_on_sound_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    found = findings(runs(), monkeypatch)
    assert failed(found) == set()
    assert sum(isinstance(one, Check) for one in found) == 11
    curves = [one for one in found if isinstance(one, Series)]
    assert [one.x[0] for one in curves] == [0.0, 0.0]
    assert all(one.y[-1] > one.y[0] for one in curves)  # type: ignore[operator]
    assert {one.id for one in found if isinstance(one, Table)} == {"real_a_a", "simulated_a_a", "a_a_spread"}
    said = [one for one in found if isinstance(one, str)]
    assert "simulated comparisons over all scenes" in said[0]
    assert "The interval over all scenes, nominally of 95 %, holds the truth in" in said[1]


def broken(change: Callable[[Judgement], Judgement], monkeypatch: pytest.MonkeyPatch) -> None:
    whole = simulated_a_a.judged
    monkeypatch.setattr(simulated_a_a, "judged", lambda *given: change(whole(*given)))


def test_a_comparer_that_never_says_anything_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    broken(lambda one: replace(one, verdict="inconclusive"), monkeypatch)
    names = failed(findings(runs(), monkeypatch))
    assert len(names) == 3
    assert all("planted" in one for one in names)


def test_a_comparer_that_calls_by_the_mean_alone_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    broken(lambda one: replace(one, verdict="better" if (one.difference or 0) > 0 else "worse"), monkeypatch)
    names = failed(findings(runs(), monkeypatch))
    assert sum("simulated" in one for one in names) == 3


def test_a_comparer_that_prints_too_small_a_size_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    broken(lambda one: replace(one, smallest_detectable=(one.smallest_detectable or 0) / 2), monkeypatch)
    assert sum("planted" in one for one in failed(findings(runs(), monkeypatch))) == 3


def test_a_size_that_is_too_small_by_a_sixth_is_seen_though_each_comparison_finds_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The sum of two quantiles of t, 12.59 + 1.06 in a family of eight with three seeds, is no size found in 80 %."""
    spreads = replace(measured_spreads(runs()), shape=norm.ppf((np.arange(500) + 0.5) / 500))
    least = 0.8 - 2 * (0.8 * 0.2 / 640) ** 0.5
    broken(lambda one: replace(one, smallest_detectable=(one.smallest_detectable or 0) * 13.65 / 16.04), monkeypatch)
    few = rates_by_scene(spreads, 80)
    assert few.found < least
    assert few.own_found >= least


def test_the_planted_size_is_that_of_the_true_spread_and_the_same_for_all_that_are_drawn_alike() -> None:
    spreads = replace(measured_spreads(runs()), shape=norm.ppf((np.arange(500) + 0.5) / 500))
    rates = rates_by_scene(spreads, 80)
    true = 16.0409 * (2 / 3 * np.mean(np.square(list(spreads.scale.values())))) ** 0.5
    assert rates.planted == pytest.approx(true, rel=0.06)
    assert rates.found == pytest.approx(0.8, abs=4 * (0.8 * 0.2 / 640) ** 0.5)
    assert rates.detectable < rates.planted


def test_real_families_are_worth_as_many_as_their_share_varies_like() -> None:
    found = real_a_a.independent_families(8, 6)
    assert 28 <= found <= 45, "of 60 splits, of which 10 part the seeds differently"
    assert real_a_a.independent_families(8, 4) <= 6
    assert real_a_a.independent_families(8, 3) == 1


def test_a_sound_share_of_real_families_holds_and_twice_as_many_do_not(monkeypatch: pytest.MonkeyPatch) -> None:
    """7 of 60 with a false call is what one sound comparer in ten shows; 12 is what one in a thousand does."""
    for called, holds in ((7, True), (12, False)):
        monkeypatch.setattr(study, "share_of_families", lambda rows, share=called / 60: share)
        names = failed(findings(runs(), monkeypatch, 10))
        assert any("real families of single scenes" in one for one in names) != holds


def test_a_real_difference_between_seeds_is_seen_in_the_real_comparisons(monkeypatch: pytest.MonkeyPatch) -> None:
    """Seeds 0 to 2 are a dB better in one run of all: the split that parts them is a difference, and is called."""
    names = failed(findings(runs(spread=0.02, by_seed=lambda seed: float(seed < 3)), monkeypatch))
    assert any("real ones" in one for one in names)


def test_a_lost_run_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    cells = runs()
    cells[3] = diverged(cells[3].scene, "nerf", cells[3].seed)
    assert failed(findings(cells, monkeypatch)) == {"pairs of real runs without a score"}


def test_families_hold_more_than_their_members() -> None:
    spreads = measured_spreads(runs())
    rates = rates_by_scene(spreads, 40)
    assert rates.count == 320
    assert rates.false <= rates.family <= 8 * rates.false + 1e-12
    overall = rates_over_scenes(spreads, 40)
    assert overall.count == 40
    assert overall.detectable < rates.detectable
