"""Changes of differences between situations, by hand and by simulation; two outputs of one plan."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.stats import ttest_1samp

from harness.command.main import main
from harness.records.cells import USUAL, CellRecord, Roles, write_cell, write_run
from harness.verdicts.changes import Condition, change, change_of, changes
from harness.verdicts.judging.two_runs import two_runs
from scenes.files.errors import InputError
from tests.harness.cells import cell, checkpoint, diverged, with_core_seconds
from tests.harness.records.test_records import one_run

METHODS = ["nerf", "nerf_matched", "qnerf"]


def cells_of(
    gains: np.ndarray, method: str = "qnerf", seeds: tuple[int, ...] = (0, 1, 2),
    moved: tuple[float, ...] = (0.0,) * 8, instruction_set: str = "AVX512",
) -> list[CellRecord]:  # fmt: skip
    """Return cells of nerf at 20 dB, and of `method` above it by `gains` [scenes, seeds]; `moved` [scenes] is added."""
    return [
        cell(
            str(scene), name, seed, [checkpoint(10, 1.0, 20.0), checkpoint(100, 10.0, 20.0 + gain + move)],
            provenance={"threads": 1, "instruction_set": instruction_set},
        )
        for scene, (row, move) in enumerate(zip(gains, moved, strict=False))
        for seed, more in zip(seeds, row, strict=True)
        for name, gain in (("nerf", 0.0), (method, float(more)))
    ]  # fmt: skip


def test_a_change_is_judged_by_the_pairs_of_scene_and_seed() -> None:
    draw = np.random.default_rng(0).normal
    before, after = draw(0.3, 0.2, (8, 3)), draw(-0.1, 0.2, (8, 3))
    found = change("qnerf", "nerf", Condition(cells_of(before)), Condition(cells_of(after)))
    moved = (after - before).mean(axis=1)
    assert (found.before, found.after) == (pytest.approx(before.mean()), pytest.approx(after.mean()))
    assert list(found.by_scene.values()) == pytest.approx(moved.tolist())
    like = found.judgement.scenes_like_these
    expected = ttest_1samp(moved, 0.0)
    assert like.p == pytest.approx(expected.pvalue)
    assert like.interval == pytest.approx(tuple(expected.confidence_interval()))


def test_two_words_may_differ_where_nothing_changed_and_agree_where_much_did() -> None:
    """Near a limit, +0.01 and −0.01 of a standard error are no change; +1 and +3 dB with one verdict are a change."""
    small = np.tile([0.195, 0.2, 0.205], (8, 1)) + np.linspace(-0.01, 0.01, 8)[:, None]
    found = change_of(
        "a", "b", *({str(k): row for k, row in enumerate(side)} for side in (small - 0.001, small + 0.001)), paired=True
    )
    assert found.judgement.chosen.verdict.size == "smaller than matters"
    large = [small + more for more in (0.8, 2.8 + np.linspace(-0.1, 0.1, 8)[:, None])]
    found = change_of("a", "b", *({str(k): row for k, row in enumerate(side)} for side in large), paired=True)
    assert found.judgement.chosen.verdict.phrase == "above 0, matters"


def test_other_seeds_are_not_paired_and_have_errors_of_both_sides() -> None:
    draw = np.random.default_rng(1).normal
    before, after = draw(0.0, 0.2, (4, 3)), draw(1.0, 0.5, (4, 5))
    sides = Condition(cells_of(before)), Condition(cells_of(after, seeds=(7, 8, 9, 10, 11)))
    found = change("qnerf", "nerf", *sides)
    here = found.judgement.on_these_scenes
    error = math.sqrt(before.var(axis=1, ddof=1).sum() / 3 + after.var(axis=1, ddof=1).sum() / 5) / 4
    assert 1.96 < (here.interval[1] - here.interval[0]) / 2 / error < 3.0
    expected = ttest_1samp(after.mean(axis=1) - before.mean(axis=1), 0.0).confidence_interval()
    assert found.judgement.scenes_like_these.interval == pytest.approx(tuple(expected))


def test_only_what_both_situations_have_counts() -> None:
    gains = np.full((3, 3), 1.0) + np.random.default_rng(2).normal(0, 0.1, (3, 3))
    before, after = cells_of(gains), [one for one in cells_of(gains + 1.0) if one.scene != "2"]
    after = [replace(one, status="diverged") if (one.scene, one.seed) == ("1", 0) else one for one in after]
    found = change("qnerf", "nerf", Condition(before), Condition(after))
    assert set(found.by_scene) == {"0", "1"}
    assert (found.judgement.pairs, found.judgement.unpaired) == (5, 1)
    assert found.judgement.difference == pytest.approx(1.0)
    assert found.after - found.before == pytest.approx(1.0)
    assert change("qnerf", "other", Condition(before), Condition(after)) is None


def test_steps_and_seconds_of_one_run_are_two_situations() -> None:
    cells = [
        replace(one, train_seconds=2 * one.train_seconds, curve=[replace(p, seconds=2 * p.seconds) for p in one.curve])
        if one.method == "qnerf"
        else one
        for one in cells_of(np.random.default_rng(3).normal(1.0, 0.1, (6, 3)))
    ]
    found = change("qnerf", "nerf", Condition(cells), Condition(cells, "seconds"))
    assert found.after < found.before, "qnerf is slower"
    assert found.judgement.chosen.verdict.sign == "below 0"


def test_all_pairs_are_looked_at_together() -> None:
    gains = np.random.default_rng(4).normal(0.2, 0.1, (6, 3))
    cells = cells_of(gains) + [one for one in cells_of(gains, "nerf_matched") if one.method != "nerf"]
    found = changes(USUAL.pairs(METHODS), Condition(cells), Condition(cells))
    assert {(one.method, one.against) for one in found} == {
        ("nerf_matched", "nerf"), ("qnerf", "nerf"), ("qnerf", "nerf_matched"),
    }  # fmt: skip
    assert {one.judgement.chosen.family for one in found} == {3}
    assert {one.judgement.difference for one in found} == {0.0}


# two outputs of one plan


FIRST, BELOW = np.array([[1.0, 1.1, 1.2]] * 2), np.array([[-1.2, -1.1, -1.0]] * 2)
"""Gains of qnerf over nerf on two scenes, above and below 0."""


def output(folder: Path, cells: list[CellRecord], **changes: object) -> Path:
    settings = {"budget": {"steps": 10}, "train": {"precision": "float32"}}
    run = replace(one_run(), methods=dict.fromkeys(("nerf", "qnerf"), "m"), settings=settings)
    write_run(folder, replace(run, **changes))
    for record in cells:
        write_cell(folder, record)
    return folder


@pytest.fixture
def first(tmp_path: Path) -> Path:
    return output(tmp_path / "first", cells_of(FIRST))


def test_how_far_scores_and_differences_moved(first: Path, tmp_path: Path) -> None:
    cells = cells_of(BELOW, moved=(0.1, -0.2), instruction_set="AVX2")
    settings = {"budget": {"steps": 10}, "train": {"precision": "bfloat16"}}
    result = two_runs(first, output(tmp_path / "second", cells, settings=settings))
    assert result.origins == {"instruction_set": (["AVX512"], ["AVX2"]), "precision": (["float32"], ["bfloat16"])}
    nerf, qnerf = result.by_method
    assert (nerf.rms, nerf.mean) == (pytest.approx(((0.1**2 + 0.2**2) / 2) ** 0.5), pytest.approx(-0.05))
    assert (qnerf.cells, qnerf.largest) == (6, pytest.approx(-2.4))
    assert qnerf.largest_of.startswith("1 qnerf")
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
    counted = output(tmp_path / "counted", [with_core_seconds(cell, 2.0) for cell in cells_of(FIRST)])
    assert [found.budget for found in two_runs(first, counted).moved] == ["steps", "seconds"]
    assert [found.budget for found in two_runs(counted, counted).moved] == ["steps", "core_seconds"]


def test_pairs_are_those_of_the_run(first: Path, tmp_path: Path) -> None:
    other = output(tmp_path / "other", cells_of(FIRST), roles=Roles("qnerf"))
    result = two_runs(other, other)
    assert {(row.method, row.against) for row in (*result.moved, *result.over_all)} == {("nerf", "qnerf")}


def test_a_cell_lost_in_one_is_named(first: Path, tmp_path: Path) -> None:
    cells = cells_of(FIRST)
    cells[-1] = diverged("1", "qnerf", 2)
    result = two_runs(first, output(tmp_path / "second", cells))
    assert result.lost == ["1 qnerf seed 2: done, then diverged"]


def test_a_method_with_a_budget_of_time_is_named_and_not_compared(first: Path, tmp_path: Path) -> None:
    cells = [replace(cell, steps=cell.steps + (cell.method == "qnerf")) for cell in cells_of(BELOW)]
    result = two_runs(first, output(tmp_path / "second", cells))
    assert (result.timed, [apart.where for apart in result.by_method]) == (["qnerf"], ["nerf"])
    assert (result.moved, result.over_all) == ([], [])
    assert result.all.rms == 0.0


def test_outputs_of_other_plans_are_refused_in_words(first: Path, tmp_path: Path) -> None:
    cells = cells_of(FIRST)
    others = {
        "scenes 0, 1 against 0": output(tmp_path / "1", [record for record in cells if record.scene == "0"]),
        "seeds 0, 1, 2 against 0, 1": output(tmp_path / "2", [record for record in cells if record.seed < 2]),
        "1 qnerf 2 is in only one of them": output(tmp_path / "3", cells[:-1]),
        "budget.steps is 10 against 20": output(tmp_path / "4", cells, settings={"budget": {"steps": 20}}),
        "no run in it": tmp_path / "nothing",
    }
    for words, other in others.items():
        with pytest.raises(InputError, match=words):
            two_runs(first, other)
