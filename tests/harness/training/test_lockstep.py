"""All methods of a group in turn: the same batches, separate clocks, complete records; one that fails fails alone."""

import math
import re
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
from harness.training.lockstep import needs_view_direction, train_group, trained_alone
from harness.training.make_learner import NotAvailable
from harness.training.scoring import evaluate
from harness.training.scoring.metrics import psnr
from harness.training.trainer import TRACED, Trainer
from scenes.files.errors import InputError
from scenes.view_sets.pixels import over_white
from scenes.view_sets.view_set import ViewSet
from tests.harness.cells import without_time
from tests.harness.patching import changed, preceded
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


@pytest.fixture(scope="module")
def trained(ball: ViewSet, tmp_path_factory: pytest.TempPathFactory) -> Trained:
    out = tmp_path_factory.mktemp("trained")
    shares: list[float] = []
    return out, group(ball, out, progress=shares.append), shares


def test_curves_are_means_over_a_few_views_and_scores_over_all(ball: ViewSet, tmp_path: Path, trained: Trained) -> None:
    """The last point of a curve is of the same views as the others, so that no step comes from other views."""
    cell = group(ball, tmp_path, ("nerf",), score=replace(SCORE, curve_views=2))["nerf"]
    everything = trained[1]["nerf"]
    assert cell.scores["psnr"] == everything.scores["psnr"]
    assert [view.view for view in cell.views] == [view.view for view in everything.views]
    chosen = [view.psnr for view in cell.views if view.view in ("test/r_0", "test/r_1")]
    assert cell.curve[-1].psnr == pytest.approx(sum(map(float, chosen)) / 2)
    assert cell.curve[-1].psnr != everything.curve[-1].psnr
    assert [point.step for point in cell.curve] == [point.step for point in everything.curve]


def test_records_are_complete(trained: Trained) -> None:
    out, cells, shares = trained
    assert shares == sorted(shares), "progress"
    assert (shares[-1], len(shares)) == (1.0, 24)
    assert set(cells) == set(THREE)
    for method, cell in cells.items():
        assert (cell.scene, cell.method, cell.seed, cell.status, cell.reason) == ("ball", method, 0, "done", None)
        assert cell.steps == 24
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


@pytest.mark.parametrize("share", [0.0, 0.8])
def test_methods_take_turns_on_the_batches_that_seed_and_settings_choose(
    ball: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, share: float
) -> None:
    """Scenes are independent draws, as the seed of batches and learners names the scene."""
    seen: list[tuple[Trainer, int, torch.Tensor]] = []

    def note(learner: Trainer, rays: Any, colours: torch.Tensor) -> None:
        seen.append((learner, learner.step, torch.cat([rays.origins, rays.directions, colours], dim=-1)))

    preceded(monkeypatch, Trainer, "train_on", note)
    train, budget = replace(TRAIN, covered_share=share), Budget(6, None)
    cells = group(ball, tmp_path, budget=budget, train=train)
    assert {cell.settings["train"]["covered_share"] for cell in cells.values()} == {share}
    order = [learner.method for learner, *_ in seen]
    rounds = [order[start : start + 3] for start in range(0, 18, 3)]
    assert all(set(one) == set(THREE) for one in rounds)
    assert [one[0] for one in rounds] == [*THREE, *THREE], "who goes first changes"
    trained_alone("nerf", ball, "ball/0", train, budget, CPU)
    assert len(seen) == 4 * 6
    assert {learner.seed for learner, *_ in seen} == {"ball/0"}
    batches = Batches(evaluate.cameras_of(ball, ball.train, CPU), ball.train.rgba, share)
    for _, step, given in seen:
        rays, colours, *_ = batches.batch("ball/0", step, TRAIN.rays)
        assert torch.equal(given, torch.cat([rays.origins, rays.directions, colours], dim=-1))
    assert not torch.equal(seen[0][2], seen[3][2]), "the next step has another batch"


@pytest.mark.parametrize(("limit", "share"), [(1e-12, 1.0), (1e9, 0.0)])
def test_the_record_says_how_many_steps_were_clipped(ball: ViewSet, tmp_path: Path, limit: float, share: float) -> None:
    settings = replace(TRAIN, clip_norm=limit, clip_ratio=1e9)
    cell = group(ball, tmp_path, ("nerf",), train=settings, budget=Budget(3, None))["nerf"]
    assert cell.properties["clipped_share"] == share


def test_only_training_is_on_the_clock(ball: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]

    def clock() -> float:
        now[0] += 0.5  # each reading
        return now[0]

    def wait(*_: Any) -> None:
        now[0] += 1000.0

    for module in ("trainer", "batches"):
        monkeypatch.setattr(f"harness.training.{module}.Stopwatch", lambda device: Stopwatch(device, clock, clock))
    for name in ("render_split", "density_histogram", "train_psnr", "measured_properties"):
        preceded(monkeypatch, evaluate, name, wait)
    preceded(monkeypatch, Trainer, "warm_up", wait)
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


@pytest.mark.slow
def test_methods_learn(ball: ViewSet, tmp_path: Path) -> None:
    train = replace(TRAIN, rays=256, grid=replace(TRAIN.grid, first_step=40, every=10))
    score = replace(SCORE, checkpoints=2, earliest=0.02)
    cells = group(ball, tmp_path, ("nerf", "qnerf_theorem"), train=train, score=score, budget=Budget(150, None))
    for cell in cells.values():
        first, last = cell.curve[0].psnr, cell.curve[-1].psnr
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
        ({"psnr": 15.9, "psnr_train": 22.0}, 0.4, False, ["billboard: training views 22.00 dB, test views 15.90 dB"]),
        ({"psnr": 16.1, "psnr_train": 22.0}, 0.4, False, ["gap: training views 22.00 dB, test views 16.10 dB"]),
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
    warnings = warnings_of(scores, None if opacity is None else (opacity, 0.4), emptied)
    assert len(warnings) == len(said)
    assert all(part in warning for part, warning in zip(said, warnings, strict=True))


