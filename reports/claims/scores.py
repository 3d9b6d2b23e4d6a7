"""Abstract, Table 2 and Table 4: how much better, and how good."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from harness.records.cells import Comparison
from harness.records.json_record import finite_or_none
from harness.verdicts.statistics import on_one_scene, on_these_scenes
from reports.claims.headline import roles
from reports.claims.ledger import (
    LEAST_PAIRS,
    MARGINS,
    Bench,
    Finding,
    Pair,
    Printed,
    judge_all,
    judge_gain,
    judge_level,
    seeds_that_settle,
)
from reports.data.selection import Selection, behind_difference
from reports.data.wording import UNTESTED, Verdict, counted, interval, listed, signed

PAIRED = "mean test {metric} at equal steps, paired by {units}; interval on these scenes"
NEEDS_PAPER = "need the paper’s settings on its own pictures (docs/full-setting.md)"
NEEDS_RUN = "need a run of {methods}"
PRINTED_FORM = "qnerf_printed"
"""The form with density at most 1 per scene unit: its verdict stands beside."""


@dataclass(frozen=True)
class Part:
    """One of several subjects of a statement."""

    name: str
    verdict: Verdict
    value: float
    seeds: int | None = None
    """The number of seeds that would settle what is open."""


def on_them(one: Comparison) -> Pair | None:
    """Return the interval that a printed gain is judged by, with error from seeds alone; two seeds give none."""
    if one.on_these_scenes is None or one.pairs < LEAST_PAIRS:
        return None
    return one.on_these_scenes.simultaneous or one.on_these_scenes.interval


def gain(bench: Bench, entry: Printed) -> Finding:
    """Judge a gain of one method over another, on a scene or over all."""
    scene, method, against, metric = (entry.of[name] for name in ("scene", "method", "against", "metric"))
    one = bench.records.comparison(scene, method, against, metric)
    how = PAIRED.format(metric=metric.upper(), units="scene and seed" if scene == "all" else "seed")
    if one is None or not isinstance(entry.printed, int | float) or not tried(bench, one):
        return Finding(UNTESTED, how, note=NEEDS_RUN.format(methods=f"{method} and {against}"))
    pair, margin = on_them(one), MARGINS[metric]
    verdict = judge_gain(entry.printed, margin, pair, bench.at_paper_scale(scene) and _on_each(bench, one))
    notes = [
        f"{counted(one.unpaired, 'pair')} could not be judged" if one.unpaired else "",
        settled_by(one, margin, _scenes(bench, scene)) if verdict == "inconclusive" else "",
        *(_beside(bench, entry, *rival) for rival in _rivals(bench, method, against)),
    ]
    return Finding(verdict, how, one.difference, pair, note="; ".join(filter(None, notes)), runs=behind_difference(one))


def _on_each(bench: Bench, one: Comparison) -> bool:
    """Return whether a mean over all scenes has a pair on each of them."""
    scenes = bench.records.scenes if one.scene == "all" else [one.scene]
    rows = [bench.records.comparison(scene, one.method, one.against, one.metric) for scene in scenes]
    return all(row is not None and row.difference is not None for row in rows)


def settled_by(one: Comparison, margin: float, scenes: int) -> str:
    """Return how many seeds would settle an open gain, in words; nothing if its spread is not known."""
    seeds = _seeds_needed(one, margin, scenes)
    return f"about {counted(seeds, 'seed')} a scene would settle it" if seeds else ""


def _seeds_needed(one: Comparison, margin: float, scenes: int) -> int | None:
    about = one.on_these_scenes
    if about is None or not about.effect or one.difference is None:
        return None
    deviation = abs(one.difference / about.effect)
    seeds = seeds_that_settle(deviation, scenes, margin, about.family)
    return seeds if seeds and seeds * scenes > one.pairs else None


def tried(bench: Bench, one: Comparison) -> bool:
    """Return whether there is a difference, or runs of both methods that could have given one and were lost."""
    if one.difference is not None:
        return True
    started = {
        cell.method
        for cell in bench.records.cells
        if one.scene in ("all", cell.scene) and cell.status != "not_available"
    }
    return {one.method, one.against} <= started


def each_row(bench: Bench, entry: Printed) -> Finding:
    """Judge a table row by row, each on its own scene: a printed row is about no other."""
    table, column, metric = (entry.of[name] for name in ("table", "column", "metric"))
    if column == "delta":
        how = PAIRED.format(metric=metric.upper(), units="seed") + "; each row on its own scene"
    else:
        how = f"mean test {metric.upper()} over seeds; each row on its own scene"
    rows = _rows(bench, table, column, metric)
    parts = [
        part for name, (printed, judge) in rows.items() if (part := judge(bench, name, printed, metric, len(rows)))
    ]
    if not parts:
        return Finding(UNTESTED, how, note=NEEDS_PAPER)
    verdict = judge_all(part.verdict for part in parts)
    if verdict == "reproduced" and len(parts) < len(rows):
        verdict = "inconclusive"
    values = [part.value for part in parts]
    return Finding(verdict, how, (min(values), max(values)), note=_by_verdict(parts, len(rows)))


Judge = Callable[[Bench, str, float, str, int], Part | None]
"""A judge of a row's name, printed value, metric and number of rows; None if its pictures are not the paper's."""


def _rows(bench: Bench, table: str, column: str, metric: str) -> dict[str, tuple[float, Judge]]:
    """Map row → its printed values, and their judge."""
    if table == "table2":
        scenes = bench.scenes_of_table2()
        return {
            scene: (row[column], _gain_of if column == "delta" else _level_of(scene, column))
            for scene, row in scenes.items()
            if column in row
        }
    rows = bench.paper.get(table) or []
    return {row["method"]: (row[metric], _level_of("lego", row["method"])) for row in rows}


def _gain_of(bench: Bench, scene: str, printed: float, metric: str, family: int) -> Part | None:
    """Judge a row of Table 2's column of gains."""
    one = bench.records.comparison(scene, "qnerf", "nerf", metric)
    if one is None or one.difference is None or not bench.at_paper_scale(scene):
        return None
    verdict = judge_gain(printed, MARGINS[metric], on_them(one), True)
    seeds = _seeds_needed(one, MARGINS[metric], 1) if verdict == "inconclusive" else None
    return Part(scene, verdict, one.difference, seeds)


