"""Training gates: short trainings with fixed steps and seeds, recorded as ordinary runs."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from harness.comparisons import compare
from harness.gate.catalog import (
    AGAIN_SEEDS,
    GATE_SEEDS,
    RENEWAL_SEEDS,
    RESOLUTION,
    STEPS,
    TRAINED_METHODS,
    TRAINED_SCENES,
    Gate,
)
from harness.gate.outcome import Pictures, Sample
from harness.gate.situation import Renewal, Situation
from harness.pictures_record import last_of, read_renders, read_truth, truth_pictures
from harness.plan import SHORT_TRAINING, Machine, Plan
from harness.records import CellRecord, read_cells, records_folder
from harness.runner import run
from harness.schedule import Budget
from harness.settings import GridSettings, ScoreSettings, ViewSettings
from scenes.errors import InputError

Cells = dict[tuple[str, str, int], CellRecord]
AGAIN = "nerf_again"


def gate_plan(seeds: tuple[int, ...], scenes: Sequence[str], methods: Sequence[str]) -> Plan:
    """Float32 always, so that machines differ by rounding alone."""
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


def wanted(gates: Iterable[Gate]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Scenes and methods that have to be trained for these gates."""
    parts = [gate.name.split(".") for gate in gates]
    everywhere = any(one[1] == "all" for one in parts)
    scenes = tuple(scene for scene in TRAINED_SCENES if everywhere or scene in {one[1] for one in parts})
    return scenes, tuple(method for method in TRAINED_METHODS if method in {one[2] for one in parts})


def measure(situation: Situation, gates: tuple[Gate, ...]) -> dict[str, Sample]:
    """Trains what the gates need and nothing else; a cell that did not end gives no figure."""
    scenes, methods = wanted(gates)
    cells = trained(situation, "training", gate_plan(GATE_SEEDS, scenes, methods))
    return {gate.name: sample_of(gate, cells, GATE_SEEDS, situation.out / "training") for gate in gates}


def renew(situation: Situation, gates: tuple[Gate, ...]) -> Renewal:
    """Raises `InputError` where a cell did not end: limits of survivors would say nothing of the others."""
    cells = trained(situation, "renewal", gate_plan(RENEWAL_SEEDS, TRAINED_SCENES, TRAINED_METHODS))
    stopped = [f"{cell.scene} {cell.method} seed {cell.seed}: {cell.reason}" for cell in cells.values()
               if cell.status != "done"]  # fmt: skip
    if stopped:
        raise InputError(f"--renew: no limits can be taken from cells that did not end ({'; '.join(stopped)})")
    return {gate.name: _complete(gate, values_of(gate, cells, RENEWAL_SEEDS)) for gate in gates}


def _complete(gate: Gate, values: list[float | None]) -> list[float]:
    if any(value is None for value in values):
        raise InputError(f"--renew: {gate.name} has no figure for some seed; such a gate cannot be kept")
    return [value for value in values if value is not None]


def trained(situation: Situation, folder: str, plan: Plan) -> Cells:
    """An ordinary run in `OUT/<folder>`."""
    out = situation.out / folder
    out.mkdir(parents=True, exist_ok=True)
    workers = min(situation.workers, len(plan.groups()))
    run(plan, out, situation.view_sets, Machine("cpu", workers, 1), "python -m harness gate", situation.show)
    return {(cell.scene, cell.method, cell.seed): cell for cell in read_cells(out)}


def values_of(gate: Gate, cells: Cells, seeds: Sequence[int]) -> list[float | None]:
    """One figure a seed; None where a cell is missing, did not end or has no such score."""
    scene, method, score = address(gate)
    scenes = TRAINED_SCENES if scene == "all" else (scene,)
    found = []
    for seed in seeds:
        each = [_score(cells.get((one, method, seed)), score) for one in scenes]
        known = [value for value in each if value is not None]
        found.append(float(np.mean(known)) if len(known) == len(each) else None)
    return found


def address(gate: Gate) -> tuple[str, str, str]:
    """(scene or all, method, score); the A/A comparison is of `nerf` on all scenes."""
    parts = gate.name.split(".")
    return ("all", "nerf", parts[-1]) if gate.kind == "fairness" else (parts[1], parts[2], parts[3])


def _score(cell: CellRecord | None, score: str) -> float | None:
    return None if cell is None or cell.status != "done" else cell.scores.get(score)


def sample_of(gate: Gate, cells: Cells, seeds: Sequence[int], out: Path) -> Sample:
    scene, method, _ = address(gate)
    used = [cells.get((one, method, seed)) for seed in seeds for one in
            (TRAINED_SCENES if scene == "all" else (scene,))]  # fmt: skip
    why = [f"{cell.scene} {cell.method} seed {cell.seed} is {cell.status}: {cell.reason}" for cell in used
           if cell is not None and cell.status != "done"]  # fmt: skip
    why += ["a cell is missing"] if None in used else []
    shown = next((cell for cell in used if cell is not None and cell.pictures), None)
    pictures = None if shown is None else pictures_of(shown, out)
    return Sample(values_of(gate, cells, seeds), "; ".join(why), pictures)


def pictures_of(cell: CellRecord, out: Path) -> Pictures:
    """A kept test view of the cell beside the truth."""
    folder = records_folder(out)
    shown = last_of(read_renders(folder / (cell.pictures or "")))[0]
    found = next(one for one in read_truth(folder / truth_pictures(cell.scene)) if one.view == shown.view)
    image, truth = (np.clip(one.astype(np.float32), 0.0, 1.0) for one in (shown.colour, found.display))
    return Pictures(image, truth, np.abs(image - truth))


def a_a(situation: Situation, scores: Iterable[str]) -> dict[str, float | None]:
    """Score → what `harness.comparisons.compare` says of nerf against nerf with other seeds, over all scenes."""
    first = [cell for cell in read_cells(situation.out / "training") if cell.method == "nerf"]
    there = len(first) == len(GATE_SEEDS) * len(TRAINED_SCENES)
    seeds = AGAIN_SEEDS if there else (*GATE_SEEDS, *AGAIN_SEEDS)
    cells = trained(situation, "training_again", gate_plan(seeds, TRAINED_SCENES, ("nerf",))).values()
    arms = first if there else [cell for cell in cells if cell.seed in GATE_SEEDS]
    arms += [
        replace(cell, method=AGAIN, seed=GATE_SEEDS[AGAIN_SEEDS.index(cell.seed)])
        for cell in cells
        if cell.seed in AGAIN_SEEDS
    ]
    rows = compare(arms, ["nerf", AGAIN])
    found = {row.metric: row for row in rows if row.scene == "all" and row.budget == "steps"}
    # where a cell has no score it is no comparison of all
    return {name: None if found[name].unpaired else found[name].difference for name in scores}
