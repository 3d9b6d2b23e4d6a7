"""The published headline states a result for each contender, in words that all replicates share."""

import pytest

from reports.run.saving.replicates import Run, answer

ABOVE, OPEN = {"sign": "above 0", "size": "matters"}, {"sign": "open", "size": "open"}
PAIRS = (("qnerf", "nerf"), ("qnerf", "nerf_matched"), ("qnerf_repaired", "nerf"), ("qnerf_repaired", "nerf_matched"))


def published(*pairs: tuple[str, str]) -> Run:
    row = {"metric": "psnr", "budget": "steps", "difference": 0.5, "verdict": ABOVE}
    rows = [{**row, "scene": "all", "method": method, "against": against} for method, against in pairs]
    return {"comparisons": rows, "scenes": [{"scene": name} for name in "abcd"], "headline": "nothing"}


def test_every_contender_has_its_clause_and_one_that_was_not_run_has_none() -> None:
    title = answer(published(*PAIRS), {})
    clauses = ["Qnerf gains 0.50 dB over nerf", "qnerf_repaired gains 0.50 dB over nerf, more"]
    assert all(words in title for words in [*clauses, "qnerf_repaired gains 0.50 dB over nerf_matched, more"])
    assert "repaired" not in answer(published(*PAIRS[:2]), {})
    assert answer(published(*PAIRS[2:]), {}) == "nothing"


@pytest.mark.parametrize(
    ("verdict", "clause"),
    [
        (ABOVE, "qnerf_repaired gains 0.50 dB over nerf, more than the 0.2 dB that matter"),
        (OPEN, "the sign of qnerf_repaired − nerf is open (+0.40 to +0.50 dB in two runs)"),
    ],
)
def test_words_that_a_replicate_does_not_repeat_are_not_said(verdict: dict[str, str], clause: str) -> None:
    row = {"method": "qnerf_repaired", "against": "nerf", "differences": [0.4], "verdicts": [verdict]}
    assert clause in answer(published(*PAIRS), {"over_all": [row]})
