"""Which candidate becomes `qnerf_repaired`: all of them are compared at equal time, on validation views of scenes and
seeds that no verdict is taken from. Candidates and rule stood here before any result, the budget did not (`HISTORY`);
nothing in it can be set.
"""

import math
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from baselines.methods.repaired import CANDIDATES, EXCLUDED
from harness.machine.provenance import provenance
from harness.plan.needed import for_scene
from harness.plan.profiles import PROFILES, Plan
from harness.plan.schedule import Budget
from harness.records.json_record import Record, as_promised, load_json, plain
from harness.studies.choices.arms import views_of
from harness.studies.evidence.evidence_context import SEARCHED
from harness.training.batches import Batches
from harness.training.learner import Learner, take_step, warm_up
from harness.training.lockstep import box_of, needs_view_direction, psnr_on, stream_of, turns
from harness.training.make_learner import learner_for
from harness.training.scoring import evaluate
from harness.training.trainer import Diverged
from scenes.files.errors import InputError
from scenes.view_sets.view_set import ViewSet

SEEDS = (1_000, 1_001)
"""Seeds that no verdict uses."""
SECONDS = 6.0
"""The training time of each cell: about 500 steps of NeRF at reduced size."""
HISTORY = (
    "A first try at 16 processor seconds a cell was stopped after chair with seed 1000, because it went on for 1300 to "
    "1500 steps where 500 were meant. Its nine scores had been seen; none of them is among the rows. Only the budget "
    "was changed, to 6.",
)
"""The changes made after results had been seen."""
REFERENCES = ("nerf", "nerf_phi_encoding_phi_skip", "qnerf", "qnerf_theorem")
"""Methods trained beside the candidates for comparison; none of them is a candidate."""
RULE = (
    "The best mean PSNR over validation views, scenes and seeds after equal training time. A candidate that diverges "
    "anywhere is out. One whose mean is within one standard error, of the paired differences over scenes and seeds, of "
    "the best ties with it; of those that tie the first in the order of candidates, the simplest, is chosen."
)

PUBLISHED = Path(__file__).parents[3] / "docs" / "repair_search.json"
"""The result of the search that gave `baselines.methods.repaired.REPAIRED`."""


class RepairRow(Record, frozen=True):
    """One method on one scene with one seed."""

    method: str
    scene: str
    seed: int
    psnr_val: float | None
    """The mean over the validation views; None if training diverged."""
    steps: int
    seconds: float
    """The seconds of training: of the processor on a CPU, so that other programs do not count, else by the wall."""
    network_evaluations: int
    alpha: float | None
    beta: float | None


class CandidateRank(Record, frozen=True):
    """One candidate over all scenes and seeds."""

    method: str
    mean: float | None
    """None if it is excluded."""
    behind: float | None
    """The best minus this one, in dB."""
    standard_error: float | None
    """The standard error of `behind`."""
    ties: bool


class Search(Record, frozen=True):
    """A search that is done."""

    rows: list[RepairRow]
    standings: list[CandidateRank]
    chosen: str
    history: list[str]
    """The changes made after results had been seen, one or more sentences each."""
    clock: str
    """The unit that the budget is counted in."""


def read_search(path: Path = PUBLISHED) -> Search:
    """Raises `InputError` where the file is not what `python -m harness study repair` writes."""
    try:
        data = load_json(path)
        return as_promised({name: data[name] for name in Search.__struct_fields__}, Search)
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise InputError(f"{path}: {error}; write it with `python -m harness study repair --out {path}`") from error


def search_plan(precision_as_planned: bool, quick: bool = False) -> Plan:
    """Return the profile `reduced` on the search's scenes and seeds, at equal time; `quick` trains next to nothing."""
    plan = PROFILES["reduced"].alone()
    whole = replace(
        plan,
        scenes=SEARCHED,
        methods=(*CANDIDATES, *REFERENCES),
        seeds=SEEDS,
        budget=Budget(steps=None, seconds=SECONDS),
        train=plan.train if precision_as_planned else replace(plan.train, precision="float32"),
    )
    if not quick:
        return whole
    views = replace(plan.views, resolution=16, train=3, val=1, test=1, spp_train=2, spp_test=2)
    return replace(whole, scenes=SEARCHED[:1], seeds=SEEDS[:1], views=views, budget=Budget(steps=None, seconds=0.1))


