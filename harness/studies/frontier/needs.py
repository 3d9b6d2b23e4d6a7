"""The best family for a scene with an interval of its lead: the table that `--pick` reads."""

from collections.abc import Iterator

import numpy as np

from harness.records.study import StudyRecord, Table
from harness.studies.framework import Found
from harness.studies.frontier.frontier_context import Frontier, FrontierContext
from harness.verdicts.statistics import paired_difference
from scenes.files.errors import InputError

KINDS = {
    "thin": ("ficus", "mic"),
    "smooth": ("hotdog", "materials"),
    "glossy or transparent": ("drums", "materials"),
    "detailed": ("lego", "ship", "chair"),
}
COLUMNS = ["scene", "core s", "best", "PSNR, dB", "second", "ahead by, dB", "95 % interval"]


def needs(context: FrontierContext) -> Iterator[Found]:
    frontier = context.frontier()
    last = frontier.budgets[-1]
    kinds = {kind: [name for name in names if name in frontier.amount.scenes] for kind, names in KINDS.items()}
    by_kind = [row for kind, names in kinds.items() if names and (row := best_two(frontier, last, kind, names))]
    yield f"At {last:g} core seconds: {'; '.join(map(_phrase, by_kind))}."
    yield Table("by_kind", 0, f"The best family by kind of scene, at {last:g} core seconds", COLUMNS, [*by_kind])
    rows = [
        row
        for scene in frontier.amount.scenes
        for budget in frontier.budgets
        if (row := best_two(frontier, budget, scene, [scene]))
    ]
    yield Table("by_scene", 0, "The best family by scene and budget", COLUMNS, [*rows])


def best_two(frontier: Frontier, budget: float, name: str, scenes: list[str]) -> list[str | float | None] | None:
    """Return a row of `COLUMNS`, or None if fewer than two families have scores. The interval is over seeds for one
    scene, over scenes for several, and empty for one value.
    """
    places = [frontier.amount.scenes.index(scene) for scene in scenes]
    scores = {}
    for family in frontier.trained:
        values = frontier.values(budget, family, "psnr")[places]
        if not np.isnan(values).any():
            scores[family] = values[0] if len(places) == 1 else values.mean(axis=1)
    if len(scores) < 2:
        return None
    best, second = sorted(scores, key=lambda family: -float(scores[family].mean()))[:2]
    lead = paired_difference(scores[best] - scores[second])
    between = " to ".join(f"{end:+.2f}".replace("-", "−") for end in lead.interval or ())
    return [name, f"{budget:g}", best, f"{scores[best].mean():.2f}", second, f"{lead.mean:.2f}", between]


def _phrase(row: list[str | float | None]) -> str:
    kind, _, best, _, second, ahead, between = map(str, row)
    caution = "" if between.startswith("+") else ", which is not settled"
    return f"on {kind} scenes {best} ahead of {second} by {ahead} dB ({between or 'one scene, no interval'}){caution}"


def pick(record: StudyRecord | None, scene: str, seconds: float) -> str:
    """Return the best family for a scene at the longest budget within `seconds`; raises `InputError` without one."""
    tables = record.tables if record is not None else []
    rows = [row for table in tables if table.id in ("by_scene", "by_kind") for row in table.rows]
    if not rows:
        raise InputError("--pick: this frontier holds no choice by scene; measure the question needs")
    known = list(dict.fromkeys(str(row[0]) for row in rows))
    if scene not in known:
        raise InputError(f"--pick {scene}: not measured; known: {', '.join(known)}")
    of_scene = [row for row in rows if row[0] == scene]
    within = [row for row in of_scene if float(str(row[1])) <= seconds]
    if not within:
        shortest = min(float(str(row[1])) for row in of_scene)
        raise InputError(f"--seconds {seconds:g}: the shortest budget that was measured is {shortest:g} core seconds")
    _, budget, best, psnr, second, ahead, between = max(within, key=lambda row: float(str(row[1])))
    interval = f"95 % interval {between}" if between else "one seed: no interval"
    return f"{best}: {psnr} dB on {scene} in {budget} core seconds, {ahead} dB ahead of {second} ({interval})"
