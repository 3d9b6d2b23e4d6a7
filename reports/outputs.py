"""Several outputs side by side: each against the first, cell by cell, judged by what judges one method against another.

Cells are paired by scene, method and seed. A scene whose ground truth is not the same in both is shown and not judged,
and so are training times of unlike machines.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from harness.comparisons import METRICS, PRIMARY, Budget, Judgement, differences, family_of, judged
from harness.records import CellRecord
from reports.load import Records
from reports.shell import flat

EVERYWHERE = "all"
FIRST, OTHER = "first", "other"
SAME_CLOCK = ("processor", "cores", "threads", "device")
"""What two runs must share before their seconds are compared."""


@dataclass(frozen=True)
class Output:
    """A run under the name that tells it from the others, and a letter for the heads of columns."""

    letter: str
    name: str
    records: Records


@dataclass(frozen=True)
class Row:
    """`other` − `first` in one metric of one method."""

    scene: str
    """A scene's name, or `all`: those with the same ground truth in both."""
    method: str
    metric: str
    budget: Budget
    found: Judgement


@dataclass(frozen=True)
class Against:
    """An output beside the first one."""

    other: Output
    identical: int
    """Cells with every score and every weight count the same to the last bit."""
    shared: int
    """Cells that both have."""
    alone: list[str]
    """Cells that only one of them has, in words."""
    unlike: dict[str, str]
    """Scene → why its scores are of another question: another ground truth."""
    same_clock: bool
    rows: list[Row] = field(default_factory=list)

    def row(self, scene: str, method: str, metric: str = PRIMARY, budget: Budget = "steps") -> Row | None:
        wanted = (scene, method, metric, budget)
        return next((one for one in self.rows if (one.scene, one.method, one.metric, one.budget) == wanted), None)


def named(found: list[Records]) -> list[Output]:
    """Each by the shortest end of its path that none of the others has."""
    paths = [records.out.resolve() for records in found]
    return [
        Output(chr(ord("A") + place) if place < 26 else str(place + 1), _name(path, paths), records)
        for place, (path, records) in enumerate(zip(paths, found, strict=True))
    ]


def _name(path: Path, paths: list[Path]) -> str:
    for many in range(1, len(path.parts)):
        if sum(other.parts[-many:] == path.parts[-many:] for other in paths) == 1:
            return "/".join(path.parts[-many:])
    return str(path)


def against(first: Output, other: Output) -> Against:
    """What `other` changes of `first`: only scenes, methods and seeds that both have can be compared."""
    ours, theirs = ({(c.scene, c.method, c.seed): c for c in one.records.cells} for one in (first, other))
    both = [key for key in ours if key in theirs]
    unlike = {
        scene: why
        for scene in dict.fromkeys(scene for scene, _, _ in both)
        if (why := other_truth(*(next(c for key, c in cells.items() if key[0] == scene) for cells in (ours, theirs))))
    }
    same_clock = all(
        first.records.run.provenance.get(key) == other.records.run.provenance.get(key) for key in SAME_CLOCK
    )
    alone = [f"{scene} · {method} · seed {seed} in {first.name} alone" for scene, method, seed in ours.keys() - both]
    alone += [f"{scene} · {method} · seed {seed} in {other.name} alone" for scene, method, seed in theirs.keys() - both]
    return Against(
        other=other,
        identical=sum(same_results(ours[key], theirs[key]) for key in both),
        shared=len(both),
        alone=sorted(alone),
        unlike=unlike,
        same_clock=same_clock,
        rows=_rows([ours[key] for key in both], [theirs[key] for key in both], set(unlike), same_clock),
    )


def same_results(one: CellRecord, other: CellRecord) -> bool:
    """Whether two cells came to the same numbers: status, steps, scores, curve but for its clock, scores by view."""

    def results(cell: CellRecord) -> tuple[Any, ...]:
        curve = [(point.step, point.network_evaluations, point.psnr, point.rmse_linear) for point in cell.curve]
        return cell.status, cell.steps, cell.scores, curve, cell.views

    return results(one) == results(other)


def other_truth(one: CellRecord, other: CellRecord) -> str:
    """Why two cells were not scored against the same images; nothing where they were."""
    facts = [cell.settings.get("view_set") or {} for cell in (one, other)]
    unequal = [key for key in ("width", "height", "test", "digest") if facts[0].get(key) != facts[1].get(key)]
    if not unequal:
        return ""
    key = unequal[0]
    if key == "digest":
        return "other images of the same size"
    words = {"width": "px wide", "height": "px high", "test": "test views"}[key]
    return f"{facts[0].get(key)} against {facts[1].get(key)} {words}"


def _rows(ours: list[CellRecord], theirs: list[CellRecord], unlike: set[str], same_clock: bool) -> list[Row]:
    scenes = list(dict.fromkeys(cell.scene for cell in ours))
    rows = []
    for method in dict.fromkeys(cell.method for cell in ours):
        keyed = {
            (cell.scene, side, cell.seed): cell
            for side, cells in ((FIRST, ours), (OTHER, theirs))
            for cell in cells
            if cell.method == method
        }
        seeds = sorted({seed for _, _, seed in keyed})
        like = [scene for scene in scenes if scene not in unlike and any(key[0] == scene for key in keyed)]
        common = np.array([all((scene, FIRST, seed) in keyed for scene in like) for seed in seeds])
        for metric, about in METRICS.items():
            budgets: tuple[Budget, ...] = ("steps", "seconds") if about.along_training and same_clock else ("steps",)
            for budget in budgets:
                table = differences(keyed, like, seeds, OTHER, FIRST, metric, budget)
                # a seed that a scene has in neither run is not a pair that was lost
                own = {
                    scene: values[[(scene, FIRST, seed) in keyed for seed in seeds]] for scene, values in table.items()
                }
                for scene in own:
                    family = family_of(metric, scene, len(like))
                    rows.append(Row(scene, method, metric, budget, judged(own, metric, family, scene)))
                if len(like) > 1 and common.any():
                    family = family_of(metric, EVERYWHERE, len(like))
                    shared = {scene: values[common] for scene, values in table.items()}
                    rows.append(Row(EVERYWHERE, method, metric, budget, judged(shared, metric, family)))
    return rows


def unequal_facts(outputs: list[Output], part: str) -> list[tuple[str, list[str]]]:
    """Settings (`settings`) or origins (`provenance`) that are not the same in all outputs: name, value in each."""
    found = [dict(flat(getattr(one.records.run, part))) for one in outputs]
    names = dict.fromkeys(name for facts in found for name in facts)
    rows = [(name, [facts.get(name, "–") for facts in found]) for name in names]
    return [(name, values) for name, values in rows if len(set(values)) > 1]
