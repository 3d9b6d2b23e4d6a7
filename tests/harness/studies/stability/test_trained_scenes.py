"""One run for all cases about scenes: nothing is trained twice, and no scene is dropped."""

from dataclasses import replace
from pathlib import Path

import pytest

from harness.execution import run as execution
from harness.plan.run_plan import Plan
from harness.records.cells import CellRecord, RunRecord, SceneRecord, write_cell, write_run
from harness.studies.stability.stability_context import StabilityContext
from harness.studies.stability.whole_scenes.scene_truth import each_method, trained
from tests.harness.cells import cell, checkpoint, diverged
from tests.harness.studies.stability.made_up import context_in, run_of

planned: list[tuple[str, ...]] = []


def scene_record(name: str) -> SceneRecord:
    return SceneRecord(name, name, f"{name}-folder", 8, 8, {}, 2.0, 6.0, [[-1.0] * 3, [1.0] * 3], 40.0, 15.0, {}, [])


def write(plan: Plan, folder: Path, finished: bool = True) -> None:
    for key in plan.cells():
        write_cell(folder, cell(*key, [checkpoint(10, 1.0, 20.0)]))
    scenes = [scene_record(name) for name in plan.scenes]
    methods = {name: name for name in plan.methods}
    write_run(folder, RunRecord("smoke", "", scenes, methods, [], [0], plan.settings(), {}, {}, finished, []))


@pytest.fixture
def context(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> StabilityContext:
    planned.clear()

    def fake(plan: Plan, folder: Path, *others: object) -> None:
        planned.append(plan.scenes)
        write(plan, folder)

    monkeypatch.setattr(execution, "run", fake)
    return context_in(tmp_path, "nerf", "qnerf", quick=False)


def test_existing_cells_are_not_trained_again(context: StabilityContext) -> None:
    for _ in range(3):
        run = trained(context, "smoke", ["lego"], context.out)
    assert planned == [("lego",)]
    assert [cell.method for cell in run.of("lego")] == ["nerf", "nerf", "qnerf", "qnerf"]
    assert run.folder("lego") == context.view_sets / "lego-folder"


def test_a_later_case_never_narrows_the_record(context: StabilityContext) -> None:
    trained(context, "smoke", ["lego"], context.out)
    both = trained(context, "smoke", ["hotdog"], context.out)
    assert planned == [("lego",), ("hotdog", "lego")]
    assert {scene for scene, _ in both.cells} == {"hotdog", "lego"}
    assert [scene.name for scene in both.run.scenes] == ["hotdog", "lego"]
    trained(context, "smoke", ["lego"], context.out)
    assert len(planned) == 2


def test_a_stopped_or_damaged_run_or_one_with_other_settings_is_run_again(context: StabilityContext) -> None:
    write(context.plan("smoke", ["lego"]), context.out, finished=False)
    trained(context, "smoke", ["lego"], context.out)
    assert planned == [("lego",)]
    trained(replace(context, methods=("nerf",)), "smoke", ["lego"], context.out)
    assert len(planned) == 2
    (context.out / "records" / "run.json").write_text("{")
    trained(context, "smoke", ["lego"], context.out)
    assert len(planned) == 3


@pytest.mark.parametrize(
    ("record", "status", "is_broken"),
    [
        (cell("lego", "nerf", 0, [checkpoint(1, 1.0, 20.0)]), "pass", False),
        (diverged("lego", "nerf", 0), "fail", True),
        (diverged("lego", "qnerf", 0), "fail", False),
        (cell("lego", "nerf", 0, [], status="not_available", reason="no LLVM"), "not_available", False),
    ],
)
def test_a_cell_without_scores_fails_unless_it_is_not_available(
    record: CellRecord, status: str, is_broken: bool
) -> None:
    (outcome,) = each_method(run_of(Path(), record), "lego", "error", lambda _: 0.5, high=1.0)
    assert (outcome.status, outcome.is_broken) == (status, is_broken)
    assert outcome.value == (0.5 if status == "pass" else None)
    assert (record.reason or "") in outcome.why
