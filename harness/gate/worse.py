"""Is it worse? Each cell of a short training against the stored one of the same seed, in the mean over cells.

Equal seeds draw equal numbers, so that a change of the program that draws no others is seen through rounding alone,
whose spread is measured: stored cells were trained several times from weights that differ in their last bit.
"""

import math
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
from msgspec import structs
from scipy.stats import norm

from harness.execution.ground_truth import read_views, view_set_folders
from harness.gate.gate_context import GateContext, complete
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
from harness.gate.limits import NONE_DIFFERS, Limit, judge
from harness.gate.references import References
from harness.machine.stopping import in_workers
from harness.plan.group_task import GroupTask
from harness.plan.profiles import SHORT_TRAINING, Plan
from harness.plan.schedule import Budget
from harness.plan.seeds import generator_for
from harness.plan.settings import GridSettings, ScoreSettings, ViewSettings
from harness.records.cells import CellRecord, Checkpoint, unscored
from harness.records.metric_table import METRICS
from harness.records.study import Check
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
TRAIN = replace(
    SHORT_TRAINING, warm_up_steps=20, grid=GridSettings(cells=32, first_step=60, every=20), precision="float32"
)
"""In float32, so that machines differ by rounding alone."""


def _answer(checks: dict[str, Check]) -> str:
    mean = checks.get("worse.all.psnr")
    return f"Is it worse? {mean.why}" if mean else ""


@complete("worse", _answer)
def measure(context: GateContext) -> Iterator[Check]:
    """Train what the gates need and nothing else."""
    stored, wider = context.references, context.wider("worse")
    asked = context.of_kind("worse")
    needed = methods_of(asked)
    cells = trained(context, needed) if needed else []
    scores = scores_of(cells)
    for name, gate in asked.items():
        _, method, which = name.split(".")
        if which == "statistics":
            yield judge(gate, [other_statistics(stored)], NONE_DIFFERS)
        elif method == "headline":
            yield headline_check(gate, cells, stored, wider)
        else:
            yield loss_check(gate, scores, stored, wider)


def renew(context: GateContext) -> References:
    """Return the references with new cells. Raises `InputError` if one did not end."""
    draws = []
    for draw in range(DRAWS):
        cells = trained(context, TRAINED_METHODS, draw)
        if stopped := [
            f"{cell.scene} {cell.method} seed {cell.seed}: {cell.reason}" for cell in cells if cell.status != "done"
        ]:
            raise InputError(f"--renew: no references can be taken from cells that did not end ({'; '.join(stopped)})")
        draws.append(scores_of(cells))
        context.show.line(f"worse: draw {draw + 1} of {DRAWS} of the rounding")
    kept = {
        key: {score: [_rounded(draw[key][score]) for draw in draws] for score in SCORES} for key in sorted(draws[0])
    }
    renewed = structs.replace(context.references, cells=kept)
    return structs.replace(renewed, statistics=statistics_of(stored_cells(renewed)))


def _rounded(value: float | None) -> float:
    if value is None:
        raise InputError("--renew: a cell has no depth or no score; references cannot be taken from it")
    return float(f"{value:.{DIGITS}g}")


def methods_of(names: Iterable[str]) -> tuple[str, ...]:
    needed: set[str] = set()
    for name in names:
        _, method, which = name.split(".")
        if method == "all":
            needed |= set(TRAINED_METHODS)
        elif method == "headline":
            needed |= {each for pair in HEADLINES if which == "_".join(pair) for each in pair}
        else:
            needed.add(method)
    return tuple(method for method in TRAINED_METHODS if method in needed)


def trained(
    context: GateContext,
    methods: tuple[str, ...],
    draw: int = 0,
    scenes: tuple[str, ...] = TRAINED_SCENES,
    seeds: tuple[int, ...] = GATE_SEEDS,
) -> list[CellRecord]:
    """Return all cells of `methods`, trained in as many processes as there are cores."""
    plan = Plan(
        profile="gate",
        scenes=scenes,
        methods=methods,
        seeds=seeds,
        budget=Budget(steps=STEPS, seconds=None),
        train=TRAIN,
        score=ScoreSettings(checkpoints=1, chunk=2048, train_views=1, stored_views=1),
        views=ViewSettings(resolution=RESOLUTION, train=40, val=0, test=6, spp_train=16, spp_test=64),
    )
    folders = view_set_folders(plan, context.view_sets, context.show)
    tasks = [
        GroupTask(
            scene, seed, methods, plan.train, plan.score, plan.budget, context.scratch, folders[scene], plan.views
        )
        for scene, seed in plan.groups()
    ]
    many = min(context.workers, len(tasks))
    return [cell for cells in in_workers([partial(train_one, task, draw) for task in tasks], many) for cell in cells]


def train_one(task: GroupTask, draw: int) -> list[CellRecord]:
    """Return the cells of one scene and seed, trained in this process."""
    place = Path(tempfile.mkdtemp(dir=task.out))
    views = read_views(task.view_set, task.views, place)
    return list(train_group(replace(task, out=place), views, {}, lambda share: None, rounded_otherwise(draw)))


def rounded_otherwise(draw: int) -> Callable[..., Learner]:
    """Return a maker of learners whose first weights differ at random in their last bit; draw 0 leaves them."""

    def make(method: str, *others: object) -> Learner:
        learner = learner_for(method, *others)  # type: ignore[arg-type]
        if draw:
            generator = generator_for("rounding", draw, method)
            with torch.no_grad():
                for weight in learner.fields.parameters():
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


