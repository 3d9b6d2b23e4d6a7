"""The constants that the paper leaves open, chosen for each method by the same search on validation views.

The unit of density and the start of the field decide how a method trains and, if its density is bounded, what it can
show at all. The same number is a slope for one method and a ceiling for another. So every method is trained with every
pair of constants, on all scenes of the plan, with a seed that no verdict uses.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path

from baselines.amplifiers import AMPLIFIERS
from baselines.catalog import CATALOG
from baselines.methods.chosen import DensityConstants
from harness.plan.run_plan import Plan
from harness.plan.schedule import Budget
from harness.records.json_record import as_promised, load_json
from harness.studies.choices.arms import Arm, CellTask, means_of, trained_cells
from harness.studies.choices.sweep import SEED
from scenes.files.errors import InputError
from scenes.files.json_object import JsonObject

UNITS = (1.0, 3.0, 10.0, 25.0, 100.0, 250.0, 1000.0)
"""The units of density that are tried, per half of the longest side of the scene's box."""
FOGS = (0.3, 3.0, 12.5)
"""The densities of a fresh field that are tried, per the same length."""
STARTS = (None, *FOGS)
READINGS: dict[str, tuple[float | None, ...]] = {
    "nerf": STARTS,
    "nerf_matched": STARTS,
    "qnerf": (None,),
    "qnerf_shifted": FOGS,
    "qnerf_theorem": STARTS,
    "qnerf_running_mean": STARTS,
    "qnerf_running_mean_listing2": STARTS,
}
"""Method → the starts that are tried: Listing 2 as printed has no start, and is another method with one."""
SHARE = 4
"""Every pair is first trained for 1 / SHARE of the plan's steps."""
STARTS_KEPT, MORE_KEPT = 3, 1
"""Per method, the starts whose best unit is then trained for all steps, and the number of other pairs."""
RULE = (
    f"Every pair is trained for 1 / {SHARE} of the steps, and ranked by the mean over scenes of PSNR on validation "
    f"views. The best unit of each of the {STARTS_KEPT} best starts of a method and the {MORE_KEPT} best of its other "
    "pairs are then trained for all steps, and the best mean of these is chosen: a start can help early and cost late, "
    "while units that share a start hardly differ. A pair that diverges on a scene is out. Pairs whose start a bounded "
    "method cannot have (start ≥ unit) are not tried."
)

CARRIED = (
    "The best pairs of each method in a search with fewer steps are trained for all steps, as many of each method, and "
    "the best mean over scenes of PSNR on validation views is chosen. A pair that diverges on a scene is out."
)


@dataclass(frozen=True)
class ConstantsRow:
    method: str
    constants: DensityConstants
    scene: str
    steps: int
    psnr_val: float | None
    """The mean PSNR on the validation views after all `steps`; None if training diverged."""
    core_seconds: float


def pairs_of(method: str) -> list[DensityConstants]:
    parts = CATALOG[method].parts
    assert parts is not None
    bounded = AMPLIFIERS[parts.amplifier](None).bounded
    return [
        DensityConstants(unit, start)
        for unit in UNITS
        for start in READINGS[method]
        if start is None or not bounded or start < unit
    ]


Pairs = dict[str, list[DensityConstants]]
"""Method → pairs of constants, the best first."""


