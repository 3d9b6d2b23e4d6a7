"""What pages take from published records: changes between runs, replicates and constants are told."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.verdicts.changes import change
from tests.harness.shell import ROOT
from tools.published.published_cells import cells_of, condition_of
from tools.published.replicates import Run, answer
from tools.published.search_blocks import choice, difference, drawings, main, means, on_complete_scenes, surface

METHODS = ["nerf", "nerf_matched", "qnerf"]


def published(name: str) -> dict[str, Any]:
    return json.loads((ROOT / "docs" / name / "summary.json").read_text(encoding="utf-8"))


def test_early_and_late_are_compared_by_their_change() -> None:
    early, late = (condition_of(published(name), METHODS) for name in ("reduced", "converged"))
    known = change("qnerf", "nerf", early, late)
    assert known.judgement.pairs == len(cells_of(published("converged"), ["qnerf"]))
    assert known.judgement.difference == pytest.approx(known.after - known.before)


ABOVE, OPEN = {"sign": "above 0", "size": "matters"}, {"sign": "open", "size": "open"}
PAIRS = (("qnerf", "nerf"), ("qnerf", "nerf_matched"), ("qnerf_repaired", "nerf"), ("qnerf_repaired", "nerf_matched"))


def made_up(*pairs: tuple[str, str]) -> Run:
    like = {"verdict": ABOVE}
    row = {"metric": "psnr", "budget": "steps", "difference": 0.5, "verdict": ABOVE, "scenes_like_these": like}
    rows = [{**row, "scene": "all", "method": method, "against": against} for method, against in pairs]
    scenes = [{"scene": name} for name in "abcd"]
    return {"comparisons": rows, "scenes": scenes, "headline": "nothing", "last_doubling": []}


def test_every_contender_has_its_clause_and_one_that_was_not_run_has_none() -> None:
    title = answer(made_up(*PAIRS), {})
    clauses = ["qnerf gains 0.50 dB over nerf", "qnerf_repaired gains 0.50 dB over nerf, more"]
    assert all(words in title for words in [*clauses, "qnerf_repaired gains 0.50 dB over nerf_matched, more"])
    assert "repaired" not in answer(made_up(*PAIRS[:2]), {})
    assert answer(made_up(*PAIRS[2:]), {}) == "nothing"


def test_words_that_a_replicate_does_not_repeat_are_not_said() -> None:
    row = {"method": "qnerf_repaired", "against": "nerf", "budget": "steps", "difference": 0.4}
    for verdict, clause in (
        (ABOVE, "qnerf_repaired gains 0.50 dB over nerf, more than the 0.2 dB that matter"),
        (OPEN, "the sign of qnerf_repaired − nerf is open (+0.40 to +0.50 dB in two runs)"),
    ):
        replicate = {"comparisons": [{**row, "scenes_like_these": {"verdict": verdict}}]}
        assert clause in answer(made_up(*PAIRS), {"runs": [replicate]})


CONSTANTS = [(1.0, None), (25.0, None), (25.0, 0.3)]


def row(pair: tuple[float, float | None], scene: str, steps: int, psnr: float | None) -> dict[str, Any]:
    constants = {"unit": pair[0], "start": pair[1]}
    return {"method": "nerf", "constants": constants, "scene": scene, "steps": steps, "psnr_val": psnr}


def search(**changes: Any) -> dict[str, Any]:
    rows = [
        row(pair, scene, 10, 20.0 + place + 2 * (scene == "b"))
        for place, pair in enumerate(CONSTANTS)
        for scene in "ab"
    ]
    rows += [row(CONSTANTS[1], "a", 40, 30.0), row(CONSTANTS[1], "b", 40, 34.0)]
    rows += [row((100.0, None), "a", 10, 99.0), row((100.0, None), "b", 10, None)]
    about = {"seed": 1000, "provenance": {"commit": "abc"}, "rule": "The best is chosen."}
    return {"rows": rows, "chosen": {"nerf": {"unit": 25.0, "start": None}}, **about, **changes}


def test_the_choice_has_the_range_of_means_without_pairs_that_diverged_on_a_scene() -> None:
    assert means(search(), "nerf", 10) == dict(zip(CONSTANTS, (21.0, 22.0, 23.0), strict=True))
    assert "| `nerf` | 25 | as printed | 32.00 | 21.00 to 23.00 |" in choice(search())
    assert choice(search()).endswith("Means over a and b; seed 1000, commit abc. The best is chosen.")


def test_a_line_for_each_start_and_marks_for_the_finalists() -> None:
    (panel,) = surface(search())
    assert [(trace.label, trace.kind, trace.x, trace.y) for trace in panel.traces] == [
        ("start as printed", "line", (1.0, 25.0), (21.0, 22.0)),
        ("start 0.3", "line", (25.0,), (23.0,)),
        ("start as printed, 40 steps", "mark", (25.0,), (32.0,)),
    ]
    ((_, key),) = drawings(search())
    assert set(key) == {trace.label for trace in panel.traces}


def test_the_difference_at_the_constants_of_each_is_judged_over_scenes() -> None:
    gains = dict(zip("abcd", (0.1, 0.3, 0.5, 0.7), strict=True))
    rows = [row(CONSTANTS[1], scene, 40, 30.0) for scene in gains]
    rows += [row(CONSTANTS[0], scene, 40, 30.0 + gain) | {"method": "qnerf"} for scene, gain in gains.items()]
    rows += [row(CONSTANTS[1], scene, 40, 99.0) | {"method": "qnerf"} for scene in gains]
    made = search(rows=rows, chosen={"nerf": {"unit": 25.0, "start": None}, "qnerf": {"unit": 1.0, "start": None}})
    # Student's t of 3 degrees of freedom at 1 - 0.05 / (2 · 6), times the standard error of four scenes
    half = 6.23154 * np.std(list(gains.values()), ddof=1) / 2
    expected = f"`qnerf` − `nerf` +0.40 dB (−{half - 0.4:.2f} to +{half + 0.4:.2f}: sign and size open)"
    assert difference(made, "qnerf", "nerf") == expected
    assert difference(made, "qnerf_shifted", "nerf") == ""


def test_a_search_that_was_stopped_shows_the_best_so_far_on_complete_scenes() -> None:
    part = search(chosen={})
    part["rows"] = [line for line in part["rows"] if line["steps"] == 10 and line["constants"]["unit"] < 100]
    part["rows"].remove(next(line for line in part["rows"] if line["scene"] == "b"))
    text = choice(on_complete_scenes(part))
    for words in ("| `nerf` | 25 | 0.3 | 22.00 | 20.00 to 22.00 |", "**Not finished**", "Means over a; seed"):
        assert words in text


def test_the_command_draws_the_record(tmp_path: Path) -> None:
    record, picture = tmp_path / "constants.json", tmp_path / "surface.png"
    record.write_text(json.dumps(search()), encoding="utf-8")
    assert main(str(record), str(picture)) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
