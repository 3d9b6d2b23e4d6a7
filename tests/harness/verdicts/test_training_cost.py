"""Ratios of core seconds to the baseline's, and cells that shared their processor."""

import numpy as np
import pytest
from msgspec.structs import replace

from harness.records.cells import CellRecord
from harness.verdicts.training_cost import CostRatio, cost_ratios
from tests.harness.cells import cell, checkpoint, diverged


def took(scene: str, method: str, seed: int, seconds: float, steps: int = 100, **changes: float | None) -> CellRecord:
    return cell(scene, method, seed, [checkpoint(steps, 2 * seconds, 20.0)], train_core_seconds=seconds, **changes)


def test_the_ratio_is_the_geometric_mean_over_pairs_of_core_seconds() -> None:
    factors = {("lego", 0): 1.5, ("lego", 1): 1.2, ("chair", 0): 1.1, ("chair", 1): 1.3}
    cells = [
        took(*key, 8.0)
        for key in [("lego", "nerf", 0), ("lego", "nerf", 1), ("chair", "nerf", 0), ("chair", "nerf", 1)]
    ]
    cells += [took(scene, "qnerf", seed, 8.0 * factor) for (scene, seed), factor in factors.items()]
    baseline, ratio = cost_ratios(cells, ["nerf", "qnerf"], "nerf")
    assert baseline == CostRatio("nerf", None, None)
    mean = np.exp(np.mean(np.log(list(factors.values()))))
    assert ratio.ratio == pytest.approx(mean)
    assert ratio.interval[0] < mean < ratio.interval[1]
    assert np.sqrt(np.prod(ratio.interval)) == pytest.approx(mean), "the interval is one of logarithms"


def test_pairs_of_other_steps_and_without_an_end_are_left_out() -> None:
    kept = [took("lego", "nerf", 0, 8.0), took("lego", "qnerf", 0, 16.0)]
    beside = [took("lego", "nerf", 1, 8.0), took("lego", "qnerf", 1, 4.0, steps=50)]
    beside += [took("lego", "nerf", 2, 8.0), diverged("lego", "qnerf", 2)]
    assert cost_ratios([*kept, *beside], ["nerf", "qnerf"], "nerf")[1].ratio == pytest.approx(2.0)
    assert cost_ratios(beside, ["nerf", "qnerf"], "nerf")[1] == CostRatio("qnerf", None, None)


def test_the_wall_is_taken_where_no_core_seconds_were_counted() -> None:
    older = [replace(took("lego", name, 0, seconds), train_core_seconds=None) for name, seconds in (("a", 1), ("b", 3))]
    assert cost_ratios([older[0], older[1]], ["a", "b"], "a")[1].ratio == pytest.approx(3.0)


def test_a_cell_that_shared_its_processor_is_told_from_one_that_used_several() -> None:
    alone = took("lego", "nerf", 0, 8.0)
    assert alone.wall_per_core_second == 2.0
    assert alone.waited
    assert not replace(alone, train_core_seconds=15.0).waited
    assert not replace(alone, train_core_seconds=32.0).waited, "two threads"
    passive = replace(alone, train_core_seconds=15.0, provenance={"threads": 2, "waiting": "passive"})
    assert not passive.waited, "its threads slept"
    assert not passive.spun
    active = replace(passive, provenance={"threads": 2, "waiting": "active"})
    assert active.spun, "2 × 16 s on cores of which it had 15 s"
    assert active.waited
    assert active.all_warnings == ["core seconds too long: 2 threads waited actively"]
    assert replace(active, provenance={"threads": 2}).spun, "an older record: they waited actively"
    assert not replace(active, train_core_seconds=30.0).spun, "nothing else ran"
    assert not replace(active, train_core_seconds=8.0, provenance={"threads": 1}).spun, "alone, it waits for nobody"
    assert not replace(alone, train_core_seconds=None).waited
    assert not replace(alone, provenance={"device": "NVIDIA H100"}).waited, "a GPU's work is no processor's"
