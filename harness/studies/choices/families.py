"""The same small search for every family of the frontier: as it is, at half and double its rates, smaller and larger.

All trials train for the same core seconds, on the frontier's training views, with a seed that no verdict uses, and are
scored on validation views. The winner is written into the program by hand.
"""

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from baselines.catalog import CATALOG
from baselines.methods.explicit import GaussianSettings, geometric
from harness.plan.profiles import PROFILES
from harness.plan.run_plan import Plan
from harness.plan.schedule import Budget
from harness.studies.choices.arms import PLANNED, Arm, means_of
from harness.studies.choices.sweep import SEED, try_arms
from harness.studies.frontier.frontier_context import VIEWS, settings_for

SEARCHED = ("chair", "ship")
BUDGET = 15.0
"""The core seconds of a training."""
USUAL = PROFILES["reduced"].train


@dataclass(frozen=True)
class Trial:
    what: str = "as the frontier trains it"
    arm: Arm = field(default_factory=Arm)


def _rates(factor: float) -> Trial:
    rates = {name: factor * getattr(USUAL, name) for name in ("learning_rate", "last_learning_rate")}
    return Trial(" to ".join(f"{rate:g}" for rate in rates.values()), Arm(rates))


def _gaussian_rates(family: str) -> Callable[[float], Trial]:
    usual: GaussianSettings = CATALOG[family].settings
    return lambda factor: Trial(
        f"positions {factor * usual.faster * usual.position:g}, the others alike",
        Arm(own=replace(usual, faster=factor * usual.faster)),
    )


def _width(width: int) -> Trial:
    network = replace(USUAL.network, width=width, colour_width=width // 2)
    return Trial(f"{network.depth} × {width}", Arm({"network": network}))


def _own(what: str, family: str, **changes: Any) -> Trial:
    usual = USUAL.own.get(family, CATALOG[family].settings)
    return Trial(what, Arm(own=replace(usual, **changes)))


def _planes(*nodes: int) -> Trial:
    return _own(", ".join(f"{count}²" for count in nodes), "planes", nodes=nodes)


def _tables(finest: int, levels: int, entries: int) -> Trial:
    what = f"{levels} levels to {finest}, {entries} entries"
    return _own(what, "hash_grid", cells=geometric(16, finest, levels), entries=entries)


def _gaussians(family: str, first: int, most: int) -> Trial:
    return _own(f"{first} to {most}", family, first=first, most=most)


def _voxels(finest: int) -> Trial:
    return _own(f"{finest}³", "voxels_drjit", finest=finest, bins=finest * 3 // 2)


def _trials(rates: Callable[[float], Trial], smaller: Trial, larger: Trial) -> dict[str, Trial]:
    scaled = {"half the rates": rates(0.5), "double the rates": rates(2.0)}
    return {PLANNED: Trial(), **scaled, "smaller": smaller, "larger": larger}


NETWORKS = _trials(_rates, _width(48), _width(96))
TRIALS: dict[str, dict[str, Trial]] = {
    "nerf": NETWORKS,
    "qnerf": NETWORKS,
    "planes": _trials(_rates, _planes(24, 48, 96), _planes(32, 64, 128, 256)),
    "hash_grid": _trials(_rates, _tables(128, 8, 1 << 14), _tables(256, 14, 1 << 16)),
    "splats": _trials(_gaussian_rates("splats"), _gaussians("splats", 2000, 4000), _gaussians("splats", 6000, 14_000)),
    "ellipsoids": _trials(
        _gaussian_rates("ellipsoids"), _gaussians("ellipsoids", 1500, 2500), _gaussians("ellipsoids", 5000, 9000)
    ),
    "voxels_drjit": _trials(_rates, _voxels(48), _voxels(96)),
}


@dataclass(frozen=True)
class FamilyRow:
    family: str
    trial: str
    scene: str
    psnr_val: float | None
    core_seconds: float
    steps: int
    why: str


def search_plan(as_planned: bool, quick: bool = False) -> Plan:
    """Return the frontier's plan on the scenes of the search; with `quick` it trains almost nothing."""
    plan = replace(PROFILES["reduced"].without_extras(), views=VIEWS).with_validation_views()
    train = settings_for(BUDGET, plan.train if as_planned else replace(plan.train, precision="float32"))
    plan = replace(
        plan, scenes=SEARCHED, methods=tuple(TRIALS), seeds=(SEED,), budget=Budget(None, None, BUDGET), train=train
    )
    if not quick:
        return plan
    views = replace(plan.views, resolution=16, train=3, val=1, test=1, spp_train=2, spp_test=2)
    few = ("nerf", "planes", "splats")
    return replace(plan, scenes=SEARCHED[:1], methods=few, views=views, budget=Budget(None, None, 0.1))


def search(
    plan: Plan, folders: dict[str, Path], scratch: Path, workers: int, device: str, kept: Path | None = None
) -> Iterator[FamilyRow]:
    def arms_of(family: str) -> dict[str, Arm]:
        return {words: trial.arm for words, trial in TRIALS[family].items()}

    for family, words, scene, ended in try_arms(plan, arms_of, folders, scratch, workers, device, kept):
        yield FamilyRow(family, words, scene, ended.psnr, ended.core_seconds, ended.steps, ended.why)


def means(rows: list[FamilyRow], family: str) -> dict[str, float | None]:
    """Map trial → the mean over scenes, the best first; None, and last, if a scene has no score."""
    return means_of((row.trial, row.psnr_val) for row in rows if row.family == family)


def as_json(rows: list[FamilyRow], plan: Plan, provenance: dict[str, object]) -> dict[str, object]:
    families = dict.fromkeys(row.family for row in rows)
    return {
        "seed": SEED,
        "provenance": provenance,
        "settings": plan.settings(),
        "trials": {family: {words: trial.what for words, trial in TRIALS[family].items()} for family in families},
        "rows": [asdict(row) for row in rows],
        "means": {family: means(rows, family) for family in families},
    }
