"""Is it worse? Each cell of a short training against the stored one of the same seed, in the mean over cells.

Equal seeds draw equal numbers, so that a change of the program that draws no others is seen through rounding alone,
whose spread is measured: stored cells were trained several times from weights that differ in their last bit.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from msgspec import structs
from scipy.stats import norm

from harness.execution.ground_truth import read_views
from harness.execution.run import view_set_folders
from harness.gate.gates import (
    DRAWS,
    GATE_SEEDS,
    HEADLINES,
    LARGEST_LOSS,
    LARGEST_SHIFT,
    RESOLUTION,
    SCORES,
    STEPS,
    TRAINED_METHODS,
    TRAINED_SCENES,
    Gate,
)
from harness.gate.limits import NONE_DIFFERS, Limit
from harness.gate.outcome import GateContext, Sample
from harness.gate.process import in_children
from harness.gate.references import References
from harness.plan.group_task import GroupTask
from harness.plan.profiles import SHORT_TRAINING, Plan
from harness.plan.schedule import Budget
from harness.plan.seeds import generator_for
from harness.plan.settings import GridSettings, ScoreSettings, ViewSettings
from harness.records.cells import CellRecord, Checkpoint
from harness.records.metric_table import METRICS
from harness.run_folder.folder_lock import scratch_folder
from harness.training.learner import Learner
from harness.training.lockstep import train_group
from harness.training.make_learner import learner_for
from harness.verdicts.comparisons import compare
from scenes.files.errors import InputError

Scores = dict[str, dict[str, float | None]]
"""scene/method/seed → score → value."""
ERRORS = 3.0
"""The number of standard errors of rounding that a limit is away, at least."""
LAST_BIT = 2.0**-23
DIGITS = 7


def gate_plan(seeds: tuple[int, ...], scenes: Sequence[str], methods: Sequence[str]) -> Plan:
    """Return a plan in float32, so that machines differ by rounding alone."""
    return Plan(
        profile="gate",
        scenes=tuple(scenes),
        methods=tuple(methods),
        seeds=seeds,
        budget=Budget(steps=STEPS, seconds=None),
        train=replace(
            SHORT_TRAINING, warm_up_steps=20, grid=GridSettings(cells=32, first_step=60, every=20), precision="float32"
        ),
        score=ScoreSettings(checkpoints=1, chunk=2048, train_views=1, stored_views=1),
        views=ViewSettings(resolution=RESOLUTION, train=40, val=0, test=6, spp_train=16, spp_test=64),
    )


def measure(situation: GateContext, gates: tuple[Gate, ...]) -> dict[str, Sample]:
    """Train what the gates need and nothing else."""
    stored = situation.references
    needed = methods_of(gates)
    cells = trained(situation, needed, draw=0) if needed else []
    scores = scores_of(cells)
    found = {}
    for gate in gates:
        parts = gate.name.removeprefix("worse.").split(".")
        if parts == ["headline", "statistics"]:
            found[gate.name] = Sample([float(other_statistics(stored))], limit=NONE_DIFFERS)
        elif parts[0] == "headline":
            found[gate.name] = headline_sample(parts[1], cells, stored)
        else:
            found[gate.name] = loss_sample(parts[0], parts[1], scores, stored)
    return found


def renew(situation: GateContext) -> References:
    """Return the references with new cells. Raises `InputError` if one did not end."""
    draws = []
    for draw in range(DRAWS):
        cells = trained(situation, TRAINED_METHODS, draw)
        if stopped := [f"{cell.scene} {cell.method} seed {cell.seed}: {cell.reason}" for cell in cells
                       if cell.status != "done"]:  # fmt: skip
            raise InputError(f"--renew: no references can be taken from cells that did not end ({'; '.join(stopped)})")
        draws.append(scores_of(cells))
        situation.show.line(f"worse: draw {draw + 1} of {DRAWS} of the rounding")
    kept = {
        key: {score: [_rounded(draw[key][score]) for draw in draws] for score in SCORES} for key in sorted(draws[0])
    }
    found = replace(situation.references, cells=kept)
    return replace(found, statistics=statistics_of(stored_cells(found)))


def _rounded(value: float | None) -> float:
    if value is None:
        raise InputError("--renew: a cell has no depth or no score; references cannot be taken from it")
    return float(f"{value:.{DIGITS}g}")


def methods_of(gates: Iterable[Gate]) -> tuple[str, ...]:
    """Return the methods that have to be trained for these gates."""
    named: set[str] = set()
    for gate in gates:
        _, what, which = gate.name.split(".")
        if what == "all":
            named |= set(TRAINED_METHODS)
        elif what == "headline":
            named |= {method for pair in HEADLINES if which == "_".join(pair) for method in pair}
        else:
            named.add(what)
    return tuple(method for method in TRAINED_METHODS if method in named)


def trained(situation: GateContext, methods: tuple[str, ...], draw: int) -> list[CellRecord]:
    """Return all cells of `methods`, trained in as many processes as there are cores."""
    plan = gate_plan(GATE_SEEDS, TRAINED_SCENES, methods)
    folders = view_set_folders(plan, situation.view_sets, situation.show)
    groups, many = plan.groups(), min(situation.workers, len(plan.groups()))
    shares = [(groups[first::many], folders, methods, situation.out, draw) for first in range(many)]
    return [cell for cells in in_children(train_groups, shares) for cell in cells]


def train_groups(
    groups: Sequence[tuple[str, int]], folders: Mapping[str, Path], methods: tuple[str, ...], out: Path, draw: int
) -> list[CellRecord]:
    """Return the cells of some scenes and seeds, trained in this process."""
    plan = gate_plan(GATE_SEEDS, TRAINED_SCENES, methods)
    cells: list[CellRecord] = []
    for scene, seed in groups:
        with scratch_folder(out) as scratch:
            views = read_views(folders[scene], plan.views, scratch)
            task = GroupTask(scene, seed, methods, plan.train, plan.score, plan.budget, scratch / "cells")
            cells += train_group(task, views, {}, _nothing, rounded_otherwise(draw))
    return cells


def _nothing(share: float) -> None:
    pass


def rounded_otherwise(draw: int) -> Callable[..., Learner]:
    """Return a function that makes learners whose first weights differ at random in their last bit; draw 0 leaves them
    as they are.
    """

    def make(method: str, *others: Any) -> Learner:
        learner = learner_for(method, *others)
        if draw:
            generator = generator_for("rounding", draw, method)
            with torch.no_grad():
                for weight in learner.fields.parameters():  # type: ignore[attr-defined]
                    weight.mul_(1.0 + LAST_BIT * torch.randint(-1, 2, weight.shape, generator=generator))
        return learner

    return make


def scores_of(cells: Iterable[CellRecord]) -> Scores:
    """Return the scores; None for every score of a cell that did not end."""
    return {
        f"{cell.scene}/{cell.method}/{cell.seed}": {
            score: cell.scores.get(score) if cell.status == "done" else None for score in SCORES
        }
        for cell in cells
    }


def loss_sample(method: str, score: str, new: Scores, stored: References) -> Sample:
    """Return by how much the cells of a method, or of all, are better than the stored ones; below 0 they are worse."""
    chosen = {key: draws[score] for key, draws in stored.cells.items() if method in ("all", key.split("/")[1])}
    missing = [key for key in chosen if new.get(key, {}).get(score) is None]
    if missing or not chosen:
        return Sample([None], f"no {score} of {', '.join(missing) or method}")
    fresh = np.array([new[key][score] for key in chosen], dtype=np.float64)
    sign = 1.0 if METRICS[score].higher_is_better else -1.0
    difference = sign * (fresh - np.array([np.mean(draws) for draws in chosen.values()]))
    repeated = all(
        _rounded(float(value)) == _rounded(draws[0]) for value, draws in zip(fresh, chosen.values(), strict=True)
    )
    limit = loss_limit(method, score, stored)
    figure = 0.0 if repeated else float(difference.mean())
    error = rounding_error(list(chosen.values()))
    said = "worse" if limit.low is not None and figure < limit.low else "not worse"
    unit = SCORES[score] and f" {SCORES[score]}"
    note = "unchanged" if repeated else f"changed, {figure:+.3f} ± {2 * error:.3f}{unit}: {said}"
    return Sample([figure], limit=limit, note=note)


def loss_limit(method: str, score: str, stored: References) -> Limit:
    """Return `LARGEST_LOSS`, or more if rounding alone may cause more; `detects` is the loss found in nine of ten
    draws.
    """
    draws = [scores[score] for key, scores in stored.cells.items() if method in ("all", key.split("/")[1])]
    error = rounding_error(draws)
    least = LARGEST_LOSS[score] * (1.0 if method == "all" else 2.0) * stored.wider("worse")
    low = max(least, ERRORS * error)
    return Limit(-low, None, 0.0, error, len(draws), low + float(norm.ppf(0.9)) * error)


def rounding_error(draws: Sequence[Sequence[float]]) -> float:
    """Return the standard error, by rounding alone, of a mean over cells of one draw each minus the means of those
    stored.
    """
    several = [np.var(one, ddof=1) * (1.0 + 1.0 / len(one)) for one in draws if len(one) > 1]
    return math.sqrt(float(np.mean(several)) / len(draws)) if several else 0.0


def headline_sample(name: str, cells: Sequence[CellRecord], stored: References) -> Sample:
    """Return the difference of two methods over scenes, as a run's page has it, minus the stored one."""
    if name not in stored.statistics:
        return Sample([None], "it is not among the stored comparisons")
    # scores alone are stored: a collapsed cell counts here as it does there, and is no failure of its own
    ended = [structs.replace(cell, warnings=[]) for cell in cells if cell.status == "done"]
    found = statistics_of(ended).get(name) if len(ended) == len(cells) else None
    if found is None:
        return Sample([None], "a cell did not end")
    wide = LARGEST_SHIFT * stored.wider("worse")
    note = f"{found[0]:+.3f} dB, stored {stored.statistics[name][0]:+.3f} dB"
    return Sample([found[0] - stored.statistics[name][0]], limit=Limit(-wide, wide), note=note)