def _level_of(scene: str, method: str) -> Judge:
    """Return a judge of the level that a method reaches on a scene."""

    def judge(bench: Bench, name: str, printed: float, metric: str, family: int) -> Part | None:
        table = _scores(bench, method, metric)
        if scene not in table or not bench.at_paper_scale(scene):
            return None
        found = on_one_scene(table, scene, family)
        pair = found.simultaneous if found.units >= LEAST_PAIRS else None
        return Part(name, judge_level(printed, MARGINS[metric], pair), found.mean)

    return judge


def _by_verdict(parts: list[Part], rows: int) -> str:
    """State which rows came out how, and how many seeds the open ones want."""
    said = []
    for verdict in dict.fromkeys(part.verdict for part in parts):
        some = [part for part in parts if part.verdict == verdict]
        said.append(f"{verdict}: {listed([part.name for part in some])}")
    wanted = [part.seeds for part in parts if part.seeds]
    if wanted:
        said.append(f"about {counted(max(wanted), 'seed')} would settle the open ones")
    if len(parts) < rows:
        said.append(f"{len(parts)} of {rows} rows")
    return "; ".join(said)


def score(bench: Bench, entry: Printed) -> Finding:
    """Judge how good a method gets. At another scale, or on other pictures than the paper's, it only stands beside."""
    method, metric = entry.of["method"], entry.of["metric"]
    how = f"mean test {metric.upper()} of this run’s {method}, error from seeds"
    table = _scores(bench, method, metric)
    if len(table) < len(bench.records.scenes):
        return Finding(UNTESTED, how, note=NEEDS_PAPER)
    found = on_these_scenes(table)
    if not bench.at_paper_scale("all") or not isinstance(entry.printed, int | float):
        return Finding(UNTESTED, how, found.mean, found.interval, note=NEEDS_PAPER)
    verdict = judge_level(entry.printed, MARGINS[metric], found.interval)
    return Finding(verdict, how, found.mean, found.interval, runs=Selection("", method, metric=metric))


def _scores(bench: Bench, method: str, metric: str) -> dict[str, np.ndarray]:
    """Map scene → scores of its finished cells [seeds], if there are any."""
    found = {
        scene: [finite_or_none(cell.scores.get(metric)) for cell in bench.records.cells_of(scene, method)]
        for scene in bench.records.scenes
    }
    table = {scene: np.array([one for one in values if one is not None]) for scene, values in found.items()}
    return {scene: values for scene, values in table.items() if values.size}


def _scenes(bench: Bench, scene: str) -> int:
    return len(bench.records.scenes) if scene == "all" else 1


def _rivals(bench: Bench, method: str, against: str) -> list[tuple[str, str]]:
    """Return the comparisons beside Q-NeRF's gain: the rest of it once bandwidth is matched, and the printed form's."""
    if (method, against) != ("qnerf", "nerf"):
        return []
    control = roles(bench.records).control
    return [(PRINTED_FORM, against), *([(method, control)] if control else [])]


def _beside(bench: Bench, entry: Printed, method: str, against: str) -> str:
    """State another difference in words: over all scenes if it was measured, else on the single one that has it."""
    metric, scenes = entry.of["metric"], bench.records.scenes
    found = [bench.records.comparison(scene, method, against, metric) for scene in (entry.of["scene"], *scenes)]
    one = next((row for row in found if row is not None and row.difference is not None), None)
    if one is None:
        return ""
    where = f" on {one.scene}" if one.scene != entry.of["scene"] else ""
    shown = f"{method} − {against}{where}: {signed(one.difference)} {interval(on_them(one))}".rstrip()
    if method != PRINTED_FORM or not isinstance(entry.printed, int | float):
        return shown
    verdict = judge_gain(entry.printed, MARGINS[metric], on_them(one), bench.at_paper_scale(one.scene))
    return f"{shown}: {verdict}"
