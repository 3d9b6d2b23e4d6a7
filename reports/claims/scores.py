"""Claims about scores: how much better, how good, and what each part adds."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from harness.records.cells import Comparison
from harness.records.claims import Pair, Statement
from harness.records.json_record import finite_or_none
from harness.records.study import Effect, Studies
from harness.verdicts.statistics import on_one_scene, on_these_scenes
from reports.claims.ledger import (
    LEAST_PAIRS,
    MARGINS,
    Bench,
    Finding,
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


def on_them(row: Comparison | Effect) -> Pair | None:
    """Return the interval that a printed gain is judged by, whose error is that of the seeds; two seeds give none."""
    if row.on_these_scenes is None or row.pairs < LEAST_PAIRS:
        return None
    return row.on_these_scenes.simultaneous or row.on_these_scenes.interval


def unpaired(row: Comparison | Effect) -> str:
    return f"{counted(row.unpaired, 'pair')} could not be judged" if row.unpaired else ""


def gain(bench: Bench, entry: Statement) -> Finding:
    scene, method, against, metric = (entry.of[name] for name in ("scene", "method", "against", "metric"))
    row = bench.records.comparison(scene, method, against, metric)
    how = PAIRED.format(metric=metric.upper(), units="scene and seed" if scene == "all" else "seed")
    if row is None or entry.printed is None or not tried(bench, row):
        return Finding(UNTESTED, how, note=NEEDS_RUN.format(methods=f"{method} and {against}"))
    scenes = bench.records.scenes if scene == "all" else [scene]
    rows = [bench.records.comparison(name, method, against, metric) for name in scenes]
    complete = all(each is not None and each.difference is not None for each in rows)
    pair, margin = on_them(row), MARGINS[metric]
    at_scale = bench.at_scale(scene) and (complete or bench.file.scale is None)  # a stated claim has no other scale
    verdict = judge_gain(entry.printed, margin, pair, at_scale, entry.bound)
    if verdict == "reproduced" and not complete:
        verdict = "inconclusive"
    # a true gain at a bound is settled by no number of seeds
    seeds = seeds_needed(row, margin, len(scenes)) if verdict == "inconclusive" and not entry.bound else None
    notes = [unpaired(row), f"about {counted(seeds, 'seed')} per scene would settle it" if seeds else ""]
    if "beside" in entry.of:  # another reading of the method, and the gain over the control of the same bandwidth
        notes.append(_beside(bench, entry, entry.of["beside"], against))
        notes.append(_beside(bench, entry, method, bench.records.control or ""))
    return Finding(verdict, how, row.difference, pair, note="; ".join(filter(None, notes)), runs=behind_difference(row))


def seeds_needed(row: Comparison, margin: float, scenes: int) -> int | None:
    """Return how many seeds per scene would settle an open gain; None if they would not, or its spread is unknown."""
    about = row.on_these_scenes
    if about is None or not about.effect or row.difference is None:
        return None
    seeds = seeds_that_settle(abs(row.difference / about.effect), scenes, margin, about.family)
    return seeds if seeds and seeds * scenes > row.pairs else None


def tried(bench: Bench, row: Comparison) -> bool:
    """Return whether there is a difference, or runs of both methods were started and lost."""
    cells = [cell for cell in bench.records.cells if row.scene in ("all", cell.scene)]
    started = {cell.method for cell in cells if cell.status != "not_available"}
    return row.difference is not None or {row.method, row.against} <= started


def _beside(bench: Bench, entry: Statement, method: str, against: str) -> str:
    """State another difference: on the scene of the claim (or all) if it was measured, else on the first with one."""
    metric, claimed = entry.of["metric"], entry.of["scene"]
    rows = [bench.records.comparison(scene, method, against, metric) for scene in (claimed, *bench.records.scenes)]
    row = next((row for row in rows if row is not None and row.difference is not None), None)
    if row is None:
        return ""
    where, pair = f" on {row.scene}" if row.scene != claimed else "", on_them(row)
    shown = f"{method} − {against}{where}: {signed(row.difference)} {interval(pair)}".rstrip()
    if method == entry.of["method"] or entry.printed is None:
        return shown
    return f"{shown}: {judge_gain(entry.printed, MARGINS[metric], pair, bench.at_scale(row.scene), entry.bound)}"


class Part(NamedTuple):
    name: str
    verdict: Verdict
    value: float
    seeds: int | None = None


def each_row(bench: Bench, entry: Statement) -> Finding:
    """Judge a table row by row, each on the scene that it is about."""
    column, metric = entry.of["column"], entry.of["metric"]
    how = f"mean test {metric.upper()} over seeds; each row on its own scene"
    if "against" in entry.of:
        how = f"{PAIRED.format(metric=metric.upper(), units='seed')}; each row on its own scene"
    if entry.of["table"] == "psnr":
        rows = [(scene, scene, column, row[column]) for scene, row in bench.file.scenes.items() if column in row]
    else:
        scene, table = entry.of.get("scene", "all"), bench.file.tables.get("ablation", [])
        rows = [
            (row["method"], scene, row["method"], row["scores"][metric]) for row in table if metric in row["scores"]
        ]
    own = [row for row in rows if bench.at_scale(row[1])]  # the pictures of the others are not the paper's
    parts = [part for row in own if (part := _part(bench, entry, len(rows), *row)) is not None]
    if not parts:
        return Finding(UNTESTED, how, note=NEEDS_PAPER)
    verdict = judge_all(part.verdict for part in parts)
    if verdict == "reproduced" and len(parts) < len(rows):
        verdict = "inconclusive"
    notes = [
        f"{verdict}: {listed([part.name for part in parts if part.verdict == verdict])}"
        for verdict in dict.fromkeys(part.verdict for part in parts)
    ]
    seeds = [part.seeds for part in parts if part.seeds]
    notes += [f"about {counted(max(seeds), 'seed')} would settle the open ones"] if seeds else []
    notes += [f"{len(parts)} of {len(rows)} rows"] if len(parts) < len(rows) else []
    values = [part.value for part in parts]
    return Finding(verdict, how, (min(values), max(values)), note="; ".join(notes))


def _part(
    bench: Bench, entry: Statement, family: int, name: str, scene: str, column: str, printed: float
) -> Part | None:
    """Judge a row: its gain if the statement names a rival, else the level of the method `column`."""
    metric = entry.of["metric"]
    margin = MARGINS[metric]
    if "against" in entry.of:
        row = bench.records.comparison(scene, entry.of["method"], entry.of["against"], metric)
        if row is None or row.difference is None:
            return None
        verdict = judge_gain(printed, margin, on_them(row), True)
        return Part(name, verdict, row.difference, seeds_needed(row, margin, 1) if verdict == "inconclusive" else None)
    scores = _scores(bench, column, metric).get(scene)
    if scores is None:
        return None
    level = on_one_scene(scores, family)
    pair = level.simultaneous if level.units >= LEAST_PAIRS else None
    return Part(name, judge_level(printed, margin, pair), level.mean)


def score(bench: Bench, entry: Statement) -> Finding:
    """Judge the score of a method; at another scale, or on other pictures, show it without a verdict."""
    method, metric, scene = (entry.of[name] for name in ("method", "metric", "scene"))
    how = f"mean test {metric.upper()} of this run’s {method}, error from seeds"
    scenes, table = bench.records.scenes if scene == "all" else [scene], _scores(bench, method, metric)
    table = {name: table[name] for name in scenes if name in table}
    if len(table) < len(scenes) or entry.printed is None:
        return Finding(UNTESTED, how, note=NEEDS_PAPER if bench.file.scale else NEEDS_RUN.format(methods=method))
    level = on_these_scenes(table) if len(table) > 1 else on_one_scene(next(iter(table.values())))
    if not bench.at_scale(scene):
        return Finding(UNTESTED, how, level.mean, level.interval, note=NEEDS_PAPER)
    pair = level.interval if sum(map(len, table.values())) >= LEAST_PAIRS else None
    verdict = judge_level(entry.printed, MARGINS[metric], pair, entry.bound)
    behind = Selection("" if scene == "all" else scene, method, metric=metric)
    return Finding(verdict, how, level.mean, level.interval, runs=behind)


def _scores(bench: Bench, method: str, metric: str) -> dict[str, np.ndarray]:
    table = {}
    for scene in bench.records.scenes:
        scores = [finite_or_none(cell.scores.get(metric)) for cell in bench.records.cells_of(scene, method)]
        table[scene] = np.array([value for value in scores if value is not None])
    return {scene: values for scene, values in table.items() if values.size}


STUDY = "factorial"
"""The study that trains every combination of the parts, with each reading of the amplifier."""
NEEDS_STUDY = "need the ablation study: `nox -s evidence -- --out out/latest`"


def added_part(bench: Bench, entry: Statement) -> Finding:
    """Judge a row of Table 4 minus the row above it: by the run's own comparison, else by the factorial study."""
    scene, method, against, metric = (entry.of[name] for name in ("scene", "method", "against", "metric"))
    finding, evidence = gain(bench, entry), bench.evidence
    if finding.verdict != UNTESTED:
        return finding
    effect = effect_of(evidence, scene, method, against, metric)
    if evidence is None or effect is None or entry.printed is None:
        return replace(finding, note=NEEDS_STUDY)
    study, pair, digits = evidence.study(STUDY), on_them(effect), entry.digits + 1
    notes = [unpaired(effect), doubts(evidence)]
    other = effect_of(evidence, scene, entry.of.get("other", ""), entry.of.get("other_against", ""), metric)
    if other is not None:
        shown = f"{signed(other.difference, digits)} {interval(other.simultaneous or other.interval, digits)}".strip()
        notes.insert(0, f"with the amplifier of Eq. 4: {shown} ({other.verdict.phrase})")
    return Finding(
        judge_gain(entry.printed, MARGINS[metric], pair, False, entry.bound),
        PAIRED.format(metric=metric.upper(), units="seed"),
        effect.difference,
        pair,
        study.scale if study else "",
        "; ".join(filter(None, notes)),
    )


def doubts(evidence: Studies) -> str:
    failed = [
        f"{sum(not check.holds for check in study.checks)} of {counted(len(study.checks), 'check')} of {study.info.id}"
        for study in (evidence.study(STUDY), evidence.study("calibration"))
        if study and not all(check.holds for check in study.checks)
    ]
    parts = [] if evidence.finished else ["the evidence was not finished"]
    return "; ".join([*parts, *([f"{' and '.join(failed)} failed"] if failed else [])])


def effect_of(evidence: Studies | None, scene: str, method: str, against: str, metric: str) -> Effect | None:
    """Return an effect at equal steps from the factorial study; a quick study gives none."""
    study = evidence.study(STUDY) if evidence and not evidence.is_quick else None
    for effect in study.effects if study else []:
        of = (effect.name, effect.against, effect.scene, effect.metric, effect.budget)
        if of == (method, against, scene, metric, "steps") and effect.difference is not None:
            return effect
    return None
