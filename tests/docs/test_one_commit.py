"""What is published together was trained at one commit, of a clean tree."""

import json

from tests.harness.shell import ROOT

TOGETHER = ("reduced/summary.json", "reduced/halved.json", "adam/summary.json", "converged/summary.json")
"""The runs that are compared with each other; a replicate is one by its commit."""


def test_runs_that_are_compared_are_of_one_commit() -> None:
    docs = ROOT / "docs"
    commits = {json.loads((docs / file).read_text(encoding="utf-8"))["provenance"]["commit"]: file for file in TOGETHER}
    replicates = docs / "reduced" / "replicates.json"
    if replicates.is_file():
        runs = json.loads(replicates.read_text(encoding="utf-8"))["runs"]
        commits |= {run["commit"]: "reduced/replicates.json" for run in runs}
    assert len(commits) == 1, commits
    assert not any(commit.endswith("-dirty") for commit in commits)
