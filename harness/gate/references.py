"""The results of one class of processor, `gates/classes/NAME.json`, which the same class must reproduce; and how well
the order of methods there predicts that of a complete run.
"""

from collections import defaultdict
from collections.abc import Iterable
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, field
from scipy.stats import kendalltau, spearmanr

from harness.gate.gates import Kind
from harness.gate.limits import SCHEMA, KindFacts, read_stored
from harness.records.json_record import Record, load_json, write_json
from scenes.files.errors import InputError

USUAL = "avx2"
"""The class whose references a class without its own is held to, with wider limits."""
Numbers = Annotated[list[float], Meta(min_length=1)]


class Course(Record, frozen=True):
    """The record of the first steps of one training."""

    losses: Numbers
    """The loss of each step, before it."""
    renders: dict[str, Numbers]
    """Red, green, blue and depth of some pixels of a test view, by number of steps."""


Courses = dict[str, dict[str, Course]]
"""Precision → start → its record."""


class References(Record, frozen=True):
    """The references of one class of processor."""

    name: str
    kinds: dict[Kind, KindFacts] = field(default_factory=dict)
    profiles: dict[str, Any] = field(default_factory=dict)
    """Setting of a profile → its value."""
    courses: Courses = field(default_factory=dict)
    reordered: dict[str, dict[str, float]] = field(default_factory=dict)
    """Precision → another order of the same sums → the largest deviation that it causes."""
    cells: dict[str, dict[str, Numbers]] = field(default_factory=dict)
    """"scene/method/seed" → score → one value for each draw of the rounding."""
    statistics: dict[str, Numbers] = field(default_factory=dict)
    """Comparison → difference and ends of its intervals, of the cells above."""
    speed: dict[str, Numbers] = field(default_factory=dict)
    """Gate → quotients, one per process."""
    schema: int = SCHEMA


def references_file(folder: Path, name: str) -> Path:
    return folder / f"{name}.json"


def references_for(folder: Path, name: str) -> References:
    """Return those of class `name`, or else of the usual one. Raises `InputError` if there is neither."""
    return read_references(folder, name if references_file(folder, name).exists() else USUAL)


def read_references(folder: Path, name: str) -> References:
    """Read references. Raises `InputError`, with the remedy, for a file that is missing or damaged."""
    file = references_file(folder, name)
    stored = read_stored(file, References)
    if stored.name != name:
        raise InputError(f"{file}: holds the references of class {stored.name!r}; get it back from version control")
    return stored


RANK_FILE = "rank.json"
FEWEST = 4
"""The fewest pairs of a scene and a method that a correlation needs."""
Scores = dict[tuple[str, str], float]
"""(scene, method) → PSNR, mean over seeds."""


def ranks(ours: Scores, theirs: Scores) -> dict[str, float]:
    """Compare two scales by the rank correlations over all `pairs` of a scene and a method, and by how many of the
    `compared` pairs of methods on the same scene are in the same order.

    Raises `ValueError` if there are too few pairs in common.
    """
    common = sorted(ours.keys() & theirs.keys())
    if len(common) < FEWEST:
        raise ValueError(f"{len(common)} pairs of a scene and a method in common, {FEWEST} are needed")
    a, b = (np.array([scores[key] for key in common]) for scores in (ours, theirs))
    same = [
        (ours[first] - ours[second]) * (theirs[first] - theirs[second]) > 0
        for first, second in combinations(common, 2)
        if first[0] == second[0]
    ]
    return {
        "spearman": round(float(spearmanr(a, b).statistic), 3),
        "kendall": round(float(kendalltau(a, b).statistic), 3),
        "pairs": len(common),
        "compared": len(same),
        "same_order": sum(same),
    }


def _means(scores: Iterable[tuple[str, str, float]]) -> Scores:
    by_key = defaultdict(list)
    for scene, method, score in scores:
        by_key[scene, method].append(score)
    return {key: float(np.mean(values)) for key, values in by_key.items()}


def publish(run: Path, folder: Path) -> str:
    """Write `rank.json` beside the limits and return it in words. Raises `InputError` for a run that has no summary."""
    try:
        summary = load_json(run / "summary.json" if run.is_dir() else run)
        scored = [cell for cell in summary["cells"] if cell["status"] == "done" and cell["psnr"] is not None]
        theirs = _means((cell["scene"], cell["method"], float(cell["psnr"])) for cell in scored)
        plan = {"profile": str(summary["profile"]), "commit": str(summary["provenance"]["commit"])}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"--rank {run}: no summary of a finished run ({error}); give a run's output folder") from error
    cells = read_references(folder / "classes", USUAL).cells
    stored = [(key.split("/"), scores["psnr"][0]) for key, scores in cells.items()]
    ours = _means((scene, method, psnr) for (scene, method, _), psnr in stored)
    try:
        likeness = ranks(ours, theirs)
    except ValueError as error:
        raise InputError(f"--rank {run}: {error}; a default run has them") from error
    rows = [
        {"scene": scene, "method": method, "gate": round(ours[scene, method], 3), "run": round(score, 3)}
        for (scene, method), score in sorted(theirs.items())
        if (scene, method) in ours
    ]
    record = {"schema": 1, "run": plan, **likeness, "scores": rows}
    write_json(folder / RANK_FILE, record)
    return f"{folder / RANK_FILE}: {rank_line(record)}"


def rank_line(record: dict[str, Any]) -> str:
    """Return what `rank.json` says as a sentence."""
    run = record["run"]
    return (
        f"Against the {run['profile']} run of commit {run['commit']}: Spearman {record['spearman']:.2f}, Kendall "
        f"{record['kendall']:.2f} over {record['pairs']} pairs of a scene and a method; {record['same_order']} of "
        f"{record['compared']} pairs of methods stand in the same order on their scene."
    )