def statistics_of(cells: Sequence[CellRecord]) -> dict[str, list[float]]:
    """Return the comparer's result for each headline: difference, interval on these scenes, interval on scenes like
    these.
    """
    found = {}
    for row in compare(list(cells), [method for method in TRAINED_METHODS if method in {one.method for one in cells}]):
        if (row.method, row.against) not in HEADLINES or (row.scene, row.metric, row.budget) != (
            "all",
            "psnr",
            "steps",
        ):
            continue
        ends = [
            end for one in (row.on_these_scenes, row.scenes_like_these) if one and one.interval for end in one.interval
        ]
        if row.difference is not None:
            found[f"{row.method}_{row.against}"] = [row.difference, *ends]
    return found


def other_statistics(stored: References) -> int:
    """Count the numbers of the stored comparisons that come out otherwise today."""
    found = statistics_of(stored_cells(stored))
    differing = 0
    for name, before in stored.statistics.items():
        now = found.get(name, [])
        differing += abs(len(now) - len(before))
        differing += sum(not math.isclose(a, b, rel_tol=1e-6) for a, b in zip(now, before, strict=False))
    return differing


def stored_cells(stored: References) -> list[CellRecord]:
    """Return the cells as they were trained without a change of their first weights."""
    found = []
    for key, scores in stored.cells.items():
        scene, method, seed = key.split("/")
        found.append(cell_with(scene, method, int(seed), {score: draws[0] for score, draws in scores.items()}))
    return found


def cell_with(scene: str, method: str, seed: int, scores: dict[str, float | None]) -> CellRecord:
    """Return a finished cell of which only scores are known."""
    point = Checkpoint(1, 1.0, 1, scores.get("psnr"), None, None)
    empty: dict[str, Any] = {"reason": None, "views": [], "trace": {}, "parameters": {}, "properties": {},
                             "warnings": [], "settings": {}, "provenance": {}}  # fmt: skip
    return CellRecord(scene, method, seed, "done", steps=1, train_seconds=1.0, scores=scores, curve=[point], **empty)
