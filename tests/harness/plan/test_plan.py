"""Profiles, and what options change in them."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from baselines.catalog import CATALOG as METHODS
from harness.command.plan_options import planned
from harness.plan.names import scene_name_of
from harness.plan.profiles import PROFILES
from harness.plan.schedule import Budget
from scenes.catalog.entries import CATALOG as SCENES
from scenes.catalog.entries import CLASSICS
from scenes.files.errors import InputError


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


def test_the_default_profile_compares_on_all_eight_scenes_with_three_seeds() -> None:
    plan = planned("reduced")
    assert plan.scenes == tuple(CLASSICS)
    assert (len(plan.scenes), len(plan.seeds), len(plan.cells())) == (8, 3, 96 + 3 * 3)


def test_further_methods_explain_one_scene_and_go_where_methods_are_named() -> None:
    plan = planned("reduced")
    assert plan.groups()["lego", 1] == (*plan.methods, *plan.extras[0].methods)
    assert plan.groups()["chair", 0] == plan.methods
    assert len({parts for name in plan.groups()["lego", 0] if (parts := METHODS[name].parts)}) == 7, "no cell twice"
    assert planned("reduced", methods=["nerf", "qnerf"]).extras == ()
    assert planned("reduced", scenes=["chair"]).extras == ()
    assert {one.seeds for one in planned("reduced", seeds=1).extras} == {(0,)}


def test_the_full_profile_is_the_papers_setting() -> None:
    plan = planned("full")
    assert plan.budget == Budget(steps=200_000, seconds=None)
    assert (plan.views.resolution, plan.views.train, plan.views.test) == (800, 100, 200)
    assert (plan.train.network.depth, plan.train.network.width) == (8, 256)
    assert (plan.train.network.position_bands, plan.train.network.direction_bands) == (10, 4)
    assert (plan.train.rays, plan.train.bins, plan.train.fine_bins) == (1024, 64, 128)
    assert (plan.train.learning_rate, plan.train.precision) == (5e-4, "float32")


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
        ("nerf_synthetic/lego", "lego"),
        ("my views!", "my-views"),
        ("a.b", "a-b"),
        ("Зонт", "view-set"),
        ("..scene..", "scene"),
        ("/", "view-set"),
    ],
)
def test_a_view_sets_name_is_fit_for_a_file_name(folder: str, name: str, tmp_path: Path) -> None:
    assert scene_name_of(tmp_path / folder) == name


def test_two_view_sets_of_one_name_are_refused_by_both_paths(ball_folder: Path, tmp_path: Path) -> None:
    other = tmp_path / ball_folder.name
    shutil.copytree(ball_folder, other)
    for again in (other, ball_folder):
        with pytest.raises(InputError, match=f"--view-set {ball_folder} {again}: both would be the scene ball; rename"):
            planned("smoke", view_set=[ball_folder, again])


def test_a_guest_has_a_cell_on_each_scene_and_none_where_methods_are_named() -> None:
    plan = planned("reduced")
    assert plan.guest_cells() == [(scene, "splats", 0) for scene in plan.scenes]
    assert not {key for key in plan.guest_cells()} & set(plan.cells())
    assert "guest" not in plan.settings(), "no result of the others depends on it"
    assert planned("reduced", methods=["nerf", "qnerf"]).guest_cells() == []
