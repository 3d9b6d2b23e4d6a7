"""The search for unit of density and start: its rule where the right choice is known, and a tiny search for real."""

import json
from pathlib import Path

import pytest

from baselines.catalog import CATALOG
from baselines.methods.chosen import FILE, DensityConstants, chosen
from harness.plan.profiles import PROFILES, Machine, planned
from harness.studies.choices import constants
from harness.studies.choices.constants import FINALISTS, READINGS, SHARE, ConstantsRow, means, pairs_of, search
from tests.harness.ball import ball_with_validation_views
from tests.replacing import replace

PUBLISHED = Path("docs/constants.json")
SCENES = ("a", "b")


def rows_of(method: str, scores: dict[DensityConstants, tuple[float | None, ...]], steps: int) -> list[ConstantsRow]:
    return [
        ConstantsRow(method, pair, scene, steps, score, 1.0)
        for pair, some in scores.items()
        for scene, score in zip(SCENES, some, strict=True)
    ]


FIRST, SECOND, LOST = DensityConstants(1.0, None), DensityConstants(25.0, 0.3), DensityConstants(100.0, 3.0)


def test_the_best_mean_after_all_steps_is_chosen_whatever_came_first() -> None:
    brief = rows_of("nerf", {FIRST: (30.0, 20.0), SECOND: (24.0, 24.0)}, 10)
    full = rows_of("nerf", {FIRST: (25.0, 25.0), SECOND: (20.0, 31.0)}, 40)
    assert list(means(brief, "nerf")) == [FIRST, SECOND]
    assert constants.chosen(brief + full) == {"nerf": SECOND}


def test_a_pair_that_diverges_on_a_scene_is_out() -> None:
    rows = rows_of("nerf", {LOST: (99.0, None), FIRST: (20.0, 20.0)}, 40)
    assert constants.chosen(rows) == {"nerf": FIRST}
    assert constants.chosen(rows_of("nerf", {LOST: (None, None)}, 40)) == {}


def test_every_pair_that_a_method_can_have_is_tried() -> None:
    assert len(pairs_of("nerf")) == len(constants.UNITS) * 4
    assert {pair.start for pair in pairs_of("qnerf")} == {None}, "Listing 2 as printed has no shift"
    assert all(pair.start is not None and pair.start < pair.unit for pair in pairs_of("qnerf_shifted"))
    assert {method for method, starts in READINGS.items() if None in starts} == READINGS.keys() - {"qnerf_shifted"}


def test_a_tiny_search_trains_every_pair_and_then_the_finalists(tmp_path: Path) -> None:
    folder = ball_with_validation_views(tmp_path / "ball")
    plan = replace(planned("smoke", methods=["qnerf"], budget_steps=2 * SHARE, resolution=16), scenes=("ball",))
    rows = list(search(plan, {"ball": folder}, tmp_path, 1, "cpu", tmp_path / "kept"))
    brief, full = ([row.constants for row in rows if row.steps == steps] for steps in (2, 2 * SHARE))
    assert brief == pairs_of("qnerf")
    assert sorted(map(str, full)) == sorted(map(str, list(means(rows[: len(brief)], "qnerf"))[:FINALISTS]))
    assert len({row.psnr_val for row in rows}) == len(rows), "each pair is another training"
    again = list(search(plan, {"ball": folder}, tmp_path, 1, "cpu", tmp_path / "kept"))
    assert again == rows, "finished cells are kept"


def test_methods_are_made_with_the_published_choice() -> None:
    record = json.loads(PUBLISHED.read_text(encoding="utf-8"))
    rows = [ConstantsRow(**{**row, "constants": DensityConstants(**row["constants"])}) for row in record["rows"]]
    assert constants.chosen(rows) == chosen("reduced"), "docs/constants.json has another choice than the methods"
    for method, pair in chosen("reduced").items():
        parts = CATALOG[method].parts
        assert parts is not None
        assert (parts.density_scale, parts.start) == (pair.unit, pair.start)


def test_the_search_uses_neither_seeds_nor_views_of_a_verdict() -> None:
    record = json.loads(PUBLISHED.read_text(encoding="utf-8"))
    assert record["seed"] not in {seed for plan in PROFILES.values() for seed in plan.seeds}
    assert {row["scene"] for row in record["rows"]} == set(PROFILES["reduced"].scenes)
    assert set(json.loads(FILE.read_text(encoding="utf-8"))) <= set(PROFILES)


@pytest.mark.parametrize("profile", ["smoke", "reduced"])
def test_a_plan_hands_the_constants_of_its_methods_to_its_cells(profile: str, tmp_path: Path) -> None:
    plan = PROFILES[profile]
    task = plan.tasks({scene: tmp_path for scene in plan.scenes}, Machine("cpu", 1, 1), tmp_path)[0]
    assert task.train.density["qnerf"] == chosen("reduced")["qnerf"]
    assert plan.settings()["train"]["density"]["qnerf_printed"] == {"unit": 1.0, "start": None}
    other = replace(plan, train=replace(plan.train, density={"nerf": DensityConstants(7.0, 0.1)}))
    assert other.settings() != plan.settings()
