"""Training gates: limits of a small training, and the same training broken on purpose."""

from dataclasses import replace
from pathlib import Path

import pytest

from harness import trainer
from harness.cell_training import GroupSettings
from harness.clipping import Clipping
from harness.gate import training
from harness.gate.catalog import GATE_SEEDS, RENEWAL_SEEDS, TRAINED_METHODS, TRAINED_SCENES, Gate, gates
from harness.gate.limits import Limit, limit_from
from harness.gate.outcome import Outcome, judged
from harness.gate.training import Cells, gate_plan, sample_of, values_of, wanted
from harness.lockstep import train_group
from harness.schedule import Budget
from harness.solo import psnr_on, trained_alone
from scenes.view_set import ViewSet
from tests.harness import tiny
from tests.harness.cells import cell, checkpoint, diverged

PSNR = Gate("training.lego.nerf.psnr", "training", "psnr", "dB", "mean", 2)
FAMILY = len(gates())
BUDGET = Budget(80, None)


def trained(views: ViewSet, seeds: tuple[int, ...]) -> Cells:
    """Cells without what takes time and is not looked at here."""
    found = {}
    for seed in seeds:
        learner = trained_alone("nerf", views, f"lego/{seed}", tiny.TRAIN, BUDGET, tiny.CPU)
        one = cell("lego", "nerf", seed, [checkpoint(80, 1.0, psnr_on(learner, views, views.test, 1024))])
        found["lego", "nerf", seed] = replace(one, pictures=None)
    return found


@pytest.fixture(scope="module")
def small_limit(ball: ViewSet) -> Limit:
    values = [value for value in values_of(PSNR, trained(ball, RENEWAL_SEEDS), RENEWAL_SEEDS) if value is not None]
    assert len(values) == len(RENEWAL_SEEDS)
    return limit_from(PSNR, values, FAMILY)


def outcome(views: ViewSet, limit: Limit) -> Outcome:
    return judged(PSNR, sample_of(PSNR, trained(views, GATE_SEEDS), GATE_SEEDS, Path()), limit, "")


@pytest.mark.thorough
@pytest.mark.slow
def test_an_unchanged_training_passes(ball: ViewSet, small_limit: Limit) -> None:
    assert outcome(ball, small_limit).status == "pass"


@pytest.mark.thorough
@pytest.mark.slow
def test_a_learning_rate_of_a_twentieth_fails(
    ball: ViewSet, small_limit: Limit, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual = trainer.learning_rate
    monkeypatch.setattr(trainer, "learning_rate", lambda *facts: 0.05 * usual(*facts))
    found = outcome(ball, small_limit)
    assert found.status == "fail"
    assert found.excess is not None
    assert found.excess > 0


@pytest.mark.thorough
@pytest.mark.slow
def test_a_gradient_that_is_lost_fails(ball: ViewSet, small_limit: Limit, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Clipping, "scale", lambda self, norm: 0.0)
    assert outcome(ball, small_limit).status == "fail"


def test_a_failure_has_pictures(ball: ViewSet, tmp_path: Path) -> None:
    settings = GroupSettings(("nerf",), tiny.TRAIN, replace(tiny.SCORE, checkpoints=1), Budget(3, None))
    cells = {
        ("lego", "nerf", seed): one
        for seed in GATE_SEEDS
        for one in train_group(ball, "lego", seed, settings, tiny.CPU, tmp_path, {}, lambda share: None)
    }
    found = judged(PSNR, sample_of(PSNR, cells, GATE_SEEDS, tmp_path), Limit(90.0, None), "")
    assert found.status == "fail"
    assert found.pictures is not None
    assert found.pictures.image.shape == found.pictures.reference.shape == (24, 24, 3)
    assert float(found.pictures.difference.max()) > 0.05


@pytest.mark.thorough
@pytest.mark.slow
def test_a_training_that_is_far_better_than_before_fails_too(small_limit: Limit) -> None:
    assert small_limit.high is not None
    better = small_limit.high + 0.5
    cells = {("lego", "nerf", seed): cell("lego", "nerf", seed, [checkpoint(80, 1.0, better)]) for seed in GATE_SEEDS}
    found = judged(PSNR, sample_of(PSNR, without_pictures(cells), GATE_SEEDS, Path()), small_limit, "")
    assert (found.status, found.excess) == ("fail", pytest.approx(0.5))


def without_pictures(cells: Cells) -> Cells:
    return {key: replace(one, pictures=None) for key, one in cells.items()}


@pytest.mark.parametrize("what", ["diverged", "missing", "no score"])
def test_a_cell_without_a_score_is_never_left_out(what: str) -> None:
    cells = {("lego", "nerf", seed): cell("lego", "nerf", seed, [checkpoint(80, 1.0, 25.0)]) for seed in GATE_SEEDS}
    key = ("lego", "nerf", GATE_SEEDS[1])
    if what == "diverged":
        cells[key] = diverged(*key)
    elif what == "missing":
        del cells[key]
    else:
        cells[key] = replace(cells[key], scores={"psnr": None})
    sample = sample_of(PSNR, without_pictures(cells), GATE_SEEDS, Path())
    assert list(sample.values) == [25.0, None]
    found = judged(PSNR, sample, Limit(0.0, 100.0), "")
    assert (found.status, found.figure) == ("fail", None)
    if what != "no score":
        assert found.why


def test_all_scenes_are_a_mean_of_every_one() -> None:
    cells = {
        (scene, "nerf", seed): cell(scene, "nerf", seed, [checkpoint(80, 1.0, 20.0 + number)])
        for number, scene in enumerate(TRAINED_SCENES)
        for seed in GATE_SEEDS
    }
    gate = replace(PSNR, name="training.all.nerf.psnr")
    assert values_of(gate, cells, GATE_SEEDS) == [21.0, 21.0]
    del cells[TRAINED_SCENES[0], "nerf", GATE_SEEDS[0]]
    assert values_of(gate, cells, GATE_SEEDS) == [None, 21.0]


def test_nothing_is_trained_that_no_gate_asks_for() -> None:
    def named(*names: str) -> list[Gate]:
        return [replace(PSNR, name=name) for name in names]

    assert wanted(named("training.lego.qnerf.psnr")) == (("lego",), ("qnerf",))
    assert wanted(named("training.all.nerf.psnr")) == (TRAINED_SCENES, ("nerf",))
    assert wanted(gate for gate in gates() if gate.kind == "training") == (TRAINED_SCENES, TRAINED_METHODS)


def test_gates_and_limits_never_share_a_seed() -> None:
    assert not set(GATE_SEEDS) & set(training.AGAIN_SEEDS)
    assert not set(RENEWAL_SEEDS) & {*GATE_SEEDS, *training.AGAIN_SEEDS}
    assert gate_plan(GATE_SEEDS, TRAINED_SCENES, TRAINED_METHODS).train.precision == "float32"
