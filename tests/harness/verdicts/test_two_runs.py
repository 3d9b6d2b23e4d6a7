"""Two outputs of one plan: differences are measured, and outputs of other plans are refused."""

import json
from pathlib import Path

import pytest
from msgspec.structs import replace

from harness.command.main import main
from harness.records.cells import CellRecord, write_cell, write_run
from harness.verdicts.judging.two_runs import two_runs
from scenes.files.errors import InputError
from tests.harness.cells import cell, checkpoint, diverged, with_core_seconds
from tests.harness.records.test_records import one_run

METHODS = ("nerf", "qnerf")


def cells_of(gain: float, moved: float = 0.0, instruction_set: str = "AVX512") -> list[CellRecord]:
    """Return cells with qnerf `gain` dB above nerf, all moved by `moved` on scene a and by −2 `moved` on scene b."""
    return [
        cell(
            scene, method, seed,
            [checkpoint(10, 1.0, 20.0 + 0.1 * seed * (method == "qnerf") + gain * (method == "qnerf") + move)],
            provenance={"threads": 1, "instruction_set": instruction_set},
        )
        for scene, move in (("a", moved), ("b", -2 * moved)) for method in METHODS for seed in range(3)
    ]  # fmt: skip


def output(folder: Path, cells: list[CellRecord], **changes: object) -> Path:
    settings = {"budget": {"steps": 10}, "precision": "float32"}
    run = replace(one_run(), methods=dict.fromkeys(METHODS, "m"), settings=settings)
    write_run(folder, replace(run, **changes))
    for record in cells:
        write_cell(folder, record)
    return folder


@pytest.fixture
def first(tmp_path: Path) -> Path:
    return output(tmp_path / "first", cells_of(1.0))


def test_how_far_scores_and_differences_moved(first: Path, tmp_path: Path) -> None:
    result = two_runs(
        first, output(tmp_path / "second", cells_of(-1.2, 0.1, "AVX2"), settings={"budget": {"steps": 10}})
    )
    assert result.origins == {"instruction_set": (["AVX512"], ["AVX2"])}
    nerf, qnerf = result.by_method
    assert (nerf.rms, nerf.mean) == (pytest.approx(((0.1**2 + 0.2**2) / 2) ** 0.5), pytest.approx(-0.05))
    assert (qnerf.cells, qnerf.largest) == (6, pytest.approx(-2.4))
    assert qnerf.largest_of.startswith("b qnerf")
    assert [(found.method, found.against, found.budget) for found in result.moved] == [
        ("qnerf", "nerf", "steps"), ("qnerf", "nerf", "seconds"),
    ]  # fmt: skip
    steps = result.moved[0]
    assert steps.difference == pytest.approx(-2.2)
    assert steps.on_these_scenes.verdict.phrase == "below 0, matters"


def test_the_same_output_again_differs_in_nothing(first: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = two_runs(first, first)
    assert (result.identical, result.origins, result.lost) == (12, {}, [])
    assert (result.all.rms, [found.difference for found in result.moved]) == (0.0, [0.0, 0.0])
    assert main(["compare", str(first), str(first), "--json", str(first / "x.json")]) == 0
    text = capsys.readouterr().out
    assert "12 of 12 cells are bit-identical" in text
    assert json.loads((first / "x.json").read_text())["all"]["rms"] == 0


def test_budgets_that_an_older_output_lacks_are_left_out(first: Path, tmp_path: Path) -> None:
    again = two_runs(first, output(tmp_path / "counted", [with_core_seconds(cell, 2.0) for cell in cells_of(1.0)]))
    same = two_runs(first, first)
    assert [found.budget for found in again.moved] == [found.budget for found in same.moved] == ["steps", "seconds"]
    counted = two_runs(tmp_path / "counted", tmp_path / "counted")
    assert [found.budget for found in counted.moved] == ["steps", "seconds", "core_seconds"]


def test_a_cell_lost_in_one_is_named(first: Path, tmp_path: Path) -> None:
    cells = cells_of(1.0)
    cells[-1] = diverged("b", "qnerf", 2)
    result = two_runs(first, output(tmp_path / "second", cells))
    assert result.lost == ["b qnerf seed 2: done, then diverged"]


def test_a_method_with_a_budget_of_time_is_named_and_not_compared(first: Path, tmp_path: Path) -> None:
    cells = [replace(cell, steps=cell.steps + (cell.method == "qnerf")) for cell in cells_of(3.0)]
    result = two_runs(first, output(tmp_path / "second", cells))
    assert (result.timed, [apart.where for apart in result.by_method]) == (["qnerf"], ["nerf"])
    assert (result.moved, result.over_all) == ([], [])
    assert result.all.rms == 0.0


def test_outputs_of_other_plans_are_refused_in_words(first: Path, tmp_path: Path) -> None:
    cells = cells_of(1.0)
    others = {
        "scenes a, b against a": output(tmp_path / "1", [record for record in cells if record.scene == "a"]),
        "seeds 0, 1, 2 against 0, 1": output(tmp_path / "2", [record for record in cells if record.seed < 2]),
        "b qnerf 2 is in only one of them": output(tmp_path / "3", cells[:-1]),
        "budget.steps is 10 against 20": output(tmp_path / "4", cells, settings={"budget": {"steps": 20}}),
        "no run in it": tmp_path / "nothing",
    }
    for words, other in others.items():
        with pytest.raises(InputError, match=words):
            two_runs(first, other)
    assert main(["compare", str(first), str(tmp_path / "nothing")]) == 2
