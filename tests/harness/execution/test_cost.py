"""What a plan is said to cost."""

import json
import statistics
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from harness.execution.cost import Extent, estimate, estimated, groups_left, mean_of, shared, training_seconds
from harness.execution.probe import LONGEST, Pace, Probe, _seconds
from harness.execution.progress import span
from harness.plan.profiles import PROFILES, Machine, Plan
from harness.plan.schedule import Budget
from tests.harness.tiny import CPU

SUMMARY = json.loads((Path(__file__).parents[3] / "docs/reduced/summary.json").read_text(encoding="utf-8"))
PLAN = replace(PROFILES["reduced"].alone(), methods=tuple(SUMMARY["settings"]["methods"]))
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
    return estimated(plan, MACHINE, replace(PROBE, **changes), Extent(missing, groups, verify, serving), cores=2).lines


def test_training_as_recorded_is_estimated_as_recorded() -> None:
    cells = []
    for method in PLAN.methods:
        curves = [cell["curve"] for cell in SUMMARY["cells"] if cell["method"] == method]
        first = statistics.mean(one["seconds"][0] / one["steps"][0] for one in curves)
        later = statistics.mean(
            (one["seconds"][-1] - one["seconds"][0]) / (one["steps"][-1] - one["steps"][0]) for one in curves
        )
        cells.append(training_seconds(PLAN, Pace(first, (later, later), (0.0, 0.0), 0.0)))
    clocks = sum(cell["train_seconds"] for cell in SUMMARY["cells"] if cell["method"] in PLAN.methods) / MACHINE.workers
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
    views = replace(PLAN, view_set=("folder",), scenes=("folder",))
    found = said(views)
    assert "yours" in found[1]
    assert found[3].startswith("  scoring at most, ")


def test_a_cluster_is_not_measured() -> None:
    found = estimate(PLAN, Machine("cpu", 2, 1, "ray"), Path("nowhere"), verify=False, serving=True, before=None)
    assert "not measured" in found.lines[0]
    assert not found.phases


def test_the_phases_that_are_expected_add_up_to_what_is_said() -> None:
    extent = Extent(8, ALL, verify=False, serving=True)
    found = estimated(PLAN, MACHINE, PROBE, extent, cores=2)
    assert list(found.phases) == ["rendering", "training", "part"]
    low, high = (sum(phase[end] for phase in found.phases.values()) for end in (0, 1))
    assert found.lines[0] == f"estimated cost: {span(low, high)}"
    scalar = estimated(PLAN, MACHINE, PROBE, extent, cores=2, compiled=False).phases
    assert scalar["rendering"] > found.phases["rendering"]
    assert scalar["training"] == found.phases["training"]


def test_rendering_as_recorded_is_within_its_range() -> None:
    phases = estimated(PLAN, MACHINE, PROBE, Extent(8, ALL, verify=False, serving=True), cores=2).phases
    low, high = phases["rendering"]
    assert low < SUMMARY["phases"]["render"] < high


def test_a_guest_is_counted_as_long_as_it_is_not_there(tmp_path: Path) -> None:
    plan = replace(PLAN, guest="splats")
    assert groups_left(plan, None) == (*ALL, *[("nerf",)] * len(PLAN.scenes))


def test_a_mean_of_many_is_known_better_than_one() -> None:
    assert mean_of(1, (2.0, 6.0)) == (2.0, 6.0)
    assert mean_of(4, (2.0, 6.0)) == (3.0, 5.0)


@pytest.mark.parametrize(("a_call", "a_ray"), [(0.05, 1e-7), (0.0, 1e-4), (0.0, 5e-3), (0.01, 4e-4)])
def test_what_a_call_takes_is_not_multiplied_by_the_rays(a_call: float, a_ray: float) -> None:
    """A GPU takes 50 ms for 64 rays and for 4096; a slow processor is not asked for 4096 × 5 ms."""
    now, longest = 0.0, 0.0

    def work(rays: int) -> None:
        nonlocal now, longest
        now += a_call + a_ray * rays
        longest = max(longest, a_call + a_ray * rays)

    found = _seconds(work, 4096, CPU, lambda: now)
    true = a_call + a_ray * 4096
    assert 0.999 * true < found < 1.001 * true + 8 * a_call
    assert longest <= 1.001 * max(LONGEST, 64 * a_ray)
