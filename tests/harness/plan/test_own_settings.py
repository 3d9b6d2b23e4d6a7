"""All that changes the results of a method is in the settings of a run and of each of its cells."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from baselines.catalog import CATALOG
from harness.plan.profiles import PROFILES, Machine, Plan
from tests.replacing import replace

OTHERS = {"base2": "phi", "phi": "base2", "half": "phi", "none": "equation4", "box": "scene", "scene": "box"}
"""Another name of the same kind; others become what nothing is called, as nothing is trained here."""


def changed(value: Any) -> Any:
    match value:
        case bool():
            return not value
        case int() | float():
            return 2 * value
        case tuple():
            return tuple(2 * part for part in value)
        case None:
            return 1.0
        case _:
            return OTHERS.get(value, f"another {value}")


def plan_of(method: str) -> Plan:
    return replace(PROFILES["reduced"].alone(), methods=("nerf", method))


def cell_settings(plan: Plan, method: str, folder: Path) -> dict[str, Any]:
    return plan.tasks(dict.fromkeys(plan.scenes, folder), Machine("cpu", 1, 1), folder)[0].settings(method)


@pytest.mark.parametrize("method", [name for name in CATALOG if name != "nerf"])
def test_each_setting_of_a_method_is_one_of_its_run_and_of_its_cells_alone(method: str, tmp_path: Path) -> None:
    plan = plan_of(method)
    own = plan.own_settings([method])[method]
    seen = [plan.settings()]
    for each in fields(own):
        other = replace(own, **{each.name: changed(getattr(own, each.name))})
        changed_plan = replace(plan, train=replace(plan.train, own={method: other}))
        assert changed_plan.settings() not in seen, each.name
        seen.append(changed_plan.settings())
        before, after = (cell_settings(one, method, tmp_path) for one in (plan, changed_plan))
        assert before != after, each.name
        assert cell_settings(plan, "nerf", tmp_path) == cell_settings(changed_plan, "nerf", tmp_path)
