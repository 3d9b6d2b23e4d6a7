"""Turns take the steps that a trainer takes one by one: replayed, they give the same bits as the same steps unrecorded.

A stand-in records and replays (`tests.harness.training.recorded`); a GPU is tried by test_gpu.py.
"""

import math
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
import torch

from baselines.contract import NO_ACCELERATION
from harness.plan.group_task import GroupTask
from harness.plan.schedule import Budget
from harness.plan.settings import TrainSettings
from harness.training.batches import Batch
from harness.training.checkpoints import restore_training, training_state
from harness.training.learner import take_turn
from harness.training.lockstep import train_group
from harness.training.make_learner import learner_for
from harness.training.trainer import Diverged, Trainer
from harness.training.turns import Capture, Turns, in_turns
from scenes.view_sets.view_set import ViewSet
from tests.harness.patching import changed
from tests.harness.tiny import BUDGET, SCORE, TRAIN, rays_and_colours, same, train, trainer, weights
from tests.harness.training.recorded import CannotBeCaptured, recorded

ROOT = Path(__file__).parents[3]
METHODS = ("nerf", "qnerf", "qnerf_repaired")
"""Without an amplifier, with a mean over the chunk, and with a mean that it holds."""
DENSE = replace(TRAIN, grid=replace(TRAIN.grid, cells=0))
TWO_PASSES = replace(DENSE, fine_bins=8)
SETTINGS = {"all points": DENSE, "two passes": TWO_PASSES, "with a grid": TRAIN}


def as_it_is(run: Callable[[], object]) -> Callable[[], object]:
    return run


def batch_at(step: int) -> Batch:
    return Batch(*rays_and_colours(seed=step))


def turning(
    method: str, settings: TrainSettings, capture: Capture = recorded, compiler: str | None = None, steps: int = 24
) -> Trainer:
    learner = in_turns(trainer(method, settings, Budget(steps, None)), capture, compiler)
    assert isinstance(learner, Trainer)
    return learner


def turns_of(learner: Trainer) -> Turns:
    assert isinstance(learner.turns, Turns)
    return learner.turns


def ended(learner: Trainer, batches: Callable[[int], Batch] = batch_at) -> Trainer:
    while learner.progress < 1.0:
        take_turn(learner, batches)
    return learner


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)
def test_a_replay_has_the_bits_of_the_steps_and_nearly_those_of_single_ones(
    method: str, settings: TrainSettings
) -> None:
    """Rate, step, batch, draws, means and clipping change from step to step: none may stay as it was recorded."""
    settings = replace(settings, clip_ratio=0.8)
    replayed, unrecorded = (ended(turning(method, settings, capture)) for capture in (recorded, as_it_is))
    assert same(weights(replayed), weights(unrecorded))
    assert replayed.trace == unrecorded.trace
    assert turns_of(replayed).properties()["step_form"] == "captured"
    assert turns_of(replayed).captured == (2 if replayed.grid else 1), "not again at each refresh of the grid"
    single = train(trainer(method, settings, Budget(24, None)), 24)
    assert replayed.network_evaluations == pytest.approx(single.network_evaluations, rel=0.05)
    assert replayed.clipping.clipped_steps == single.clipping.clipped_steps > 0
    assert set(replayed.trace) == set(single.trace)
    for name in ("loss", "gradient_norm", "alpha", "learning_rate"):
        for ours, theirs in zip(replayed.trace[name], single.trace[name], strict=True):
            assert ours == (None if theirs is None else pytest.approx(theirs, rel=2e-3))


@pytest.mark.slow
def test_the_compiler_takes_the_complete_loss_and_changes_nothing() -> None:
    """`aot_eager` traces as the compiler of a GPU does, without a break, and runs what was traced. In another process:
    here all functions check the shapes of their arguments, which no compiler can trace.
    """
    in_another_process("from tests.harness.training import test_turns as t; t.compiled_steps_are_the_same()")


@pytest.mark.slow
def test_on_a_gpu_of_tensors_without_values_a_step_reads_nothing_and_nothing_crosses() -> None:
    in_another_process("from tests.harness.training import fake_gpu; fake_gpu.nothing_crosses()")


def in_another_process(code: str) -> None:
    ended = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr[-2000:]


