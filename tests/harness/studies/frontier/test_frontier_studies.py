"""The findings of the frontier on planted cells, and its plans; nothing is trained here."""

import itertools
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from harness.execution.progress import Progress
from harness.plan.run_plan import Machine
from harness.records.cells import CellRecord
from harness.records.study import Effect, Series, StudyRecord
from harness.studies.framework import Found
from harness.studies.frontier.costs import time_to_score
from harness.studies.frontier.error_against_time import error_against_time, larger
from harness.studies.frontier.front import front
from harness.studies.frontier.frontier_context import PHI_METHODS, Amount, FrontierContext
from harness.studies.frontier.frontier_studies import AT_BUDGETS, AT_LARGE_BUDGETS, STUDIES
from harness.studies.frontier.needs import needs, pick
from harness.studies.frontier.peers import Point, peers, read_points
from harness.studies.frontier.phi import phi
from harness.studies.trained_context import StudyRun
from scenes.catalog.entries import CLASSICS
from scenes.files.errors import InputError
from tests.harness.cells import cell, checkpoint, diverged
from tests.harness.studies.evidence.planted import lines, sentences, table

SCENES = ("ficus", "lego", "mic")
OFFSETS = dict(zip(SCENES, (0.0, 5.0, 2.0), strict=True))
SCORES = {4.0: {"nerf": 20.0, "planes": 24.0}, 16.0: {"nerf": 26.0, "planes": 25.0}}
"""nerf overtakes planes between the two budgets: 4 dB behind, then 1 dB ahead."""


@dataclass(frozen=True)
class Planted(FrontierContext):
    """Trainings whose scores are known."""

    cells: dict[str, list[CellRecord]] = field(default_factory=dict)

    def trained(self, name: str) -> StudyRun:
        return StudyRun(self.plan(name), [], self.cells[name])


def planted(cells: dict[str, list[CellRecord]], methods: tuple[str, ...] = ("nerf", "planes")) -> Planted:
    amount = Amount(SCENES, methods, tuple(SCORES), phi_seeds=(0, 1))
    return Planted(Path(), Path(), Path(), False, Progress(), Machine("cpu", 1, 1), False, amount, cells)


def scored(scene: str, method: str, psnr: float, seconds: float, seed: int = 0) -> CellRecord:
    curve = [checkpoint(100, seconds, psnr)]
    scores = {"psnr": psnr, "psnr_floor": 12.0, "psnr_ceiling": 45.0, "depth_rmse": 0.01 * seconds}
    return cell(scene, method, seed, curve, scores=scores, train_core_seconds=seconds)


def two_families(lost: tuple[str, str, float] | None = None) -> Planted:
    cells = {
        f"core_seconds_{budget:g}": [
            diverged(scene, method, 0)
            if (scene, method, budget) == lost
            else scored(scene, method, psnr + OFFSETS[scene], budget)
            for scene in SCENES
            for method, psnr in means.items()
        ]
        for budget, means in SCORES.items()
    }
    return planted(cells)


def line(findings: Iterable[Found], name: str = "nerf", scene: str = "all scenes") -> Series:
    return lines(findings)[f"Error against core seconds of training, {scene}", name]


def test_every_budget_is_a_separate_training_in_core_seconds_with_equal_settings_for_all_families() -> None:
    here = planted({})
    names = here.trainings(STUDIES["needs"], STUDIES["phi"])
    assert names == ["core_seconds_4", "core_seconds_16", "phi"]
    plans = [here.plan(name) for name in names]
    assert {plan.budget.steps for plan in plans} == {None}
    assert [plan.budget.core_seconds for plan in plans] == [4.0, 16.0, 15.0]
    assert plans[2].methods == PHI_METHODS
    assert plans[0].train.grid.first_step < plans[1].train.grid.first_step
    assert {name for study in STUDIES.values() for name in study.trainings} == {AT_BUDGETS, AT_LARGE_BUDGETS, "phi"}
    splats = [plan.train.own["splats"].first for plan in plans[:2]]
    assert splats[0] < splats[1], "more time, more Gaussians"
    (large,) = here.trainings(STUDIES["larger"])
    assert here.plan(large).views.resolution == 400
    assert here.plan(large).scenes == here.amount.large_scenes


