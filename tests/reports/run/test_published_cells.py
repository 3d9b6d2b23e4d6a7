"""The functions that judge a run also judge a published summary, from its cells."""

import json
from typing import Any

import pytest

from harness.records.former.four_words import in_two_words
from harness.verdicts.changes import change
from reports.run.saving.published_cells import cells_of, condition_of, judged_again
from reports.run.saving.run_blocks import DUELS
from tests.harness.shell import ROOT

METHODS = ["nerf", "nerf_matched", "qnerf"]


def published(name: str) -> dict[str, Any]:
    return in_two_words(json.loads((ROOT / "docs" / name / "summary.json").read_text(encoding="utf-8")))


def test_differences_are_the_published_ones_and_verdicts_those_of_this_version() -> None:
    run = published("reduced")
    again = judged_again(run)
    names = ("scene", "method", "against", "metric", "budget")
    before, after = ({tuple(row[name] for name in names): row for row in of["comparisons"]} for of in (run, again))
    assert before.keys() == after.keys()
    for key, row in before.items():
        assert after[key]["difference"] == pytest.approx(row["difference"], abs=1e-9)
        assert after[key]["interval"] is None or key[0] != "all" or after[key]["pairs"] == row["pairs"]
    main = after["all", "qnerf", "nerf", "psnr", "steps"]
    assert main["family"] == len(DUELS) * 2, "at equal steps and at equal core seconds"
    assert main["scenes_like_these"]["interval"] == pytest.approx(
        before["all", "qnerf", "nerf", "psnr", "steps"]["interval"]
    )
    assert judged_again(again) is again, "a summary of this version stays as it is"


def test_early_and_late_are_compared_by_their_change() -> None:
    early, late = (condition_of(published(name), METHODS) for name in ("reduced", "converged"))
    known = change("qnerf", "nerf", early, late)
    assert known.seeds_paired
    assert known.judgement.pairs == len(cells_of(published("reduced"), ["qnerf"]))
    assert known.judgement.difference == pytest.approx(known.after - known.before)
