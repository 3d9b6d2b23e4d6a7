"""The context of the frontier: the families, the budgets, and the plan of each training."""

import math
from dataclasses import asdict, dataclass, replace

import numpy as np
from jaxtyping import Float

from baselines.catalog import CATALOG
from harness.plan.profiles import PROFILES
from harness.plan.run_plan import Plan
from harness.plan.schedule import Budget
from harness.plan.settings import TrainSettings
from harness.records.cells import CellRecord
from harness.studies.framework import Study
from harness.studies.frontier.frontier_studies import AT_BUDGETS, AT_LARGE_BUDGETS
from harness.studies.trained_context import TrainedContext
from harness.verdicts.failures import judgeable
from scenes.catalog.entries import CLASSICS

FAMILIES = ("nerf", "qnerf", "planes", "hash_grid", "splats", "ellipsoids", "voxels_drjit")
PHI = ("planes_phi", "planes_same_ends", "planes_same_size")
PHI_METHODS = (*PHI, *(name.replace("planes", "hash_grid") for name in PHI))
PHI_BUDGET = 15.0
CORE_SECONDS = "core_seconds_"
LARGE = "large_"
"""The beginning of the name of a training at a budget, and of one with larger pictures."""
BUDGETS = (4.0, 15.0, 60.0)
LONG_BUDGETS = (*BUDGETS, 240.0)
"""The core seconds of a cell's training: by default, somewhat over an hour on two cores, and with `--long`."""
VIEWS = replace(PROFILES["reduced"].views, spp_train=256, ceiling_train_db=42.0)
"""The usual views. With those of a short run, whose noise allows 36 dB, trainings of a minute fit the noise; trainings
on larger pictures are far from it, and use the views of a short run.
"""
GAUSSIANS = {8.0: (2500, 5000), 60.0: (4000, 8000), 600.0: (4000, 16_000), math.inf: (8000, 40_000)}
"""Budgets below which `splats` begins with, and grows to, so many Gaussians: more than it can train are worse."""


@dataclass(frozen=True)
class Amount:
    scenes: tuple[str, ...] = tuple(CLASSICS)
    families: tuple[str, ...] = FAMILIES
    budgets: tuple[float, ...] = BUDGETS
    seeds: tuple[int, ...] = (0,)
    phi_seeds: tuple[int, ...] = (0, 1)
    resolution: int = 100
    large_scenes: tuple[str, ...] = ("chair", "ficus", "lego")
    large_families: tuple[str, ...] = ("nerf", "planes", "hash_grid", "splats")
    large_budgets: tuple[float, ...] = (60.0,)
    large_resolution: int = 400

    @property
    def phi_budget(self) -> float:
        return min(PHI_BUDGET, max(self.budgets))

    @property
    def core_seconds(self) -> dict[str, float]:
        cells = len(self.scenes) * len(self.families) * len(self.seeds)
        phi = self.phi_budget * len(self.scenes) * len(PHI_METHODS) * len(self.phi_seeds)
        large = len(self.large_scenes) * len(self.large_families) * len(self.seeds) * sum(self.large_budgets)
        return {AT_BUDGETS: cells * sum(self.budgets), "phi": phi, AT_LARGE_BUDGETS: large}

    def at_large(self) -> "Amount":
        """Return the amount of the trainings with larger pictures, as if they were all."""
        scenes, families, budgets = self.large_scenes, self.large_families, self.large_budgets
        return replace(self, scenes=scenes, families=families, budgets=budgets, resolution=self.large_resolution)


AMOUNTS = {
    "default": Amount(),
    "quick": Amount(
        ("ficus", "lego"), budgets=BUDGETS[:2], phi_seeds=(0,),
        large_scenes=("lego",), large_budgets=BUDGETS[:1], large_resolution=150,
    ),
    "long": Amount(
        budgets=LONG_BUDGETS, seeds=(0, 1, 2), phi_seeds=(0, 1, 2), large_budgets=(60.0, 600.0)
    ),
}  # fmt: skip


def settings_for(budget: float, train: TrainSettings) -> TrainSettings:
    """Return the settings of all families: a short budget uses its grid early, a long one trains as `converged`."""
    if budget <= 8.0:
        train = replace(train, warm_up_steps=20, grid=replace(train.grid, first_step=40, every=15))
    elif budget >= 60.0:
        train = replace(PROFILES["converged"].train, precision=train.precision)
    first, most = next(counts for below, counts in GAUSSIANS.items() if budget < below)
    splats = replace(CATALOG["splats"].settings, first=first, most=most)
    return replace(train, own={**train.own, "splats": splats})


@dataclass(frozen=True)
class FrontierContext(TrainedContext):
    command = "nox -s frontier"
    amount: Amount

    def settings(self) -> dict[str, object]:
        return {"amount": asdict(self.amount), "device": self.machine.device}

    def trainings(self, *studies: Study) -> list[str]:
        """Return the names of the trainings, one per budget in place of `AT_BUDGETS`."""
        stands_for = {
            AT_BUDGETS: [f"{CORE_SECONDS}{budget:g}" for budget in self.amount.budgets],
            AT_LARGE_BUDGETS: [f"{LARGE}{budget:g}" for budget in self.amount.large_budgets],
        }
        return [each for name in super().trainings(*studies) for each in stands_for.get(name, [name])]

    def seconds(self, study: Study, asked: list[Study]) -> float:
        """Return wall seconds, with a sixth added for scoring; a shared training counts for its first study only."""
        first = {training: other.info.id for other in reversed(asked) for training in other.trainings}
        work = sum(self.amount.core_seconds[training] for training, id in first.items() if id == study.info.id)
        return study.seconds + work * 7 / 6 / (self.machine.workers * self.machine.threads)

    def plan(self, name: str) -> Plan:
        profile, is_phi, is_large = PROFILES["reduced"], name == "phi", name.startswith(LARGE)
        amount = self.amount.at_large() if is_large else self.amount
        train = profile.train if self.as_planned else replace(profile.train, precision="float32")
        budget = amount.phi_budget if is_phi else float(name.rpartition("_")[2])
        return replace(
            profile.without_extras(),
            scenes=amount.scenes,
            methods=PHI_METHODS if is_phi else amount.families,
            seeds=amount.phi_seeds if is_phi else amount.seeds,
            budget=Budget(None, None, budget),
            train=settings_for(budget, train),
            score=replace(profile.score, checkpoints=1, stored_views=1),
            views=replace(profile.views if is_large else VIEWS, resolution=amount.resolution),
        )

    def frontier(self, *, large: bool = False) -> "Frontier":
        """Return the cells of all budgets, of usual or larger pictures, after training those that are missing."""
        amount, prefix = (self.amount.at_large(), LARGE) if large else (self.amount, CORE_SECONDS)
        return Frontier(amount, {budget: self.trained(f"{prefix}{budget:g}").cells for budget in amount.budgets})


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

    def mean(self, budget: float, family: str, name: str) -> str | None:
        """Return the mean of a score over scenes and seeds to three decimals; None if one is missing."""
        value = float(self.values(budget, family, name).mean())
        return None if np.isnan(value) else f"{value:.3f}"