def test_the_best_mean_is_named_and_curves_are_errors_with_intervals_over_scenes() -> None:
    findings = list(error_against_time(two_families()))
    mean = 26.0 + 7.0 / 3.0
    best = f"nerf {mean:.2f} dB (depth error 0.160)"
    assert findings[0] == f"At 16 core seconds nerf has the best mean over 3 scenes of 100 pixels: {best}."
    assert table(findings, "depth_over_scenes").rows == [["nerf", "0.040", "0.160"], ["planes", "0.040", "0.160"]]
    over_all = line(findings)
    assert over_all.x == [4.0, 16.0]
    assert over_all.y == pytest.approx([10 ** (-(20.0 + 7.0 / 3.0) / 20), 10 ** (-mean / 20)])
    assert over_all.low is not None
    assert over_all.low[1] < over_all.y[1]  # type: ignore[operator]
    assert line(findings, "copying the nearest training view", "ficus").y == pytest.approx([10**-0.6] * 2)
    assert "± " in str(table(findings, "over_scenes").rows[0][1])


def test_two_scenes_have_no_band() -> None:
    here = two_families()
    over_two = line(error_against_time(replace(here, amount=replace(here.amount, scenes=SCENES[:2]))))
    assert (over_two.low, over_two.high) == ([None, None], [None, None])


def test_a_family_that_failed_on_a_scene_has_no_mean_there_and_is_named() -> None:
    findings = list(error_against_time(two_families(("lego", "nerf", 16.0))))
    assert any("nerf on lego" in sentence for sentence in sentences(findings))
    assert table(findings, "over_scenes").rows[0][2] == "a scene without a score"
    assert line(findings).x == [4.0]
    assert [row[2] for row in table(findings, "by_scene").rows if row[:2] == ["lego", "16"]] == [None]
    assert next(iter(front(two_families(("lego", "nerf", 16.0))))) == (
        "Best mean, with the share of draws of scenes in which it is: planes at 4 core seconds (100 %) and planes at "
        f"16 core seconds ({100 * (1 - (2 / 3) ** 3):.0f} %)."
    )


def test_crossings_and_ranks_of_two_families() -> None:
    here = two_families()
    findings = list(front(here))
    assert findings[1] == (
        "The winner at 4 core seconds, planes, is not that at 16, nerf; Kendall's τ of the two rankings is -1.00."
    )
    at = f"{4 * 4**0.8:.3g}"
    assert table(findings, "crossings").rows == [["nerf", "planes", at, f"{at} to {at}", "100 %"]]
    assert table(findings, "on_front").rows == [["nerf", "0 %", "100 %"], ["planes", "100 %", "0 %"]]
    single = replace(here, amount=replace(here.amount, budgets=(4.0,)))
    assert not any("winner" in sentence for sentence in sentences(front(single)))


def test_pick_names_the_family_of_the_longest_budget_within_the_seconds() -> None:
    findings = [finding for finding in needs(two_families()) if not isinstance(finding, str)]
    record = StudyRecord(STUDIES["needs"].info, findings=findings)
    assert pick(record, "lego", 5.0) == (
        "planes: 29.00 dB on lego in 4 core seconds, 4.00 dB ahead of nerf (one seed: no interval)"
    )
    assert pick(record, "lego", 1e6).startswith("nerf: 31.00 dB on lego in 16 core seconds, 1.00 dB ahead")
    assert pick(record, "thin", 60.0).startswith("nerf: ")
    for scene, seconds, wrong in (("chair", 60.0, "known: thin, detailed, ficus"), ("lego", 1.0, "shortest budget")):
        with pytest.raises(InputError, match=wrong):
            pick(record, scene, seconds)
    with pytest.raises(InputError, match="no choice by scene"):
        pick(None, "lego", 60.0)