def search(
    plan: Plan,
    folders: dict[str, Path],
    scratch: Path,
    workers: int,
    device: str,
    finished: list[ConstantsRow],
    carried: Pairs | None = None,
) -> Iterator[list[ConstantsRow]]:
    """Train every pair of every method of `plan` on every scene, then the finalists for the full budget. Yield the rows
    of one scene, method and start at a time; rows that are `finished` are not trained again. Decoded images go to
    `scratch`. With pairs `carried` over from a shorter search there is no first round.

    Raises `InputError` for a view set without validation views.
    """
    known = {(row.method, row.constants, row.scene, row.steps): row for row in finished}

    def trained(steps: int, pairs: Pairs) -> Iterator[list[ConstantsRow]]:
        budgeted = replace(plan, budget=Budget(steps, None))
        tasks = []
        for scene, (method, some) in product(folders, pairs.items()):
            yield [known[key] for pair in some if (key := (method, pair, scene, steps)) in known]
            missing = [pair for pair in some if (method, pair, scene, steps) not in known]
            own = plan.own_settings([method])[method]
            for start in dict.fromkeys(pair.start for pair in missing):
                arms = {str(pair): Arm(own=replace(own, **pair.fields)) for pair in missing if pair.start == start}
                tasks.append(CellTask(scene, method, SEED, folders[scene], scratch, budgeted, arms, device, "val"))
        for cell in trained_cells(tasks, workers):
            yield [
                ConstantsRow(cell.method, pair, cell.scene, steps, ended.psnr, ended.core_seconds)
                for pair in pairs[cell.method]
                if (ended := cell.ended.get(str(pair)))
            ]

    assert plan.budget.steps is not None
    if carried is not None:
        yield from trained(plan.budget.steps, carried)
        return
    rows = []
    for some in trained(max(1, plan.budget.steps // SHARE), {method: pairs_of(method) for method in plan.methods}):
        rows += some
        yield some
    yield from trained(plan.budget.steps, {method: finalists(rows, method) for method in plan.methods})


def means(rows: list[ConstantsRow], method: str) -> dict[DensityConstants, float]:
    """Map the pairs of a method that have a score on every scene → mean PSNR over scenes, the best first."""
    averaged = means_of((row.constants, row.psnr_val) for row in rows if row.method == method)
    return {pair: mean for pair, mean in averaged.items() if mean is not None}


def finalists(rows: list[ConstantsRow], method: str) -> list[DensityConstants]:
    pairs = list(means(rows, method))
    rank = {pair: sum(pair.start == better.start for better in pairs[:place]) for place, pair in enumerate(pairs)}
    kept = sorted(pairs, key=rank.__getitem__)[:STARTS_KEPT]
    return kept + [pair for pair in pairs if pair not in kept][:MORE_KEPT]


def best_of(rows: list[ConstantsRow], methods: Sequence[str], many: int) -> Pairs:
    """Return the `many` best pairs after the longest training. Raises `InputError` for a method without a pair."""
    steps = max((row.steps for row in rows), default=0)
    longest = [row for row in rows if row.steps == steps]
    pairs = {method: list(means(longest, method))[:many] for method in methods}
    if lacking := [method for method, best in pairs.items() if not best]:
        raise InputError(f"{lacking[0]} has no pair that ended well in the shorter search; leave the method out")
    return pairs


def chosen(rows: list[ConstantsRow], steps: int, carried: Pairs | None = None) -> dict[str, DensityConstants]:
    """Map method → its best pair of those trained for all `steps`; none if all diverged or the search is unfinished."""
    first, second = ([row for row in rows if (row.steps == steps) is last] for last in (False, True))
    choice = {}
    for method in dict.fromkeys(row.method for row in rows):
        pairs = finalists(first, method) if carried is None else carried.get(method, [])
        trained = {(row.constants, row.scene) for row in second if row.method == method}
        if trained != set(product(pairs, {row.scene for row in rows})):
            return {}
        choice[method] = list(means(second, method))[:1]
    return {method: best[0] for method, best in choice.items() if best}


def settings_of(plan: Plan) -> JsonObject:
    """Return the settings of a search, as JSON: those of its plan without the constants that it chooses."""
    settings: JsonObject = json.loads(json.dumps(plan.settings()))
    for own in settings["train"]["own"].values():
        for name in DensityConstants(1.0, None).fields:
            del own[name]
    return settings


def as_json(
    rows: list[ConstantsRow], plan: Plan, provenance: dict[str, object], carried: Pairs | None = None
) -> JsonObject:
    choice = chosen(rows, plan.budget.steps or 0, carried)
    return {
        "what": "unit of density and start of the field of each method, on validation views",
        "rule": RULE if carried is None else CARRIED,
        "seed": SEED,
        "provenance": provenance,
        "settings": settings_of(plan),
        "rows": [asdict(row) for row in rows],
        "chosen": {method: asdict(pair) for method, pair in choice.items()},
    }


def read_rows(file: Path, plan: Plan | None = None) -> list[ConstantsRow]:
    """Return the rows of a search's record. With a `plan` the search is to be resumed: the settings must be the same,
    and without a record there are no rows.

    Raises `InputError` for a record that cannot be read, and for other settings.
    """
    if plan is not None and not file.exists():
        return []
    try:
        record = load_json(file)
        rows = as_promised(record["rows"], list[ConstantsRow])
        settings = record["settings"]
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise InputError(f"{file}: not a record of a search ({error}); remove it, or name another file") from error
    if plan is not None and settings != settings_of(plan):
        raise InputError(f"{file}: was made with other settings; use the same options, or name another --out")
    return rows
