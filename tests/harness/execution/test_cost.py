"""The estimated cost of a plan agrees with a recorded run, and names all its parts."""

import json
import statistics
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from harness.execution import ground_truth
from harness.execution.cost import (
    LONGEST,
    CostEstimate,
    Pace,
    Paces,
    estimate,
    estimate_from,
    groups_left,
    measure_paces,
    on_workers,
    seconds_of,
    training_seconds,
)
from harness.execution.ground_truth import rendering_seconds
from harness.execution.progress import span
from harness.plan.profiles import PROFILES
from harness.plan.run_plan import Machine, Plan
from harness.plan.schedule import Budget
from tests.harness.tiny import CPU

SUMMARY = json.loads((Path(__file__).parents[3] / "docs/reduced/summary.json").read_text(encoding="utf-8"))
PLAN = replace(
    PROFILES["reduced"],
    methods=tuple(SUMMARY["settings"]["methods"]),
    budget=Budget(SUMMARY["settings"]["budget"]["steps"], None),
)
MACHINE = Machine("cpu", 2, 1)
PACE = Pace(first_step=0.02, step=0.015, ray=7e-6)
PACES = Paces(dict.fromkeys(PLAN.methods, PACE), {}, start=5.0, compared=0.05, delayed=1.0)


@pytest.fixture(autouse=True)
def two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ground_truth, "available_cores", lambda: 2)
    monkeypatch.setattr(ground_truth, "llvm_libraries", lambda: ["libLLVM.so"])


def estimated(plan: Plan = PLAN, missing: int = 0, **changes: Any) -> CostEstimate:
    groups = list(plan.groups().values())
    return estimate_from(plan, MACHINE, replace(PACES, **changes), groups, missing, verify=False)


RENDERED = 245.0
"""The seconds in which two cores rendered the eight scenes, with five validation and 15 test views, before training."""


def test_a_run_as_recorded_is_estimated_as_recorded() -> None:
    cells = []
    for method in PLAN.methods:
        curves = [cell["curve"] for cell in SUMMARY["cells"] if cell["method"] == method]
        first = statistics.mean(one["seconds"][0] / one["steps"][0] for one in curves)
        later = statistics.mean(
            (one["seconds"][-1] - one["seconds"][0]) / (one["steps"][-1] - one["steps"][0]) for one in curves
        )
        cells.append(training_seconds(PLAN, Pace(first, later, 0.0)))
    clocks = sum(cell["train_seconds"] for cell in SUMMARY["cells"] if cell["method"] in PLAN.methods) / MACHINE.workers
    groups = len(PLAN.groups())
    assert sum(cells) * groups / MACHINE.workers == pytest.approx(clocks, rel=0.05)
    low, high = on_workers([sum(cells)] * groups, MACHINE)
    assert low < clocks < high
    low, high = rendering_seconds(replace(PLAN.views, val=5, test=15), 8)
    assert low < RENDERED < high


def test_a_budget_in_seconds_is_what_training_takes() -> None:
    assert training_seconds(replace(PLAN, budget=Budget(1000, 16.0)), PACE) == pytest.approx(0.02 * 100 + 0.015 * 900)
    assert training_seconds(replace(PLAN, budget=Budget(1000, 12.0)), PACE) == 12.0
    assert training_seconds(replace(PLAN, budget=Budget(None, None, 12.0)), PACE) == 12.0


def test_every_part_of_a_run_is_named_and_they_add_up(monkeypatch: pytest.MonkeyPatch) -> None:
    found = estimated(missing=3)
    methods = list(PACES.of)
    assert [line.split()[0] for line in found.lines] == ["estimated", "rendering", "training", *methods, "scoring"]
    assert all(line.endswith(" per cell") for line in found.lines[3 : 3 + len(methods)])
    assert "3 of 8 view sets are not in the cache" in found.lines[1]
    assert list(found.phases) == ["rendering", "training"]
    low, high = (sum(phase[end] for phase in found.phases.values()) for end in (0, 1))
    assert found.lines[0] == f"estimated cost: {span(low, high)}"
    assert "cached" in estimated().lines[1]
    one, many = (on_workers([50.0] * count, MACHINE) for count in (1, 10))
    assert one[0] == pytest.approx(35.0), "two workers train one group no faster"
    assert many[0] == pytest.approx(175.0)
    monkeypatch.setattr(ground_truth, "llvm_libraries", list)
    assert estimated(missing=3).phases["rendering"] > found.phases["rendering"], "scalar rendering is slower"


def test_a_machine_that_others_use_and_methods_that_could_not_be_tried_are_named() -> None:
    assert estimated(delayed=1.1).lines[0] == estimated().lines[0]
    assert estimated(delayed=9.04).lines[0].endswith("now other programs run, and it takes 9 times as long")
    assert estimated(untried={"mine": "needs LLVM"}).lines[-1] == "  mine is not included: needs LLVM"


def test_the_rendering_of_a_scene_of_ones_own_is_not_estimated() -> None:
    assert "not known beforehand" in estimated(replace(PLAN, scene_file="mine.xml", scenes=("mine",))).lines[1]
    lines = estimated(replace(PLAN, view_set=("folder",), scenes=("folder",))).lines
    assert "yours" in lines[1]
    assert any(line.startswith("  scoring at most, ") for line in lines)


def test_a_cluster_is_not_measured() -> None:
    found = estimate(PLAN, Machine("cpu", 2, 1, "ray"), Path("nowhere"), verify=False, before=None)
    assert "not measured" in found.lines[0]
    assert not found.phases


def test_a_guest_is_counted_as_long_as_it_is_not_there() -> None:
    groups = list(PLAN.groups().values())
    given = replace(PLAN, given=(("a.ply", "digest"),) * len(PLAN.scenes))
    assert groups_left(given, None) == groups + [()] * len(PLAN.scenes), "its scoring takes next to nothing"


def test_methods_are_measured_and_those_that_cannot_run_are_named() -> None:
    plan = replace(PROFILES["smoke"].without_extras(), methods=("nerf", "splats", "nowhere"))
    paces = measure_paces(plan, CPU, threads=1)
    for method in ("nerf", "splats"):  # splats take one view per step
        assert 0.0 < paces.of[method].step < LONGEST
        assert 0.0 < paces.of[method].ray < paces.of[method].step
    assert list(paces.untried) == ["nowhere"]


@pytest.mark.parametrize(("a_call", "a_ray"), [(0.05, 1e-7), (0.0, 1e-4), (0.0, 5e-3), (0.01, 4e-4)])
def test_what_a_call_takes_is_not_multiplied_by_the_rays(a_call: float, a_ray: float) -> None:
    """A GPU takes 50 ms for 64 and for 4096 rays; a slow processor must not be measured for 4096 × 5 ms."""
    now, longest = 0.0, 0.0

    def work(rays: int) -> None:
        nonlocal now, longest
        now += a_call + a_ray * rays
        longest = max(longest, a_call + a_ray * rays)

    found = seconds_of(work, 4096, CPU, lambda: now)
    true = a_call + a_ray * 4096
    assert 0.999 * true < found < 1.001 * true + 8 * a_call
    assert longest <= 1.001 * max(LONGEST, 64 * a_ray)
