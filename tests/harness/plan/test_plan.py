"""Profiles, what options change in them, what the record of a run states, and the settings of each method."""

import json
import shutil
from dataclasses import fields
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any

import pytest

from baselines.catalog import CATALOG as METHODS
from baselines.methods.chosen import DensityConstants, chosen
from baselines.methods.repaired import CANDIDATES
from harness.command.plan_options import planned
from harness.plan import run_plan
from harness.plan.names import scene_name_of
from harness.plan.planned_record import SEARCHED_AT, deviations, not_tested
from harness.plan.profiles import PROFILES
from harness.plan.run_plan import Machine, Plan
from harness.training.learner import Job
from harness.training.make_learner import learner_for
from harness.verdicts.claim_files import known_claims
from scenes.catalog.entries import CATALOG as SCENES
from scenes.files.errors import InputError
from tests.harness import tiny
from tests.replacing import replace


@pytest.mark.parametrize("name", PROFILES)
def test_a_profile_can_be_run(name: str) -> None:
    plan = planned(name)
    assert json.loads(json.dumps(plan.settings(), allow_nan=False))["profile"] == name
    assert set(plan.scenes) <= set(SCENES)
    assert set(plan.methods) <= set(METHODS)
    assert {"nerf", "nerf_matched", "qnerf"} <= set(plan.methods), "the bandwidth control is part of every default run"
    # what is drawn from scores needs seeds to compare; stress and ladder show where a method breaks
    assert len(plan.seeds) >= (1 if name in ("stress", "ladder") else 2)
    # with a depth of 5 or less the φ skip falls on the last layer
    assert plan.train.network.depth >= 6
    assert plan.budget.steps is not None
    assert plan.train.grid.cells == 0 or plan.train.grid.first_step < plan.budget.steps


def test_further_methods_explain_one_scene_and_go_where_methods_are_named() -> None:
    plan = planned("smoke")
    assert plan.groups()["lego", 0] == (*plan.methods, *plan.extras[0].methods)
    assert plan.groups()["lego", 1] == plan.groups()["hotdog", 0] == plan.methods
    assert len({parts for name in plan.groups()["lego", 0] if (parts := METHODS[name].parts)}) == 4, "no cell twice"
    assert planned("smoke", methods=["nerf", "qnerf"]).extras == ()
    assert planned("smoke", scenes=["hotdog"]).extras == ()
    assert planned("smoke", first_seed=1).extras == ()


def test_the_full_profile_has_every_setting_that_the_paper_states() -> None:
    settings = planned("full").settings()
    (paper,) = known_claims()
    stated = {entry.of["at"]: entry.printed for entry in paper.claims if entry.of.get("at")}
    scale = {"budget.steps": paper.scale.steps, "views.resolution": paper.scale.width, **paper.scale.settings}
    scale |= {f"views.{split}": count for split, count in paper.scale.views.items()}
    for place, value in [*stated.items(), *scale.items()]:
        assert reduce(getitem, place.split("."), settings) == value, place


def test_cells_come_seed_by_seed_so_that_a_stopped_run_has_every_scene() -> None:
    plan = planned("smoke", scenes=["lego", "mic"], methods=["nerf", "qnerf"], seeds=2)
    assert list(plan.groups()) == [("lego", 0), ("mic", 0), ("lego", 1), ("mic", 1)]
    assert plan.cells()[:3] == [("lego", "nerf", 0), ("lego", "qnerf", 0), ("mic", "nerf", 0)]
    assert len(set(plan.cells())) == 8


def test_options_change_what_they_name_and_nothing_else(ball_folder: Path) -> None:
    before = planned("smoke").settings()
    changes: list[tuple[dict[str, Any], set[str]]] = [
        ({"scenes": ["mic"]}, {"scenes"}),
        ({"methods": ["qnerf"]}, {"methods"}),
        ({"seeds": 1}, {"seeds"}),
        ({"budget_steps": 7}, {"budget"}),
        ({"resolution": 16}, {"views"}),
        ({"precision": "float32"}, {"train"}),
        ({"view_set": [ball_folder]}, {"view_set", "scenes"}),
    ]
    for options, expected in changes:
        after = planned("smoke", **options).settings()
        after["train"]["own"] = before["train"]["own"]  # of the methods that are planned
        assert {key for key in before if before[key] != after.get(key)} - {"extras"} == expected


@pytest.mark.parametrize(
    ("folder", "name"),
    [
        ("nerf_synthetic/lego", "lego"), ("my views!", "my-views"), ("a.b", "a-b"), ("Зонт", "view-set"),
        ("..scene..", "scene"), ("/", "view-set"), ("chair/transforms.json", "chair"), ("x/fern.npz", "fern"),
    ],
)  # fmt: skip
def test_a_view_sets_name_is_fit_for_a_file_name(folder: str, name: str, tmp_path: Path) -> None:
    if Path(folder).suffix in (".json", ".npz"):
        (tmp_path / folder).parent.mkdir()
        (tmp_path / folder).touch()
    assert scene_name_of(tmp_path / folder) == name


def test_two_view_sets_of_one_name_are_refused_by_both_paths(ball_folder: Path, tmp_path: Path) -> None:
    other = tmp_path / ball_folder.name
    shutil.copytree(ball_folder, other)
    for again in (other, ball_folder):
        with pytest.raises(InputError, match=f"--view-set {ball_folder} {again}: both would be the scene ball; rename"):
            planned("smoke", view_set=[ball_folder, again])


# what the record of a run states


def beginning(plan: Plan, words: str, **notes: tuple[str, ...]) -> list[str]:
    return [sentence for sentence in deviations(plan, notes) if sentence.startswith(words)]