@pytest.mark.parametrize(("opacity", "truth", "collapsed"), [
    (0.015, 0.3, True), (0.012, 0.012, False), (0.001, 0.012, True), (0.0, 0.0, False), (0.03, 1.0, False),
])  # fmt: skip
def test_a_picture_as_thin_as_its_scene_is_no_collapse(opacity: float, truth: float, collapsed: bool) -> None:
    assert [warning[:14] for warning in warnings_of({}, (opacity, truth), False)] == ["empty collapse"] * collapsed


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


# a method that fails or diverges before, in or after training: the other is bit-identical

FAULTY = "nerf_matched"
"""The second method, which goes first in every other step."""
Fault = Callable[[pytest.MonkeyPatch], None]


def raises(error: BaseException) -> Callable[[Any], None]:
    def act(learner: Any) -> None:
        raise error

    return act


def poisoned(learner: Trainer) -> None:
    with torch.no_grad():
        learner.coarse.density_head.weight[0, 0] = math.nan


def dazzled(learner: Trainer) -> None:
    with torch.no_grad():
        learner.coarse.colour_net[0].bias[0] = math.inf
        learner.coarse.colour_net[1].weight[:] = 0.0  # 0 × ∞ in the next layer


def before(owner: Any, name: str, act: Callable[[Any], object]) -> Fault:
    """Let a function whose first argument belongs to the faulty method begin with `act`."""
    return lambda patch: preceded(patch, owner, name, lambda one, *_: act(one) if one.method == FAULTY else None)


def in_step_7(act: Callable[[Any], object]) -> Fault:
    return before(Trainer, "train_on", lambda learner: act(learner) if learner.step == 7 else None)


def too_bright(patch: pytest.MonkeyPatch) -> None:
    def change(view: evaluate.View, learner: Trainer, *_: Any) -> evaluate.View:
        return replace(view, colour=view.colour * 30.0) if learner.method == FAULTY else view

    changed(patch, evaluate, "render_view", change)


NO_ROOM = raises(torch.OutOfMemoryError("no room"))
FAULTS: dict[str, tuple[Fault, str, int, str]] = {
    "not available": (
        before(lockstep, "learner_for", raises(NotAvailable("needs a library that is not here"))),
        "not_available", 0, "needs a library that is not here",
    ),
    "when it is made": (
        before(lockstep, "learner_for", NO_ROOM), "error", 0, "OutOfMemoryError before the first step: no room"
    ),
    "in its warm-up": (before(Trainer, "warm_up", NO_ROOM), "error", 0, "OutOfMemoryError before the first step"),
    "diverges in its warm-up": (
        before(Trainer, "warm_up", poisoned), "diverged", 0,
        "not finite at step 0: weight of coarse.density_head.weight",
    ),
    "diverges at a checkpoint": (
        before(evaluate, "render_split", dazzled), "diverged", 6, "not finite at step 6: rendered colour of ray 0"
    ),
    "diverges in a step": (
        in_step_7(poisoned), "diverged", 7, "^not finite at step 7: weight of coarse.density_head.weight$"
    ),
    "no score is defined": (too_bright, "error", 6, "psnr is -.*renders colours from "),
    "a bug": (in_step_7(raises(RuntimeError("a bug"))), "error", 7, "RuntimeError at step 7: a bug"),
    "ends": (in_step_7(raises(SystemExit(0))), "error", 7, "SystemExit at step 7: 0"),
    "dtype": (
        in_step_7(lambda _: torch.set_default_dtype(torch.float64)), "error", 8,
        "torch's default dtype from torch.float32 to torch.float64",
    ),
    "threads": (in_step_7(lambda _: torch.set_num_threads(3)), "error", 8, "torch's number of threads from"),
    "gradients": (in_step_7(lambda _: torch.set_grad_enabled(False)), "error", 7, "does not require grad"),
    "numpy": (in_step_7(lambda _: np.seterr(all="ignore")), "error", 8, "numpy's handling of errors from"),
}  # fmt: skip
"""A fault of a user's method, or of what it does to its process → its cell's status, steps and reason."""


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_a_method_that_fails_costs_its_own_cell_alone(
    fault: str, trained: Trained, ball: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fails, status, steps, reason = FAULTS[fault]
    fails(monkeypatch)
    shares: list[float] = []
    cells = group(ball, tmp_path, ("nerf", FAULTY), progress=shares.append)
    failed = cells[FAULTY]
    assert (failed.status, failed.steps, failed.scores, failed.views) == (status, steps, {}, [])
    assert re.search(reason, failed.reason or "")
    assert (failed.train_seconds == 0.0) == (steps == 0)
    assert [point.step for point in failed.curve] == ([6] if steps > 6 else []), "what was scored before stays"
    if failed.curve:
        kept = read_renders(tmp_path / "records" / str(failed.pictures))
        assert [one.step for one in kept] == [6], "and so do its pictures"
        assert set(failed.properties) == {"flops_per_evaluation", "rays_per_step"}, "known before the first step"
    write_cell(tmp_path, failed)
    assert read_cell(cell_path(tmp_path, "ball", FAULTY, 0)).reason == failed.reason
    assert without_time(cells["nerf"]) == without_time(trained[1]["nerf"])
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_a_mistake_of_the_user_ends_the_group(ball: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lockstep, "learner_for", raises(InputError("--network: too deep")))
    with pytest.raises(InputError, match="too deep"):
        group(ball, tmp_path)
