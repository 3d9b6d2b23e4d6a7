"""`voxels_drjit` in training: it grows by its budget, stops at a NaN, and writes the same records as other methods."""

import json
import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file

from harness.plan.group_task import GroupTask
from harness.plan.schedule import Budget
from harness.records.cells import read_cells
from harness.training import make_learner
from harness.training.learner import Learner
from harness.training.lockstep import train_group
from harness.training.make_learner import NotAvailable, drjit_backend
from harness.training.scoring.evaluate import density_histogram
from harness.training.trainer import TRACED, Diverged
from scenes.view_sets.view_set import ViewSet
from tests.harness.ball import write_ball
from tests.harness.shell import ROOT
from tests.harness.tiny import CPU, SCORE, rays_and_colours, train
from tests.harness.voxels import SETTINGS, drjit_or_skip, voxels


def test_it_is_a_learner_and_grows_by_its_budget() -> None:
    learner = voxels()
    assert isinstance(learner, Learner)
    shapes = []
    for step in range(24):
        learner.train_on(*rays_and_colours(seed=step))
        shapes.append(learner.field.shape[0])
    assert [shapes.count(voxels) for voxels in (4, 8, 16)] == [3, 5, 16]
    assert learner.progress == 1.0
    assert learner.network_evaluations == 24 * 64 * 24
    assert learner.trace["step"] == [1.0, 20.0]
    assert {len(series) for series in learner.trace.values()} == {2}
    assert sum(density_histogram(learner, points=4)["after"]) == pytest.approx(1.0)


KERNELS = """
import json
import torch
import drjit as dr
from tests.harness.tiny import rays_and_colours
from tests.harness.voxels import voxels

torch.set_num_threads(1)
one = voxels()
dr.set_flag(dr.JitFlag.KernelHistory, True)

def launched():
    rows = [row for row in dr.kernel_history() if row["type"] == dr.KernelType.JIT]
    dr.kernel_history_clear()
    return [[str(row["hash"]), bool(row["cache_hit"])] for row in rows]

launched()
one.warm_up(*rays_and_colours(seed=3))
warm = launched()
steps = []
for step in range(24):
    one.train_on(*rays_and_colours(seed=step))
    steps.append(launched())
print(json.dumps([warm, steps, one.field.shape[0]]))
"""
"""Hashes of the kernels launched by the warm-up and by each step after it, and whether they were compiled before."""


@pytest.mark.thorough
@pytest.mark.slow
def test_nothing_is_compiled_on_the_clock_after_the_warm_up(tmp_path: Path) -> None:
    """It runs in another process with an empty kernel cache: both remember what other tests have compiled."""
    drjit_or_skip()
    ran = subprocess.run(
        [sys.executable, "-c", KERNELS], env={**os.environ, "HOME": str(tmp_path)}, capture_output=True, text=True
    )
    assert ran.returncode == 0, ran.stderr
    warm, steps, finest = json.loads(ran.stdout)
    assert finest == 16, "every refinement is among the steps"
    assert any((tmp_path / ".drjit").iterdir()), "the cache is that of this test"
    assert all(steps)
    known = {kernel for kernel, _ in warm}
    new = {step: [kernel for kernel, _ in rows if kernel not in known] for step, rows in enumerate(steps)}
    assert {step: kernels for step, kernels in new.items() if kernels} == {}
    assert all(compiled_before for rows in steps for _, compiled_before in rows)


def test_a_voxel_that_is_not_finite_is_named() -> None:
    learner = train(voxels(), 2)
    learner.field.values["red"] = learner.field.values["red"] * math.nan
    with pytest.raises(Diverged, match="at step 2: weight of red"):
        train(learner, 1)
    with pytest.raises(Diverged, match="at step 2: rendered colour"):
        learner.render(rays_and_colours()[0], 1000)


def test_a_spike_reaches_adam_as_a_few_times_the_usual_gradient_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    learner = train(voxels(), 6)
    usual = learner.clipping.usual_norm
    original = learner._slope
    norms: list[float] = []
    shares: list[float] = []

    def spiked(*batch: Any) -> Any:
        loss, norm, *others = original(*batch)
        norms.append(1e6 * norm)
        return loss, norms[-1], *others

    monkeypatch.setattr(learner, "_slope", spiked)
    monkeypatch.setattr(learner._optimiser, "step", lambda field, gradients, rate, scale: shares.append(scale))
    train(learner, 1)
    assert shares[0] * norms[0] == pytest.approx(SETTINGS.clip_ratio * usual, rel=1e-6)


