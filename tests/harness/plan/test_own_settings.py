"""All that changes the results of a method is in the settings of a run and of each of its cells."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from baselines.catalog import CATALOG
from baselines.methods.chosen import DensityConstants
from baselines.methods.repaired import CANDIDATES
from harness.plan import run_plan
from harness.plan.profiles import PROFILES
from harness.plan.run_plan import Machine, Plan
from harness.training.learner import Job
from harness.training.make_learner import learner_for
from tests.harness import tiny
from tests.replacing import replace

OTHERS = {"base2": "phi", "phi": "base2", "half": "phi", "none": "equation4", "box": "scene", "scene": "box"}
"""Another name of the same kind; others become what nothing is called, as nothing is trained here."""


def changed(name: str, value: Any) -> Any:
    if name == "start" and value is None:
        return 1.0
    if name == "decay":
        return "linear"
    match value:
        case bool():
            return not value
        case int() | float():
            return 2 * value
        case tuple():
            return tuple(2 * part for part in value)
        case None:
            return 3
        case _:
            return OTHERS.get(value, f"another {value}")


def plan_of(method: str) -> Plan:
    return replace(PROFILES["reduced"].without_extras(), methods=("nerf", method))


def cell_settings(plan: Plan, method: str, folder: Path) -> dict[str, Any]:
    return plan.tasks(dict.fromkeys(plan.scenes, folder), Machine("cpu", 1, 1), folder)[0].settings(method)


@pytest.mark.parametrize("method", [name for name in CATALOG if name != "nerf"])
def test_each_setting_of_a_method_is_one_of_its_run_and_of_its_cells_alone(method: str, tmp_path: Path) -> None:
    plan = plan_of(method)
    own = plan.own_settings([method])[method]
    seen = [plan.settings()]
    for each in fields(own):
        other = replace(own, **{each.name: changed(each.name, getattr(own, each.name))})
        changed_plan = replace(plan, train=replace(plan.train, own={method: other}))
        assert changed_plan.settings() not in seen, each.name
        seen.append(changed_plan.settings())
        before, after = (cell_settings(one, method, tmp_path) for one in (plan, changed_plan))
        assert before != after, each.name
        assert cell_settings(plan, "nerf", tmp_path) == cell_settings(changed_plan, "nerf", tmp_path)


@pytest.mark.parametrize("name", ["qnerf", "qnerf_repaired"])
def test_constants_chosen_at_the_scale_of_a_profile_are_those_of_all_that_was_searched(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """qnerf_repaired is one of the candidates that are searched under names of their own."""
    repaired = next(each for each, parts in CANDIDATES.items() if parts == CATALOG["qnerf_repaired"].settings)
    pairs = {"qnerf": DensityConstants(100.0, None), repaired: DensityConstants(10.0, 7.0)}
    monkeypatch.setattr(run_plan, "chosen", lambda profile: pairs if profile == "converged" else {})
    usual = CATALOG[name].settings
    pair = pairs[repaired if name == "qnerf_repaired" else name]
    assert PROFILES["converged"].own_settings([name])[name] == replace(usual, **pair.fields)
    assert PROFILES["smoke"].own_settings([name])[name] == usual


@pytest.mark.parametrize(
    ("method", "changes"),
    [
        ("nerf", {"encoding": "base2_matched"}),
        ("nerf", {"width": 20}),
        ("planes", {"nodes": (8, 16)}),
        ("hash_grid", {"cells": (8, 16), "entries": 64}),
        ("splats", {"first": 50}),
    ],
)
def test_a_trainer_has_the_settings_of_its_job(method: str, changes: dict[str, Any]) -> None:
    own = replace(CATALOG[method].settings, **changes)
    settings = [tiny.TRAIN, replace(tiny.TRAIN, own={method: own})]
    learners = [learner_for(Job(method, tiny.box(), each, tiny.BUDGET, 0, tiny.CPU)) for each in settings]
    counts = [learner.field.parameter_counts()["total"] for learner in learners]
    assert counts[0] != counts[1]
