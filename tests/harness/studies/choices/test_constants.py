"""The search for unit of density and start: its rule where the right choice is known, and a tiny real search."""

import json
from itertools import chain
from pathlib import Path

import pytest

from baselines.catalog import CATALOG
from baselines.methods.chosen import FILE, DensityConstants, chosen
from baselines.methods.repaired import CANDIDATES
from harness.command.plan_options import planned
from harness.plan.profiles import PROFILES
from harness.records.json_record import write_json
from harness.studies.choices import constants
from harness.studies.choices.arms import trained_cell
from harness.studies.choices.constants import READINGS, SHARE, ConstantsRow, finalists, pairs_of, read_rows, search
from scenes.files.errors import InputError
from tests.harness.ball import ball_with_validation_views
from tests.harness.tiny import TRAIN
from tests.replacing import replace

SCENES = ("a", "b")


def rows_of(method: str, scores: dict[DensityConstants, tuple[float | None, ...]], steps: int) -> list[ConstantsRow]:
    return [
        ConstantsRow(method, pair, scene, steps, score, 1.0)
        for pair, some in scores.items()
        for scene, score in zip(SCENES, some, strict=True)
    ]


FIRST, SECOND, LOST = DensityConstants(1.0, None), DensityConstants(25.0, 0.3), DensityConstants(100.0, 3.0)
BRIEF = rows_of("nerf", {FIRST: (30.0, 20.0), SECOND: (24.0, 24.0), LOST: (20.0, 20.0)}, 10)


FULL = rows_of("nerf", {FIRST: (25.0, 25.0), SECOND: (20.0, 31.0), LOST: (10.0, 10.0)}, 40)
DIVERGED = rows_of("nerf", {FIRST: (20.0, 20.0), SECOND: (10.0, 10.0), LOST: (99.0, None)}, 40)


@pytest.mark.parametrize(
    ("rows", "choice"),
    [
        (BRIEF + FULL, {"nerf": SECOND}),
        (BRIEF + DIVERGED, {"nerf": FIRST}),
        (BRIEF + [replace(row, psnr_val=None) for row in FULL], {}),
        (BRIEF + FULL[:-1], {}),  # stopped
        ([*BRIEF, *FULL, *rows_of("qnerf", {FIRST: (30.0, 30.0)}, 10)], {}),  # stopped before another method
    ],
)
def test_the_best_mean_after_all_steps_is_chosen_once_the_search_is_complete(
    rows: list[ConstantsRow], choice: dict[str, DensityConstants]
) -> None:
    assert list(constants.means(BRIEF, "nerf")) == [FIRST, SECOND, LOST]
    assert constants.chosen(rows, 40) == choice


def test_the_best_unit_of_each_start_is_trained_to_the_end() -> None:
    by_rank = [(25.0, 3.0), (100.0, 3.0), (3.0, None), (10.0, None), (25.0, 0.3)]
    pairs = [DensityConstants(*pair) for pair in by_rank]
    rows = rows_of("nerf", {pair: (30.0 - place, 30.0) for place, pair in enumerate(pairs)}, 10)
    assert finalists(rows, "nerf") == [pairs[0], pairs[2], pairs[4], pairs[1]]
    one_start = [row for row in rows if row.constants.start == 3.0]
    assert finalists(one_start, "nerf") == pairs[:2]


def test_the_best_pairs_of_a_shorter_search_are_carried_over() -> None:
    carried = constants.best_of(BRIEF + FULL, ["nerf"], 2)
    assert carried == {"nerf": [SECOND, FIRST]}, "by the longest training of the search"
    for rows in ([], BRIEF + FULL):
        with pytest.raises(InputError, match="qnerf has no pair that ended well"):
            constants.best_of(rows, ["qnerf"], 2)
    late = rows_of("nerf", {FIRST: (33.0, 33.0), SECOND: (32.0, 33.5)}, 160)
    assert constants.chosen(late, 160, carried) == {"nerf": FIRST}
    assert constants.chosen(late[:-1], 160, carried) == {}, "stopped"


def test_every_pair_that_a_method_can_have_is_tried() -> None:
    assert len(pairs_of("nerf")) == len(constants.UNITS) * 4
    assert {pair.start for pair in pairs_of("qnerf")} == {None}, "Listing 2 as printed has no shift"
    assert all(pair.start is not None and pair.start < pair.unit for pair in pairs_of("qnerf_shifted"))
    assert {method for method, starts in READINGS.items() if None in starts} == READINGS.keys() - {"qnerf_shifted"}