def test_a_batch_that_sees_nothing_of_the_box_teaches_nothing() -> None:
    learner = train(voxels(), 1)
    before = learner.fields.state_dict()
    rays, colours = rays_and_colours()
    learner.train_on(replace(rays, directions=-rays.directions), torch.ones_like(colours))
    assert learner.last_loss == 0.0
    assert all(torch.equal(before[name], value) for name, value in learner.fields.state_dict().items())


@pytest.mark.slow
def test_its_records_are_as_complete_as_those_of_others_and_it_learns(ball: ViewSet, tmp_path: Path) -> None:
    drjit_or_skip()
    settings, score = replace(SETTINGS, rays=256), replace(SCORE, checkpoints=2)
    task = GroupTask("ball", 0, ("nerf", "voxels_drjit"), settings, score, Budget(100, None), tmp_path)
    cells = {cell.method: cell for cell in train_group(task, ball, {}, lambda share: None)}
    cell, other = cells["voxels_drjit"], cells["nerf"]
    assert (cell.status, cell.reason, cell.steps) == ("done", None, 100)
    for part in ("scores", "properties", "costs"):
        assert set(getattr(cell, part)) == set(getattr(other, part))
    assert set(cell.trace) == set(TRACED)
    known = {name for name, value in other.scores.items() if value is not None}
    assert {name for name, value in cell.scores.items() if value is not None} == known
    assert cell.scores["psnr"] > 17.0
    assert all(point.density is not None for point in cell.curve)
    assert cell.parameters["total"] == sum(n for name, n in cell.parameters.items() if name != "total")
    assert float(cell.properties["chunk_max_difference"] or 0) < 1e-5
    assert cell.pictures == "pictures/ball.voxels_drjit.0.safetensors"
    stored = load_file(tmp_path / "checkpoints" / "ball.voxels_drjit.0.safetensors")
    assert stored["density"].shape == (16, 16, 16)
    assert sum(value.numel() for value in stored.values()) == cell.parameters["total"]


# where it cannot run


def test_without_an_llvm_library_it_is_not_available(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(make_learner, "llvm_libraries", list)
    with pytest.raises(NotAvailable, match=r"LLVM 16 or newer.*none was found.*libllvm19.*DRJIT_LIBLLVM_PATH"):
        drjit_backend(CPU)
    monkeypatch.setattr(make_learner, "llvm_libraries", lambda: [Path("/some/libLLVM.so")])
    monkeypatch.setattr(make_learner, "probe", lambda variant, library: "it aborted")
    with pytest.raises(NotAvailable, match=r"/some/libLLVM\.so failed: it aborted"):
        drjit_backend(CPU)


@pytest.mark.slow
@pytest.mark.thorough
def test_a_run_where_mitsuba_and_drjit_cannot_be_imported_goes_on_without_them(tmp_path: Path) -> None:
    for name in ("mitsuba", "drjit"):
        (tmp_path / "blocked" / name).mkdir(parents=True)
        (tmp_path / "blocked" / name / "__init__.py").write_text("raise ImportError('this test allows no Mitsuba')")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path / "blocked"), str(ROOT)])}
    blocked = subprocess.run([sys.executable, "-c", "import mitsuba"], env=environment, capture_output=True)
    assert blocked.returncode == 1
    write_ball(tmp_path / "ball", size=16, train=3, test=1)
    options = "run --profile smoke --view-set ball --out run --resolution 16 --seeds 1 --budget-steps 3 --quiet"
    command = [sys.executable, "-m", "harness", *options.split(), "--methods", "nerf", "voxels_drjit"]
    ran = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert (ran.returncode, ran.stderr) == (0, "")
    cells = {one.method: one for one in read_cells(tmp_path / "run")}
    assert {name: one.status for name, one in cells.items()} == {"nerf": "done", "voxels_drjit": "not_available"}
    reason = cells["voxels_drjit"].reason or ""
    assert "this test allows no Mitsuba" in reason or "LLVM" in reason
