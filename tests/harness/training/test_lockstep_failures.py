"""A method that fails or diverges before, in or after training: the other methods of its group are bit-identical."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from harness.records.cells import CellRecord, cell_path, read_cell, write_cell
from harness.records.pictures import read_renders
from harness.training import lockstep
from harness.training.learner import Job
from harness.training.make_learner import NotAvailable, learner_for
from harness.training.scoring import evaluate
from harness.training.trainer import Trainer
from scenes.files.errors import InputError
from scenes.view_sets.view_set import ViewSet
from tests.harness.training.test_lockstep import THREE, group, watched, without_time


def raises(error: BaseException) -> Callable[[Trainer], None]:
    def act(learner: Trainer) -> None:
        raise error

    return act


MISDEEDS: dict[str, tuple[Callable[[Trainer], object], str]] = {
    "a bug": (raises(RuntimeError("a bug")), "RuntimeError at step 7: a bug"),
    "ends": (raises(SystemExit(0)), "SystemExit at step 7: 0"),
    "dtype": (
        lambda _: torch.set_default_dtype(torch.float64),
        "torch's default dtype from torch.float32 to torch.float64",
    ),
    "threads": (lambda _: torch.set_num_threads(3), "torch's number of threads from"),
    "gradients": (lambda _: torch.set_grad_enabled(False), "does not require grad"),
    "numpy": (lambda _: np.seterr(all="ignore"), "numpy's handling of errors from"),
}
"""A fault of a user's method in a step → its action, and the reason in its record."""


@pytest.fixture(scope="module")
def trained(ball: ViewSet, tmp_path_factory: pytest.TempPathFactory) -> dict[str, CellRecord]:
    return group(ball, tmp_path_factory.mktemp("trained"))


def poisoned(learner: Trainer) -> None:
    with torch.no_grad():
        learner.coarse.density_head.weight[0, 0] = math.nan


def others_are_the_same(cells: dict[str, CellRecord], trained: dict[str, CellRecord], failed: str) -> bool:
    return all(without_time(cells[one]) == without_time(trained[one]) for one in THREE if one != failed)


def test_a_method_that_diverges_does_not_stop_or_change_the_others(
    trained: dict[str, CellRecord], ball: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    watched(monkeypatch, lambda one, *_: poisoned(one) if (one.method, one.step) == ("qnerf", 9) else None)
    shares: list[float] = []
    cells = group(ball, tmp_path, progress=shares.append)
    broken = cells["qnerf"]
    assert (broken.status, broken.steps, broken.scores, broken.views) == ("diverged", 9, {}, [])
    assert broken.reason == "not finite at step 9: weight of coarse.density_head.weight"
    assert [point.step for point in broken.curve] == [6], "what was scored before stays"
    kept = read_renders(tmp_path / "records" / str(broken.pictures))
    assert [one.step for one in kept] == [6], "and so do its pictures"
    assert set(broken.properties) == {"flops_per_evaluation", "rays_per_step"}, "known before the first step"
    write_cell(tmp_path, broken)
    assert others_are_the_same(cells, trained, "qnerf")
    assert shares[-1] == 1.0


@pytest.mark.parametrize("misdeed", MISDEEDS)
def test_what_a_method_does_to_its_process_costs_its_own_cell_alone(
    trained: dict[str, CellRecord], ball: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, misdeed: str
) -> None:
    act, said = MISDEEDS[misdeed]
    watched(monkeypatch, lambda one, *_: act(one) if (one.method, one.step) == ("nerf", 7) else None)
    cells = group(ball, tmp_path)
    assert cells["nerf"].status == "error"
    assert said in (cells["nerf"].reason or "")
    assert others_are_the_same(cells, trained, "nerf")


@pytest.mark.parametrize("where", ["not available", "__init__", "warm_up"])
def test_what_fails_before_the_first_step_costs_its_own_cell_alone(
    where: str, trained: dict[str, CellRecord], ball: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(job: Job) -> Any:
        if job.method == "nerf_matched":
            raise NotAvailable("needs a library that is not here")
        return learner_for(job)

    def broken(self: Trainer, *arguments: Any) -> None:
        original(self, *arguments)
        if self.method == "nerf_matched":
            raise torch.OutOfMemoryError("no room")

    if where == "not available":
        expected = ("not_available", "needs a library that is not here")
        monkeypatch.setattr(lockstep, "learner_for", missing)
    else:
        expected = ("error", "OutOfMemoryError before the first step: no room")
        original = getattr(Trainer, where)
        monkeypatch.setattr(Trainer, where, broken)
    shares: list[float] = []
    cells = group(ball, tmp_path, progress=shares.append)
    failed = cells["nerf_matched"]
    assert (failed.status, failed.reason) == expected
    assert (failed.steps, failed.train_seconds, failed.scores, failed.curve) == (0, 0.0, {}, [])
    write_cell(tmp_path, failed)
    assert read_cell(cell_path(tmp_path, "ball", "nerf_matched", 0)).reason == failed.reason
    assert others_are_the_same(cells, trained, "nerf_matched")
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


@pytest.mark.parametrize(
    ("part", "said"),
    [("warm_up", "0: weight of coarse.density_head.weight"), ("render_split", "6: rendered colour of ray 0")],
)
def test_what_is_not_finite_in_the_warm_up_or_at_a_checkpoint_is_a_divergence(
    part: str, said: str, ball: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    owner: Any = Trainer if part == "warm_up" else evaluate
    original = getattr(owner, part)

    def spoilt(trainer: Trainer, *others: Any) -> Any:
        if trainer.method == "nerf" and part == "warm_up":
            poisoned(trainer)
        elif trainer.method == "nerf":
            with torch.no_grad():
                trainer.coarse.colour_net[0].bias[0] = math.inf
                trainer.coarse.colour_net[1].weight[:] = 0.0  # 0 × ∞ in the next layer
        return original(trainer, *others)

    monkeypatch.setattr(owner, part, spoilt)
    cells = group(ball, tmp_path, ("nerf", "qnerf"))
    assert (cells["nerf"].status, cells["qnerf"].status) == ("diverged", "done")
    assert cells["nerf"].reason == f"not finite at step {said}"


def test_colours_that_no_score_is_defined_for_cost_their_own_cell_alone(
    trained: dict[str, CellRecord], ball: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    original = evaluate.render_view

    def beyond(trainer: Trainer, *others: Any) -> evaluate.View:
        view = original(trainer, *others)
        return replace(view, colour=view.colour * 30.0) if trainer.method == "nerf" else view

    monkeypatch.setattr(evaluate, "render_view", beyond)
    cells = group(ball, tmp_path)
    assert cells["nerf"].status == "error"
    assert "psnr is -" in (cells["nerf"].reason or "")
    assert "renders colours from " in (cells["nerf"].reason or "")
    for cell in cells.values():
        write_cell(tmp_path, cell)
        assert read_cell(cell_path(tmp_path, "ball", cell.method, 0)).status == cell.status
    assert others_are_the_same(cells, trained, "nerf")


def test_a_mistake_of_the_user_ends_the_group(ball: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lockstep, "learner_for", raises(InputError("--network: too deep")))
    with pytest.raises(InputError, match="too deep"):
        group(ball, tmp_path)
