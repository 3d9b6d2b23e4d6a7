"""One run of the benchmark for all cases that look at its scenes: nothing twice, nothing forgotten."""

from dataclasses import replace
from pathlib import Path

import pytest

from harness.execution.progress import Quiet
from harness.plan.profiles import Plan
from harness.records.cells import CellRecord, RunRecord, SceneRecord, write_cell, write_run
from harness.studies.stability.stability_context import StabilityContext
from harness.studies.stability.whole_scenes.scene_truth import trained, unscored
from tests.harness.cells import cell, checkpoint, diverged

METHODS = ("nerf", "qnerf")
planned: list[tuple[str, ...]] = []


def scene_record(name: str) -> SceneRecord:
    return SceneRecord(name, name, f"{name}-folder", 8, 8, {}, 2.0, 6.0, [[-1.0] * 3, [1.0] * 3], 40.0, 15.0, {}, [])


def cell_of(scene: str, method: str, seed: int = 0) -> CellRecord:
    if (scene, method) == ("lego", "qnerf"):
        return diverged(scene, method, seed)
    return cell(scene, method, seed, [checkpoint(10, 1.0, 20.0)])


def write(plan: Plan, folder: Path, finished: bool = True) -> None:
    for key in plan.cells():
        write_cell(folder, cell_of(*key))
    scenes = [scene_record(name) for name in plan.scenes]
    methods = {name: name for name in plan.methods}
    write_run(folder, RunRecord("smoke", "", scenes, methods, [], {}, [0], plan.settings(), {}, {}, finished, []))


@pytest.fixture
def situation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> StabilityContext:
    planned.clear()

    def fake(self: StabilityContext, plan: Plan, folder: Path) -> Path:
        planned.append(plan.scenes)
        write(plan, folder)
        return folder

    monkeypatch.setattr(StabilityContext, "trained", fake)
    return StabilityContext(METHODS, tmp_path / "out", tmp_path / "views", tmp_path, 1, False, Quiet())


def test_what_is_there_is_not_run_again(situation: StabilityContext) -> None:
    for _ in range(3):
        found = trained(situation, "smoke", ["lego"], situation.out)
    assert planned == [("lego",)]
    assert [one.method for one in found.of("lego")] == ["nerf", "nerf", "qnerf", "qnerf"]
    assert found.folder("lego") == situation.view_sets / "lego-folder"


def test_a_later_case_never_narrows_the_record(situation: StabilityContext) -> None:
    trained(situation, "smoke", ["lego"], situation.out)
    both = trained(situation, "smoke", ["hotdog"], situation.out)
    assert planned == [("lego",), ("hotdog", "lego")]
    assert {scene for scene, _ in both.cells} == {"hotdog", "lego"}
    assert [scene.name for scene in both.run.scenes] == ["hotdog", "lego"]
    trained(situation, "smoke", ["lego"], situation.out)
    assert len(planned) == 2


def test_a_run_that_was_stopped_or_had_other_settings_goes_on(situation: StabilityContext) -> None:
    plan = situation.plan("smoke", ["lego"])
    write(plan, situation.out, finished=False)
    trained(situation, "smoke", ["lego"], situation.out)
    assert planned == [("lego",)]
    trained(replace(situation, methods=("nerf",)), "smoke", ["lego"], situation.out)
    assert len(planned) == 2


def test_a_damaged_record_is_run_again(situation: StabilityContext) -> None:
    trained(situation, "smoke", ["lego"], situation.out)
    (situation.out / "records" / "run.json").write_text("{")
    trained(situation, "smoke", ["lego"], situation.out)
    assert len(planned) == 2


def test_a_cell_without_scores_is_told_from_a_whole_one() -> None:
    assert unscored("S1", cell("a", "nerf", 0, [checkpoint(1, 1.0, 20.0)]), "x") is None
    broke = unscored("S1", diverged("a", "nerf", 0), "x")
    assert broke is not None
    assert (broke.status, broke.value, broke.is_broken) == ("fail", None, True)
    assert "not finite at step 7: loss" in broke.why
    paper = unscored("S1", diverged("a", "qnerf", 0), "x")
    assert paper is not None
    assert not paper.is_broken
    missing = unscored("S1", cell("a", "nerf", 0, [], status="not_available", reason="no LLVM"), "x")
    assert missing is not None
    assert (missing.status, missing.is_broken) == ("not_available", False)
