"""All methods of a group in turn: the same batches, separate clocks, complete records; one that fails fails alone."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from harness.machine.stopwatch import Stopwatch
from harness.plan.group_task import GroupTask
from harness.plan.schedule import Budget
from harness.records.cells import CellRecord, cell_path, read_cell, write_cell
from harness.records.pictures import read_renders
from harness.training import lockstep
from harness.training.batches import Batches
from harness.training.cell_training import warnings_of
from harness.training.learner import Job
from harness.training.lockstep import needs_view_direction, train_group, trained_alone
from harness.training.make_learner import NotAvailable, learner_for
from harness.training.scoring import evaluate
from harness.training.scoring.metrics import psnr
from harness.training.trainer import TRACED, Trainer
from scenes.files.errors import InputError
from scenes.view_sets.pixels import over_white
from scenes.view_sets.view_set import ViewSet
from tests.harness.cells import without_time
from tests.harness.tiny import BUDGET, CPU, SCORE, TRAIN
from tests.replacing import replace

THREE = ("nerf", "nerf_matched", "qnerf")
Trained = tuple[Path, dict[str, CellRecord], list[float]]
"""The output folder, the cells and the progress of a group."""


def group(
    ball: ViewSet, out: Path, methods: tuple[str, ...] = THREE, seed: int = 0, progress: Any = None, **changes: Any
) -> dict[str, CellRecord]:
    task = replace(GroupTask("ball", seed, methods, TRAIN, SCORE, BUDGET, out), **changes)
    cells = train_group(task, ball, {"here": 1}, progress or (lambda share: None))
    return {cell.method: cell for cell in cells}


def watched(monkeypatch: pytest.MonkeyPatch, note: Callable[[Trainer, Any, torch.Tensor], object]) -> None:
    """Let `note` see every step before it is taken."""
    original = Trainer.train_on

    def spy(self: Trainer, rays: Any, colours: torch.Tensor) -> None:
        note(self, rays, colours)
        original(self, rays, colours)

    monkeypatch.setattr(Trainer, "train_on", spy)


@pytest.fixture(scope="module")
def trained(ball: ViewSet, tmp_path_factory: pytest.TempPathFactory) -> Trained:
    out = tmp_path_factory.mktemp("trained")
    shares: list[float] = []
    return out, group(ball, out, progress=shares.append), shares


def test_records_are_complete(trained: Trained) -> None:
    out, cells, shares = trained
    assert shares == sorted(shares), "progress"
    assert (shares[-1], len(shares)) == (1.0, 24)
    assert set(cells) == set(THREE)
    for method, cell in cells.items():
        assert (cell.scene, cell.method, cell.seed, cell.status, cell.reason) == ("ball", method, 0, "done", None)
        assert cell.steps == 24
        assert len(cell.curve) == SCORE.checkpoints
        assert [point.step for point in cell.curve] == [6, 12, 24]
        assert cell.curve[-1].seconds == cell.train_seconds > 0
        assert cell.curve[-1].core_seconds == cell.train_core_seconds > 0
        assert [a.seconds < b.seconds for a, b in zip(cell.curve, cell.curve[1:], strict=False)] == [True, True]
        assert set(cell.trace) > set(TRACED)
        assert {name.partition(".")[0] for name in cell.curve[-1].dead_units or {}} == {"density_net"}
        assert set(cell.costs) == {"view_seconds", "view_core_seconds", "weights_bytes", "memory_bytes"}
        assert [view.view for view in cell.views] == ["test/r_0", "test/r_1", "test/r_2"]
        assert cell.scores["psnr"] == pytest.approx(sum(view.psnr or 0 for view in cell.views) / 3)
        assert cell.scores["psnr"] == pytest.approx(cell.curve[-1].psnr)
        named = {"psnr", "ssim", "flip", "delta_e", "rmse_linear", "opacity_iou", "psnr_train", "psnr_floor"}
        assert {name for name in named if cell.scores[name] is None} == set()
        # a foreign view set carries no geometry and no variance
        assert (cell.scores["depth_rmse"], cell.scores["psnr_ceiling"]) == (None, None)
        assert cell.parameters["total"] == sum(n for name, n in cell.parameters.items() if name != "total")
        assert cell.settings["train"]["rays"] == cell.properties["rays_per_step"] == TRAIN.rays
        flops, weights = cell.properties["flops_per_evaluation"], cell.parameters["total"]
        assert isinstance(flops, int)
        assert 1.5 * weights < flops < 2 * weights, "two operations a weight, none for a bias"
        assert cell.provenance == {"here": 1, "in_lockstep": list(THREE)}
        write_cell(out, cell)
        assert read_cell(cell_path(out, "ball", method, 0)).scores == cell.scores


def test_pictures_and_weights_are_kept(trained: Trained, ball: ViewSet) -> None:
    out, cells, _ = trained
    for method, cell in cells.items():
        assert cell.pictures == f"pictures/ball.{method}.0.safetensors"
        renders = read_renders(out / "records" / cell.pictures)
        assert [(one.view, one.step) for one in renders] == [("test/r_1", point.step) for point in cell.curve]
        assert all(one.colour.shape == (24, 24, 3) for one in renders)
        scored = next(row.psnr for row in cell.views if row.view == "test/r_1")
        truth = over_white(ball.test.rgba[1])
        assert psnr(renders[-1].colour.astype(np.float64), truth) == pytest.approx(scored, abs=0.01)
        tensors = load_file(out / "checkpoints" / f"ball.{method}.0.safetensors")
        assert tensors["occupied"].shape == (8**3,)
        learnt = [value for name, value in tensors.items() if name != "occupied" and "amplifier.mean" not in name]
        counted = sum(value.numel() for value in learnt)
        assert counted == cell.parameters["total"]


def test_alone_or_in_lockstep_a_method_gets_the_same_bits(trained: Trained, ball: ViewSet, tmp_path: Path) -> None:
    alone = group(ball, tmp_path, ("qnerf",))["qnerf"]
    assert without_time(alone) == without_time(trained[1]["qnerf"])


def test_methods_share_batches_and_take_turns(ball: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: dict[str, list[torch.Tensor]] = {method: [] for method in THREE}
    order: list[str] = []

    def note(learner: Trainer, rays: Any, colours: torch.Tensor) -> None:
        seen[learner.method].append(torch.cat([rays.origins, rays.directions, colours], dim=-1))
        order.append(learner.method)

    watched(monkeypatch, note)
    group(ball, tmp_path, budget=Budget(6, None))
    assert len(seen["nerf"]) == 6
    for method in THREE[1:]:
        assert all(torch.equal(a, b) for a, b in zip(seen["nerf"], seen[method], strict=True))
    for a, b in zip(seen["nerf"], seen["nerf"][1:], strict=False):
        assert not torch.equal(a, b)
    rounds = [order[start : start + 3] for start in range(0, 18, 3)]
    assert all(set(one) == set(THREE) for one in rounds)
    assert [one[0] for one in rounds] == [*THREE, *THREE], "who goes first changes"


@pytest.mark.parametrize("share", [0.0, 0.8])
def test_all_methods_get_the_rays_that_the_settings_choose(
    ball: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, share: float
) -> None:
    cameras = evaluate.cameras_of(ball, ball.train, CPU)
    expected = Batches(cameras, ball.train.rgba, share).batch("ball/0", 1, TRAIN.rays)
    seen: list[tuple[int, torch.Tensor, torch.Tensor]] = []
    watched(monkeypatch, lambda learner, rays, colours: seen.append((learner.step, rays.directions, colours)))
    train = replace(TRAIN, covered_share=share)
    cells = group(ball, tmp_path, ("nerf", "qnerf"), budget=Budget(3, None), train=train)
    assert {cell.settings["train"]["covered_share"] for cell in cells.values()} == {share}
    trained_alone("nerf", ball, "ball/0", train, Budget(3, None), CPU)
    second = [(directions, colours) for step, directions, colours in seen if step == 1]
    assert len(second) == 3
    for directions, colours in second:
        assert torch.equal(directions, expected[0].directions)
        assert torch.equal(colours, expected[1])


@pytest.mark.parametrize(("limit", "share"), [(1e-12, 1.0), (1e9, 0.0)])
def test_the_record_says_how_many_steps_were_clipped(ball: ViewSet, tmp_path: Path, limit: float, share: float) -> None:
    settings = replace(TRAIN, clip_norm=limit, clip_ratio=1e9)
    cell = group(ball, tmp_path, ("nerf",), train=settings, budget=Budget(3, None))["nerf"]
    assert cell.properties["clipped_share"] == share


def test_scenes_are_independent_draws(ball: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[torch.Tensor, torch.Tensor]] = []
    watched(
        monkeypatch,
        lambda learner, _, colours: seen.append((colours, learner.coarse.density_net[0].weight.detach().clone())),
    )
    score = replace(SCORE, checkpoints=1)
    for scene in ("lego", "mic"):
        task = GroupTask(scene, 0, ("nerf",), TRAIN, score, Budget(1, None), tmp_path)
        list(train_group(task, ball, {}, lambda share: None))
    (first_colours, first_weights), (second_colours, second_weights) = seen
    assert not torch.equal(first_colours, second_colours)
    assert not torch.equal(first_weights, second_weights)


def test_only_training_is_on_the_clock(ball: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]

    def clock() -> float:
        now[0] += 0.5  # each reading
        return now[0]

    def slowed(name: str) -> None:
        original = getattr(evaluate, name)

        def slow(*arguments: Any) -> Any:
            now[0] += 1000.0
            return original(*arguments)

        monkeypatch.setattr(evaluate, name, slow)

    for module in ("trainer", "batches"):
        monkeypatch.setattr(f"harness.training.{module}.Stopwatch", lambda device: Stopwatch(device, clock, clock))
    for name in ("render_split", "quick_scores", "density_histogram", "train_psnr", "measured_properties"):
        slowed(name)
    original = Trainer.warm_up

    def warm_up(self: Trainer, *batch: Any) -> None:
        now[0] += 1000.0
        original(self, *batch)

    monkeypatch.setattr(Trainer, "warm_up", warm_up)
    together = group(ball, tmp_path / "together", ("nerf", "qnerf"))
    for cell in (*together.values(), *group(ball, tmp_path / "alone", ("qnerf",)).values()):
        # a step and its batch, whoever it was made for; between two readings of one clock the other is read once
        assert cell.train_seconds == cell.train_core_seconds == 24 * 2 * 1.0
        assert [point.seconds for point in cell.curve] == [12.0, 24.0, 48.0]


def test_a_budget_of_seconds_ends_each_method_by_its_own_clock(
    ball: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spent: dict[int, float] = {}

    def stopwatch(device: torch.device) -> Stopwatch:
        number = len(spent)
        spent[number] = 0.0

        def clock() -> float:
            spent[number] += 1.0 + number  # the second method is half as fast
            return spent[number]

        return Stopwatch(device, clock)

    monkeypatch.setattr("harness.training.trainer.Stopwatch", stopwatch)
    monkeypatch.setattr("harness.training.batches.Stopwatch", lambda device: Stopwatch(device, float, float))
    cells = group(ball, tmp_path, ("nerf", "qnerf"), budget=Budget(None, 20.0))
    assert {method: (cell.steps, cell.train_seconds) for method, cell in cells.items()} == {
        "nerf": (20, 20.0), "qnerf": (10, 20.0),
    }  # fmt: skip


def test_methods_learn(ball: ViewSet, tmp_path: Path) -> None:
    train = replace(TRAIN, rays=256, grid=replace(TRAIN.grid, first_step=40, every=10))
    score = replace(SCORE, checkpoints=2, earliest=0.02)
    cells = group(ball, tmp_path, ("nerf", "qnerf_theorem"), train=train, score=score, budget=Budget(150, None))
    for cell in cells.values():
        first, last = cell.curve[0].psnr, cell.curve[-1].psnr
        assert first is not None
        assert last is not None
        assert last > first + 4.0
        assert last > 17.0
        assert (cell.scores["opacity_iou"] or 0) > 0.6
        assert not any("collapse" in warning or "grid" in warning for warning in cell.warnings)


@pytest.mark.parametrize(
    ("scores", "opacity", "emptied", "said"),
    [
        ({"psnr": 22.0, "psnr_floor": 15.0, "psnr_train": 24.0}, 0.4, False, []),
        ({"psnr": 22.0}, 0.01, False, ["empty collapse"]),
        ({"psnr": 22.0}, 0.4, True, ["occupancy grid"]),
        ({"psnr": 14.0, "psnr_floor": 15.0}, 0.4, False, ["below the floor"]),
        ({"psnr": 20.0, "psnr_train": 27.0}, 0.4, False, ["billboard"]),
        ({"psnr": 8.0, "psnr_train": 22.0}, 0.4, False, ["billboard: training views 22.00 dB, test views 8.00 dB"]),
        ({"psnr": 18.0, "psnr_train": 22.0}, 0.4, False, ["gap: training views 22.00 dB, test views 18.00 dB"]),
        ({"psnr": 22.0, "psnr_train": 18.0}, 0.4, False, []),
        ({"psnr": 14.0, "psnr_floor": 13.0, "psnr_train": 21.0}, 0.4, False, ["gap"]),
        ({"psnr": 12.0, "psnr_floor": 13.0, "psnr_train": 21.0}, 0.4, False, ["below the floor", "billboard"]),
        ({"psnr": 10.0, "psnr_floor": 15.0, "psnr_train": 30.0}, 0.0, True,
         ["empty collapse", "occupancy grid", "below the floor", "billboard"]),
        ({"psnr": 29.01, "psnr_ceiling": 30.0}, 0.4, False,
         ["reference-limited: 29.01 dB, an image without noise would have 30.00 dB"]),
        ({"psnr": 30.2, "psnr_ceiling": 30.0}, 0.4, False, ["reference-limited"]),
        ({"psnr": 28.99, "psnr_ceiling": 30.0}, 0.4, False, []),
        ({"psnr": 29.9, "psnr_ceiling": None}, 0.4, False, []),
        ({}, None, False, []),
        ({"psnr": None, "psnr_floor": None, "psnr_train": None}, 0.4, False, []),
    ],
)  # fmt: skip
def test_states_that_a_reader_must_know(
    scores: dict[str, float | None], opacity: float | None, emptied: bool, said: list[str]
) -> None:
    warnings = warnings_of(scores, opacity, emptied)
    assert len(warnings) == len(said)
    assert all(part in warning for part, warning in zip(said, warnings, strict=True))


def test_the_direction_is_left_out_where_the_scene_says_so(ball: ViewSet, tmp_path: Path) -> None:
    assert needs_view_direction(ball)
    named = {"name": "view_direction", "what": "in other words"}
    assert not needs_view_direction(replace(ball, rendered={"left_out": [named]}))
    # older manifests have no names
    same_from_all_sides = replace(ball, rendered={"left_out": [{"what": "view-direction branch"}]})
    assert not needs_view_direction(same_from_all_sides)
    score = replace(SCORE, checkpoints=1)
    with_direction = group(ball, tmp_path / "a", ("nerf",), budget=Budget(2, None), score=score)["nerf"]
    without = group(same_from_all_sides, tmp_path / "b", ("nerf",), budget=Budget(2, None), score=score)["nerf"]
    # 3 coordinates and 2 bands of sine and cosine, into 16 units
    assert with_direction.parameters["colour_net"] - without.parameters["colour_net"] == 15 * 16


# a method that fails or diverges before, in or after training: the others are bit-identical


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


def poisoned(learner: Trainer) -> None:
    with torch.no_grad():
        learner.coarse.density_head.weight[0, 0] = math.nan


def others_are_the_same(cells: dict[str, CellRecord], trained: Trained, failed: str) -> bool:
    return all(without_time(cells[one]) == without_time(trained[1][one]) for one in THREE if one != failed)


def test_a_method_that_diverges_does_not_stop_or_change_the_others(
    trained: Trained, ball: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
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
    trained: Trained, ball: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, misdeed: str
) -> None:
    act, said = MISDEEDS[misdeed]
    watched(monkeypatch, lambda one, *_: act(one) if (one.method, one.step) == ("nerf", 7) else None)
    cells = group(ball, tmp_path)
    assert cells["nerf"].status == "error"
    assert said in (cells["nerf"].reason or "")
    assert others_are_the_same(cells, trained, "nerf")


@pytest.mark.parametrize("where", ["not available", "__init__", "warm_up"])
def test_what_fails_before_the_first_step_costs_its_own_cell_alone(
    where: str, trained: Trained, ball: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
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
    trained: Trained, ball: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
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