def search(plan: Plan, folders: dict[str, Path], device: torch.device, scratch: Path) -> Iterator[RepairRow]:
    """Train every method of `plan` on every scene with every seed; decoded images go to `scratch`, a folder on a disk.

    Raises `InputError` for a view set without validation views.
    """
    for scene, folder in folders.items():
        views = views_of(folder, plan, scratch, "val")
        for seed in plan.seeds:
            yield from _together(plan, views, scene, seed, device)


def standings(rows: list[RepairRow]) -> list[CandidateRank]:
    """Return the candidates in their own order. Raises `ValueError` if none has a score everywhere."""
    scores: dict[str, np.ndarray] = {}
    # scenes and seeds always in the same order; NaN where training diverged
    for name in (name for name in CANDIDATES if any(row.method == name for row in rows)):
        mine = sorted((row for row in rows if row.method == name), key=lambda row: (row.scene, row.seed))
        scores[name] = np.array([math.nan if row.psnr_val is None else row.psnr_val for row in mine])
    complete = [values for values in scores.values() if np.isfinite(values).all()]
    if not complete:
        raise ValueError("every candidate diverged somewhere: there is nothing to choose")
    best = max(complete, key=lambda values: float(values.mean()))
    table = []
    for name, values in scores.items():
        behind = best - values
        mean, error = float(behind.mean()), float(behind.std(ddof=1)) / behind.size**0.5 if behind.size > 1 else 0.0
        if np.isfinite(mean):
            table.append(CandidateRank(name, float(values.mean()), mean, error, mean <= error))
        else:
            table.append(CandidateRank(name, None, None, None, ties=False))
    return table


def chosen(table: list[CandidateRank]) -> str:
    """Return the candidate that `RULE` chooses."""
    return next(candidate.method for candidate in table if candidate.ties)


def as_json(rows: list[RepairRow], plan: Plan, device: torch.device) -> dict[str, Any]:
    table = standings(rows)
    return {
        "what": "candidates for qnerf_repaired at equal training time, on validation views",
        "rule": RULE,
        "history": list(HISTORY),
        "clock": "processor seconds" if device.type == "cpu" else "seconds of the wall",
        "provenance": provenance(device),
        "candidates": {name: asdict(parts) for name, parts in CANDIDATES.items()},
        "excluded": EXCLUDED,
        "references": list(REFERENCES),
        "settings": plan.settings(),
        "rows": plain(rows),
        "standings": plain(table),
        "chosen": chosen(table),
    }


def _together(plan: Plan, views: ViewSet, scene: str, seed: int, device: torch.device) -> Iterator[RepairRow]:
    """Train in turn on the same batches, each until its own time is spent: what slows the machine slows them all."""
    settings, stream = for_scene(plan.train, views), stream_of(scene, seed)
    cameras = evaluate.cameras_of(views, views.train, device)
    batch_at = Batches(cameras, views.train.rgba, settings.covered_share).stream(stream, settings.rays)
    box, directed = box_of(views, device), needs_view_direction(views)
    on_cores = device.type == "cpu"
    budget = Budget(None, None, plan.budget.seconds) if on_cores else plan.budget
    active: list[Learner] = []
    for method in plan.methods:
        learner = learner_for(method, box, settings, budget, stream, device, directed)
        warm_up(learner, batch_at)
        active.append(learner)
    for order in turns(active):
        for learner in order:
            try:
                take_step(learner, batch_at)
                if learner.progress < 1.0:
                    continue
                score = psnr_on(learner, views, views.val, plan.score.chunk)
            except Diverged:
                score = None
            active.remove(learner)
            evaluations, scalars = learner.network_evaluations, learner.amplifier_scalars()
            seconds = learner.clock.core_seconds if on_cores else learner.clock.seconds
            yield RepairRow(learner.method, scene, seed, score, learner.step, seconds, evaluations, **scalars)