def test_the_control_is_named_only_where_it_takes_part() -> None:
    for methods, words in (
        (("nerf", "nerf_matched", "qnerf"), "bandwidth, which is why nerf_matched is shown for comparison."),
        (("nerf", "qnerf"), "reward low bandwidth."),
    ):
        (sentence,) = (one for one in not_tested(replace(PROFILES["reduced"], methods=methods)) if "bandwidth" in one)
        assert sentence.endswith(words)


def test_the_full_setting_states_what_the_paper_leaves_open() -> None:
    """π, images per batch, unit and start with the scale of their search, precision, the views of curves, the rays."""
    plan = PROFILES["full"]
    for words in (
        "Positions are normalised by the scene's box (longest half-extent 1) and multiplied by π",
        "Each ray of a batch goes through a random pixel of a random image",
        "Matrix multiplications run in bfloat16",
        "Curves, and scores at equal time, are means over 8 evenly spread test views",
    ):
        assert beginning(plan, words), words
    (sentence,) = beginning(plan, "Unit of density")
    assert SEARCHED_AT["full" if chosen("full") else "reduced"] in sentence
    assert not beginning(PROFILES["converged"], "Curves")
    assert not beginning(plan, "0%")
    assert beginning(replace(plan, train=replace(plan.train, covered_share=0.7)), "70% of the rays")
    assert [extra.methods for extra in plan.extras] == [("nerf_float32", "qnerf_float32")]
    skipping = PROFILES["full_skipping"]
    assert (skipping.budget, skipping.score, skipping.views) == (plan.budget, plan.score, plan.views)
    assert replace(skipping.train, grid=plan.train.grid) == plan.train


def test_whoever_cannot_leave_out_hidden_points_is_named() -> None:
    words = "Points behind matter"
    (sentence,) = beginning(planned("reduced", methods=["nerf", "qnerf", "qnerf_repaired"]), words)
    assert "In qnerf it depends on" in sentence
    assert not beginning(planned("reduced", methods=["nerf", "qnerf_repaired"]), words)
    assert not beginning(planned("reduced", without=["hidden"]), words)


def test_what_the_reader_of_images_noted_and_what_was_forced_is_said_once() -> None:
    plan = planned("reduced", need=["view_direction"])
    notes = {"ball": ("No alpha.",), "cup": ("No alpha.", "No test views.")}
    assert beginning(plan, "Of the view set of", **notes) == [
        "Of the view set of ball, cup: No alpha.",
        "Of the view set of cup: No test views.",
    ]
    assert len(beginning(plan, "Forced by --need, whatever the scene needs: kept are ")) == 1


def test_a_loss_or_schedule_of_its_own_is_stated_with_the_method() -> None:
    plan = planned("reduced", methods=["nerf", "qnerf"])
    assert not beginning(plan, "qnerf: It trains with")
    own = plan.own_settings(["qnerf"])["qnerf"]
    own = replace(own, loss="huber", learning_rate=0.003)
    (sentence,) = beginning(replace(plan, train=replace(plan.train, own={"qnerf": own})), "qnerf: It trains with")
    assert "loss huber, learning_rate 0.003, the other methods" in sentence


# all that changes the results of a method is in the settings of a run and of each of its cells


OTHERS = {"base2": "phi", "phi": "base2", "half": "phi", "none": "equation4", "box": "scene", "scene": "box"}
"""Another name of the same kind; others become what nothing is called, as nothing is trained here."""


def changed(name: str, value: Any) -> Any:
    if name == "start" and value is None:
        return 1.0
    if name in ("decay", "precision"):
        return "linear"
    match value:
        case bool():
            return not value
        case int() | float():
            return 2 * value or 1
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


@pytest.mark.parametrize("method", [name for name in METHODS if name != "nerf"])
def test_each_setting_of_a_method_is_one_of_its_run_and_of_its_cells_alone(method: str, tmp_path: Path) -> None:
    plan = plan_of(method)
    own = plan.own_settings([method])[method]
    seen = [plan.settings()]
    before, of_nerf = (cell_settings(plan, name, tmp_path) for name in (method, "nerf"))
    for each in fields(own):
        other = replace(own, **{each.name: changed(each.name, getattr(own, each.name))})
        changed_plan = replace(plan, train=replace(plan.train, own={method: other}))
        assert changed_plan.settings() not in seen, each.name
        seen.append(changed_plan.settings())
        assert cell_settings(changed_plan, method, tmp_path) != before, each.name
        assert cell_settings(changed_plan, "nerf", tmp_path) == of_nerf


@pytest.mark.parametrize("name", ["qnerf", "qnerf_repaired"])
def test_constants_chosen_at_the_scale_of_a_profile_are_those_of_all_that_was_searched(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """qnerf_repaired is one of the candidates that are searched under names of their own."""
    repaired = next(each for each, parts in CANDIDATES.items() if parts == METHODS["qnerf_repaired"].settings)
    pairs = {"qnerf": DensityConstants(100.0, None), repaired: DensityConstants(10.0, 7.0)}
    monkeypatch.setattr(run_plan, "chosen", lambda profile: pairs if profile == "converged" else {})
    usual = METHODS[name].settings
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
    own = replace(METHODS[method].settings, **changes)
    settings = [tiny.TRAIN, replace(tiny.TRAIN, own={method: own})]
    learners = [learner_for(Job(method, tiny.box(), each, tiny.BUDGET, 0, tiny.CPU)) for each in settings]
    counts = [learner.field.parameter_counts()["total"] for learner in learners]
    assert counts[0] != counts[1]
