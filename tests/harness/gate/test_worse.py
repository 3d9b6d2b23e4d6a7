"""Judgement of short trainings: the checks of new cells, and the methods that are trained."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from msgspec.structs import force_setattr

from harness.gate import early
from harness.gate.gates import (
    DRAWS,
    GATE_SEEDS,
    OTHER_SEEDS,
    SCORES,
    TRAINED_METHODS,
    TRAINED_SCENES,
    gates,
    settings_of,
)
from harness.gate.limits import KindFacts
from harness.gate.quality import short_trainings, worse
from harness.gate.quality.losses import FIGURES, Judge, Scores
from harness.gate.references import References
from harness.plan.schedule import Budget
from harness.records.cells import Comparison
from harness.records.study import Answer, Check
from harness.training.learner import Job
from harness.training.lockstep import box_of
from tests.harness import tiny
from tests.harness.cells import diverged
from tests.harness.gate.gate_runs import context_of
from tests.harness.patching import changed

BY_NAME = {gate.name: gate for gate in gates()}
GROUPS = [f"{scene}/{method}" for scene in TRAINED_SCENES for method in TRAINED_METHODS]
KEYS = [f"{group}/{seed}" for group in GROUPS for seed in GATE_SEEDS]
ROUNDING = 0.03


def stored_with(generator: np.random.Generator) -> tuple[References, np.ndarray]:
    """Return references whose cells scatter by 0.3 dB, and the truth without rounding."""
    truth = 25.0 + 0.3 * generator.standard_normal(len(KEYS))
    others = [f"{group}/{seed}" for group in GROUPS for seed in OTHER_SEEDS]

    def scores(psnr: float, many: int) -> dict[str, list[float]]:
        centre = {"psnr": (psnr, ROUNDING), "ssim": (0.8, 0.001), "depth_rmse": (0.2, 0.005)}
        return {name: (mean + sd * generator.standard_normal(many)).tolist() for name, (mean, sd) in centre.items()}

    cells = {key: scores(value, DRAWS) for key, value in zip(KEYS, truth, strict=True)}
    cells |= {key: scores(25.0 + 0.3 * generator.standard_normal(), 1) for key in others}
    return References({"worse": KindFacts(settings_of("worse"), {}, 1.0)}, cells=cells), truth


def scores_with(psnr: np.ndarray, ssim: float = 0.8, depth: float = 0.2) -> Scores:
    return {key: {"psnr": float(one), "ssim": ssim, "depth_rmse": depth} for key, one in zip(KEYS, psnr, strict=True)}


def loss(name: str, new: Scores, stored: References, has_changed: bool = False) -> Check:
    return Judge.of(stored, new, has_changed).check(BY_NAME[name])


def test_what_is_said() -> None:
    generator = np.random.default_rng(4)
    stored, truth = stored_with(generator)
    for draw in (0, DRAWS - 1):
        again = scores_with(np.array([stored.cells[key]["psnr"][draw] for key in KEYS]))
        assert loss("worse.all.psnr", again, stored).why.startswith("unchanged; detects 0.0"), draw
    small, large = (loss("worse.all.psnr", scores_with(truth - less), stored) for less in (0.005, 0.05))
    assert (small.status, large.status) == ("pass", "fail")
    assert small.why.startswith("changed, -0.0")
    assert " dB: not worse, judged with the scatter of rounding; detects 0.0" in small.why
    assert " dB: worse, judged with the scatter of rounding; detects 0.0" in large.why
    assert loss("worse.all.psnr", scores_with(truth + 1.0), stored).status == "pass"
    redrawn = loss("worse.all.psnr", scores_with(25.0 + 0.3 * generator.standard_normal(len(KEYS))), stored, True)
    assert redrawn.status == "pass"
    assert "judged with the seeds' spread" in redrawn.why
    changed = loss("worse.all.psnr", scores_with(truth - 0.05), stored, True)
    assert changed.status == "fail"
    assert "judged with the scatter of the differences" in changed.why


def test_a_score_of_which_less_is_better_is_worse_where_it_grows() -> None:
    stored, truth = stored_with(np.random.default_rng(5))
    new = scores_with(truth, ssim=0.79, depth=0.21)
    assert loss("worse.all.ssim", new, stored).is_broken
    assert loss("worse.all.depth_rmse", new, stored).is_broken
    assert loss("worse.all.depth_rmse", scores_with(truth, depth=0.1), stored).status == "pass"


def test_one_method_that_lost_fails_by_its_name_its_scene_and_in_the_headline() -> None:
    stored, truth = stored_with(np.random.default_rng(6))
    lost = scores_with(truth - np.array([0.2 if "drums/qnerf/" in key else 0.0 for key in KEYS]))
    failed = [name for name in FIGURES if name.endswith("psnr") and loss(name, lost, stored).is_broken]
    assert "worse.qnerf.drums.psnr" in failed
    assert not any(other in name for name in failed for other in ("nerf_matched", "repaired", "lego", "hotdog"))
    check = loss("worse.headline.qnerf_nerf", lost, stored)
    assert check.is_broken
    assert check.value == pytest.approx(-0.2 / 3, abs=0.03)
    gained = scores_with(truth + np.array([0.2 if "/qnerf/" in key else 0.0 for key in KEYS]))
    assert loss("worse.headline.qnerf_nerf", gained, stored).is_broken, "a headline is held from both sides"


@pytest.mark.parametrize("has_changed", [False, True])
@pytest.mark.parametrize("what", ["diverged", "missing", "no score"])
def test_a_cell_without_a_score_is_never_left_out(what: str, has_changed: bool) -> None:
    stored, truth = stored_with(np.random.default_rng(7))
    scores = scores_with(truth)
    scene, method, seed = KEYS[5].split("/")
    if what == "diverged":
        scores |= worse.scores_of([diverged(scene, method, int(seed))])
    elif what == "missing":
        del scores[KEYS[5]]
    else:
        scores[KEYS[5]]["psnr"] = None
    for name in ("worse.all.psnr", f"worse.{method}.{scene}.psnr"):
        check = loss(name, scores, stored, has_changed)
        assert (check.status, check.value) == ("fail", None)
        assert KEYS[5] in check.why
    other = next(name for name in TRAINED_METHODS if name != method)
    assert loss(f"worse.{other}.psnr", scores, stored, has_changed).status == "pass"


@pytest.mark.parametrize("changed", [[], ["changed.double.nerf"]])
def test_first_steps_decide_how_it_is_judged(changed: list[str], limits: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stored, truth = stored_with(np.random.default_rng(8))
    monkeypatch.setattr(worse, "trained", lambda *given: [])
    monkeypatch.setattr(worse, "scores_of", lambda cells: scores_with(truth))
    monkeypatch.setattr(early, "broken", lambda context: changed)
    context = dataclasses.replace(context_of((BY_NAME["worse.all.psnr"],), limits), references=stored)
    found = list(worse.measure(context))
    answers = [finding.text for finding in found if isinstance(finding, Answer)]
    assert answers[0].startswith("Is it worse? changed, ")
    assert answers[1].startswith("The first steps are others, with" if changed else "The first steps are the stored")


def test_a_comparer_that_says_something_else_of_the_stored_cells_is_seen(
    stored: References, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert worse.other_statistics(stored) == 0

    def narrow(rows: list[Comparison], *_: Any) -> list[Comparison]:
        for row in rows:
            for estimate in (row.on_these_scenes, row.scenes_like_these):
                if estimate and estimate.interval:
                    low, high = estimate.interval
                    force_setattr(estimate, "interval", (low + 0.01 * (high - low), high))
        return rows

    changed(monkeypatch, worse, "compare", narrow)
    # the lower end of both intervals of both headlines
    assert worse.other_statistics(stored) == 4


def test_nothing_is_trained_that_no_gate_asks_for() -> None:
    def methods(*names: str) -> tuple[str, ...]:
        return worse.methods_of(BY_NAME[name] for name in names)

    assert methods("worse.qnerf.psnr") == ("qnerf",)
    assert methods("worse.headline.qnerf_nerf_matched") == ("nerf_matched", "qnerf")
    assert methods("worse.nerf.lego.psnr", "worse.qnerf.ssim") == ("nerf", "qnerf")
    assert methods("worse.all.ssim") == TRAINED_METHODS


def test_draws_differ_in_the_last_bit_alone(ball: Any) -> None:
    def first_weights(draw: int) -> dict[str, torch.Tensor]:
        make = short_trainings.rounded_otherwise(draw)
        learner = make(Job("nerf", box_of(ball, tiny.CPU), tiny.TRAIN, Budget(1, None), "lego/0", tiny.CPU))
        return dict(learner.fields.state_dict())

    usual, other = first_weights(0), first_weights(1)
    assert all(torch.equal(usual[key], again) for key, again in first_weights(0).items())
    weights = [key for key in usual if usual[key].ndim == 2]
    assert all(not torch.equal(usual[key], other[key]) for key in weights)
    assert all(torch.allclose(usual[key], other[key], rtol=2e-7, atol=0.0) for key in weights)


def test_the_stored_cells_are_of_these_gates(stored: References) -> None:
    draws = {f"{group}/{seed}": DRAWS for group in GROUPS for seed in GATE_SEEDS}
    draws |= {f"{group}/{seed}": 1 for group in GROUPS for seed in OTHER_SEEDS}
    assert {key: len(scores["psnr"]) for key, scores in stored.cells.items()} == draws
    assert all(set(scores) == set(SCORES) for scores in stored.cells.values())
