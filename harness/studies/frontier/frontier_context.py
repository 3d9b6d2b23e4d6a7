"""The context of the frontier: the families, the budgets, and the plan of each training."""

from dataclasses import asdict, dataclass, replace

import numpy as np
from jaxtyping import Float

from harness.plan.profiles import PROFILES
from harness.plan.run_plan import Plan
from harness.plan.schedule import Budget
from harness.plan.settings import TrainSettings
from harness.records.cells import CellRecord
from harness.studies.framework import Study
from harness.studies.frontier.frontier_studies import AT_BUDGETS
from harness.studies.trained_context import TrainedContext
from harness.verdicts.failures import judgeable
from scenes.catalog.entries import CLASSICS

FAMILIES = ("nerf", "qnerf", "planes", "hash_grid", "splats", "ellipsoids", "voxels_drjit")
PHI = ("planes_phi", "planes_same_ends", "planes_same_size")
PHI_METHODS = (*PHI, *(name.replace("planes", "hash_grid") for name in PHI))
PHI_BUDGET = 15.0
CORE_SECONDS = "core_seconds_"
BUDGETS = (4.0, 15.0, 60.0)
LONG_BUDGETS = (4.0, 8.0, 15.0, 30.0, 60.0, 120.0, 600.0)
"""The core seconds of a cell's training: by default, about an hour on two cores, and with `--long`."""


@dataclass(frozen=True)
class Amount:
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
        cells = len(self.scenes) * len(self.families) * len(self.seeds)
        phi = self.phi_budget * len(self.scenes) * len(PHI_METHODS) * len(self.phi_seeds)
        return {AT_BUDGETS: cells * sum(self.budgets), "phi": phi}


AMOUNTS = {
    "default": Amount(),
    "quick": Amount(("ficus", "lego"), budgets=BUDGETS[:2], phi_seeds=(0,)),
    "long": Amount(budgets=LONG_BUDGETS, seeds=(0, 1, 2), phi_seeds=(0, 1, 2)),
}


def settings_for(budget: float, train: TrainSettings) -> TrainSettings:
    """Return the settings of all families: a short budget uses its grid early, a long one trains as `converged`."""
    if budget <= 8.0:
        return replace(train, warm_up_steps=20, grid=replace(train.grid, first_step=40, every=15))
    if budget < 60.0:
        return train
    return replace(PROFILES["converged"].train, precision=train.precision)


@dataclass(frozen=True)
class FrontierContext(TrainedContext):
    command = "nox -s frontier"
    amount: Amount

    def settings(self) -> dict[str, object]:
        return {"amount": asdict(self.amount), "device": self.machine.device}

    def trainings(self, *studies: Study) -> list[str]:
        """Return the names of the trainings, one per budget in place of `AT_BUDGETS`."""
        budgets = [f"{CORE_SECONDS}{budget:g}" for budget in self.amount.budgets]
        names = super().trainings(*studies)
        return [each for name in names for each in (budgets if name == AT_BUDGETS else [name])]

    def seconds(self, study: Study, asked: list[Study]) -> float:
        """Return wall seconds, with a sixth added for scoring; a shared training counts for its first study only."""
        first = {training: other.info.id for other in reversed(asked) for training in other.trainings}
        work = sum(self.amount.core_seconds[training] for training, id in first.items() if id == study.info.id)
        return study.seconds + work * 7 / 6 / (self.machine.workers * self.machine.threads)

    def plan(self, name: str) -> Plan:
        profile, amount, is_phi = PROFILES["reduced"], self.amount, name == "phi"
        train = profile.train if self.as_planned else replace(profile.train, precision="float32")
        budget = amount.phi_budget if is_phi else float(name.removeprefix(CORE_SECONDS))
        return replace(
            profile.without_extras(),
            scenes=amount.scenes,
            methods=PHI_METHODS if is_phi else amount.families,
            seeds=amount.phi_seeds if is_phi else amount.seeds,
            budget=Budget(None, None, budget),
            train=settings_for(budget, train),
            score=replace(profile.score, checkpoints=1, stored_views=1),
            views=replace(profile.views, resolution=amount.resolution),
        )

    def frontier(self) -> "Frontier":
        """Return the cells of all budgets, after training those that are missing."""
        cells = {budget: self.trained(f"{CORE_SECONDS}{budget:g}").cells for budget in self.amount.budgets}
        return Frontier(self.amount, cells)


@dataclass(frozen=True)
class Frontier:
    amount: Amount
    cells: dict[float, list[CellRecord]]

    @property
    def budgets(self) -> list[float]:
        return sorted(self.cells)

    @property
    def trained(self) -> tuple[str, ...]:
        return tuple(name for name in self.amount.families if any(self.of(budget, name) for budget in self.cells))

    def of(self, budget: float, family: str) -> list[CellRecord]:
        return [cell for cell in self.cells[budget] if cell.method == family and judgeable(cell)]

    def values(self, budget: float, family: str, name: str) -> Float[np.ndarray, "scenes seeds"]:
        scores = {(cell.scene, cell.seed): cell.scores.get(name) for cell in self.of(budget, family)}
        rows = [[scores.get((scene, seed)) for seed in self.amount.seeds] for scene in self.amount.scenes]
        return np.array(rows, dtype=np.float64)

    def table(self, budget: float, families: tuple[str, ...]) -> Float[np.ndarray, "methods scenes"]:
        """Return the mean PSNR over seeds, NaN where a seed has none."""
        return np.array([self.values(budget, family, "psnr").mean(axis=1) for family in families])
