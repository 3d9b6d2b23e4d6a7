"""Is it worse? Differences from stored cells against the spread of rounding, by simulation and on the stored cells."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from msgspec.structs import force_setattr, replace

from harness.gate import worse
from harness.gate.gates import (
    GATE_SEEDS,
    LARGEST_LOSS,
    SCORES,
    TRAINED_METHODS,
    TRAINED_SCENES,
    WIDER,
    gates,
    settings_of,
)
from harness.gate.limits import KindFacts
from harness.gate.references import References, read_references
from harness.gate.worse import Scores
from harness.plan.schedule import Budget
from harness.records.study import Check
from tests.harness import tiny
from tests.harness.cells import diverged

ROOT = Path(__file__).parents[3]
BY_NAME = {gate.name: gate for gate in gates()}
KEYS = [f"{scene}/{method}/{seed}" for scene in TRAINED_SCENES for method in TRAINED_METHODS for seed in GATE_SEEDS]
ROUNDING = 0.03


def stored_with(generator: np.random.Generator, rounding: float = ROUNDING) -> tuple[References, np.ndarray]:
    """References of cells that differ by 0.3 dB, with three draws of the rounding each; the truth without rounding."""
    truth = 25.0 + 0.3 * generator.standard_normal(len(KEYS))
    cells = {
        key: {
            "psnr": (value + rounding * generator.standard_normal(3)).tolist(),
            "ssim": [0.8, 0.8, 0.8],
            "depth_rmse": [0.2, 0.2, 0.2],
        }
        for key, value in zip(KEYS, truth, strict=True)
    }
    return References("avx2", {"worse": KindFacts(settings_of("worse"), {}, 1.0)}, cells=cells), truth


def compared(stored: References) -> References:
    """With what the comparer says of them."""
    return replace(stored, statistics=worse.statistics_of(worse.stored_cells(stored)))


def scores_with(psnr: np.ndarray, ssim: float = 0.8, depth: float = 0.2) -> Scores:
    return {
        key: {"psnr": float(value), "ssim": ssim, "depth_rmse": depth} for key, value in zip(KEYS, psnr, strict=True)
    }


def loss(name: str, new: Scores, stored: References) -> Check:
    return worse.loss_check(BY_NAME[name], new, stored)


@pytest.mark.parametrize("redrawn", [False, True])
def test_other_rounding_passes_and_two_tenths_of_a_decibel_fail(redrawn: bool) -> None:
    """Also where a change draws other numbers, which makes each cell another training: cells differ as seeds do."""
    generator = np.random.default_rng(2)
    failed = {"as good": 0, "worse": 0}
    for _ in range(100):
        stored, truth = stored_with(generator)
        new = 25.0 + 0.3 * generator.standard_normal(len(KEYS))
        if not redrawn:
            new = truth + ROUNDING * generator.standard_normal(len(KEYS))
        failed["as good"] += loss("worse.all.psnr", scores_with(new), stored).is_broken
        failed["worse"] += loss("worse.all.psnr", scores_with(new - 0.2), stored).is_broken
    assert failed["as good"] <= (10 if redrawn else 0)
    assert failed["worse"] >= (90 if redrawn else 100)


def test_rounding_gets_the_interval_that_it_makes() -> None:
    generator = np.random.default_rng(3)
    inside = []
    for _ in range(400):
        stored, truth = stored_with(generator)
        rounded = truth + ROUNDING * generator.standard_normal(len(KEYS))
        check = loss("worse.all.psnr", scores_with(rounded), stored)
        error = worse.rounding_error([scores["psnr"] for scores in stored.cells.values()])
        assert check.value is not None
        inside.append(abs(check.value) < 1.96 * error)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.035)


def test_what_is_said() -> None:
    stored, truth = stored_with(np.random.default_rng(4))
    again = scores_with(np.array([stored.cells[key]["psnr"][0] for key in KEYS]))
    assert loss("worse.all.psnr", again, stored).why.startswith("unchanged; detects 0.1")
    small, large = (loss("worse.all.psnr", scores_with(truth - less), stored) for less in (0.05, 0.2))
    assert (small.status, large.status) == ("pass", "fail")
    assert small.why.startswith("changed, -0.0")
    assert " dB: not worse; detects" in small.why
    assert " dB: worse; detects" in large.why
    better = loss("worse.all.psnr", scores_with(truth + 1.0), stored)
    assert better.status == "pass"


def test_a_score_of_which_less_is_better_is_worse_where_it_grows() -> None:
    stored, truth = stored_with(np.random.default_rng(5))
    new = scores_with(truth, ssim=0.8 - 2 * LARGEST_LOSS["ssim"], depth=0.2 + 2 * LARGEST_LOSS["depth_rmse"])
    assert loss("worse.all.ssim", new, stored).is_broken
    assert loss("worse.all.depth_rmse", new, stored).is_broken
    assert loss("worse.all.depth_rmse", scores_with(truth, depth=0.1), stored).status == "pass"


def test_one_method_that_lost_fails_by_its_name_and_in_the_headline() -> None:
    stored, truth = stored_with(np.random.default_rng(6))
    stored = compared(stored)
    lost = truth - np.array([0.5 if "/qnerf/" in key else 0.0 for key in KEYS])
    new = scores_with(lost)
    failed = [method for method in TRAINED_METHODS if loss(f"worse.{method}.psnr", new, stored).is_broken]
    assert failed == ["qnerf"]
    cells = [
        worse.cell_with(
            cell.scene, cell.method, cell.seed, {"psnr": cell.scores["psnr"] - 0.5 * (cell.method == "qnerf")}
        )  # type: ignore[operator]
        for cell in worse.stored_cells(stored)
    ]
    for against in ("nerf", "nerf_matched"):
        gate = BY_NAME[f"worse.headline.qnerf_{against}"]
        check = worse.headline_check(gate, cells, stored)
        assert check.is_broken
        assert check.value == pytest.approx(-0.5, abs=0.05)


@pytest.mark.parametrize("what", ["diverged", "missing", "no score"])
def test_a_cell_without_a_score_is_never_left_out(what: str) -> None:
    stored, truth = stored_with(np.random.default_rng(7))
    scores = scores_with(truth)
    scene, method, seed = KEYS[5].split("/")
    if what == "diverged":
        scores |= worse.scores_of([diverged(scene, method, int(seed))])
    elif what == "missing":
        del scores[KEYS[5]]
    else:
        scores[KEYS[5]]["psnr"] = None
    check = loss("worse.all.psnr", scores, stored)
    assert (check.status, check.value) == ("fail", None)
    assert KEYS[5] in check.why
    other = next(name for name in TRAINED_METHODS if name != method)
    assert loss(f"worse.{other}.psnr", scores, stored).status == "pass"


def test_a_comparer_that_says_something_else_of_the_stored_cells_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    stored = compared(stored_with(np.random.default_rng(8))[0])
    assert worse.other_statistics(stored) == 0
    usual = worse.compare

    def narrow(*given: Any) -> Any:
        rows = usual(*given)
        for row in rows:
            for estimate in (row.on_these_scenes, row.scenes_like_these):
                if estimate and estimate.interval:
                    low, high = estimate.interval
                    force_setattr(estimate, "interval", (low + 0.01 * (high - low), high))
        return rows

    monkeypatch.setattr(worse, "compare", narrow)
    # the lower end of both intervals of both headlines
    assert worse.other_statistics(stored) == 4


def test_limits_are_wider_on_a_class_of_which_nothing_is_stored() -> None:
    stored, _ = stored_with(np.random.default_rng(9))
    low = worse.loss_limit("all", "psnr", stored).low
    wide = worse.loss_limit("all", "psnr", stored, WIDER["worse"]).low
    assert low == -LARGEST_LOSS["psnr"]
    assert wide == 2 * low


def test_nothing_is_trained_that_no_gate_asks_for() -> None:
    assert worse.methods_of(["worse.qnerf.psnr"]) == ("qnerf",)
    assert worse.methods_of(["worse.headline.qnerf_nerf_matched"]) == ("nerf_matched", "qnerf")
    assert worse.methods_of(["worse.headline.statistics"]) == ()
    assert worse.methods_of(["worse.all.ssim"]) == TRAINED_METHODS


def test_draws_differ_in_the_last_bit_alone(ball: Any) -> None:
    from harness.training.lockstep import box_of

    def first_weights(draw: int) -> dict[str, torch.Tensor]:
        make = worse.rounded_otherwise(draw)
        learner = make("nerf", box_of(ball, tiny.CPU), tiny.TRAIN, Budget(1, None), "lego/0", tiny.CPU, True)
        return dict(learner.fields.state_dict())

    usual, other = first_weights(0), first_weights(1)
    assert all(torch.equal(usual[key], again) for key, again in first_weights(0).items())
    weights = [key for key in usual if usual[key].ndim == 2]
    assert all(not torch.equal(usual[key], other[key]) for key in weights)
    assert all(torch.allclose(usual[key], other[key], rtol=2e-7, atol=0.0) for key in weights)


@pytest.mark.parametrize("name", ["avx2", "avx512"])
def test_the_stored_cells_find_two_tenths_of_a_decibel(name: str) -> None:
    """In nine of ten draws of the rounding at least; that rounding of both classes is alike is measured, too."""
    stored = read_references(ROOT / "gates" / "classes", name)
    assert set(stored.cells) == set(KEYS)
    assert all(set(scores) == set(SCORES) for scores in stored.cells.values())
    detects = worse.loss_limit("all", "psnr", stored).detects
    assert detects is not None
    assert detects < 0.2
    assert worse.other_statistics(stored) == 0
