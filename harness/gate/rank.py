"""Does the order of methods at the gate's scale predict that of a whole run?"""

from collections import defaultdict
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import kendalltau, spearmanr

from harness.gate.references import USUAL, References, read_references
from harness.json_record import load_json, write_json
from scenes.errors import InputError

RANK_FILE = "rank.json"
FEWEST = 4
"""Pairs of a scene and a method that a correlation needs."""
Scores = dict[tuple[str, str], float]
"""(scene, method) → PSNR, mean over seeds."""


@dataclass(frozen=True)
class Ranks:
    """How alike two scales order scenes and methods."""

    spearman: float
    """Over all pairs of a scene and a method."""
    kendall: float
    pairs: int
    compared: int
    """Pairs of methods on the same scene."""
    same_order: int
    """Of these, how many stand in the same order at both scales."""


def ranks(ours: Scores, theirs: Scores) -> Ranks:
    """Raises `ValueError` where there are too few pairs in common."""
    common = sorted(ours.keys() & theirs.keys())
    if len(common) < FEWEST:
        raise ValueError(f"{len(common)} pairs of a scene and a method in common, {FEWEST} are needed")
    a, b = (np.array([scores[key] for key in common]) for scores in (ours, theirs))
    same = [
        (ours[first] - ours[second]) * (theirs[first] - theirs[second]) > 0
        for first, second in combinations(common, 2)
        if first[0] == second[0]
    ]
    return Ranks(
        float(spearmanr(a, b).statistic), float(kendalltau(a, b).statistic), len(common), len(same), int(sum(same))
    )


def gate_scores(references: References) -> Scores:
    """The stored cells of the gate."""
    found = defaultdict(list)
    for key, scores in references.cells.items():
        scene, method, _ = key.split("/")
        found[scene, method].append(scores["psnr"][0])
    return {key: float(np.mean(values)) for key, values in found.items()}


def run_scores(summary: dict[str, Any]) -> Scores:
    """The finished cells of a run's `summary.json`."""
    found = defaultdict(list)
    for cell in summary["cells"]:
        if cell["status"] == "done" and cell["psnr"] is not None:
            found[cell["scene"], cell["method"]].append(float(cell["psnr"]))
    return {key: float(np.mean(values)) for key, values in found.items()}


def publish(run: Path, folder: Path) -> str:
    """Writes `rank.json` beside the limits and gives it in words. Raises `InputError` for a run that has no summary."""
    file = run / "summary.json" if run.is_dir() else run
    try:
        summary = load_json(file)
        theirs = run_scores(summary)
        plan = {"profile": str(summary["profile"]), "commit": str(summary["provenance"]["commit"])}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"--rank {run}: no summary of a finished run ({error}); give a run's output folder") from error
    ours = gate_scores(read_references(folder / "classes", USUAL))
    try:
        found = ranks(ours, theirs)
    except ValueError as error:
        raise InputError(f"--rank {run}: {error}; a default run has them") from error
    rows = [
        {"scene": scene, "method": method, "gate": round(ours[scene, method], 3), "run": round(score, 3)}
        for (scene, method), score in sorted(theirs.items())
        if (scene, method) in ours
    ]
    numbers = {name: round(value, 3) for name, value in vars(found).items()}
    write_json(folder / RANK_FILE, {"schema": 1, "run": plan, **numbers, "scores": rows})
    return (
        f"Spearman {found.spearman:.2f}, Kendall {found.kendall:.2f} over {found.pairs} pairs of a scene and a method; "
        f"{found.same_order} of {found.compared} pairs of methods in the same order; {folder / RANK_FILE}"
    )
