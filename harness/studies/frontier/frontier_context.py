"""The context of the frontier: the families, the budgets, one plan for each, and their run."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from harness.execution.progress import Progress
from harness.machine.device import keep_freed_memory, multiplies_bfloat16, use_threads
from harness.machine.provenance import provenance
from harness.plan.profiles import PROFILES, Machine, Plan
from harness.plan.schedule import Budget
from harness.plan.settings import TrainSettings
from harness.records.cells import CellRecord
from harness.studies import framework
from harness.studies.frontier.frontier_studies import AT_BUDGETS, SHELF, STUDIES
from harness.studies.trained_context import TrainedContext, with_valid_trainings
from harness.verdicts.failures import judgeable
from scenes.catalog.entries import CLASSICS

FAMILIES = ("nerf", "qnerf", "planes", "hash_grid", "splats", "ellipsoids", "voxels_drjit")
PHI = ("planes_phi", "planes_same_ends", "planes_same_size")
PHI_METHODS = (*PHI, *(name.replace("planes", "hash_grid") for name in PHI))
PHI_BUDGET = 15.0
CORE_SECONDS = "core_seconds_"
"""How the name of the training of a budget begins."""
BUDGETS = (4.0, 15.0, 60.0)
LONG_BUDGETS = (4.0, 8.0, 15.0, 30.0, 60.0, 120.0, 600.0)
"""The budgets of a cell's training, in core seconds: those of an hour on two cores, and all."""


@dataclass(frozen=True)
class Amount:
    """What is trained, and for how long."""

    scenes: tuple[str, ...] = tuple(CLASSICS)
    families: tuple[str, ...] = FAMILIES
    budgets: tuple[float, ...] = BUDGETS
    seeds: tuple[int, ...] = (0,)
    phi_seeds: tuple[int, ...] = (0, 1)
    resolution: int = 100

    @property
    def phi_budget(self) -> float:
        return min(PHI_BUDGET, max(self.budgets))

    @property
    def core_seconds(self) -> dict[str, float]:
        """Map training → the core seconds of all its cells."""
        cells = len(self.scenes) * len(self.families) * len(self.seeds)
        phi = self.phi_budget * len(self.scenes) * len(PHI_METHODS) * len(self.phi_seeds)
        return {AT_BUDGETS: cells * sum(self.budgets), "phi": phi}


AMOUNTS = {
    "default": Amount(),
    "quick": Amount(("ficus", "lego"), budgets=BUDGETS[:2], phi_seeds=(0,)),
    "long": Amount(budgets=LONG_BUDGETS, seeds=(0, 1, 2), phi_seeds=(0, 1, 2)),
}


def settings_for(budget: float, train: TrainSettings) -> TrainSettings:
    """Return the settings of a budget, the same for all families: in a short one the occupancy grid begins early, and
    the batches and grids of a long one are those of the profile `converged`.
    """
    if budget <= 8.0:
        return replace(train, warm_up_steps=20, grid=replace(train.grid, first_step=40, every=15))
    if budget < 60.0:
        return train
    return replace(PROFILES["converged"].train, precision=train.precision)


@dataclass(frozen=True)
class FrontierContext(TrainedContext):
    """One run of the frontier."""

    command = "nox -s frontier"
    precision_as_planned: bool
    """Whether this processor has the profile's bfloat16 matrix multiplications."""
    amount: Amount

    def named(self, *trainings: str) -> list[str]:
        """Return the names of trainings, with one for each budget."""
        budgets = [f"{CORE_SECONDS}{budget:g}" for budget in self.amount.budgets]
        return [name for training in trainings for name in (budgets if training == AT_BUDGETS else [training])]

    def repaired(self, name: str) -> bool:
        resumed = [
            super(FrontierContext, self).repaired(one) for one in self.named(name)
        ]  # each of them, not the first
        return any(resumed)

    def scale(self, *names: str) -> str:
        return super().scale(*self.named(*names))

    def plan(self, name: str) -> Plan:
        profile, amount, is_phi = PROFILES["reduced"], self.amount, name == "phi"
        train = profile.train if self.precision_as_planned else replace(profile.train, precision="float32")
        budget = amount.phi_budget if is_phi else float(name.removeprefix(CORE_SECONDS))
        return replace(
            profile.alone(),
            scenes=amount.scenes,
            methods=PHI_METHODS if is_phi else amount.families,
            seeds=amount.phi_seeds if is_phi else amount.seeds,
            budget=Budget(None, None, budget),
            train=settings_for(budget, train),
            score=replace(profile.score, checkpoints=1, stored_views=1),
            views=replace(profile.views, resolution=amount.resolution),
        )

    def frontier(self) -> "Frontier":
        """Return all cells of the budgets, trained now or before."""
        cells = {budget: self.trained(f"{CORE_SECONDS}{budget:g}").cells for budget in self.amount.budgets}
        return Frontier(self.amount, cells)


@dataclass(frozen=True)
class Frontier:
    """The cells of every budget."""

    amount: Amount
    cells: dict[float, list[CellRecord]]

    @property
    def budgets(self) -> list[float]:
        return sorted(self.cells)

    @property
    def trained(self) -> tuple[str, ...]:
        """Return the families with any score."""
        return tuple(name for name in self.amount.families if any(self.of(budget, name) for budget in self.cells))

    def of(self, budget: float, family: str) -> list[CellRecord]:
        """Return the cells that ended with a picture."""
        return [cell for cell in self.cells[budget] if cell.method == family and judgeable(cell)]

    def values(self, budget: float, family: str, name: str) -> Float[np.ndarray, "scenes seeds"]:
        """Return a score of every cell; NaN where there is none."""
        found = {(cell.scene, cell.seed): cell.scores.get(name) for cell in self.of(budget, family)}
        rows = [[found.get((scene, seed)) for seed in self.amount.seeds] for scene in self.amount.scenes]
        return np.array(rows, dtype=np.float64)

    def table(self, budget: float, families: tuple[str, ...]) -> Float[np.ndarray, "methods scenes"]:
        """Return PSNR, each the mean over seeds; NaN where a seed has none."""
        return np.array([self.values(budget, family, "psnr").mean(axis=1) for family in families])


def run(
    studies: list[str], amount: Amount, out: Path, view_sets: Path, machine: Machine, resume: bool, show: Progress
) -> int:
    """Run `studies` into `out`; with `resume` only those that are not complete there. Returns 0, or 3 if a check fails.

    Raises `InputError` before anything is measured if `out` cannot be used.
    """
    device = torch.device(machine.device)
    use_threads(machine.threads)
    keep_freed_memory()
    as_planned = multiplies_bfloat16(device)

    def seconds(name: str) -> float:
        """Return the wall seconds, with a sixth more for scoring; what an earlier study trained is trained."""
        first = {training: study for study in reversed(studies) for training in STUDIES[study].trainings}
        work = sum(amount.core_seconds[training] for training, study in first.items() if study == name)
        return STUDIES[name].seconds + work * 7 / 6 / (machine.workers * machine.threads)

    return framework.run(
        SHELF,
        studies,
        out,
        resume,
        {"amount": asdict(amount), "device": machine.device},
        provenance(device),
        lambda scratch, _: FrontierContext(out, view_sets, scratch, False, show, machine, as_planned, amount),
        show,
        repaired=lambda record, here: with_valid_trainings(record, studies, STUDIES, here),
        scale_of=lambda study, here: here.scale(*study.trainings),
        seconds_of=seconds,
    )