def _draws(method: str, score: str, stored: References) -> dict[str, list[float]]:
    return {key: draws[score] for key, draws in stored.cells.items() if method in ("all", key.split("/")[1])}


def loss_check(gate: Gate, new: Scores, stored: References, wider: float = 1.0) -> Check:
    """Check by how much the cells of a method, or of all, are better than the stored ones; below 0 they are worse."""
    _, method, score = gate.name.split(".")
    chosen = _draws(method, score, stored)
    limit = loss_limit(method, score, stored, wider)
    missing = [key for key in chosen if new.get(key, {}).get(score) is None]
    if missing or not chosen:
        return judge(gate, [], limit, f"no {score} of {', '.join(missing) or method}")
    fresh = np.array([new[key][score] for key in chosen], dtype=np.float64)
    if all(_rounded(float(value)) == _rounded(draws[0]) for value, draws in zip(fresh, chosen.values(), strict=True)):
        return judge(gate, [0.0], limit, "unchanged")
    sign = 1.0 if METRICS[score].higher_is_better else -1.0
    figure = float((sign * (fresh - np.array([np.mean(draws) for draws in chosen.values()]))).mean())
    error = rounding_error(list(chosen.values()))
    verdict = "worse" if limit.low is not None and figure < limit.low else "not worse"
    unit = SCORES[score] and f" {SCORES[score]}"
    return judge(gate, [figure], limit, f"changed, {figure:+.3f} ± {2 * error:.3f}{unit}: {verdict}")


def loss_limit(method: str, score: str, stored: References, wider: float = 1.0) -> Limit:
    """Return `LARGEST_LOSS`, or more if rounding may cause more; `detects` is found in nine of ten draws."""
    draws = list(_draws(method, score, stored).values())
    error = rounding_error(draws)
    least = LARGEST_LOSS[score] * (1.0 if method == "all" else 2.0) * wider
    low = max(least, ERRORS * error)
    return Limit(-low, None, 0.0, error, len(draws), low + float(norm.ppf(0.9)) * error)


def rounding_error(draws: Sequence[Sequence[float]]) -> float:
    """Return the standard error, by rounding alone, of the mean over cells of one draw minus those stored."""
    several = [np.var(some, ddof=1) * (1.0 + 1.0 / len(some)) for some in draws if len(some) > 1]
    return math.sqrt(float(np.mean(several)) / len(draws)) if several else 0.0


def headline_check(gate: Gate, cells: Sequence[CellRecord], stored: References, wider: float = 1.0) -> Check:
    """Check the difference of two methods over scenes, as a run's page has it, minus the stored one."""
    limit = Limit(-LARGEST_SHIFT * wider, LARGEST_SHIFT * wider)
    name = gate.name.removeprefix("worse.headline.")
    if name not in stored.statistics:
        return judge(gate, [], limit, "it is not among the stored comparisons")
    # scores alone are stored: a collapsed cell counts here as it does there, and is no failure of its own
    ended = [structs.replace(cell, warnings=[]) for cell in cells if cell.status == "done"]
    now = statistics_of(ended).get(name) if len(ended) == len(cells) else None
    if now is None:
        return judge(gate, [], limit, "a cell did not end")
    before = stored.statistics[name][0]
    return judge(gate, [now[0] - before], limit, f"{now[0]:+.3f} dB, stored {before:+.3f} dB")


def statistics_of(cells: Sequence[CellRecord]) -> dict[str, list[float]]:
    """Return for each headline the comparer's difference and the ends of its two intervals."""
    statistics = {}
    trained = {cell.method for cell in cells}
    for row in compare(list(cells), [method for method in TRAINED_METHODS if method in trained]):
        is_headline = (row.method, row.against) in HEADLINES
        if is_headline and (row.scene, row.metric, row.budget) == ("all", "psnr", "steps"):
            estimates = (row.on_these_scenes, row.scenes_like_these)
            ends = [end for estimate in estimates if estimate and estimate.interval for end in estimate.interval]
            if row.difference is not None:
                statistics[f"{row.method}_{row.against}"] = [row.difference, *ends]
    return statistics


def other_statistics(stored: References) -> int:
    """Count the numbers of the stored comparisons that come out otherwise today."""
    today = statistics_of(stored_cells(stored))
    differing = 0
    for name, before in stored.statistics.items():
        now = today.get(name, [])
        differing += abs(len(now) - len(before))
        differing += sum(not math.isclose(a, b, rel_tol=1e-6) for a, b in zip(now, before, strict=False))
    return differing


def stored_cells(stored: References) -> list[CellRecord]:
    """Return the cells as they were trained without a change of their first weights."""
    cells = []
    for key, scores in stored.cells.items():
        scene, method, seed = key.split("/")
        cells.append(cell_with(scene, method, int(seed), {score: draws[0] for score, draws in scores.items()}))
    return cells


def cell_with(scene: str, method: str, seed: int, scores: dict[str, float | None]) -> CellRecord:
    """Return a finished cell of which only scores are known."""
    point = Checkpoint(1, 1.0, 1, scores.get("psnr"), None, None)
    empty = unscored(scene, method, seed, "done", "")
    return structs.replace(empty, reason=None, steps=1, train_seconds=1.0, scores=scores, curve=[point])