def compiled_steps_are_the_same() -> None:
    """The compiler takes one function a few times, here once, then gives up for good; each cell has a new one."""
    torch._dynamo.config.recompile_limit = 1
    small = replace(DENSE, network=replace(DENSE.network, depth=2))
    for method in METHODS:
        plain, compiled = (ended(turning(method, small, *more, steps=2)) for more in ((), (as_it_is, "aot_eager")))
        assert turns_of(compiled).form == "compiled, captured", turns_of(compiled).form
        for name, value in weights(compiled).items():
            torch.testing.assert_close(value, weights(plain)[name], atol=1e-6, rtol=1e-5)
    two_passes = ended(turning("qnerf", replace(small, fine_bins=8), as_it_is, "aot_eager", steps=2))
    assert turns_of(two_passes).form == "compiled, captured"


def test_without_compiler_or_graph_the_steps_are_the_same() -> None:
    def refuses(run: Callable[[], object]) -> Callable[[], object]:
        raise RuntimeError("this device has no graphs")

    learner = ended(turning("qnerf", DENSE, refuses, compiler="none such"))
    assert turns_of(learner).form == "not compiled (InvalidBackend), not captured (RuntimeError)"
    assert same(weights(learner), weights(ended(turning("qnerf", DENSE))))


@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)
def test_a_step_that_waits_for_the_device_cannot_be_recorded(settings: TrainSettings) -> None:
    """The stand-in sees what a graph would refuse: the steps that are taken one by one read numbers."""
    with pytest.raises(CannotBeCaptured):
        recorded(lambda: train(trainer("nerf", settings), 1))


# what is not finite


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("step", [0, 7, 9])
def test_a_value_that_is_not_finite_is_found_late_and_named_as_if_at_once(method: str, step: int) -> None:
    """In the middle of a turn: the step and the tensor are named, and the weights are those before this step."""

    def spoilt(at: int) -> Batch:
        batch = batch_at(at)
        return batch if at != step else batch._replace(colours=batch.colours / 0.0)

    learner = turning(method, TWO_PASSES)
    with pytest.raises(Diverged, match=f"not finite at step {step}: loss"):
        ended(learner, spoilt)
    assert learner.step == step
    assert all(bool(torch.isfinite(weight).all()) for weight in learner.fields.parameters())


def test_a_weight_is_named() -> None:
    learner = turning("nerf", DENSE)
    take_turn(learner, batch_at, 0.25)
    with torch.no_grad():
        learner.coarse.density_net[1].weight[0, 0] = math.nan
    with pytest.raises(Diverged, match=r"step 6: weight of coarse.density_net.1.weight"):
        take_turn(learner, batch_at)