@pytest.mark.slow
def test_a_tiny_search_trains_each_pair_and_then_the_finalists(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(constants, "trained_cells", lambda tasks, workers: map(trained_cell, tasks))
    monkeypatch.setattr(constants, "UNITS", (3.0, 25.0))
    folder = ball_with_validation_views(tmp_path / "ball")
    smoke = planned("smoke", methods=["qnerf"], budget_steps=2 * SHARE, resolution=16)
    plan = replace(smoke, scenes=("ball",), train=replace(smoke.train, rays=32, network=TRAIN.network))
    rows = list(chain(*search(plan, {"ball": folder}, tmp_path, 1, "cpu", [])))
    brief, full = ([row.constants for row in rows if row.steps == steps] for steps in (2, 2 * SHARE))
    assert brief == pairs_of("qnerf")
    assert sorted(map(str, full)) == sorted(map(str, finalists(rows[: len(brief)], "qnerf")))
    assert len({row.psnr_val for row in rows}) == len(rows), "each pair is another training"
    carried = constants.best_of(rows, ["qnerf"], 1)
    late = list(chain(*search(plan, {"ball": folder}, tmp_path, 1, "cpu", [], carried)))
    assert [_result(row) for row in late] == [_result(row) for row in rows if row.constants in carried["qnerf"]][1:]
    file = tmp_path / "record.json"
    write_json(file, constants.as_json(rows[3:], plan, {}))
    again = search(plan, {"ball": folder}, tmp_path, 1, "cpu", read_rows(file, plan))
    assert sorted(map(_result, chain(*again))) == sorted(map(_result, rows)), "what is missing is trained alike"
    with pytest.raises(InputError, match="was made with other settings"):
        read_rows(file, planned("smoke", methods=["qnerf"], budget_steps=SHARE, resolution=16))
    file.write_text("[]")
    with pytest.raises(InputError, match="not a record of a search"):
        read_rows(file, plan)


def test_a_search_can_be_resumed_after_its_choice_was_adopted() -> None:
    plan = planned("smoke", methods=["nerf"])
    own = replace(plan.own_settings(["nerf"])["nerf"], density_scale=7.0, start=None)
    adopted = replace(plan, train=replace(plan.train, own={"nerf": own}))
    assert adopted.settings() != plan.settings()
    assert constants.settings_of(adopted) == constants.settings_of(plan)
    other = replace(plan, train=replace(plan.train, own={"nerf": replace(own, encoding="phi")}))
    assert constants.settings_of(other) != constants.settings_of(plan)


def _result(row: ConstantsRow) -> str:
    return str(replace(row, core_seconds=0.0))


def test_methods_are_made_with_their_constants() -> None:
    for method, pair in chosen("reduced").items():
        parts = CATALOG[method].parts
        assert parts is not None
        assert (parts.density_scale, parts.start) == (pair.unit, pair.start)
    assert set(json.loads(FILE.read_text(encoding="utf-8"))) <= set(PROFILES)
    assert set(READINGS) == set(chosen("reduced"))


def test_the_constants_are_those_of_the_published_search() -> None:
    rows = read_rows(Path("docs/constants.json"))
    steps = max(row.steps for row in rows)
    choice = constants.chosen(rows, steps)
    assert choice == chosen("reduced")
    full = [row for row in rows if row.steps == steps]
    best = max(("qnerf_shifted", *CANDIDATES), key=lambda method: constants.means(full, method)[choice[method]])
    assert CATALOG["qnerf_repaired"].parts == CATALOG[best].parts
    assert {row.scene for row in rows} == set(PROFILES["reduced"].scenes)
    seed = json.loads(Path("docs/constants.json").read_text(encoding="utf-8"))["seed"]
    assert seed not in {seed for plan in PROFILES.values() for seed in plan.seeds}


@pytest.mark.parametrize(
    ("profile", "file", "before"),
    [("converged", "constants_late", "constants"), ("full", "constants_400", "constants_late")],
)
def test_constants_of_later_profiles_are_those_of_their_search(profile: str, file: str, before: str) -> None:
    rows = read_rows(Path(f"docs/{file}.json"))
    methods = list(dict.fromkeys(row.method for row in rows))
    carried = constants.best_of(read_rows(Path(f"docs/{before}.json")), methods, 3)
    assert constants.chosen(rows, max(row.steps for row in rows), carried) == chosen(profile)
