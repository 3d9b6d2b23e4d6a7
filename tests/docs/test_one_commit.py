"""What is published together was measured at one commit, of a clean tree."""

import json

import pytest

from tests.harness.shell import ROOT

TOGETHER = {
    "runs": ("reduced/summary.json", "reduced/halved.json", "adam/summary.json", "converged/summary.json"),
    "studies": (
        "reduced/evidence.json",
        "stability.json",
        "reduced/serving.json",
        "speed.json",
        "left_out.json",
        "frontier/frontier.json",
        "frontier/late.json",
        "frontier/large.json",
        "frontier/families.json",
    ),
}
"""The runs that are compared with each other, of which a replicate is one by its commit; and studies."""


@pytest.mark.parametrize("kind", TOGETHER)
def test_what_is_compared_is_of_one_commit(kind: str) -> None:
    docs = ROOT / "docs"
    commits = {
        json.loads((docs / file).read_text(encoding="utf-8"))["provenance"]["commit"]: file for file in TOGETHER[kind]
    }
    replicates = docs / "reduced" / "replicates.json"
    if kind == "runs" and replicates.is_file():
        runs = json.loads(replicates.read_text(encoding="utf-8"))["runs"]
        commits |= {run["commit"]: "reduced/replicates.json" for run in runs}
    assert len(commits) == 1, commits
    assert not any(commit.endswith("-dirty") for commit in commits)