@pytest.mark.parametrize("value", [math.nan, -1.0])
def test_an_invalid_density_is_named_with_its_ray(value: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """A negative one leaves all numbers finite: only its count tells."""
    learner = turning("nerf", DENSE)
    rays = torch.arange(64).unsqueeze(1) == 21
    samples = torch.arange(16) == 3

    def spoil(whole: tuple[torch.Tensor, torch.Tensor], *given: object) -> tuple[torch.Tensor, torch.Tensor]:
        return torch.where(rays & samples, value, whole[0]), whole[1]

    changed(monkeypatch, learner.coarse, "density_and_colour_of_rays", spoil)
    with pytest.raises(Diverged, match="step 0: density of sample 3 of ray 21"):
        take_turn(learner, batch_at)


@pytest.mark.slow
def test_a_failure_of_the_replay_alone_costs_time_and_no_result() -> None:
    """The turn is taken again step by step, and the next one is replayed."""
    fails = iter([True])

    def flawed(run: Callable[[], object]) -> Callable[[], object]:
        replay = recorded(run)

        def replay_or_spoil() -> None:
            replay()
            if next(fails, False):
                turns_of(learner)._memory.rows.fill_(math.nan)  # type: ignore[union-attr]

        return replay_or_spoil

    learner = turning("nerf", DENSE, flawed, steps=120)
    ended(learner)
    assert turns_of(learner).redone == 1
    assert same(weights(learner), weights(ended(turning("nerf", DENSE, steps=120))))


# a capacity


def emptied(learner: Trainer, share: float) -> Trainer:
    """Empty a share of the cells for good, as the silhouettes of a scene do."""
    assert learner.grid is not None
    learner.grid.within.copy_(torch.rand(512, generator=torch.Generator().manual_seed(2)) > share)
    learner.grid.occupied.copy_(learner.grid.within)
    learner.grid.density.copy_(torch.where(learner.grid.within, math.inf, 0.0))
    return learner


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_skipped_space_is_packed_and_changes_no_picture(method: str) -> None:
    learner, single = (
        emptied(made, 0.7) for made in (turning(method, TRAIN), trainer(method, TRAIN, Budget(24, None)))
    )
    ended(learner)
    train(single, 24)
    assert turns_of(learner).capacity < 0.6
    assert learner.trace["loss"] == pytest.approx(single.trace["loss"], rel=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("step", [0, 15])
def test_points_that_do_not_fit_are_counted_and_the_turn_is_taken_again(step: int) -> None:
    """With ten times too little room the result is that of a run that had enough; also at a refresh of the grid, which
    is not made again.
    """
    enough, learner = (emptied(turning("qnerf", TRAIN), 0.7) for _ in range(2))
    turns = turns_of(learner)
    turns._prepare(batch_at(0))
    while learner.progress < 1.0:
        if learner.step == step:
            turns._resize(0.04)
        take_turn(learner, batch_at)
    ended(enough)
    assert turns.redone > turns_of(enough).redone == 0
    assert turns.properties()["turns_redone"] == turns.redone
    assert learner.grid is not None
    assert enough.grid is not None
    torch.testing.assert_close(learner.grid.density, enough.grid.density, atol=1e-4, rtol=1e-3)
    for name, value in weights(learner).items():
        torch.testing.assert_close(value, weights(enough)[name], atol=1e-5, rtol=1e-4)


# turns end where something must be read


@pytest.mark.slow
def test_turns_end_at_the_share_at_refreshes_and_after_a_hundred_steps() -> None:
    def lengths(settings: TrainSettings, steps: int, share: float = 1.0) -> list[int]:
        learner, taken = turning("nerf", settings, as_it_is, steps=steps), [0]
        while learner.progress < share:
            take_turn(learner, batch_at, share)
            taken.append(learner.step)
        return [after - before for before, after in pairwise(taken)]

    assert lengths(DENSE, 230) == [100, 100, 30]
    assert lengths(DENSE, 24, 0.3) == [8]
    without = replace(TRAIN, accelerations=NO_ACCELERATION)  # the bins change at the same step, without a refresh
    assert lengths(without, 24) == [10, 1, 13]
    # the first refresh is at step 10, the bins change behind it, and the next refresh is at step 15
    assert lengths(TRAIN, 24) == [10, 1, 4, 5, 4]


def test_a_clock_ends_training_after_a_short_turn() -> None:
    learner = in_turns(trainer("nerf", DENSE, Budget(None, 1e-3)), as_it_is, None)
    take_turn(learner, batch_at)
    assert (learner.step, learner.progress >= 1.0) == (10, True)


@pytest.mark.slow
@pytest.mark.parametrize("settings", [DENSE, TRAIN], ids=["all points", "with a grid"])
def test_a_resumed_cell_has_the_bits_of_one_that_was_not_stopped(settings: TrainSettings) -> None:
    whole, half, resumed = (turning("qnerf_repaired", settings) for _ in range(3))
    ended(whole)
    while half.step < 12:
        take_turn(half, batch_at, 0.5)
    restore_training(resumed, training_state(half))
    assert resumed.step == half.step == 12
    ended(resumed)
    apart = turning("qnerf_repaired", settings)
    while apart.progress < 1.0:
        take_turn(apart, batch_at, 0.5 if apart.step < 12 else 1.0)
    assert same(weights(resumed), weights(apart))
    assert same(weights(apart), weights(whole))


def test_only_networks_that_adam_trains_take_turns() -> None:
    from harness.plan.profiles import TUNED

    soap = trainer("nerf", replace(TRAIN, **TUNED["soap"]))
    assert in_turns(soap, recorded, None) is soap
    assert soap.turns is None
    assert in_turns(trainer("hash_grid", replace(TRAIN, own={})), recorded, None).turns is None  # type: ignore[attr-defined]


@pytest.mark.slow
def test_a_group_in_turns_leaves_complete_records(ball: ViewSet, tmp_path: Path) -> None:
    settings = replace(TRAIN, accelerations=NO_ACCELERATION, fine_bins=8)
    task = GroupTask("ball", 0, ("nerf", "qnerf"), settings, SCORE, BUDGET, tmp_path)
    cells = list(
        train_group(task, ball, {}, lambda share: None, lambda job: in_turns(learner_for(job), recorded, None))
    )
    for cell in cells:
        assert (cell.status, cell.steps, cell.reason) == ("done", 24, None)
        assert [point.step for point in cell.curve] == [6, 12, 24]
        assert cell.properties["step_form"] == "captured"
        assert cell.curve[-1].core_seconds == cell.train_core_seconds > 0
    one_by_one = train_group(replace(task, out=tmp_path / "singly"), ball, {}, lambda share: None)
    singly = {cell.method: cell for cell in one_by_one}
    for cell in cells:
        assert cell.scores["psnr"] == pytest.approx(singly[cell.method].scores["psnr"], abs=0.05)