def test_a_gain_of_phi_is_judged_against_each_control_by_scenes_and_seeds() -> None:
    gains = {"planes_phi": 0.5, "hash_grid_phi": -0.3}

    def psnr(scene: str, method: str, seed: int) -> float:
        spread = 1 + 0.01 * SCENES.index(scene) + 0.02 * seed
        return 30.0 + OFFSETS[scene] + gains.get(method, 0.0) * spread

    keys = list(itertools.product(SCENES, PHI_METHODS, (0, 1)))
    cells = [scored(scene, method, psnr(scene, method, seed), 15.0, seed) for scene, method, seed in keys]
    findings = list(phi(planted({"phi": cells}, PHI_METHODS)))
    effects = [finding for finding in findings if isinstance(finding, Effect) and finding.scene == "all"]
    assert len({(effect.name, effect.against) for effect in effects}) == 4
    for effect in effects:
        assert effect.difference == pytest.approx(gains[effect.name] * 1.02, rel=1e-6)
        assert (effect.budget, effect.pairs) == ("core_seconds", 6)
        assert effect.verdict.sign == ("above 0" if gains[effect.name] > 0 else "below 0")
    assert "+0.51 dB" in str(findings[0])


def test_larger_pictures_have_a_table_and_lines_of_their_own() -> None:
    here = two_families()
    of_mic = [cell for cell in here.cells["core_seconds_16"] if cell.scene == "mic"]
    amount = replace(here.amount, large_scenes=("mic",), large_families=("nerf", "planes"), large_budgets=(16.0,))
    findings = list(larger(replace(here, amount=amount, cells={"large_16": of_mic})))
    assert "1 scene of 400 pixels: nerf 28.00 dB" in str(findings[0])
    panel = "Error against core seconds of training, all scenes, 400 px"
    assert list(lines(findings))[:2] == [(panel, "nerf"), (panel, "planes")]
    of_nerf = [cell for cell in of_mic if cell.method == "nerf"]
    alone = replace(amount, large_families=("nerf",))
    findings = list(larger(replace(here, amount=alone, cells={"large_16": of_nerf})))
    assert "nerf has this mean over 1 scene" in str(findings[0]), "one family is not the best of several"


def test_others_are_compared_with_the_best_of_ours_in_no_more_time(monkeypatch: pytest.MonkeyPatch) -> None:
    points = [Point("Theirs", "fast", "as it is", "lego", 100, *at) for at in ((3.0, 1.0), (9.0, 29.5), (20.0, 30.5))]
    others = Point("Theirs", "large", "elsewhere", "lego", 400, 9.0, 1.0)
    monkeypatch.setattr("harness.studies.frontier.peers.read_points", lambda: [*points, others])
    findings = list(peers(two_families()))
    assert findings[0] == "Theirs: at 1 of 3 points a family of ours scores higher in no more core seconds."
    # lego: planes 29 dB at 4 s, nerf 31 dB at 16 s
    words = [row[4] for row in table(findings, "peers").rows]
    assert words == ["", "29.0 dB in 4 core s, planes", "31.0 dB in 16 core s, nerf"]
    theirs = line(error_against_time(two_families()), "Theirs, fast", "lego")
    assert (theirs.x, theirs.y) == ([3.0, 9.0, 20.0], pytest.approx([10 ** (-psnr / 20) for psnr in (1.0, 29.5, 30.5)]))


def test_the_points_of_others_can_be_read_and_name_their_protocol() -> None:
    points = read_points()
    assert points
    assert all(point.protocol and point.scene in CLASSICS and 5.0 < point.psnr < 60.0 for point in points)


def test_a_score_that_is_never_reached_takes_more_than_the_longest_budget() -> None:
    rows = time_to_score(two_families().frontier()).rows
    # ficus, lego and mic at 4 and at 16 s: nerf 20 25 22 and 26 31 28; planes 24 29 26 and 25 30 27
    assert rows == [
        ["nerf", "16 (3 of 3 scenes)", "16 (2 of 3 scenes)", "> 16 (1 of 3 scenes)"],
        ["planes", "4 (3 of 3 scenes)", "> 16 (1 of 3 scenes)", "> 16 (1 of 3 scenes)"],
    ]
