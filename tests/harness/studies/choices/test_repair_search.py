"""The search for the repaired Q-NeRF: its rule where the right choice is known, and a tiny search for real."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from baselines.catalog import CATALOG
from baselines.methods.repaired import CANDIDATES
from harness.plan.profiles import EXPLAINING
from harness.plan.schedule import Budget
from harness.studies.choices.repair_search import (
    HISTORY,
    PUBLISHED,
    REFERENCES,
    SECONDS,
    SEEDS,
    RepairRow,
    as_json,
    chosen,
    read_search,
    search,
    search_plan,
    standings,
)
from harness.studies.evidence.evidence_context import SEARCHED, TRAININGS
from scenes.files.errors import InputError
from tests.harness import tiny
from tests.harness.ball import ball_with_validation_views

NAMES = list(CANDIDATES)
BEST_FAITH = ("qnerf_theorem", "qnerf_repaired")
SEARCH = json.loads(PUBLISHED.read_text())
CELLS = [(scene, seed) for scene in SEARCHED for seed in SEEDS]


def rows_of(scores: dict[str, list[float | None]]) -> list[RepairRow]:
    """Method → score on each of `CELLS`."""
    return [
        RepairRow(method, scene, seed, score, 500, SECONDS, 1000, None, None)
        for method, some in scores.items()
        for (scene, seed), score in zip(CELLS, some, strict=True)
    ]


def scores(first: float, last: float, noise: float = 0.01) -> dict[str, list[float | None]]:
    """All 20 dB but the first and the last candidate."""
    wobble = [noise, -noise, -noise, noise]
    means = dict.fromkeys(NAMES, 20.0) | {NAMES[0]: first, NAMES[-1]: last}
    signs = dict.fromkeys(NAMES, -1) | {NAMES[0]: 1}
    return {name: [mean + signs[name] * offset for offset in wobble] for name, mean in means.items()}


def test_the_best_is_chosen_where_nothing_ties_with_it() -> None:
    assert chosen(standings(rows_of(scores(22.0, 23.0)))) == NAMES[-1]
    assert chosen(standings(rows_of(scores(23.0, 22.0)))) == NAMES[0]
    references = {name: [40.0] * 4 for name in REFERENCES}
    assert chosen(standings(rows_of(scores(22.0, 23.0) | references))) == NAMES[-1], "a reference is no candidate"


def test_a_tie_within_one_standard_error_goes_to_the_simplest() -> None:
    rows = rows_of(scores(22.995, 23.0))
    table = standings(rows)
    assert standings(rows[::-1]) == table
    assert [rank.method for rank in table if rank.ties] == [NAMES[0], NAMES[-1]]
    assert chosen(table) == NAMES[0]
    assert table[0].behind == pytest.approx(0.005)
    assert table[0].standard_error == pytest.approx(0.02 / 3**0.5, rel=1e-6), "differences of ±0.02 about their mean"
    assert chosen(standings(rows_of(scores(22.98, 23.0)))) == NAMES[-1], "more than one standard error behind"


def test_one_that_diverged_anywhere_is_out() -> None:
    some = scores(22.0, 23.0)
    some[NAMES[-1]][2] = None
    table = standings(rows_of(some))
    assert chosen(table) == NAMES[0]
    assert (table[-1].mean, table[-1].ties) == (None, False)
    with pytest.raises(ValueError, match="every candidate diverged"):
        standings(rows_of({name: [None] * 4 for name in NAMES}))


def test_no_verdict_is_taken_where_the_choice_was_made() -> None:
    plan = search_plan(precision_as_planned=True)
    verdict = TRAININGS["repaired"]
    assert not set(plan.scenes) & set(verdict.scenes)
    assert not set(plan.seeds) & {seed for training in TRAININGS.values() for seed in training.seeds}
    assert set(plan.methods) == {*CANDIDATES, *REFERENCES}
    assert plan.budget == Budget(steps=None, seconds=SECONDS)


def test_a_search_for_real_scores_validation_views_at_equal_time(tmp_path: Path) -> None:
    folder = ball_with_validation_views(tmp_path / "ball")
    plan = replace(
        search_plan(precision_as_planned=False),
        scenes=("ball",),
        methods=(NAMES[0], NAMES[3], "nerf"),
        budget=Budget(steps=None, seconds=0.05),
        train=tiny.TRAIN,
        views=replace(tiny.VIEWS, val=2),
    )
    rows = list(search(plan, {"ball": folder}, torch.device("cpu"), tmp_path))
    everyone = sorted((name, seed) for name in plan.methods for seed in SEEDS)
    assert sorted((row.method, row.seed) for row in rows) == everyone
    for row in rows:
        assert row.psnr_val is not None
        assert row.seconds >= 0.05
        assert row.steps >= 1
        assert (row.alpha is None) == (row.method == "nerf")
    data = as_json(rows, plan, torch.device("cpu"))
    (tmp_path / "found.json").write_text(json.dumps(data))
    found = read_search(tmp_path / "found.json")
    assert found.rows == rows
    assert found.standings == standings(rows)
    assert found.chosen == data["chosen"]
    assert (found.history, found.clock) == (list(HISTORY), "processor seconds")
    assert {"commit", "processor", "packages"} <= data["provenance"].keys()
    assert as_json(rows, plan, torch.device("meta"))["clock"] == "seconds of the wall"


def test_what_is_published_is_the_whole_search_and_what_the_catalogue_has() -> None:
    found, data = read_search(), SEARCH
    assert sorted((row.method, row.scene, row.seed) for row in found.rows) == sorted(
        (method, scene, seed) for method in (*CANDIDATES, *REFERENCES) for scene, seed in CELLS
    )
    assert found.standings == standings(found.rows), "the figures of the file follow from its rows"
    assert found.chosen == chosen(found.standings)
    assert CATALOG["qnerf_repaired"].parts == CANDIDATES[found.chosen]
    assert data["candidates"].keys() == CANDIDATES.keys()
    assert all(row.seconds == pytest.approx(SECONDS, rel=0.1) for row in found.rows), "equal time"
    assert (found.history, found.clock) == (list(HISTORY), "processor seconds")
    assert "nine scores had been seen" in found.history[0]
    assert data["provenance"]["commit"]
    known_as = {"qnerf_theorem": "qnerf_theorem", "qnerf_repaired": found.chosen}
    mean = {name: np.mean([row.psnr_val for row in found.rows if row.method == known_as[name]]) for name in BEST_FAITH}
    assert max(BEST_FAITH, key=lambda name: mean[name]) in EXPLAINING, "chosen on validation views"
    assert len(set(BEST_FAITH) & set(EXPLAINING)) == 1


@pytest.mark.parametrize(
    "content",
    ["", "[]", "{}", '{"rows": [{"method": 3}], "standings": [], "chosen": "x"}',
     json.dumps({name: value for name, value in SEARCH.items() if name != "history"})],
)  # fmt: skip
def test_a_file_that_is_no_search_or_does_not_say_what_was_changed_is_named(tmp_path: Path, content: str) -> None:
    file = tmp_path / "search.json"
    file.write_text(content)
    with pytest.raises(InputError, match="python -m harness study repair"):
        read_search(file)
