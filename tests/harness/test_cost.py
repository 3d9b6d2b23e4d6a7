"""What a plan is said to cost."""

import json
import statistics
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from harness import probe
from harness.cost import (
    Extent,
    estimate_lines,
    groups_left,
    lines_of,
    shared,
    training_seconds,
)
from harness.learner import Learner
from harness.plan import PROFILES, Machine, Plan, planned
from harness.probe import Pace, Probe, probed
from harness.records import cell_path, write_cell
from harness.schedule import Budget
from harness.unscored import unscored

SUMMARY = json.loads((Path(__file__).parents[2] / "docs/reduced/summary.json").read_text(encoding="utf-8"))
PLAN = replace(PROFILES["reduced"], extras=())
MACHINE = Machine("cpu", 2, 1)
PACE = Pace(first_step=0.02, step=(0.01, 0.02), ray=(5e-6, 1e-5), point=1e-6)
PROBE = Probe(dict.fromkeys(PLAN.methods, PACE), {}, start=5.0, compared=0.05, delayed=1.0)
ALL = (PLAN.methods,) * len(PLAN.groups())


def said(
    plan: Plan = PLAN,
    *,
    missing: int = 0,
    groups: tuple[tuple[str, ...], ...] = ALL,
    verify: bool = False,
    serving: bool = False,
    **changes: Any,
) -> list[str]:
    return lines_of(plan, MACHINE, replace(PROBE, **changes), Extent(missing, groups, verify, serving), cores=2)


def small(**changes: Any) -> Plan:
    plan = planned("smoke", resolution=8, **changes)
    return replace(plan, train=replace(plan.train, rays=32), score=replace(plan.score, chunk=32))


def test_training_as_recorded_is_estimated_as_recorded() -> None:
    cells = []
    for method in PLAN.methods:
        curves = [cell["curve"] for cell in SUMMARY["cells"] if cell["method"] == method]
        first = statistics.mean(one["seconds"][0] / one["steps"][0] for one in curves)
        later = statistics.mean(
            (one["seconds"][-1] - one["seconds"][0]) / (one["steps"][-1] - one["steps"][0]) for one in curves
        )
        cells.append(training_seconds(PLAN, Pace(first, (later, later), (0.0, 0.0), 0.0)))
    clocks = sum(cell["train_seconds"] for cell in SUMMARY["cells"]) / MACHINE.workers
    low, high = shared([cells] * len(ALL), MACHINE)
    assert 0.95 * clocks < low < 1.05 * clocks < high
    assert low < SUMMARY["phases"]["train"], "which has scoring in it as well"


def test_a_budget_in_seconds_is_what_training_takes() -> None:
    both = replace(PLAN, budget=Budget(1000, 12.0))
    assert training_seconds(both, PACE) == (pytest.approx(0.02 * 100 + 0.01 * 900), 12.0)
    assert training_seconds(replace(PLAN, budget=Budget(None, 12.0)), PACE) == (12.0, 12.0)


def test_every_part_of_a_run_is_named_and_they_add_up() -> None:
    found = said(missing=3, serving=True)
    assert [line.split()[0] for line in found] == ["estimated", "rendering", "training", "scoring", "view"]
    assert "3 of 8 view sets are not in the cache" in found[1]
    assert found[0] == "estimated cost: 12 to 30 min"
    assert "cached" in said()[1]
    assert not any("attention" in line for line in said())
    group_alone = said(replace(PLAN, scenes=("lego",), seeds=(0,)), groups=ALL[:1])
    assert group_alone[2] == "  training 35 to 80 s", "two workers train one group no faster"


def test_a_machine_that_others_use_and_methods_that_could_not_be_tried_are_named() -> None:
    assert said(delayed=1.1)[0] == said()[0]
    assert said(delayed=9.04)[0].endswith("now others use this machine, and it takes 9 times as long")
    assert said(untried={"mine": "needs LLVM"})[-1] == "  mine is not in it: needs LLVM"


def test_of_a_scene_of_ones_own_no_rendering_is_foretold() -> None:
    own = replace(PLAN, scene_file="mine.xml", scenes=("mine",))
    assert "not known beforehand" in said(own)[1]
    views = replace(PLAN, view_set="folder", scenes=("folder",))
    found = said(views)
    assert "yours" in found[1]
    assert found[3].startswith("  scoring at most, ")


def test_every_method_is_tried_and_one_that_fails_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    import torch

    plan = small(methods=["nerf", "qnerf"])
    monkeypatch.setattr(probe, "LONGEST", 0.0)
    usual = probe.learner_for

    def failing(method: str, *arguments: Any) -> Learner:
        if method == "qnerf":
            raise ValueError("no such thing")
        return usual(method, *arguments)

    monkeypatch.setattr(probe, "learner_for", failing)
    found = probed(plan, torch.device("cpu"), 1)
    assert found.untried == {"qnerf": "no such thing"}
    pace = found.paces["nerf"]
    assert min(pace.first_step, *pace.step, *pace.ray, pace.point, found.start, found.compared) > 0


def test_without_a_grid_what_comes_after_its_first_step_is_timed_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    import torch

    timed = []

    def noted(work: Any, *_: Any) -> float:
        timed.append((work.__name__, learner.step))
        return float(len(timed))

    monkeypatch.setattr(probe, "_seconds", noted)
    plan = small(methods=["nerf"], without=["grid"])
    learner = probe._learner(plan, "nerf", torch.device("cpu"))
    pace = probe._pace(learner, plan, time.process_time)
    later = plan.train.grid.first_step + 1
    assert timed == [("step", 0), ("step", later), ("render", later)]
    assert (pace.first_step, pace.step) == (1.0, (2.0, 2.0))


def test_a_cluster_is_not_measured() -> None:
    found = estimate_lines(PLAN, Machine("cpu", 2, 1, "ray"), Path("nowhere"), verify=False, serving=True, before=None)
    assert "not measured" in found[0]


def test_what_is_finished_is_not_in_it_and_what_else_is_not_is_said(tmp_path: Path) -> None:
    methods, scene = PLAN.methods, PLAN.scenes[0]
    for method in methods:
        write_cell(tmp_path, unscored(scene, method, 0, "diverged", "a NaN"))
        write_cell(tmp_path, unscored(scene, method, 1, "error", "is tried again"))
    damaged = cell_path(tmp_path, scene, methods[0], 2)
    damaged.write_text("{", encoding="utf-8")
    assert groups_left(PLAN, tmp_path) == ALL[1:]
    assert groups_left(PLAN, tmp_path / "nothing") == groups_left(PLAN, None) == ALL
    found = said(groups=ALL[:12], verify=True)
    assert found[-2:] == [
        "  12 of 24 groups of cells are finished, not in it",
        "  verification of omissions is not in it: it trains cells again",
    ]
    assert said(groups=())[2] == "  24 of 24 groups of cells are finished, not in it", "neither training nor scoring"
    assert not any("not in it" in line for line in said())
